"""Paths in a picture that share an edge between two cells, each in a lane of its own."""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from uav_collect.kernels.arrays import Floats

_LANE_SHARE = 0.13  # of a cell, between two lanes
_LANES_SHARE = 0.6  # of a cell, at most, for all lanes of an edge
_JOG_SHARE = 0.1  # of a cell, before and after its centre, where a way changes its lane

_Edge = tuple[float, ...]  # the centres of two neighbouring cells: east and north of each


def steps(place_m: Floats) -> Iterator[tuple[Floats, Floats]]:
    """The moves between the places where a UAV decided, shape (T, 2): from where to where."""
    for here_m, there_m in pairwise(place_m):
        if (here_m != there_m).any():
            yield here_m, there_m


def lane_shifts(ways_m: Sequence[Floats]) -> list[list[float]]:
    """How far each step of each way is shifted [cells]: north if it runs east or west, else east.

    Args:
        ways_m: one per UAV, the places where it decided [m], shape (T, 2).
    """
    n_lanes = _lane_counts(ways_m)
    taken: Counter[_Edge] = Counter()
    shifts: list[list[float]] = []
    for way_m in ways_m:
        shifts.append([])
        for step in steps(way_m):
            edge = _edge(*step)
            lane = taken[edge] - (n_lanes[edge] - 1) / 2
            shifts[-1].append(lane * _lane_width(n_lanes[edge]))
            taken[edge] += 1
    return shifts


def narrowest_lane(ways_m: Sequence[Floats]) -> float:
    """The least distance between two lanes [cells]."""
    return _lane_width(max(_lane_counts(ways_m).values(), default=1))


def _lane_counts(ways_m: Sequence[Floats]) -> Counter[_Edge]:
    return Counter(_edge(*step) for way_m in ways_m for step in steps(way_m))


def _lane_width(n_lanes: int) -> float:
    return min(_LANE_SHARE, _LANES_SHARE / n_lanes)


def _edge(here_m: Floats, there_m: Floats) -> _Edge:
    low, high = sorted([tuple(here_m.tolist()), tuple(there_m.tolist())])
    return (*low, *high)


def corners_m(way_m: Floats, shifts: Sequence[float], cell_size_m: float) -> Floats:
    """The corners of a way in its lanes [m], shape (K, 2)."""
    if not shifts:
        return way_m[:1]
    moves = list(steps(way_m))
    heads = [(there_m - here_m) / cell_size_m for here_m, there_m in moves]
    sides = [shift * np.abs(head[::-1]) for head, shift in zip(heads, shifts, strict=True)]
    corners = [moves[0][0] + sides[0] * cell_size_m]
    for index in range(1, len(moves)):
        joint = _corners_in_cell(heads[index - 1], sides[index - 1], heads[index], sides[index])
        corners += [moves[index][0] + shift * cell_size_m for shift in joint]
    corners.append(moves[-1][1] + sides[-1] * cell_size_m)
    return np.array(corners)


def _corners_in_cell(
    head_in: Floats, side_in: Floats, head_out: Floats, side_out: Floats
) -> list[Floats]:
    """The corners of a way within one cell, in cells from its centre."""
    if head_in @ head_out == 0:  # a turn: both lanes meet in one corner
        return [side_in + side_out]
    if (head_in != head_out).any() or (side_in == side_out).all():  # straight back, or straight on
        return [side_in, side_out]
    return [side_in - _JOG_SHARE * head_in, side_out + _JOG_SHARE * head_out]

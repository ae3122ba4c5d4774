"""Makes a closed tour shorter: by turning pieces of it round, and by moving short ones elsewhere.

Source: Croes, "A Method for Solving Traveling-Salesman Problems", Operations Research 6 (6), 1958;
Or, "Traveling Salesman-Type Combinatorial Problems", thesis, Northwestern University, 1976.
"""

from collections.abc import Iterator

import numpy as np
from uav_collect.kernels.arrays import Ints

_N_NEAR = 10  # points that a point may be joined to: those nearest to it
_LONGEST_PIECE = 3  # points that are moved at once
_MAX_CHANGES = 4000  # of a tour: more than one of 1000 points that begins well takes


def shortened(way: Ints) -> list[int]:
    """The order of a closed tour through all points that no such change makes shorter.

    Args:
        way: between any two points, (N, N), symmetric; the tour that is made shorter comes to them
            in their order.

    Returns:
        The points by index; the tour begins at the first one.
    """
    tour = _Tour(way)
    waiting, n_changes = list(range(len(way))), 0
    while waiting and n_changes < _MAX_CHANGES and len(way) > 3:
        point = waiting.pop()
        if ends := tour.turn(point) or tour.move(point):
            waiting.extend(ends)
            n_changes += 1
    start = tour.points.index(0)
    return tour.points[start:] + tour.points[:start]


class _Tour:
    """A closed tour that changes where that makes it shorter, and says at which points it did."""

    def __init__(self, way: Ints) -> None:
        self._way: list[list[int]] = way.tolist()
        near = np.argsort(way, axis=1, kind='stable')[:, : _N_NEAR + 1].tolist()
        self._near = [[each for each in row if each != point] for point, row in enumerate(near)]
        self.points = list(range(len(way)))
        self._place = list(range(len(way)))

    def turn(self, point: int) -> tuple[int, ...]:
        """Turn a piece that begins or ends next to a point round."""
        points, place, way = self.points, self._place, self._way
        for step in (1, -1):
            beside = points[(place[point] + step) % len(points)]
            old = way[point][beside]
            for near in self._near[point]:
                if way[point][near] >= old:
                    break
                other = points[(place[near] + step) % len(points)]
                if way[point][near] + way[beside][other] < old + way[near][other]:
                    ends = (beside, near) if step == 1 else (near, beside)
                    self._reverse(place[ends[0]], place[ends[1]])
                    return *self._near[point], point, beside, near, other
        return ()

    def move(self, point: int) -> tuple[int, ...]:
        """Move a short piece that begins or ends at a point to between two other points."""
        points, place, way = self.points, self._place, self._way
        for piece in self._pieces(point):
            # The piece as it stands between its neighbours, its far end next to `after`.
            first, last = (place[piece[0]], place[piece[-1]])
            step = 1 if points[(first + 1) % len(points)] in piece[1:2] or len(piece) == 1 else -1
            before, after = (
                points[(first - step) % len(points)],
                points[(last + step) % len(points)],
            )
            saved = way[before][point] + way[piece[-1]][after] - way[before][after]
            for near in self._near[point]:
                if near in piece:
                    continue
                for side in (1, -1):
                    other = points[(place[near] + side) % len(points)]
                    if other in piece:
                        continue
                    longer = way[near][point] + way[piece[-1]][other] - way[near][other]
                    if longer < saved:
                        self._put(piece, near, side)
                        ends = (before, after, near, other, piece[-1], point)
                        return *self._near[point], *self._near[piece[-1]], *ends
        return ()

    def _pieces(self, point: int) -> Iterator[list[int]]:
        """The short pieces that begin at a point, in both directions."""
        at, n_points = self._place[point], len(self.points)
        for size in range(1, min(_LONGEST_PIECE, n_points - 3) + 1):
            yield [self.points[(at + index) % n_points] for index in range(size)]
            if size > 1:
                yield [self.points[(at - index) % n_points] for index in range(size)]

    def _reverse(self, first: int, last: int) -> None:
        """Turn the points from a place to another one round; the same as to turn all others."""
        if first > last:
            first, last = last + 1, first - 1
        self.points[first : last + 1] = self.points[first : last + 1][::-1]
        for place in range(first, last + 1):
            self._place[self.points[place]] = place

    def _put(self, piece: list[int], near: int, side: int) -> None:
        """Put a piece beside a point: its beginning next to that, on the side of the next one."""
        rest = [point for point in self.points if point not in piece]
        at = rest.index(near)
        self.points = (
            rest[: at + 1] + piece + rest[at + 1 :]
            if side == 1
            else (rest[:at] + piece[::-1] + rest[at:])
        )
        for place, point in enumerate(self.points):
            self._place[point] = place

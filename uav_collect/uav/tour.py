"""A tour through the cells of an area that need a visit, and an order of them.

Both depend on the briefing alone, so all UAVs of a fleet find the same before they take off.
"""

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from uav_collect.uav.actions import start_cells
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.open_ways import OpenCells
from uav_collect.uav.shortening import shortened

NOWHERE = -1  # the place of a cell that needs no visit

_LANE_WIDTH = 3  # columns that one flight along a lane's middle sees
_MAX_STOPS = 1000  # of a tour that is made shorter once it is found
_EXPECTED_SHARE = 0.6  # of the cells that hold data: from there on all are come to


class TourKind(Enum):
    """How a tour serves the cells that need a visit."""

    LANES = 1  # it goes up and down lanes, and sees them
    LOOKOUTS = 2  # it sees them
    CELLS = 3  # it comes to them


class Area(NamedTuple):
    """What tours depend on."""

    n_rows: int
    n_columns: int
    is_open: tuple[int, ...]  # (C,)
    is_needed: tuple[int, ...]  # (C,) of the open cells those that need a visit
    data_share: float  # of these, that is expected to hold data; 0: nobody knows
    first: int  # cell where the first UAV starts
    is_right: bool  # its home is in the eastern half of the area
    is_low: bool  # in the southern half


class Tour(NamedTuple):
    """A closed tour: its beginning follows its end."""

    place: list[int]  # (C,) of each cell that needs a visit, in moves from its beginning; NOWHERE
    stop: list[int]  # (n_places,) a cell at each place
    kind: TourKind


def area_of(briefing: Briefing) -> Area:
    """What tours through the area of a briefing depend on."""
    return Area(
        n_rows=briefing.n_rows,
        n_columns=briefing.n_columns,
        is_open=tuple(int(is_open) for is_open in briefing.is_open),
        is_needed=tuple(1 - int(is_known) for is_known in briefing.known_complete),
        data_share=briefing.data_share,
        first=start_cells(briefing)[0],
        is_right=2.0 * briefing.home_x_m[0] > briefing.n_columns * briefing.cell_size_m,
        is_low=2.0 * briefing.home_y_m[0] <= briefing.n_rows * briefing.cell_size_m,
    )


def order_of(area: Area) -> list[int]:
    """The cells that need a visit, from the south-western one on, each the nearest to that before.

    Where all do and none is closed, that is up one column and down the next.
    """
    grid, needed = OpenCells(area.n_rows, area.n_columns, area.is_open), _needed(area)
    if not needed:
        return []
    return grid.nearest_first(needed, min(needed, key=grid.column_first))


def tour_of(area: Area) -> Tour:
    """A short tour through the cells that need a visit.

    It comes to all of them if most hold data, as far as that is known. Else it comes so near that
    they are seen: up and down the lanes of an area that needs visits everywhere.
    """
    if all(area.is_needed) and area.data_share < _EXPECTED_SHARE:
        return _lanes(area)
    # Most may be seen from an open cell that no way leads to: nobody looks from there.
    grid = OpenCells(area.n_rows, area.n_columns, area.is_open).reached_from(area.first)
    needed = [cell for cell in _needed(area) if grid.is_open[cell]]
    if area.data_share >= _EXPECTED_SHARE:
        return Tour(*_around(grid, needed, area.first), TourKind.CELLS)
    place, stop = _around(grid, _lookouts(grid, needed), area.first)
    return Tour(_places_seen(grid, needed, place), stop, TourKind.LOOKOUTS)


def _needed(area: Area) -> list[int]:
    return [cell for cell, is_needed in enumerate(area.is_needed) if is_needed]


def _lanes(area: Area) -> Tour:
    """An open area's tour: up one lane of cells and down the next; a place is a row of a lane.

    The lanes are even in number, so that it ends on the side where it began, the one of the first
    UAV's home, and at most as wide as a UAV sees.
    """
    n_rows, n_columns = area.n_rows, area.n_columns
    n_lanes = 2 * ((n_columns + 2 * _LANE_WIDTH - 1) // (2 * _LANE_WIDTH))
    place, stop = [NOWHERE] * (n_rows * n_columns), [0] * (n_lanes * n_rows)
    middles = [(2 * lane + 1) * n_columns // (2 * n_lanes) for lane in range(n_lanes)]
    for column in range(n_columns):
        across = n_columns - 1 - column if area.is_right else column
        lane = ((across + 1) * n_lanes - 1) // n_columns
        is_up = (lane % 2 == 0) == area.is_low
        for row in range(n_rows):
            cell = row * n_columns + column
            place[cell] = lane * n_rows + (row if is_up else n_rows - 1 - row)
            if across == middles[lane]:
                stop[place[cell]] = cell
    return Tour(place, stop, TourKind.LANES)


def _lookouts(grid: OpenCells, needed: Sequence[int]) -> list[int]:
    """Open cells from which all cells that need a visit are seen, few of them.

    The western- and southernmost cell that is not seen yet is seen from where most others are.
    """
    unseen, lookouts = set(needed), list[int]()
    for cell in sorted(needed, key=grid.column_first):
        if cell in unseen:
            lookout = max(
                grid.region(cell), key=lambda each: len(unseen.intersection(grid.region(each)))
            )
            unseen.difference_update(grid.region(lookout))
            lookouts.append(lookout)
    return lookouts


def _around(grid: OpenCells, stops: Sequence[int], first: int) -> tuple[list[int], list[int]]:
    """A short tour from a cell through some stops and back; places, and a stop at each place.

    A place is a move of the tour, counted from its first stop.
    """
    order = grid.nearest_first(stops, first)
    if len(order) <= _MAX_STOPS:
        way = grid.moves_between([first, *order])
        order = [order[point - 1] for point in shortened(way)[1:]]
    place, at_place = [NOWHERE] * len(grid.is_open), list[int]()
    for cell in order:
        n_moves = grid.moves(at_place[-1], cell) if at_place else 1
        at_place.extend([cell] * n_moves)
        place[cell] = len(at_place) - 1
    return place, at_place


def _places_seen(grid: OpenCells, needed: Sequence[int], place: Sequence[int]) -> list[int]:
    """The place of each cell that needs a visit: the first one of a stop from where it is seen."""
    places = [NOWHERE] * len(place)
    for cell in needed:
        places[cell] = min(place[each] for each in grid.region(cell) if place[each] != NOWHERE)
    return places

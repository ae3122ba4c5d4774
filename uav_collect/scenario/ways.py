"""Ways around closed cells: home from everywhere, and where moves lead.

A way home is straight where it can be; else it turns at centres of open cells. It touches no
closed cell, their corners neither. The others are found from those outwards, the shortest first,
each cell by way of a neighbour or of the place where the neighbour's own way turns (Theta*): a
turn lies at a corner that is in the way, not at every cell.
"""

from collections.abc import Iterator
from functools import lru_cache
from heapq import heappop, heappush
import math
from typing import NamedTuple

from uav_collect.scenario.area import cell_of, open_cells
from uav_collect.scenario.model import AreaConfig, Point

HOME_ITSELF = -1  # as the next place of a way home
_TOUCH = 1e-6  # of a cell: as near to a border is on it
_INWARDS = 1e-5  # of the way to its cell's centre: so far a home is off all borders
_AROUND = ((-1, 0), (0, -1), (0, 1), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1))  # rows, columns
_N_MOVES = 4  # of them


class WaysHome(NamedTuple):
    """Ways home by cell, (C,)."""

    length_m: tuple[float, ...]  # from the cell's centre; 0 where no way leads
    via: tuple[int, ...]  # the cell to fly straight to, or HOME_ITSELF

    @property
    def has_turns(self) -> bool:
        """Whether one of them is not straight."""
        return any(cell != HOME_ITSELF for cell in self.via)


@lru_cache(maxsize=64)
def ways_home(area: AreaConfig, home_m: Point) -> WaysHome:
    """The ways from all cells to a home that lies in an open one."""
    grid, n_cells = _Grid(area), area.n_cells
    centre_m = [grid.centre_m(cell) for cell in range(n_cells)]
    (x_m, y_m), own_m = home_m, centre_m[cell_of(area, home_m)]
    inside_m = x_m + (own_m[0] - x_m) * _INWARDS, y_m + (own_m[1] - y_m) * _INWARDS
    # Nan: not known yet. What leads straight home is settled first: nothing is shorter.
    length_m = [
        _straight_m(centre_m[cell], home_m)
        if grid.is_open[cell] and grid.is_free(centre_m[cell], inside_m)
        else math.nan
        for cell in range(n_cells)
    ]
    via, waiting = [HOME_ITSELF] * n_cells, list[tuple[float, int, int]]()

    def look_on(cell: int) -> None:
        for near in grid.around(cell):
            if math.isnan(length_m[near]):
                for turn in {cell, via[cell]} - {HOME_ITSELF}:
                    longer_m = length_m[turn] + _straight_m(centre_m[near], centre_m[turn])
                    heappush(waiting, (longer_m, near, turn))

    for cell in range(n_cells):
        if not math.isnan(length_m[cell]):
            look_on(cell)
    while waiting:
        way_m, cell, turn = heappop(waiting)
        if math.isnan(length_m[cell]) and grid.is_free(centre_m[cell], centre_m[turn]):
            length_m[cell], via[cell] = way_m, turn
            look_on(cell)
    return WaysHome(tuple(0.0 if math.isnan(way_m) else way_m for way_m in length_m), tuple(via))


def reached_cells(area: AreaConfig, start: int) -> set[int]:
    """The open cells that moves lead to from one, itself among them."""
    grid, reached, waiting = _Grid(area), {start}, [start]
    while waiting:
        for near in grid.around(waiting.pop(), _N_MOVES):
            if near not in reached:
                reached.add(near)
                waiting.append(near)
    return reached


def _straight_m(from_m: Point, to_m: Point) -> float:
    # As `actions.home_duration_s` has it, to the last bit.
    east_m, north_m = to_m[0] - from_m[0], to_m[1] - from_m[1]
    return math.sqrt(east_m * east_m + north_m * north_m)


class _Grid:
    """The cells of an area, and what can be seen over the open ones."""

    def __init__(self, area: AreaConfig) -> None:
        self.is_open: list[int] = open_cells(area).tolist()
        self._n_rows, self._n_columns = area.n_rows, area.n_columns
        self._size_m = area.cell_size_m

    def centre_m(self, cell: int) -> Point:
        row, column = divmod(cell, self._n_columns)
        return (column + 0.5) * self._size_m, (row + 0.5) * self._size_m

    def around(self, cell: int, n_ways: int = len(_AROUND)) -> Iterator[int]:
        """The open cells about one; those that moves lead to come first."""
        row, column = divmod(cell, self._n_columns)
        for rows, columns in _AROUND[:n_ways]:
            near = (row + rows) * self._n_columns + column + columns
            if self._is_inside(row + rows, column + columns) and self.is_open[near]:
                yield near

    def is_free(self, from_m: Point, to_m: Point) -> bool:
        """Whether the straight way between two places inside cells touches no closed cell.

        It is looked at column by column, or row by row where it leads further that way.
        """
        ways = [abs(to_m[axis] - from_m[axis]) for axis in (0, 1)]
        along = 0 if ways[0] >= ways[1] else 1
        if ways[along] == 0.0:
            return True
        start, end = sorted(
            (place[along] / self._size_m, place[1 - along] / self._size_m)
            for place in (from_m, to_m)
        )
        slope = (end[1] - start[1]) / (end[0] - start[0])
        for strip in range(math.floor(start[0]), math.ceil(end[0])):
            ends = (
                start[1] + slope * (max(float(strip), start[0]) - start[0]),
                start[1] + slope * (min(strip + 1.0, end[0]) - start[0]),
            )
            low = math.floor(min(ends) - _TOUCH)
            high = math.floor(max(ends) + _TOUCH)
            for across in range(low, high + 1):
                row, column = (across, strip) if along == 0 else (strip, across)
                if self._is_closed(row, column):
                    return False
        return True

    def _is_inside(self, row: int, column: int) -> bool:
        return 0 <= row < self._n_rows and 0 <= column < self._n_columns

    def _is_closed(self, row: int, column: int) -> bool:
        is_inside = self._is_inside(row, column)
        return is_inside and not self.is_open[row * self._n_columns + column]

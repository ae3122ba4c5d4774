"""The cells of a field: where they lie, which are open, and which sensors no UAV can serve."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
import math

import numpy as np
from uav_collect.fields.ground import Ground
from uav_collect.kernels.arrays import Bools, Floats, Ints
from uav_collect.limits import MAX_CELLS_PER_SIDE
from uav_collect.scenario.area import are_inside, cell_of, cells_of, open_cells
from uav_collect.scenario.model import AreaConfig, Point, Polygon
from uav_collect.scenario.ways import reached_cells

# Where the field's west and south end lie in their cells: a zone or an edge may be near a line.
_OFFSETS = (0.0, 0.02, 0.15, 0.3, 0.5, 0.7, 0.85, 0.98)
_MANY_CORNERS = 500  # of polygons: with more, fewer places are tried
_MOST_CORNERS = 100_000  # of zones and edges of all grids that are tried: some 20 s
_DIGITS = 3  # millimetres
_SMALLEST_SHARE = 0.25  # of the wanted size, down to which sensors may make cells smaller
_STEP = 0.9  # from one size that is tried to the next
_NOWHERE = -1


@dataclass(frozen=True, kw_only=True)
class CellGrid:
    """Cells over a field."""

    ground: Ground
    corner_m: Point  # south-west, from the field's origin
    n_rows: int
    n_columns: int
    cell_size_m: float
    altitude_m: float

    @property
    def n_cells(self) -> int:
        """Number of cells, closed ones among them."""
        return self.n_rows * self.n_columns

    @cached_property
    def area(self) -> AreaConfig:
        """The cells as a scenario has them."""
        ground = self.ground
        boundary = ground.boundary_m
        return AreaConfig(
            rows=self.n_rows,
            columns=self.n_columns,
            cell_size_m=self.cell_size_m,
            altitude_m=self.altitude_m,
            boundary=None if boundary is None else self.from_corner(boundary),
            no_fly=tuple(map(self.from_corner, ground.no_fly_m)) or None,
        )

    @cached_property
    def position_m(self) -> Floats:
        """Sensors from the corner, (S, 2)."""
        return np.asarray(np.round(self.ground.position_m - np.array(self.corner_m), _DIGITS))

    @cached_property
    def sensor_cell(self) -> Ints:
        """The cell of each sensor, (S,)."""
        return cells_of(self.area, self.position_m)

    @cached_property
    def is_open(self) -> Bools:
        """Whether UAVs may fly over a cell, (C,)."""
        return np.asarray(open_cells(self.area) == 1)

    @cached_property
    def is_inside(self) -> Bools:
        """Whether a cell is of the area, be it under a no-fly zone or not, (C,)."""
        return np.asarray(open_cells(replace(self.area, no_fly=None)) == 1)

    @cached_property
    def part(self) -> Ints:
        """Which connected part of the open cells each is of, the largest is 0, (C,); -1: none."""
        return _parts(self.area)

    @cached_property
    def main_part(self) -> int:
        """The part that UAVs fly in: that of the base, or the one with most sensors."""
        if self.ground.base_m is not None:
            return int(self.part[self.base_cell])
        parts = self.part[self.sensor_cell]
        counts = np.bincount(parts[parts >= 0], minlength=1)
        return int(counts.argmax())

    @cached_property
    def base_cell(self) -> int:
        """Where UAVs start: as asked, else the southernmost cell near the field's middle line."""
        if self.ground.base_m is not None:
            return cell_of(self.area, self.from_corner((self.ground.base_m,))[0])
        rows, columns = np.divmod(np.flatnonzero(self.part == self.main_part), self.n_columns)
        middle = (float(self.position_m[:, 0].mean()) / self.cell_size_m) - 0.5
        best = np.lexsort((columns, np.abs(columns - middle), rows))[0]
        return int(rows[best] * self.n_columns + columns[best])

    @property
    def base_moved_m(self) -> float | None:
        """How far the middle of that cell is from the base that was asked for; None: none was."""
        if self.ground.base_m is None:
            return None
        return math.dist(self.from_corner((self.ground.base_m,))[0], self.centre_m(self.base_cell))

    @cached_property
    def unserved(self) -> Ints:
        """The sensors whose cell is closed or cannot be reached from the base."""
        if self.main_part == _NOWHERE:
            return np.arange(len(self.sensor_cell))
        return np.flatnonzero(self.part[self.sensor_cell] != self.main_part)

    @property
    def n_data_cells(self) -> int:
        """Number of cells with sensors."""
        return int(np.unique(self.sensor_cell).size)

    @property
    def corner_distance_m(self) -> float:
        """From the point below a hovering UAV to the corners of its cell."""
        return self.cell_size_m / math.sqrt(2)

    def from_corner(self, places_m: Polygon) -> Polygon:
        """Places from the corner instead of the field's origin."""
        east_m, north_m = self.corner_m
        return tuple(
            (round(x - east_m, _DIGITS), round(y - north_m, _DIGITS)) for x, y in places_m
        )

    def centre_m(self, cell: int) -> Point:
        """The middle of a cell, from the corner."""
        row, column = divmod(cell, self.n_columns)
        return (column + 0.5) * self.cell_size_m, (row + 0.5) * self.cell_size_m


def least_size_m(ground: Ground) -> float:
    """The smallest cells [m] of which a side of the area does not have too many."""
    (west, south), (east, north) = ground.extent_m
    return max(east - west, north - south) / (MAX_CELLS_PER_SIDE - 1)


def best_grid(
    ground: Ground,
    cell_size_m: float,
    altitude_m: float,
    *,
    is_fixed: bool,
    most_corners: int | None = None,
) -> CellGrid:
    """The cells that leave fewest sensors unserved, then those that need fewest hovers.

    Args:
        ground: the field.
        cell_size_m: wanted side of a cell [m].
        altitude_m: at which UAVs fly [m].
        is_fixed: whether cells must not be smaller than that.
        most_corners: of zones and edges of all grids that are tried while sensors stay unserved;
            None: as many as take some 20 s.

    Where some sensors stay unserved, it is not looked on for long whether they could be.
    """
    most_corners = _MOST_CORNERS if most_corners is None else most_corners
    best, n_corners = None, 0
    n_hopeless = int(under_zones(ground).sum())
    for size_m in _sizes_m(ground, cell_size_m, is_fixed=is_fixed):
        # Which cells are open takes longest: it is found out of those that would be taken first.
        for found in sorted(_grids(ground, size_m, altitude_m), key=_cost):
            if best is None or found.unserved.size < best.unserved.size:
                best = found
            if best.unserved.size == 0:
                return _trimmed(best)
            n_corners += _n_corners(ground)
            if best.unserved.size <= n_hopeless or n_corners >= most_corners:
                return best
    if best is None:
        raise RuntimeError('no size was tried')
    return best


def _trimmed(grid: CellGrid) -> CellGrid:
    """The cells without outer rows and columns in which none is open."""
    rows, columns = np.divmod(np.flatnonzero(grid.is_open), grid.n_columns)
    first_row, first_column = int(rows.min()), int(columns.min())
    east_m, north_m = grid.corner_m
    return replace(
        grid,
        corner_m=(
            round(east_m + first_column * grid.cell_size_m, _DIGITS),
            round(north_m + first_row * grid.cell_size_m, _DIGITS),
        ),
        n_rows=int(rows.max()) - first_row + 1,
        n_columns=int(columns.max()) - first_column + 1,
    )


def _sizes_m(ground: Ground, cell_size_m: float, *, is_fixed: bool) -> Iterator[float]:
    yield cell_size_m
    least_m = max(least_size_m(ground), _SMALLEST_SHARE * cell_size_m)
    while not is_fixed and (cell_size_m := smaller_size_m(cell_size_m)) >= least_m:
        yield cell_size_m


def rounded_size_m(size_m: float) -> float:
    """A size that people can remember, not above another one: two digits, or ..5 of three."""
    step_m = 10.0 ** math.floor(math.log10(size_m)) / 20
    return round(math.floor(size_m / step_m + 1e-9) * step_m, 6)


def smaller_size_m(size_m: float) -> float:
    """The size that is tried after another."""
    return rounded_size_m(_STEP * size_m)


def _grids(ground: Ground, size_m: float, altitude_m: float) -> Iterator[CellGrid]:
    """Grids of one size, each with its corner elsewhere within a cell."""
    (west, south), (east, north) = ground.extent_m
    offsets = _OFFSETS if _n_corners(ground) <= _MANY_CORNERS else _OFFSETS[::2]
    for across, up in product(offsets, offsets):
        left, low = west - across * size_m, south - up * size_m
        n_columns, n_rows = _n_cells(east - left, size_m), _n_cells(north - low, size_m)
        if max(n_columns, n_rows) <= MAX_CELLS_PER_SIDE:
            yield CellGrid(
                ground=ground,
                corner_m=(round(left, _DIGITS), round(low, _DIGITS)),
                n_rows=n_rows,
                n_columns=n_columns,
                cell_size_m=size_m,
                altitude_m=altitude_m,
            )


def under_zones(ground: Ground) -> Bools:
    """Which sensors lie within a no-fly zone, (S,): no cells make them served."""
    is_under = np.zeros(len(ground.position_m), dtype=np.bool_)
    for zone in ground.no_fly_m:
        is_under |= are_inside(zone, ground.position_m)
    return is_under


def _n_corners(ground: Ground) -> int:
    return sum(map(len, (*ground.no_fly_m, ground.boundary_m or ())))


def _n_cells(length_m: float, size_m: float) -> int:
    # The north and east edges belong to the last cells; a millimetre may be lost in rounding.
    return max(1, math.ceil((length_m + 10.0**-_DIGITS) / size_m))


def _cost(grid: CellGrid) -> tuple[float, ...]:
    """How dear the cells are if all of them are open: hovers, then cells, then distances."""
    rows, columns = np.divmod(grid.sensor_cell, grid.n_columns)
    centres_m = (np.column_stack([columns, rows]) + 0.5) * grid.cell_size_m
    away_m2 = float(((grid.position_m - centres_m) ** 2).sum())
    return grid.n_data_cells, grid.n_cells, away_m2


def _parts(area: AreaConfig) -> Ints:
    """The number of the connected part that each cell is in, (C,); the largest is 0."""
    is_open = open_cells(area) == 1
    if is_open.all():
        return np.zeros(is_open.size, dtype=np.int64)
    part = np.full(is_open.size, _NOWHERE)
    found: list[list[int]] = []
    for start in np.flatnonzero(is_open).tolist():
        if part[start] == _NOWHERE:
            found.append(sorted(reached_cells(area, start)))
            part[found[-1]] = 0
    for number, cells in enumerate(sorted(found, key=len, reverse=True)):
        part[cells] = number
    return part

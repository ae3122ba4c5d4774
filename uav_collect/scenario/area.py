"""Which cells of an area are open: within its boundary, and under no part of a no-fly zone.

Cells are numbered row by row from the south-west. A cell belongs to the area if its centre lies
within the boundary or on it; a zone closes every cell that it shares more than a border with.
Where a zone's edges cross each other, all that they run around is closed.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
from uav_collect.kernels.arrays import Bools, Floats, Ints
from uav_collect.scenario.model import AreaConfig, Point, Polygon, Scenario
from uav_collect.scenario.rounding import ROUNDING_M

NO_ZONE = -1
_ZONE_REACH = 0.5  # of the longer side of all else, as far as zones are shown beyond it
_RIM = 0.01  # of the longer side, about outlines

Box = tuple[float, float, float, float]  # west, south, east, north [m]


@lru_cache(maxsize=16)
def open_cells(area: AreaConfig) -> Ints:
    """1 for each cell that UAVs may fly over, 0 for each that is closed; (C,), not to be written.

    Where an area has neither boundary nor zones, all are open.
    """
    is_open = zone_over_cells(area) == NO_ZONE
    if area.boundary is not None:
        turns, is_on_border = _turns_about_centres(area, area.boundary)
        is_open &= ((turns % 2 == 1) | is_on_border).ravel()
    cells: Ints = is_open.astype(np.int64)
    cells.setflags(write=False)
    return cells


@lru_cache(maxsize=16)
def zone_over_cells(area: AreaConfig) -> Ints:
    """The first no-fly zone that closes each cell, NO_ZONE for those that none does; (C,)."""
    zones = np.full((area.n_rows, area.n_columns), NO_ZONE, dtype=np.int64)
    for index, zone in enumerate(area.no_fly or ()):
        zones[(zones == NO_ZONE) & _overlaps(area, zone)] = index
    cells = zones.ravel()
    cells.setflags(write=False)
    return cells


def shown_box_m(area: AreaConfig) -> Box:
    """What pictures of an area hold: all cells and all outlines, with a rim about those."""
    cells: Box = 0.0, 0.0, area.width_m, area.height_m
    outlines = outlines_box_m(area) or cells
    whole = _box_of([cells[:2], cells[2:], outlines[:2], outlines[2:]])
    if whole == cells:
        return cells
    rim_m = _RIM * _longer_side_m(whole)
    return whole[0] - rim_m, whole[1] - rim_m, whole[2] + rim_m, whole[3] + rim_m


def outlines_box_m(area: AreaConfig) -> Box | None:
    """The box about the boundary and the no-fly zones; None where an area has neither.

    A zone may reach over half a country; of it, what lies near the area is shown.
    """
    zones_m = [point for zone in area.no_fly or () for point in zone]
    corners_m = [*(area.boundary or ())]
    if not zones_m and not corners_m:
        return None
    west_m, south_m, east_m, north_m = near = _box_of(
        [(0.0, 0.0), (area.width_m, area.height_m), *corners_m]
    )
    reach_m = _ZONE_REACH * _longer_side_m(near)
    return _box_of(
        corners_m
        + [
            (
                min(max(x_m, west_m - reach_m), east_m + reach_m),
                min(max(y_m, south_m - reach_m), north_m + reach_m),
            )
            for x_m, y_m in zones_m
        ]
    )


def _box_of(points: Sequence[Sequence[float]]) -> Box:
    """The box about points (east, north) [m]."""
    easts_m, norths_m = zip(*points, strict=True)
    return min(easts_m), min(norths_m), max(easts_m), max(norths_m)


def _longer_side_m(box: Box) -> float:
    return max(box[2] - box[0], box[3] - box[1])


def mean_data_cells(scenario: Scenario) -> float:
    """How many cells hold data in a mission on average, if enough have sensors."""
    share, n_open = scenario.demand.cell_share, int(open_cells(scenario.area).sum())
    return float(n_open) if isinstance(share, str) else share * n_open


def cell_of(area: AreaConfig, place_m: Point) -> int:
    """The cell of a place, as `cells_of` has it."""
    return int(cells_of(area, np.array([place_m]))[0])


def cells_of(area: AreaConfig, places_m: Floats) -> Ints:
    """The cells of places (N, 2) [m], (N,); beyond the area, the nearest.

    A border belongs to the cell east or north of it, those of the area to its last cells.
    """
    last = area.n_columns - 1, area.n_rows - 1
    columns, rows = np.clip(places_m // area.cell_size_m, 0, last).astype(np.int64).T
    return np.asarray(rows * area.n_columns + columns)


def cell_centres_m(area: AreaConfig) -> Floats:
    """Where the cells' centres are [m], (C, 2)."""
    x_m = (np.arange(area.n_columns) + 0.5) * area.cell_size_m
    y_m = (np.arange(area.n_rows) + 0.5) * area.cell_size_m
    return np.stack([np.tile(x_m, area.n_rows), np.repeat(y_m, area.n_columns)], axis=1)


def are_inside(polygon: Polygon, places_m: Floats) -> Bools:
    """Which places (S, 2) [m] a polygon runs around, its border apart; (S,)."""
    turns = np.zeros(len(places_m), dtype=np.int64)
    is_on_border = np.zeros(len(places_m), dtype=np.bool_)
    for edge in _edges(polygon):
        turned, is_near = _turns(edge, places_m[:, 0], places_m[:, 1])
        turns += turned
        is_on_border |= is_near
    return np.asarray((turns != 0) & ~is_on_border)


def _turns_about_centres(area: AreaConfig, polygon: Polygon) -> tuple[Ints, Bools]:
    """How often a polygon runs around each cell's centre, and which lie on its border.

    Both are (n_rows, n_columns). Where edges do not cross, turns are 0, or 1 or -1 inside.
    """
    centres_m = cell_centres_m(area).reshape(area.n_rows, area.n_columns, 2)
    x_m, y_m = centres_m[:1, :, 0], centres_m[:, :1, 1]
    turns = np.zeros((area.n_rows, area.n_columns), dtype=np.int64)
    is_on_border = np.zeros((area.n_rows, area.n_columns), dtype=np.bool_)
    for start_m, end_m in _edges(polygon):
        rows = slice(*_span(start_m[1], end_m[1], area.cell_size_m, area.n_rows))
        turned, is_near = _turns((start_m, end_m), x_m, y_m[rows])
        turns[rows] += turned
        is_on_border[rows] |= is_near
    return turns, is_on_border


def _turns(edge: tuple[Point, Point], x_m: Floats, y_m: Floats) -> tuple[Ints, Bools]:
    """By how much an edge adds to the turns about places, and which of them lie on it."""
    (ax_m, ay_m), (bx_m, by_m) = edge
    east_m, north_m = bx_m - ax_m, by_m - ay_m
    # A ray to the east crosses an edge that has one end above it, and one not.
    crosses = (ay_m > y_m) != (by_m > y_m)
    aside_m2 = (x_m - ax_m) * north_m - (y_m - ay_m) * east_m
    is_east = crosses & ((aside_m2 < 0.0) == (north_m > 0.0))
    is_near = _distances_m(x_m - ax_m, y_m - ay_m, east_m, north_m) <= ROUNDING_M
    return np.where(is_east, 1 if north_m > 0.0 else -1, 0), is_near


def _distances_m(x_m: Floats, y_m: Floats, east_m: float, north_m: float) -> Floats:
    """How far points are from the straight line between the origin and another point [m]."""
    length2_m2 = east_m * east_m + north_m * north_m
    share = (x_m * east_m + y_m * north_m) / (length2_m2 or 1.0)  # of no length: 0
    along = np.clip(share, 0.0, 1.0)
    return np.hypot(x_m - along * east_m, y_m - along * north_m)


def _overlaps(area: AreaConfig, zone: Polygon) -> Bools:
    """The cells that a zone shares more than a border with, (n_rows, n_columns).

    An edge runs through the cell, or the cell lies in the zone as a whole, its centre too.
    """
    turns, is_on_border = _turns_about_centres(area, zone)
    touched = (turns != 0) | is_on_border
    size_m = area.cell_size_m
    for start_m, end_m in _edges(zone):
        columns = _span(start_m[0], end_m[0], size_m, area.n_columns)
        rows = _span(start_m[1], end_m[1], size_m, area.n_rows)
        first, last = _within(start_m[0], end_m[0], np.arange(*columns), size_m)
        second, then = _within(start_m[1], end_m[1], np.arange(*rows)[:, None], size_m)
        enters, leaves = np.maximum(first, second), np.minimum(last, then)
        touched[slice(*rows), slice(*columns)] |= enters < leaves
    return np.asarray(touched)


def _span(one_m: float, other_m: float, size_m: float, n_cells: int) -> tuple[int, int]:
    """The first column, or row, that an edge may run through, and one past the last."""
    low_m, high_m = sorted((one_m, other_m))
    first, last = int(np.floor(low_m / size_m)) - 1, int(np.floor(high_m / size_m)) + 2
    return max(0, min(first, n_cells)), max(0, min(last, n_cells))


def _within(start_m: float, end_m: float, strips: Ints, size_m: float) -> tuple[Floats, Floats]:
    """Between which shares of an edge it lies inside columns, or rows, their borders apart."""
    lows_m, highs_m = strips * size_m + ROUNDING_M, (strips + 1) * size_m - ROUNDING_M
    way_m = end_m - start_m
    if way_m == 0.0:
        is_inside = (lows_m < start_m) & (start_m < highs_m)
        return np.where(is_inside, 0.0, 1.0), np.where(is_inside, 1.0, 0.0)
    one, other = (lows_m - start_m) / way_m, (highs_m - start_m) / way_m
    return np.maximum(np.minimum(one, other), 0.0), np.minimum(np.maximum(one, other), 1.0)


def _edges(polygon: Polygon) -> Iterator[tuple[Point, Point]]:
    return pairwise([*polygon, polygon[0]])

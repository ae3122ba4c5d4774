"""Cells over a field: where they lie, and who cannot be served."""

from fields import ground, square
import numpy as np
import pytest
from uav_collect.fields import grid as grid_module
from uav_collect.fields.grid import best_grid, least_size_m, rounded_size_m
from uav_collect.kernels.arrays import Ints
from uav_collect.scenario.model import AreaConfig

TURNED = ((0.0, 0.0), (1000.0, 300.0), (700.0, 1300.0), (-300.0, 1000.0))  # [m], a square


@pytest.mark.parametrize(
    ('size_m', 'rounded_m'),
    [(197.9, 195.0), (195.0, 195.0), (175.5, 175.0), (99.9, 99.5), (47.0, 47.0), (1234.0, 1200.0)],
)
def test_a_size_is_rounded_down_to_one_that_people_remember(
    size_m: float, rounded_m: float
) -> None:
    assert rounded_size_m(size_m) == rounded_m


def test_a_pipeline_is_covered_by_one_row() -> None:
    # 51 sensors, 100 m apart and 40 m north and south of a line, as along a pipe.
    places = [(100.0 * n, 40.0 if n % 2 else -40.0) for n in range(51)]
    grid = best_grid(ground(*places), 200.0, 100.0, is_fixed=True)
    assert (grid.n_rows, grid.n_columns) == (1, 26)
    assert grid.n_data_cells == 26
    assert (grid.position_m >= 0).all()
    assert (grid.position_m <= [grid.area.width_m, grid.area.height_m]).all()


def test_the_corner_is_where_fewest_cells_hold_sensors() -> None:
    # Four sensors within 90 m, another 200 m east of them: two cells of 100 m do.
    places = [(0.0, 0.0), (90.0, 0.0), (0.0, 90.0), (90.0, 90.0), (290.0, 45.0)]
    grid = best_grid(ground(*places), 100.0, 100.0, is_fixed=True)
    assert grid.n_data_cells == 2


def test_one_sensor_has_one_cell() -> None:
    grid = best_grid(ground((3.0, 4.0)), 50.0, 100.0, is_fixed=True)
    assert (grid.n_rows, grid.n_columns, grid.base_cell) == (1, 1, 0)


def test_cells_beyond_the_edge_are_closed_and_sensors_at_it_are_served() -> None:
    # Posts at the corners of a field that is turned: smaller cells serve them all.
    grid = best_grid(ground(*TURNED, edge_m=TURNED), 195.0, 100.0, is_fixed=False)
    assert grid.unserved.size == 0
    assert grid.cell_size_m < 195.0
    assert not grid.is_open.all()


def test_a_field_that_may_be_flown_beyond_keeps_its_large_cells() -> None:
    wide = ground(*TURNED, edge_m=TURNED, widen_m=60.0)
    grid = best_grid(wide, 195.0, 100.0, is_fixed=False)
    assert (grid.unserved.size, grid.cell_size_m) == (0, 195.0)


def test_no_outer_row_or_column_is_closed_as_a_whole() -> None:
    # 8.2 cells from west to east and 5.3 from south to north: at an end there is no middle of one.
    edge = ((0.0, 0.0), (858.0, 0.0), (858.0, 556.0), (0.0, 556.0))
    field = ground((140.0, 110.0), (580.0, 330.0), edge_m=edge)
    grid = best_grid(field, 105.0, 100.0, is_fixed=True)
    assert grid.is_open.all()
    assert grid.unserved.size == 0


def test_cells_move_off_a_no_fly_zone_that_is_near_a_sensor() -> None:
    # The zone begins 10 m east of the sensor: a line between cells must run between them.
    field = ground((0.0, 0.0), (0.0, 300.0), no_fly_m=[square(10.0, -50.0, 100.0)])
    grid = best_grid(field, 90.0, 100.0, is_fixed=True)
    assert grid.unserved.size == 0


def test_a_sensor_within_a_no_fly_zone_is_not_served() -> None:
    field = ground((0.0, 0.0), (300.0, 0.0), no_fly_m=[square(-50.0, -50.0, 100.0)])
    grid = best_grid(field, 90.0, 100.0, is_fixed=False)
    assert grid.unserved.tolist() == [0]


def test_sensors_behind_a_wall_of_zones_are_not_served_from_where_most_are() -> None:
    # A wall from north to south, wider than a cell; two sensors west of it, one east.
    wall = ((150.0, -1000.0), (300.0, -1000.0), (300.0, 1000.0), (150.0, 1000.0))
    field = ground((0.0, 0.0), (0.0, 200.0), (500.0, 100.0), no_fly_m=[wall])
    grid = best_grid(field, 100.0, 100.0, is_fixed=True)
    assert grid.is_open[grid.sensor_cell].all()
    assert grid.unserved.tolist() == [2]


def test_a_base_that_is_asked_for_decides_from_which_side_sensors_are_served() -> None:
    wall = ((150.0, -1000.0), (300.0, -1000.0), (300.0, 1000.0), (150.0, 1000.0))
    field = ground((0.0, 0.0), (0.0, 200.0), (500.0, 100.0), no_fly_m=[wall], base_m=(520.0, 90.0))
    grid = best_grid(field, 100.0, 100.0, is_fixed=True)
    assert grid.unserved.tolist() == [0, 1]


def test_a_base_outside_of_the_sensors_has_a_cell() -> None:
    field = ground((0.0, 0.0), (100.0, 0.0), base_m=(-450.0, 300.0))
    grid = best_grid(field, 100.0, 100.0, is_fixed=True)
    x_m, y_m = grid.centre_m(grid.base_cell)
    assert abs(x_m + grid.corner_m[0] + 450.0) <= 50.0
    assert abs(y_m + grid.corner_m[1] - 300.0) <= 50.0


def test_the_base_is_in_the_southernmost_open_row_near_the_middle_of_the_sensors() -> None:
    places = [(x, y) for x in (0.0, 1000.0) for y in (0.0, 1000.0)]
    field = ground(*places, no_fly_m=[square(300.0, -200.0, 400.0)])
    grid = best_grid(field, 100.0, 100.0, is_fixed=True)
    row, column = divmod(grid.base_cell, grid.n_columns)
    assert row == 0
    assert grid.is_open[grid.base_cell]
    nearer = range(min(column, grid.n_columns - 1 - column) + 1, grid.n_columns // 2)
    assert not any(grid.is_open[each] for each in nearer)


def test_the_smallest_cells_make_no_area_of_too_many() -> None:
    rng = np.random.default_rng(0)
    field = ground(*map(tuple, rng.uniform(0.0, 20_000.0, (300, 2)).tolist()))
    grid = best_grid(field, least_size_m(field), 100.0, is_fixed=True)
    assert max(grid.n_rows, grid.n_columns) == 64


def test_thousands_of_sensors_have_their_cells() -> None:
    rng = np.random.default_rng(0)
    field = ground(*map(tuple, rng.uniform(0.0, 6000.0, (6000, 2)).tolist()))
    grid = best_grid(field, 195.0, 100.0, is_fixed=True)
    assert (grid.n_rows, grid.n_columns) == (31, 31)


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> set[AreaConfig]:
    """The areas of which it was found out which cells are open."""
    areas: set[AreaConfig] = set()

    def open_cells(area: AreaConfig) -> Ints:
        areas.add(area)
        return known(area)

    known = grid_module.open_cells
    monkeypatch.setattr(grid_module, 'open_cells', open_cells)
    return areas


def test_no_other_cells_are_tried_for_a_sensor_under_a_zone(tried: set[AreaConfig]) -> None:
    places_m = (10.0, 10.0), (500.0, 500.0), (300.0, 300.0)
    field = ground(*places_m, no_fly_m=[square(280.0, 280.0, 50.0)])
    assert best_grid(field, 100.0, 100.0, is_fixed=False).unserved.tolist() == [2]
    assert len(tried) == 1


def test_not_too_many_cells_are_tried_for_a_sensor_between_zones(
    tried: set[AreaConfig], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grid_module, '_MOST_CORNERS', 20)
    # The sensor has 0.2 m between two zones, of 8 corners together.
    zones = square(200.0, 250.0, 99.9), square(300.1, 250.0, 99.9)
    field = ground((10.0, 10.0), (500.0, 500.0), (300.0, 300.0), no_fly_m=zones)
    assert best_grid(field, 100.0, 100.0, is_fixed=False).unserved.tolist() == [2]
    assert len(tried) == 3

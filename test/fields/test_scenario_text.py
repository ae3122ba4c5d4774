"""The file of a field: what is proposed, read again, with a word to each value."""

from pathlib import Path

from fields import ground, proposed, square
import numpy as np
import pytest
from uav_collect.fields.proposal import Proposal
from uav_collect.fields.scenario_text import scenario_text
from uav_collect.scenario.area import open_cells
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site

PLACES = [(0.0, 0.0), (400.0, 20.0), (250.0, 610.0), (30.0, 590.0)]


def read_again(field: Proposal, folder: Path) -> tuple[str, Scenario]:
    """The text of a proposal, and the scenario that it is."""
    text = scenario_text(field, 'paper_10x10', 'loggers.csv', 'EPSG:25832, ETRS89')
    file = folder / 'loggers.yaml'
    file.write_text(text)
    return text, load(file)


def test_the_file_says_what_is_proposed(tmp_path: Path) -> None:
    field = proposed(
        ground(
            *PLACES,
            edge_m=square(-80.0, -80.0, 800.0),
            no_fly_m=[square(150.0, 150.0, 60.0), square(500.0, 400.0, 60.0)],
            origin_deg=(46.78, -117.08),
            data_mbit=[1.0, 2.5, 0.0, 4.0],
        ),
        n_uavs=3,
    )
    _, scenario = read_again(field, tmp_path)
    grid, area = field.grid, scenario.area
    assert (area.n_rows, area.n_columns) == (grid.n_rows, grid.n_columns)
    assert (area.boundary, area.no_fly) == (grid.area.boundary, grid.area.no_fly)
    assert (open_cells(area) == grid.is_open).all()
    site = build_site(scenario)
    order = [site.sensor_ids.index(name) for name in field.grid.ground.sensor_ids]
    assert (site.position_m[order] == grid.position_m).all()
    assert (site.cell[order] == grid.sensor_cell).all()
    assert site.data_bit[order].tolist() == [1.0e6, 2.5e6, 0.0, 4.0e6]
    assert [uav.start_m for uav in scenario.uavs] == [grid.centre_m(grid.base_cell)] * 3
    assert scenario.uavs[0].energy_budget_kj == pytest.approx(field.crafts[0].energy_budget_kj)
    assert scenario.uavs[0].speed_mps == field.crafts[0].speed_mps
    assert scenario.radio.contact_range_m == field.contact_range_m


def test_a_sensor_is_where_on_earth_its_list_has_it(tmp_path: Path) -> None:
    field = proposed(ground(*PLACES, origin_deg=(46.78, -117.08)))
    _, scenario = read_again(field, tmp_path)
    assert scenario.area.reference is not None
    x_m, y_m = field.grid.position_m[0].tolist()  # the origin of the list's plane
    assert scenario.area.reference.lat_lon_deg(x_m, y_m) == pytest.approx((46.78, -117.08))


def test_what_is_not_known_is_not_said(tmp_path: Path) -> None:
    text, scenario = read_again(proposed(ground(*PLACES)), tmp_path)
    assert scenario.area.reference is scenario.area.boundary is scenario.area.no_fly is None
    assert scenario.demand.data_mbit == (0.1, 1.0)
    assert 'data_mbit: [0.1, 1.0]' in text


@pytest.mark.parametrize(
    ('east_m', 'said'), [(0.0, 'as asked'), (30.0, 'where asked; its middle is 30 m off')]
)
def test_it_says_how_far_the_base_is_from_where_it_was_asked_for(
    east_m: float, said: str, tmp_path: Path
) -> None:
    at_m = proposed(ground(*PLACES)).grid.from_corner(((0.0, 0.0),))[0]
    cell_m = proposed(ground(*PLACES)).grid.centre_m(0)
    base_m = cell_m[0] - at_m[0] + east_m, cell_m[1] - at_m[1]
    text, _ = read_again(proposed(ground(*PLACES, base_m=base_m)), tmp_path)
    [line] = [it for it in text.splitlines() if it.lstrip().startswith('start:')]
    assert line.endswith(f'# [row, column], {said}')


def test_each_value_has_a_comment_and_no_line_is_long(tmp_path: Path) -> None:
    text, _ = read_again(proposed(ground(*PLACES, edge_m=square(-80.0, -80.0, 800.0))), tmp_path)
    assert max(map(len, text.splitlines())) <= 99
    head, _, _ = text.partition('sensors:\n')
    keys = ('altitude_m', 'cell_size_m', 'boundary', 'data_mbit', 'airframe', 'speed_mps', 'start')
    lines = head.splitlines()
    for key in keys:
        at = next(n for n, line in enumerate(lines) if line.lstrip(' -').startswith(f'{key}:'))
        assert '#' in lines[at] or lines[at - 1].lstrip().startswith('#'), key


@pytest.mark.parametrize(
    'name', ['Größe 1', 'a: b', '#3', '- x', '"', "it's", '{}', '0x1f', 'null']
)
def test_any_name_of_a_sensor_is_read_as_it_was_written(name: str, tmp_path: Path) -> None:
    field = ground(*PLACES)
    named = type(field)(**{**field.__dict__, 'sensor_ids': (name, 'b', 'c', 'd')})
    _, scenario = read_again(proposed(named), tmp_path)
    assert name in build_site(scenario).sensor_ids


def test_as_many_sensors_as_there_may_be_fit_into_a_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    places = map(tuple, rng.uniform(-2500.0, 2500.0, (20_000, 2)).tolist())
    _, scenario = read_again(proposed(ground(*places, origin_deg=(50.0, 8.0))), tmp_path)
    assert build_site(scenario).n_sensors == 20_000

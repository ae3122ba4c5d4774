"""Places that are where they should be, but for what rounding takes and gives."""

from pathlib import Path

import pytest
from tiny_world import tiny, uav
from uav_collect.errors import ConfigError
from uav_collect.scenario.load import from_yaml, load
from uav_collect.scenario.model import ListedSensors, Scenario

# 3 x 20.2 is 60.6, but 60.599999999999994 in floating point: less than people write.
SIDE_M, SIZE_M, N_CELLS = 60.6, 20.2, 3
LIST = 'sensor_id,x_m,y_m,data_mbit\na,0,0,1\nb,60.6,60.6,1\n'


def square(**uav_places: object) -> Scenario:
    places = {'start': {'cell': [0, 0]}, 'home': {'cell': [0, 0]}} | uav_places
    return tiny(
        {'speed_mps': 5.0, **places},
        sensors=[(SIDE_M, SIDE_M, 1.0)],
        area__cells_per_side=N_CELLS,
        area__cell_size_m=SIZE_M,
    )


def at(x_m: float, y_m: float) -> dict[str, object]:
    return {'position_m': [x_m, y_m]}


def test_the_side_of_such_an_area_is_less_than_people_write() -> None:
    assert N_CELLS * SIZE_M < SIDE_M


def test_a_start_is_at_a_centre_that_rounding_has_moved() -> None:
    scenario = tiny(
        uav() | {'start': at(30.15, 50.25), 'home': at(30.15, 50.25)},
        sensors=[(0.0, 0.0, 1.0)],
        area__cell_size_m=20.1,
    )
    assert scenario.uavs[0].start_m == (1.5 * 20.1, 2.5 * 20.1) != (30.15, 50.25)
    assert scenario.uavs[0].home_m == scenario.uavs[0].start_m
    assert from_yaml(scenario.to_yaml()) == scenario


@pytest.mark.parametrize('aside_m', [2e-6, -2e-6, 1e-3])
def test_a_start_that_is_off_by_more_is_refused(aside_m: float) -> None:
    with pytest.raises(ConfigError, match='must be the centre of a cell of the area'):
        square(start=at(0.5 * SIZE_M + aside_m, 0.5 * SIZE_M))


def test_homes_and_sensors_on_the_edge_are_in_the_area() -> None:
    scenario = square(home=at(SIDE_M, 0.0))
    width_m = scenario.area.width_m
    assert scenario.uavs[0].home_m == (width_m, 0.0)
    assert isinstance(scenario.sensors, ListedSensors)
    assert [(it.x_m, it.y_m) for it in scenario.sensors.entries] == [(width_m, width_m)]


def test_homes_and_sensors_beyond_the_edge_are_refused_with_all_their_digits() -> None:
    with pytest.raises(ConfigError, match=r'is \[60\.600002, 0\.0\]: must be from 0 to 60\.6 m'):
        square(home=at(60.600002, 0.0))
    with pytest.raises(ConfigError, match=r'x_m is 12800\.04: must be from 0 to 12800 m'):
        tiny(uav(), sensors=[(12800.04, 0.0, 1.0)], area__cell_size_m=3200.0)


@pytest.mark.parametrize('origin', ['auto', '[0, 0]'])
def test_a_list_as_wide_as_the_area_fits_into_it(tmp_path: Path, origin: str) -> None:
    (tmp_path / 'list.csv').write_text(LIST)
    (tmp_path / 'field.yaml').write_text(
        'extends: paper_10x10\n'
        f'area: {{cells_per_side: {N_CELLS}, cell_size_m: {SIZE_M}}}\n'
        f'sensors: {{kind: csv, file: list.csv, origin: {origin}}}\n'
        'demand: {cell_share: all, data_mbit: csv}\n'
        'fleet: {default: {start: {cell: [0, 0]}, home: {cell: [0, 0]}}}\n'
    )
    sensors = load(tmp_path / 'field.yaml').sensors
    assert isinstance(sensors, ListedSensors)
    assert [it.x_m for it in sensors.entries] == [0.0, N_CELLS * SIZE_M]

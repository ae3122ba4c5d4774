from dataclasses import FrozenInstanceError
import math
import os
from pathlib import Path
import sys

from hypothesis import given, settings
from hypothesis import strategies as st
from processes import completed
import pytest
from uav_collect.config import yaml_text
from uav_collect.physics.radio import reference_gain
from uav_collect.scenario.earth import east_north_m
from uav_collect.scenario.load import fingerprint, from_yaml, load, parse_override, scenario_names
from uav_collect.scenario.model import DrawnSensors, ListedSensors

FARM = """
extends: paper_10x10
sensors: {kind: csv, file: data/sensors.csv, origin: auto}
demand: {cell_share: all, data_mbit: csv}
"""
SENSORS = """sensor_id,easting_m,northing_m,note,data_mbit
007,493400,5180500,old,0.25
1e5,493700,5180700,,0.5
"""


def farm(folder: Path, *, sensors: str = SENSORS, scenario: str = FARM) -> str:
    (folder / 'data').mkdir(exist_ok=True)
    (folder / 'data' / 'sensors.csv').write_text(sensors)
    (folder / 'farm.yaml').write_text(scenario)
    return str(folder / 'farm.yaml')


def places(name: str) -> dict[str, tuple[float, float]]:
    sensors = load(name).sensors
    assert isinstance(sensors, ListedSensors)
    return {sensor.id: (sensor.x_m, sensor.y_m) for sensor in sensors.entries}


def printed_by(script: str) -> str:
    paths = [str(Path(__file__).parents[2]), os.environ.get('PYTHONPATH', '')]
    environment = os.environ | {'PYTHONHASHSEED': '7', 'PYTHONPATH': os.pathsep.join(paths)}
    return completed(sys.executable, '-c', script, env=environment).stdout


def test_the_default_scenario_holds_the_values_of_the_paper() -> None:
    scenario = load('paper_10x10')
    slow, fast = scenario.uavs
    assert (slow.speed_mps, fast.speed_mps) == (5.0, 10.0)
    assert slow.start_m == slow.home_m == (25.0, 25.0)
    assert slow.energy_budget_j == 1e6
    assert (scenario.area.width_m, scenario.area.height_m) == (500.0, 500.0)
    assert scenario.n_cells == 100
    assert scenario.bandwidth_hz == 0.5e6
    assert scenario.radio.tx_power_w == pytest.approx(0.01, rel=1e-15)
    assert scenario.radio.noise_w_per_hz == pytest.approx(1e-18, rel=1e-15)
    # (4 pi 2e9 / 299792458)^-2, by hand
    assert reference_gain(scenario.radio.carrier_hz) == pytest.approx(1.4228584e-4, rel=1e-7)
    # 0.5 x drag ratio x air density x solidity x disc, Zeng 2019
    drag = 0.5 * 0.6 * 1.225 * 0.05 * 0.503
    assert slow.propulsion.parasite_coefficient == pytest.approx(drag, rel=1e-12)


@pytest.mark.parametrize(
    ('name', 'cells_per_side'),
    [('paper_8x8', 8), ('paper_10x10', 10), ('paper_15x15', 15), ('paper_20x20', 20)],
)
def test_the_sizes_of_the_paper_differ_in_cells_and_topology_alone(
    name: str, cells_per_side: int
) -> None:
    scenario = load(name)
    assert scenario.area.cells_per_side == cells_per_side
    assert isinstance(scenario.sensors, DrawnSensors)
    overrides = {'area.cells_per_side': cells_per_side, 'sensors.seed': scenario.sensors.seed}
    assert fingerprint(load('paper_10x10', overrides)) == fingerprint(scenario)


def test_every_shipped_scenario_is_valid_and_named_after_its_file() -> None:
    names = scenario_names()
    assert set(names) >= {'paper_8x8', 'paper_10x10', 'paper_15x15', 'paper_20x20', 'lillgrund'}
    assert [load(name).name for name in names] == list(names)


def test_lillgrund_has_its_48_turbines_around_the_middle_of_the_area() -> None:
    scenario = load('lillgrund')
    xs_m, ys_m = zip(*places('lillgrund').values(), strict=True)
    assert len(xs_m) == 48
    assert min(xs_m) + max(xs_m) == pytest.approx(scenario.area.width_m)
    assert min(ys_m) + max(ys_m) == pytest.approx(scenario.area.height_m)
    assert max(xs_m) - min(xs_m) == pytest.approx(2664.0)
    assert scenario.demand.cell_share == 'all'


def test_a_file_overlays_what_it_extends_level_by_level(tmp_path: Path) -> None:
    (tmp_path / 'base.yaml').write_text('extends: paper_10x10\narea: {altitude_m: 80}\nname: b')
    (tmp_path / 'top.yaml').write_text('extends: base.yaml\narea: {cell_size_m: 40}\n')
    scenario = load(tmp_path / 'top.yaml')
    assert scenario.area.altitude_m == 80.0
    assert scenario.area.cell_size_m == 40.0
    assert scenario.area.cells_per_side == 10
    assert scenario.uavs[0].start_m == (20.0, 20.0)
    assert scenario.name == 'top'  # a base's name is not its heir's


def test_a_user_file_may_be_called_as_the_shipped_one_it_extends(tmp_path: Path) -> None:
    (tmp_path / 'paper_10x10.yaml').write_text('extends: paper_10x10\nname: mine\n')
    assert load(tmp_path / 'paper_10x10.yaml').name == 'mine'


def test_a_uav_overrides_the_default_of_the_fleet(tmp_path: Path) -> None:
    (tmp_path / 'fleet.yaml').write_text("""
extends: paper_10x10
fleet:
  default: {energy_budget_kj: 300, start: {cell: [0, 9]}}
  uavs:
  - speed_mps: 7
  - {speed_mps: 8, energy_budget_kj: 90, start: {position_m: [75, 25]}, home: {cell: [9, 9]}}
  - {speed_mps: 9, propulsion: {tip_speed_mps: 150}}
""")
    first, second, third = load(tmp_path / 'fleet.yaml').uavs
    assert (first.speed_mps, first.energy_budget_j, first.start_m) == (7.0, 3e5, (475.0, 25.0))
    assert (second.energy_budget_j, second.start_m, second.home_m) == (
        9e4,
        (75.0, 25.0),
        (475.0,) * 2,
    )
    assert third.propulsion.tip_speed_mps == 150.0
    assert third.propulsion.induced_power_w == first.propulsion.induced_power_w


def test_overrides_by_path_count_more_than_the_file() -> None:
    scenario = load(
        'paper_10x10',
        {
            'demand.cell_share': 0.5,
            'fleet.uavs.0.speed_mps': 6,
            'fleet.uavs.1.start': {'cell': (9, 0)},
            'fleet.default.energy_budget_kj': 50,
        },
    )
    assert scenario.demand.cell_share == 0.5
    assert scenario.uavs[0].speed_mps == 6.0
    assert scenario.uavs[1].start_m == (25.0, 475.0)
    assert {uav.energy_budget_j for uav in scenario.uavs} == {5e4}
    assert load('paper_10x10', {'fleet.uavs': ({'speed_mps': 3},) * 4}).n_uavs == 4


@pytest.mark.parametrize(
    ('assignment', 'value'),
    [
        ('demand.cell_share=0.5', 0.5),
        ('demand.cell_share = all', 'all'),
        ('radio.contact_range_m=.inf', math.inf),
        ('radio.carrier_hz=2.4e9', 2.4e9),
        ('fleet.uavs=[{speed_mps: 5}]', [{'speed_mps': 5}]),
    ],
)
def test_a_command_line_override_is_a_path_and_a_yaml_value(
    assignment: str, value: object
) -> None:
    path, parsed = parse_override(assignment)
    assert path == assignment.partition('=')[0].strip()
    assert parsed == value


@pytest.mark.parametrize('name', ['paper_10x10', 'lillgrund'])
def test_a_resolved_scenario_stands_alone_and_reads_back_the_same(name: str) -> None:
    scenario = load(name, {'radio.contact_range_m': math.inf})
    text = scenario.to_yaml()
    again = from_yaml(text)
    assert again == scenario
    assert again.to_yaml() == text
    assert fingerprint(again) == fingerprint(scenario)
    assert 'extends' not in text
    assert 'csv' not in text


def test_a_resolved_text_may_be_used_as_a_scenario_file(tmp_path: Path) -> None:
    scenario = load('lillgrund')
    (tmp_path / 'copy.yaml').write_text(scenario.to_yaml())
    assert load(tmp_path / 'copy.yaml') == scenario


by_the_same_cases = settings(deadline=None, derandomize=True, database=None)
texts = st.one_of(
    st.sampled_from(
        [
            *('007', '1e5', '1.5e-3', '0x1f', 'on', 'null', '~', '1:30', '2024-01-01', '-'),
            *(
                '-.5',
                '+.5e3',
                '00.5',
                '1.',
                '+.inf',
                '.NaN',
                'No',
                '<<',
                '=',
                '?',
                '!x',
                '&a',
                '*a',
            ),
        ]
    ),
    st.text(min_size=1).filter(str.isprintable),
)
numbers = st.floats(allow_nan=False)


@by_the_same_cases
@given(st.dictionaries(texts, texts | numbers | st.tuples(numbers, numbers), min_size=1))
def test_written_yaml_reads_back_the_same(values: dict[str, object]) -> None:
    expected = {
        key: [*value] if isinstance(value, tuple) else value for key, value in values.items()
    }
    assert yaml_text.read_value(yaml_text.dump(values), '')[0] == expected


def test_a_loaded_scenario_cannot_be_changed() -> None:
    scenario = load('paper_10x10')
    with pytest.raises(FrozenInstanceError):
        scenario.area.altitude_m = 3.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ('path', 'value'),
    [
        ('area.altitude_m', 100.5),
        ('sensors.seed', 36),
        ('demand.cell_share', 'all'),
        ('demand.data_mbit', [0.1, 0.9]),
        ('radio.contact_range_m', math.inf),
        ('reward.scale_mbit', 2),
        ('fleet.uavs.1.speed_mps', 11),
        ('fleet.uavs.0.home', {'cell': [0, 1]}),
        ('fleet.uavs', [{'speed_mps': 10}, {'speed_mps': 5}]),
    ],
)
def test_the_fingerprint_changes_with_any_value(path: str, value: object) -> None:
    assert fingerprint(load('paper_10x10', {path: value})) != fingerprint(load('paper_10x10'))


def test_the_fingerprint_ignores_name_order_and_comments(tmp_path: Path) -> None:
    text = load('paper_10x10').to_yaml()
    head, _, rest = text.partition('area:\n  cells_per_side: 10\n  cell_size_m: 50.0\n')
    (tmp_path / 'other.yaml').write_text(
        f'# mine\n{rest.removeprefix("  altitude_m: 100.0")}\n'
        f'area: {{altitude_m: 1e2, cell_size_m: 50, cells_per_side: 10}}\n'
    )
    assert head == 'name: paper_10x10\n'
    other = load(tmp_path / 'other.yaml')
    assert other.name == 'other'
    assert fingerprint(other) == fingerprint(load('paper_10x10'))


def test_the_fingerprint_is_the_same_in_every_process() -> None:
    printed = printed_by(
        'from uav_collect.scenario import load as s; print(s.fingerprint(s.load("paper_10x10")))'
    )
    assert printed.strip() == fingerprint(load('paper_10x10')) == 'ce37799ee3bb718d'


def test_reading_scenarios_loads_neither_numpy_nor_numba() -> None:
    loaded = printed_by('import sys, uav_collect.scenario.load; print(*sys.modules)').split()
    assert 'uav_collect.scenario.load' in loaded
    assert not {'numpy', 'numba', 'torch'} & {*loaded}


def test_sensors_from_csv_are_centred_in_the_area(tmp_path: Path) -> None:
    assert places(farm(tmp_path)) == {'007': (100.0, 150.0), '1e5': (400.0, 350.0)}
    sensors = load(farm(tmp_path)).sensors
    assert isinstance(sensors, ListedSensors)
    assert [sensor.data_mbit for sensor in sensors.entries] == [0.25, 0.5]


def test_an_origin_is_the_south_west_corner_in_the_coordinates_of_the_file(tmp_path: Path) -> None:
    scenario = FARM.replace('auto', '[493390, 5180400]')
    assert places(farm(tmp_path, scenario=scenario)) == {
        '007': (10.0, 100.0),
        '1e5': (310.0, 300.0),
    }
    sensors = 'sensor_id,x_m,y_m,data_mbit\na,10,0,1\nb,500,499.5,1\n'
    scenario = FARM.replace('auto', '[0, 0]')
    assert places(farm(tmp_path, sensors=sensors, scenario=scenario)) == {
        'a': (10.0, 0.0),
        'b': (500.0, 499.5),
    }


def test_a_csv_from_a_spreadsheet_is_read(tmp_path: Path) -> None:
    sensors = '\ufeffsensor_id, x_m, y_m, data_mbit\r\n"a", 10, 20, 1\r\n\r\nb, 30, 40, 1\r\n'
    assert places(farm(tmp_path, sensors=sensors)) == {'a': (240.0, 240.0), 'b': (260.0, 260.0)}


def test_a_csv_lies_beside_the_file_that_names_it(tmp_path: Path) -> None:
    path = farm(tmp_path)
    (tmp_path / 'deep').mkdir()
    (tmp_path / 'deep' / 'heir.yaml').write_text('extends: ../farm.yaml\n')
    assert places(str(tmp_path / 'deep' / 'heir.yaml')) == places(path)


# One hundredth of a degree on the WGS84 ellipsoid, from the radii of curvature M and N:
# 0 deg: M = 6335439.3 m, N = 6378137.0 m; 45 deg: M = 6367381.8 m, N cos(lat) = 4517590.9 m.
@pytest.mark.parametrize(
    ('lat_deg', 'north_m', 'east_m'), [(0.0, 1105.7427, 1113.1949), (45.0, 1111.3178, 788.4683)]
)
@pytest.mark.parametrize('lon_deg', [0.0, 12.8, -117.1, 179.995])
def test_a_hundredth_of_a_degree_is_as_long_as_the_ellipsoid_says(
    lat_deg: float, north_m: float, east_m: float, lon_deg: float
) -> None:
    south = east_north_m(lat_deg - 0.005, lon_deg, origin_lat_deg=lat_deg, origin_lon_deg=lon_deg)
    north = east_north_m(lat_deg + 0.005, lon_deg, origin_lat_deg=lat_deg, origin_lon_deg=lon_deg)
    east = east_north_m(lat_deg, lon_deg + 0.01, origin_lat_deg=lat_deg, origin_lon_deg=lon_deg)
    assert north[1] - south[1] == pytest.approx(north_m, abs=2e-3)
    assert east[0] == pytest.approx(east_m, abs=2e-3)
    assert north[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize('lon_deg', [12.8, 180.0])
def test_sensors_given_by_latitude_and_longitude_lie_east_and_north(
    tmp_path: Path, lon_deg: float
) -> None:
    east_deg = lon_deg + 0.002 if lon_deg < 180.0 else -179.998  # over the date line
    sensors = (
        'sensor_id,lat,lon,data_mbit\n'
        f'west,55.0,{lon_deg - 0.002},1\neast,55.0,{east_deg},1\nnorth,55.002,{lon_deg},1\n'
    )
    by_id = places(farm(tmp_path, sensors=sensors))
    # N cos(55 deg) x 0.004 deg = 255.9765 m; M(55.001 deg) x 0.002 deg = 222.6471 m.
    assert by_id['east'][0] - by_id['west'][0] == pytest.approx(255.9765, abs=1e-3)
    assert by_id['north'][1] - by_id['west'][1] == pytest.approx(222.6471, abs=3e-3)
    assert by_id['north'][0] == pytest.approx(250.0, abs=1e-3)
    origin = FARM.replace('auto', f'[55.0, {lon_deg - 0.002}]')
    by_id = places(farm(tmp_path, sensors=sensors, scenario=origin))
    assert by_id['west'] == (0.0, 0.0)
    assert by_id['east'][0] == pytest.approx(255.9765, abs=1e-3)

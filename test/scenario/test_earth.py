"""Places on the Earth: there and back, and where a scenario keeps them."""

import csv
from dataclasses import replace
import math
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
import pytest
from uav_collect.errors import ConfigError
from uav_collect.scenario.earth import east_north_m, lat_lon_deg
from uav_collect.scenario.grids import grid_of, lat_lon_of
from uav_collect.scenario.load import fingerprint, from_yaml, load
from uav_collect.scenario.model import ListedSensors, Scenario

LILLGRUND = Path(__file__).parents[2] / 'config/scenarios/lillgrund_turbines.csv'
SENSORS = """sensor_id,lat,lon,data_mbit
west,55.0,12.798,1
east,55.0,12.802,1
north,55.002,12.8,1
"""
BY_ID = {'west': (55.0, 12.798), 'east': (55.0, 12.802), 'north': (55.002, 12.8)}


def farm(folder: Path, sensors: str = SENSORS, origin: str = 'auto', more: str = '') -> Scenario:
    (folder / 'sensors.csv').write_text(sensors)
    (folder / 'farm.yaml').write_text(
        'extends: paper_10x10\n'
        f'sensors: {{kind: csv, file: sensors.csv, origin: {origin}}}\n'
        f'demand: {{cell_share: all, data_mbit: csv}}\n{more}'
    )
    return load(folder / 'farm.yaml')


@given(
    east_m=st.floats(-50e3, 50e3),
    north_m=st.floats(-50e3, 50e3),
    lat_deg=st.floats(-80.0, 80.0),
    lon_deg=st.floats(-180.0, 180.0),
)
def test_a_place_in_the_plane_has_the_latitude_and_longitude_that_lie_there(
    east_m: float, north_m: float, lat_deg: float, lon_deg: float
) -> None:
    origin = {'origin_lat_deg': lat_deg, 'origin_lon_deg': lon_deg}
    there = lat_lon_deg(east_m, north_m, **origin)
    assert east_north_m(*there, **origin) == pytest.approx((east_m, north_m), abs=1e-6)
    assert -180.0 <= there[1] <= 180.0


@pytest.mark.parametrize('origin', ['auto', '[54.999, 12.797]'])
def test_a_site_given_by_latitudes_knows_where_its_places_are(tmp_path: Path, origin: str) -> None:
    scenario = farm(tmp_path, origin=origin)
    assert isinstance(scenario.sensors, ListedSensors)
    assert scenario.area.reference is not None
    for sensor in scenario.sensors.entries:
        place = scenario.area.reference.lat_lon_deg(sensor.x_m, sensor.y_m)
        assert place == pytest.approx(BY_ID[sensor.id], abs=1e-10)  # 11 micrometres


def test_the_place_on_earth_is_kept_in_the_resolved_scenario(tmp_path: Path) -> None:
    scenario = farm(tmp_path)
    assert from_yaml(scenario.to_yaml()) == scenario


def test_the_place_on_earth_is_no_part_of_the_fingerprint(tmp_path: Path) -> None:
    placed = farm(tmp_path)
    nowhere = replace(placed, area=replace(placed.area, reference=None))
    assert fingerprint(placed) == fingerprint(nowhere)
    reference = {'lat_deg': 55.0, 'lon_deg': 12.8, 'position_m': [0, 0]}
    somewhere = load('paper_10x10', {'area.reference': reference})
    assert fingerprint(somewhere) == fingerprint(load('paper_10x10'))
    assert somewhere.area.reference is not None
    assert somewhere.area.reference.lat_lon_deg(0.0, 0.0) == pytest.approx((55.0, 12.8))


def test_a_scenario_without_latitudes_says_nothing_of_them() -> None:
    assert 'reference' not in load('paper_10x10').to_yaml()


def test_turbines_of_the_wind_farm_are_where_their_grid_has_them() -> None:
    area = load('lillgrund').area
    assert area.reference is not None
    with LILLGRUND.open() as lines:
        rows = {row['sensor_id']: row for row in csv.DictReader(lines)}
    grid = grid_of(area.crs or '', 'crs')
    sensors = load('lillgrund').sensors
    assert isinstance(sensors, ListedSensors)
    for sensor in sensors.entries:
        row = rows[sensor.id]
        [there] = lat_lon_of([(float(row['easting_m']), float(row['northing_m']))], grid)
        assert there is not None
        lat_deg, lon_deg = area.reference.lat_lon_deg(sensor.x_m, sensor.y_m)
        away_m = east_north_m(lat_deg, lon_deg, origin_lat_deg=there[0], origin_lon_deg=there[1])
        assert math.hypot(*away_m) < 0.5  # without the bearing of the grid's north up to 60 m


def test_y_points_where_its_bearing_says() -> None:
    turned = {'lat_deg': 0, 'lon_deg': 0, 'position_m': [0, 0], 'y_bearing_deg': 90}
    reference = load('paper_10x10', {'area.reference': turned}).area.reference
    assert reference is not None
    lat_deg, lon_deg = reference.lat_lon_deg(0.0, 100.0)
    # East along the equator: 100 m / 6378137 m
    assert (lat_deg, lon_deg) == pytest.approx((0.0, math.degrees(100.0 / 6378137.0)), abs=1e-9)


def test_the_grid_of_a_list_is_kept_and_no_part_of_the_fingerprint(tmp_path: Path) -> None:
    sensors = 'id,x,y,data_mbit\na,361469,6154543,1\nb,361203,6154244,1\n'
    scenario = farm(tmp_path, sensors, 'auto, crs: UTM 33N', 'area: {cell_size_m: 100}\n')
    assert scenario.area.crs == 'EPSG:32633'
    assert from_yaml(scenario.to_yaml()) == scenario
    elsewhere = replace(scenario, area=replace(scenario.area, crs='EPSG:25833'))
    assert fingerprint(elsewhere) == fingerprint(scenario)


@pytest.mark.parametrize('origin', ['[361200, 6154200]', '[55.514122, 12.801796]'])
def test_a_list_whose_rows_name_one_utm_zone_is_of_that_grid(tmp_path: Path, origin: str) -> None:
    sensors = (
        'id,easting,northing,utm_zone,data_mbit\na,361469,6154543,33T,1\nb,361203,6154244,33T,1\n'
    )
    more = 'area: {cell_size_m: 100, crs: EPSG:32633}\n'  # as the list says, too
    scenario = farm(tmp_path, sensors, origin, more)
    assert scenario.area.crs == 'EPSG:32633'
    assert isinstance(scenario.sensors, ListedSensors)
    x_m, y_m = scenario.sensors.entries[1].x_m, scenario.sensors.entries[1].y_m
    assert (x_m, y_m) == pytest.approx((3.0, 44.0), abs=3.0)
    with pytest.raises(ConfigError, match=r'area\.crs is given: must be left out, as .*the grid'):
        farm(tmp_path, sensors, origin, more.replace('32633', '25832'))


def test_a_place_on_earth_is_given_once(tmp_path: Path) -> None:
    more = 'area: {reference: {lat_deg: 55, lon_deg: 12.8, position_m: [0, 0]}}\n'
    with pytest.raises(ConfigError, match=r'area\.reference is given: must be left out, as .*csv'):
        farm(tmp_path, more=more)


def test_a_latitude_that_there_is_none_of_is_refused() -> None:
    reference = {'lat_deg': 91, 'lon_deg': 12.8, 'position_m': [0, 0]}
    with pytest.raises(ConfigError, match=r'area\.reference\.lat_deg.*from -89 to 89 deg'):
        load('paper_10x10', {'area.reference': reference})

"""Lists of sensors that cannot be used: file, line, column, value and what is allowed."""

from pathlib import Path
from typing import NamedTuple

import pytest
from uav_collect.errors import ConfigError
from uav_collect.scenario.load import load

COORDINATES = 'lat,lon or easting_m,northing_m or x_m,y_m'
METRES = 'must be a number from -10000000 to 10000000 m'
LATITUDE = 'must be a number from -89 to 89 deg'
DATA = 'must be a number from 1e-06 to 10000 Mbit, or 0'
COLUMNS = (
    'must be a mapping of some of id, lat, lon, easting_m, northing_m, x_m, y_m, data_mbit, '
    'utm_zone to names of columns'
)
ONE_ROW = 'must be unique, or doubles: first, or last, to keep one row'
ONE_PLACE = (
    'must be one row for each place, or doubles: first, last, or keep for sensors of one place'
)


class Case(NamedTuple):
    """A list, and the line that refuses it."""

    name: str
    text: str
    line: int  # 0: of the whole file
    problem: str


CASES = (
    Case('empty', '', 0, 'is empty: must begin with the names of columns'),
    Case('header alone', 'sensor_id,x_m,y_m\n', 0,
         'has no sensors: must have at least one line below the header'),
    Case('no places', 'sensor_id,data_mbit\na,1\n', 1,
         "has no coordinates, but 'sensor_id,data_mbit': must have columns "
         f'{COORDINATES}, or be told which they are, as columns: {{lat: Y, lon: X}}'),
    Case('half a place', 'sensor_id,X [m]\na,1\n', 1,
         f"has 'X [m]' without a column y_m: must have {COORDINATES}"),
    Case('column twice', 'sensor_id,x_m,y_m,x_m\na,1,2,3\n', 1, 'column x_m appears twice'),
    Case('x and y of both', 'id,x,y\na,1,2\nb,4,6\nc,7,3\n', 1,
         'x,y may be degrees or metres: must be told, by columns: {lon: x, lat: y} or '
         'columns: {x_m: x, y_m: y}'),
    Case('control characters', 'sensor_id,\x1b,\x1b\na,1,2\n', 1,
         'must be text, but is UTF-8 with the character U+001B'),
    Case('field left out', 'sensor_id,x_m,y_m\na,1\n', 2,
         'has 2 fields: must have 3, as the header'),
    Case('decimal comma among commas', 'sensor_id,x_m,y_m\na,1,5,2\n', 2,
         'has 4 fields: must have 3, as the header'),
    Case('thousand or fraction', 'sensor_id;x_m;y_m\na;1,500;2\n', 2,
         "x_m is '1,500': may be a thousand or a fraction"),
    Case('number in words', 'sensor_id,x_m,y_m\n\na,1,2\nb,one,2\n', 4, f"x_m is 'one': {METRES}"),
    Case('underscore', 'sensor_id,x_m,y_m\na,1_0,2\n', 2, f"x_m is '1_0': {METRES}"),
    Case('digits of another script', 'sensor_id,x_m,y_m\na,\u0661,2\n', 2,
         f"x_m is '\u0661': {METRES}"),
    Case('not a number', 'sensor_id,x_m,y_m\na,nan,2\n', 2, f"x_m is 'nan': {METRES}"),
    Case('infinite', 'sensor_id,x_m,y_m\na,1,-inf\n', 2, f"y_m is '-inf': {METRES}"),
    Case('half a place left out', 'sensor_id,x_m,y_m\na,,2\n', 2, f"x_m is '': {METRES}"),
    Case('place left out', 'sensor_id,x_m,y_m\na,,\n', 2,
         'x_m,y_m are empty: must be numbers, or blanks: skip'),
    Case('id twice', 'sensor_id,x_m,y_m\na,1,2\nb,3,4\na ,5,6\n', 2,
         f"sensor_id is 'a', as in line 4: {ONE_ROW}"),
    Case('place twice', 'sensor_id,x_m,y_m\na,1,2\nb,3,4\nc,1.0,2\n', 2,
         f'x_m,y_m is 1, 2, as in line 4: {ONE_PLACE}'),
    Case('id left out', 'sensor_id,x_m,y_m\n,1,2\n', 2,
         "sensor_id is '': must be 1 to 64 printable characters"),
    Case('degrees as UTM', 'sensor_id,easting_m,northing_m\na,12.8,55.5\n', 2,
         "easting_m is '12.8': must be a number from 100000 to 900000 m"),
    Case('latitude past the pole', 'sensor_id,lat,lon\na,91,12\n', 2, f"lat is '91': {LATITUDE}"),
    Case('longitude past the date line', 'sensor_id,lat,lon\na,55,190\n', 2,
         "lon is '190': must be a number from -180 to 180 deg"),
    Case('degrees of another axis', 'Site,Latitude,Longitude\na,55 30 E,12.8\n', 2,
         f"Latitude is '55 30 E': {LATITUDE}"),
    Case('minutes of an hour and more', 'Site,Latitude,Longitude\na,55\u00b0 61\u2032,12.8\n', 2,
         f"Latitude is '55\u00b0 61\u2032': {LATITUDE}"),
    Case('negative amount', 'sensor_id,x_m,y_m,data_mbit\na,1,2,-1\n', 2,
         f"data_mbit is '-1': {DATA}"),
    Case('no amount', 'sensor_id,x_m,y_m,data_mbit\na,1,2,\n', 2, f"data_mbit is '': {DATA}"),
    Case('larger than the area', 'sensor_id,x_m,y_m\na,0,0\nb,600,10\n', 0,
         'sensors span 600 m x 10 m: must fit into the area, 500 m x 500 m'),
    Case('open quote', 'sensor_id,x_m,y_m\n"a,1,2\n', 0,
         'is not valid CSV: unexpected end of data'),
    Case('without a fix', 'id,lat,lon\na,46.7812,-117.0891\nb,46.78,-117.0875\nnofix,0,0\n', 4,
         'lat,lon is 0, 0: lies 12,028 km from the others: must be put right, or its row left '
         'out'),
    Case('another grid', 'sensor_id,easting_m,northing_m\na,2600123,1200234\nb,2600223,1200334\n',
         0, 'has easting_m from 2600123 to 2600223 and northing_m from 1200234 to 1200334, which '
         'is no UTM: must be read by the grid it is of, as crs: EPSG:2056, or as plain metres, by '
         'columns: {x_m: easting_m, y_m: northing_m}'),
    Case('degrees swapped', 'id,lat,lon\na,-117.0891,46.7812\nb,-117.0875,46.78\n', 0,
         'has lat from -117.0891 to -117.0875 and lon from 46.78 to 46.7812, which are longitudes '
         'and latitudes: must be swapped, by columns: {lat: lon, lon: lat}'),
    Case('x and y swapped', 'id,X,Y\na,46.7812,-117.0891\nb,46.78,-117.0875\n', 0,
         'has Y from -117.0891 to -117.0875 and X from 46.78 to 46.7812, which are longitudes '
         'and latitudes: must be swapped, by columns: {lat: X, lon: Y}'),
    Case('columns of UTM', 'id,easting,northing\na,93383,5180586\nb,493510,5180568\nc,493574,5180',
         2, "easting is '93383': must be a number from 100000 to 900000 m"),
)  # fmt: skip


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write_site(sensors: str, more: str = '', origin: str = 'auto') -> None:
    Path('site.yaml').write_text(
        'extends: paper_10x10\n'
        f'sensors: {{kind: csv, file: sensors.csv, origin: {origin}{more}}}\n'
        'demand: {cell_share: all, data_mbit: csv}\n'
    )
    Path('sensors.csv').write_text(sensors)


def problems_of(sensors: str, more: str = '', origin: str = 'auto') -> tuple[str, ...]:
    write_site(sensors, more, origin)
    with pytest.raises(ConfigError) as caught:
        load('site.yaml')
    return caught.value.problems


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.name)
def test_a_list_that_cannot_be_used_is_refused_by_line_column_and_value(case: Case) -> None:
    place = f'sensors.csv:{case.line}' if case.line else 'sensors.csv'
    assert problems_of(case.text) == (f'{place}: {case.problem}',)


def test_all_that_is_wrong_with_a_list_is_said_at_once_in_the_order_of_its_rows() -> None:
    rows = 'a,46.78,-117.08\nb,x,-200\n,46.7812,-117.0801\nc,46.78,-117.08\nd,,\n'
    more = 'a,46.7809,-117.0812\ne,0,0\n'
    assert problems_of(f'id,lat,lon\n{rows}{more}') == (
        f"sensors.csv:2: id is 'a', as in line 7: {ONE_ROW}",
        f'sensors.csv:2: lat,lon is 46.78, -117.08, as in line 5: {ONE_PLACE}',
        f"sensors.csv:3: lat is 'x': {LATITUDE}",
        "sensors.csv:3: lon is '-200': must be a number from -180 to 180 deg",
        "sensors.csv:4: id is '': must be 1 to 64 printable characters",
        'sensors.csv:6: lat,lon are empty: must be numbers, or blanks: skip',
        'sensors.csv:8: lat,lon is 0, 0: lies 12,027 km from the others: must be put right, or '
        'its row left out',
    )


def test_of_many_problems_twenty_are_shown_and_the_others_counted() -> None:
    problems_of('id,x_m,y_m\n' + ''.join(f's{number},x,{number}\n' for number in range(50)))
    with pytest.raises(ConfigError) as caught:
        load('site.yaml')
    lines = str(caught.value).splitlines()
    assert len(lines) == 21
    assert lines[-1] == '... and 30 more problems'


@pytest.mark.parametrize(
    ('origin', 'sensor', 'problem'),
    [
        (
            '[400, 0]',
            'sensor_id,x_m,y_m\na,10,20\nb,450,30\nc,20,40\n',
            (
                'sensors.csv:2: x_m,y_m of sensor a lies at x = -390 m, y = 20 m in the area: '
                'must be from 0 to 500 m',
                'sensors.csv:4: x_m,y_m of sensor c lies at x = -380 m, y = 40 m in the area: '
                'must be from 0 to 500 m',
            ),
        ),
        (
            '[12.8, 55.5]',
            'sensor_id,easting_m,northing_m\na,361469,6154543',
            (
                'sensors.csv: sensors.origin has easting_m 12.8: '
                'must be a number from 100000 to 900000 m',
            ),
        ),
    ],
)
def test_an_origin_that_does_not_fit_the_sensors_is_refused(
    origin: str, sensor: str, problem: tuple[str, ...]
) -> None:
    sensor = '\n'.join(f'{line},1' for line in sensor.splitlines()).replace('m,1', 'm,mbit', 1)
    assert problems_of(sensor, origin=origin) == problem


def test_places_too_far_for_the_area_are_named_before_their_span() -> None:
    rows = ''.join(f's{n},{n * 10},{n},1\n' for n in range(9))
    assert problems_of(f'id,x_m,y_m,mbit\n{rows}odd,30000,5,1\n') == (
        'sensors.csv:11: x_m,y_m is 30000, 5: lies 30 km from the others: must be put right, or '
        'the area larger',
        'sensors.csv: sensors span 30000 m x 8 m: must fit into the area, 500 m x 500 m',
    )


@pytest.mark.parametrize(
    ('more', 'problem'),
    [
        (', columns: {lat: Y}', 'sensors.csv:1: column Y is missing, which columns gives as lat: '
         "the header is 'id,x_m,y_m'"),
        (', columns: {z: id}', f"site.yaml:2: sensors.columns is {{'z': 'id'}}: {COLUMNS}"),
        (', columns: {lat: 5}', f"site.yaml:2: sensors.columns is {{'lat': 5}}: {COLUMNS}"),
        (', columns: 5', f'site.yaml:2: sensors.columns is 5: {COLUMNS}'),
        (', crs: here', "site.yaml:2: sensors.crs is 'here': must be EPSG:NUMBER, as EPSG:27700, "
         'or UTM ZONE N or S, as UTM 33N'),
        (', crs: "EPSG:999999"', "sensors.csv: crs is 'EPSG:999999': must name a map grid, "
         'EPSG:NUMBER, as EPSG:27700, or UTM ZONE N or S, as UTM 33N'),
        (', crs: "EPSG:4326"', 'sensors.csv: crs is EPSG:4326, which has latitudes and '
         'longitudes: must be left out, as the places are x_m,y_m'),
        (', doubles: some', "site.yaml:2: sensors.doubles is 'some': must be refuse or first "
         'or last or keep'),
    ],
)  # fmt: skip
def test_what_a_scenario_says_of_its_list_is_held_to_it(more: str, problem: str) -> None:
    assert problems_of('id,x_m,y_m\na,1,2\n', more) == (problem,)

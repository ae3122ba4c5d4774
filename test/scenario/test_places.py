"""Lists of sensors as people have them: each is read, and gives the places that it means."""

from pathlib import Path

from logger_lists import ids_and_places, places_of
import pytest
from uav_collect.errors import ConfigError
from uav_collect.scenario.columns import parse_columns
from uav_collect.scenario.earth import east_north_m
from uav_collect.scenario.places import ReadOptions

HERE = {'a': (46.7812, -117.0891), 'b': (46.78, -117.0875)}
LISTS = {
    'plain': 'sensor_id,lat,lon\na,46.7812,-117.0891\nb,46.78,-117.0875\n',
    'spreadsheet of Germany': 'Messstelle;Höhe;Breite;Länge\r\na;3,5;46,7812;-117,0891\r\n'
    'b;2,7;46,78;-117,0875\r\n',
    'spreadsheet of France': '\ufeffsep=;\r\nNom;Latitude;Longitude;Type;Type\r\n'
    'a;46,7812;-117,0891;x;y\r\nb;46,78;-117,0875;x;y\r\n',
    'tabs and blanks': '\n\nName\tLat (deg)\tLong (deg)\n\na\t46.7812\t-117.0891\n \t\t\n'
    'b\t46.78\t-117.0875\n',
    'bars': '| Station ID | Latitude | Longitude |\n| a | 46.7812 | -117.0891 |\n'
    '| b | 46.78 | -117.0875 |\n',
    'remarks above': '# exported 2025-04-13, 12:00\nProject,Moisture,,\nID,decimalLatitude,'
    'decimalLongitude,\na,46.7812,-117.0891,\nb,46.78,-117.0875,\n,,,\n',
    'minutes and seconds': 'site,lat,lng\na,46\u00b046\'52.32"N,117\u00b05\'20.76"W\n'
    'b,46\u00b046\u203248\u2033N,117 5.25 W\n',
    'map program': 'X,Y,name,depth\n-117.0891,46.7812,a,\n-117.0875,46.78,b,2\n',
    'both systems': 'id,easting,northing,lat,lon\na,x,y,46.7812,-117.0891\n'
    'b,,,46.78,-117.0875\n',
    'old Mac': 'sensor_id,lat,lon\ra,46.7812,-117.0891\rb,46.78,-117.0875',
    'quotes': '"sensor_id","lat","lon","note, long"\n"a","46,7812","-117,0891","1,5 m"\n'
    '"b","46,78","-117,0875",""\n',
}  # fmt: skip


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'utf-16', 'utf-16-le', 'cp1252'])
@pytest.mark.parametrize('name', LISTS)
def test_a_list_is_read_whatever_wrote_it(tmp_path: Path, name: str, encoding: str) -> None:
    text = LISTS[name].removeprefix('\ufeff')
    text = text.replace('\u2032', "'").replace('\u2033', '"') if encoding == 'cp1252' else text
    places = places_of(tmp_path / 'list.csv', text.encode(encoding))
    assert ids_and_places(places) == {
        name: pytest.approx(place, abs=1e-9) for name, place in HERE.items()
    }
    assert places.is_angular
    assert places.grid is None


def test_what_was_found_is_noted(tmp_path: Path) -> None:
    assert places_of(tmp_path / 'a.csv', LISTS['spreadsheet of Germany']).notes == (
        'fields are separated by semicolons',
        'numbers have decimal commas',
        "columns not read: 'H\u00f6he'",
    )
    assert places_of(tmp_path / 'b.csv', LISTS['remarks above']).notes == (
        'the names of columns stand in line 3',
    )
    assert places_of(tmp_path / 'c.csv', LISTS['both systems']).notes == (
        'places go by lat,lon, not by easting,northing',
    )


def test_of_many_columns_that_are_not_read_some_are_named(tmp_path: Path) -> None:
    rest = [f'h{n}' for n in range(9)]
    text = f'id,x_m,y_m,data_mbit,{",".join(rest)}\na,1,2,3{",0" * 9}\nb,4,5,6{",0" * 9}\n'
    named = "'h0', 'h1', 'h2', 'h3', 'h4', 'h5' and 3 more"
    assert places_of(tmp_path / 'list.csv', text).notes == (f'columns not read: {named}',)


def test_columns_of_other_names_are_those_that_a_user_gives(tmp_path: Path) -> None:
    text = 'Kuerzel,north to south,id,lat\na,46.7812,x,1\nb,46.78,x,2\n'.replace('\n', ',w\n')
    text = text.replace(',w', ',w', 1).replace('1,w', '1,-117.0891').replace('2,w', '2,-117.0875')
    columns = parse_columns('id=Kuerzel, lat=north to south, lon=W', '--columns')
    places = places_of(tmp_path / 'list.csv', text, ReadOptions(columns=columns))
    assert ids_and_places(places) == HERE
    assert places.names == ('north to south', 'w')


@pytest.mark.parametrize('text', ['', 'id', 'id=', '=Y', 'id=a,,lat=b', 'height=Z'])
def test_columns_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(
        ConfigError, match=r'--columns has .*: must be KEY=COLUMN with KEY of id, '
    ):
        parse_columns(text, '--columns')


def test_a_list_without_names_has_its_sensors_numbered(tmp_path: Path) -> None:
    rows = ''.join(f'{n},{n * n}\n' for n in range(12))
    places = places_of(tmp_path / 'list.csv', f'x_m,y_m\n{rows}')
    assert [sensor.id for sensor in places.sensors] == [f'S{n:02d}' for n in range(1, 13)]
    assert places.notes == ('no column has a name of ids, as id or station: sensors are numbered',)


def test_bare_x_and_y_are_metres_where_they_are_no_degrees(tmp_path: Path) -> None:
    places = places_of(tmp_path / 'list.csv', 'id,x,y\na,0,0\nb,40,12.5\nc,80,25\n')
    assert ids_and_places(places) == {'a': (0.0, 0.0), 'b': (40.0, 12.5), 'c': (80.0, 25.0)}
    assert not places.is_angular


TWICE = 'id,x_m,y_m\na,1,2\nb,1,2\nc,5,6\na,7,8\nd,,\n'


@pytest.mark.parametrize(
    ('doubles', 'ids'), [('first', {'a': (1.0, 2.0), 'c': (5.0, 6.0)}),
                         ('last', {'b': (1.0, 2.0), 'c': (5.0, 6.0), 'a': (7.0, 8.0)})]
)  # fmt: skip
def test_of_rows_of_one_id_or_place_one_is_kept_as_asked(
    tmp_path: Path, doubles: str, ids: dict[str, tuple[float, float]]
) -> None:
    options = ReadOptions(doubles=doubles, skips_blanks=True)  # type: ignore[arg-type]
    places = places_of(tmp_path / 'list.csv', TWICE, options)
    assert ids_and_places(places) == ids
    n_left_out = 4 - len(ids)
    assert places.notes == (
        'left out: 1 line without a place',
        f'left out: {n_left_out} line{"s" if n_left_out > 1 else ""} of an id or a place that '
        'another has',
    )


def test_sensors_of_one_place_may_be_kept(tmp_path: Path) -> None:
    text = TWICE.replace('a,7', 'e,7').replace('d,,\n', '')
    places = places_of(tmp_path / 'list.csv', text, ReadOptions(doubles='keep'))
    assert [sensor.id for sensor in places.sensors] == ['a', 'b', 'c', 'e']


def test_a_place_that_lies_far_but_not_too_far_is_noted(tmp_path: Path) -> None:
    rows = ''.join(f's{n},{n * 10},{n}\n' for n in range(9))
    places = places_of(tmp_path / 'list.csv', f'id,x_m,y_m\n{rows}odd,30000,5\n')
    assert len(places.sensors) == 10
    assert places.far == (
        f'{tmp_path}/list.csv:11: x_m,y_m is 30000, 5: lies 30 km from the others',
    )


# Examples of the grids' own surveys: OS Guide to coordinate systems in Great Britain, Annex C (the
# water tower at Caister); swisstopo's Bern observatory, the origin of LV95; the west of a
# UTM zone at the equator.
@pytest.mark.parametrize(
    ('crs', 'east', 'north', 'lat_lon'),
    [
        ('EPSG:27700', 651409.903, 313177.270, (52.65798, 1.71608)),
        ('EPSG:2056', 2600000.0, 1200000.0, (46.95108, 7.43864)),
        ('utm 33N', 166021.443, 0.0, (0.0, 12.0)),
    ],
)
def test_places_of_a_grid_become_latitudes_and_longitudes(
    tmp_path: Path, crs: str, east: float, north: float, lat_lon: tuple[float, float]
) -> None:
    text = f'id;E-W;easting;northing\na;x;{east};{north}\nb;x;{east + 100};{north}\n'
    places = places_of(tmp_path / 'list.csv', text, ReadOptions(crs=crs))
    first, second = (sensor.at for sensor in places.sensors)
    east_m, north_m = east_north_m(*first, origin_lat_deg=lat_lon[0], origin_lon_deg=lat_lon[1])
    assert abs(east_m) < 5.0
    assert abs(north_m) < 5.0
    east_m, north_m = east_north_m(*second, origin_lat_deg=first[0], origin_lon_deg=first[1])
    assert (east_m**2 + north_m**2) ** 0.5 == pytest.approx(100.0, rel=2e-3)
    assert places.is_angular
    assert places.grid is not None


@pytest.mark.parametrize(
    ('amounts', 'mbit'),
    [
        (['0.350', '2.5'], [0.35, 2.5]),
        (['0.350', '1.250'], [0.35, 1.25]),
        (['0,350', '1.250'], [0.35, 1250.0]),
        (['1,250', '3'], [1.25, 3.0]),
        (['1.234,5', "1'234"], [1234.5, 1234.0]),
    ],
)
def test_amounts_in_a_list_of_decimal_commas_may_have_points(
    tmp_path: Path, amounts: list[str], mbit: list[float]
) -> None:
    rows = ''.join(f's{n};{n},5;{n + 2},25;{amount}\n' for n, amount in enumerate(amounts))
    options = ReadOptions(needs_data=True)
    places = places_of(tmp_path / 'list.csv', f'id;x_m;y_m;data_mbit\n{rows}', options)
    assert [sensor.data_mbit for sensor in places.sensors] == mbit
    assert places.sensors[0].at == (0.5, 2.25)


@pytest.mark.parametrize(
    ('amounts', 'mbit'), [(['1,250', '0,5'], [1.25, 0.5]), (['1.250', '0.5'], [1.25, 0.5]),
                          (['1.250', '2,5'], [1250.0, 2.5]), (['1,250', '2.5'], [1250.0, 2.5])]
)  # fmt: skip
def test_amounts_have_the_mark_that_others_of_their_column_have(
    tmp_path: Path, amounts: list[str], mbit: list[float]
) -> None:
    rows = ''.join(f's{n};{n};{n + 2};{amount}\n' for n, amount in enumerate(amounts))
    options = ReadOptions(needs_data=True)
    places = places_of(tmp_path / 'list.csv', f'id;x_m;y_m;data_mbit\n{rows}', options)
    assert [sensor.data_mbit for sensor in places.sensors] == mbit


@pytest.mark.parametrize(
    ('rows', 'problem'),
    [
        # An amount of the mark that its list's places do not have
        ('a;0,5;2,5;1.250\nb;1,5;2;3\n', "2: data_mbit is '1.250'"),
        ('a;0.5;2.5;3\nb;1.5;2;1,250\n', "3: data_mbit is '1,250'"),
        # of a column that has both, in an amount or in a place
        ('a;0,5;2,5;0.2\nb;1,5;2;0,2\nc;3;4;1,250\n', "4: data_mbit is '1,250'"),
        ('a;0,5;2.5;1\nb;1.250;2;1\n', "3: x_m is '1.250'"),
        ('a;1,250;2;1\nb;0.5;2.250;1\nc;0,5;2;1\n', "2: x_m is '1,250'"),
    ],
)
def test_a_number_that_may_be_a_thousand_or_a_fraction_is_refused(
    tmp_path: Path, rows: str, problem: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        places_of(
            tmp_path / 'list.csv', f'id;x_m;y_m;data_mbit\n{rows}', ReadOptions(needs_data=True)
        )
    expected = f'{tmp_path}/list.csv:{problem}: may be a thousand or a fraction'
    assert caught.value.problems[0] == expected


def test_a_group_of_thousands_begins_with_no_zero(tmp_path: Path) -> None:
    text = 'id;x_m;y_m\na;0.350;1,5\nb;0.5;2,5\n'
    places = places_of(tmp_path / 'list.csv', text)
    assert ids_and_places(places) == {'a': (0.35, 1.5), 'b': (0.5, 2.5)}


def test_commas_between_all_groups_of_numbers_are_no_decimal_ones(tmp_path: Path) -> None:
    text = 'id;x_m;y_m\na;1,000,200;1,500\nb;1,000,100;1,400\n'
    places = places_of(tmp_path / 'list.csv', text)
    assert ids_and_places(places) == {'a': (1000200.0, 1500.0), 'b': (1000100.0, 1400.0)}


@pytest.mark.parametrize(
    ('text', 'names'),
    [
        ('data_mbit,x_m,y_m,tag\n0.5,1,2,n1\n1.5,3,4,n2\n', ['n1', 'n2']),
        ('easting,lat,lon,tag\n300000,46.1,7.1,n1\n300010,46.2,7.2,n2\n', ['n1', 'n2']),
        ('x_m;y_m;height\n1;2;2,5\n3;4;4,5\n', ['S1', 'S2']),
        ('depth,x_m,y_m\n2.5,1,2\n3.5,3,4\n', ['S1', 'S2']),
        ('plot,x_m,y_m\n25,1,2\n35,3,4\n', ['25', '35']),
        ('x_m,y_m,turbidity\n1,2,<0.5\n3,4,2.5\n5,6,n/a\n', ['S1', 'S2', 'S3']),
        ('x_m,y_m,log\n1,2,1.5 Mbit\n3,4,12 kB\n', ['S1', 'S2']),
        ('x_m,y_m,wet\n1,2,15 %\n3,4,20 %\n', ['S1', 'S2']),
        ('seen,x_m,y_m\n2025-04-01 10:00,1,2\n2025-04-01 11:00,3,4\n', ['S1', 'S2']),
        ('x_m,y_m,seen,row\n1,2,10:00,1-1\n3,4,11:30,1-2\n', ['1-1', '1-2']),
        ('location,mean\n"46.78, -117.09",3\n"46.781, -117.09",3\n', ['S1', 'S2']),
        ('WKT,mean\nPOINT (7.1 46.7),3\nPOINT (7.1 46.8),4\n', ['S1', 'S2']),
    ],
)
def test_no_column_of_something_else_or_of_what_is_measured_holds_the_ids(
    tmp_path: Path, text: str, names: list[str]
) -> None:
    places = places_of(tmp_path / 'list.csv', text)
    assert [sensor.id for sensor in places.sensors] == names


def test_utm_zones_of_a_list_say_where_on_earth_it_is(tmp_path: Path) -> None:
    text = 'id,easting,northing,UTM zone\na,493383.11,5180586.08,11T\nb,493510,5180568,11T\n'
    places = places_of(tmp_path / 'list.csv', text)
    assert places.sensors[0].at == pytest.approx((46.7786, -117.0866), abs=1e-3)
    assert places.notes == ('places are UTM, EPSG:32611',)
    assert places.grid is not None
    assert (places.grid.name, places.names) == ('EPSG:32611', ('easting', 'northing'))
    places = places_of(tmp_path / 'list.csv', text.replace('11T', '11S'))
    assert not places.is_angular
    assert places.notes[0].startswith("utm_zone '11S' does not say of which half of the Earth")


def test_a_list_may_have_places_of_two_utm_zones(tmp_path: Path) -> None:
    text = 'id,easting,northing,utm_zone\na,750000,5180586,11T\nb,291000,5180568,12T\n'
    places = places_of(tmp_path / 'list.csv', text)
    assert places.grid is None
    assert [round(sensor.at[1], 2) for sensor in places.sensors] == [-113.73, -113.74]
    assert places.notes == ('places are UTM, EPSG:32611, EPSG:32612',)


def test_which_of_bare_x_and_y_is_the_latitude_is_noted(tmp_path: Path) -> None:
    places = places_of(tmp_path / 'list.csv', 'id,x,y\na,12.8,55.5\nb,12.801,55.501\n')
    assert places.sensors[0].at == (55.5, 12.8)
    assert places.notes == ('x,y are degrees: x is taken for the longitude, y for the latitude',)


def test_places_outside_of_their_grid_are_refused(tmp_path: Path) -> None:
    text = 'id,easting,northing\na,651409,313177\nb,651509,313177\nc,651509,9313177\n'
    with pytest.raises(ConfigError) as caught:
        places_of(tmp_path / 'list.csv', text, ReadOptions(crs='EPSG:27700'))
    assert caught.value.problems == (
        f'{tmp_path}/list.csv:4: easting,northing is 651509, 9313177: lies 9,000 km from the '
        'others: must be put right, or its row left out',
        f'{tmp_path}/list.csv:4: easting,northing is 651509, 9313177: must lie in EPSG:27700 '
        '(OSGB36 / British National Grid)',
    )
    with pytest.raises(ConfigError) as caught:
        places_of(tmp_path / 'list.csv', text, ReadOptions(crs='EPSG:2056'))
    assert caught.value.problems[0].endswith('must be of that grid, or crs another one')

"""Lists as portals, surveys and programs publish them: each is read without an edit."""

from pathlib import Path
import sys

from logger_lists import zip_of
import pytest
from uav_collect.errors import MissingPackageError
from uav_collect.scenario.load import load
from uav_collect.scenario.model import ListedSensors
from uav_collect.scenario.odd_places import Doubles
from uav_collect.scenario.places import read, ReadOptions

# What each holds: the ids, the first sensor's place, notes.
PUBLIC: dict[str, tuple[str, list[str], tuple[float, float], tuple[str, ...]]] = {
    'stations of a weather service': (
        'Stations_id;von_datum;bis_datum;Stationshoehe;geoBreite;geoLaenge;Stationsname\r\n'
        '00044;20070401;20250412;44;52.9336;8.2370;Gro\u00dfenkneten\r\n'
        '00073;19520101;20250412;374;52.9411;8.2503;M\u00fchlhausen\r\n',
        ['00044', '00073'], (52.9336, 8.237),
        ('fields are separated by semicolons',
         "columns not read: 'von_datum', 'bis_datum', 'Stationshoehe', 'Stationsname'"),
    ),
    'gauges of a water survey': (
        '# Data provided by the survey.\n#\n# agency_cd  -- Agency\n#\n'
        'agency_cd\tsite_no\tstation_nm\tdec_lat_va\tdec_long_va\n5s\t15s\t50s\t16s\t16s\n'
        'XS\t13346760\tPARADISE CREEK\t46.73183\t-117.02266\n'
        'XS\t13346800\tSOUTH FORK, UPPER\t46.73266\t-117.0338\n',
        ['13346760', '13346800'], (46.73183, -117.02266),
        ('fields are separated by tabs', 'the names of columns stand in line 5',
         'left out: line 6, widths of columns', "columns not read: 'agency_cd', 'station_nm'"),
    ),
    'occurrences of a biodiversity portal': (
        'occurrenceID\tdecimalLatitude\tdecimalLongitude\tlocality\tcode\n'
        'urn:1\t8.4071\t-83.3459\tSirena\tS1\nurn:2\t8.4111\t-83.3554\t\tS2\n',
        ['S1', 'S2'], (8.4071, -83.3459),
        ('fields are separated by tabs', "columns not read: 'occurrenceID', 'locality'"),
    ),
    'tags of an animal tracking portal': (
        'event-id,visible,timestamp,location-long,location-lat,individual-local-identifier\n'
        '1,true,2025-04-13 10:00:00.000,11.0161,47.7333,"Base, north"\n'
        '2,true,2025-04-13 10:00:00.000,11.0175,47.7341,Base south\n',
        ['Base, north', 'Base south'], (47.7333, 11.0161),
        ("columns not read: 'event-id', 'visible', 'timestamp'",),
    ),
    'points of an open data portal': (
        '\ufeffNom;Adresse;geo_point_2d\n"Place, nord";1 rue;48.8566, 2.3522\n'
        'Gare;;"48.8570, 2.3530"\n',
        ['Place, nord', 'Gare'], (48.8566, 2.3522),
        ('fields are separated by semicolons', 'places stand in geo_point_2d, as lat,lon',
         "columns not read: 'Adresse'"),
    ),
    'geometries of a converter': (
        'WKT,name,depth_cm\n"POINT (-117.0891 46.7812)",a,30\n"POINT (-117.0875 46.78)",b,\n',
        ['a', 'b'], (46.7812, -117.0891),
        ('places stand in WKT, as x,y',
         'x,y are degrees: x is taken for the longitude, y for the latitude',
         "columns not read: 'depth_cm'"),
    ),
    'devices of a radio network': (
        'dev_eui,name,latitude,longitude,last_seen,battery\n'
        '70B3D57ED0001A2B,pump,51.5,-0.1201,2025-01-01T00:00:00Z,\n'
        '70B3D57ED0001A2C,gate,51.5004,-0.121,,97 %\n',
        ['70B3D57ED0001A2B', '70B3D57ED0001A2C'], (51.5, -0.1201),
        ("columns not read: 'name', 'last_seen', 'battery'",),
    ),
    'towers of a network of towers': (
        'SITE_ID,SITE_NAME,LOCATION_LAT,LOCATION_LONG,LOCATION_ELEV,IGBP\n'
        'DE-Hai,Hainich,51.0792,10.4522,430,DBF\nDE-HaX,"Hainich, 2",51.0801,10.4531,,DBF\n',
        ['DE-Hai', 'DE-HaX'], (51.0792, 10.4522),
        ("columns not read: 'SITE_NAME', 'LOCATION_ELEV', 'IGBP'",),
    ),
    'turbines of a register': (
        'Anlage Nr.;Kennung;Rechtswert;Hochwert;Nabenh\u00f6he [m]\n'
        'WEA 1;W1;361.469,5;6.154.543,0;65,0\nWEA 2;W2;361.203,0;6.154.244,5;65,0\n',
        ['W1', 'W2'], (361469.5, 6154543.0),
        ('fields are separated by semicolons', 'numbers have decimal commas',
         "columns not read: 'Anlage Nr.', 'Nabenh\u00f6he [m]'"),
    ),
    'plots of a trial': (
        'Plot,Treatment,X (m),Y (m)\n101,A,0.0,0.0\n102,B,7.5,0.0\n103,A,15.0,0.0\n',
        ['101', '102', '103'], (0.0, 0.0), ("columns not read: 'Treatment'",),
    ),
    'sensors of a time series': (
        'sensor_id;sensor_type;location;lat;lon;timestamp;P1\n'
        '12;SDS011;7;48.7758;9.1829;2025-04-13T00:00:01;3.1\n'
        '13;SDS011;8;48.7761;9.1840;2025-04-13T00:00:02;4\n'
        '12;SDS011;7;48.7758;9.1829;2025-04-13T00:02:30;3.3\n',
        ['12', '13'], (48.7758, 9.1829),
        ('fields are separated by semicolons',
         "columns not read: 'sensor_type', 'timestamp', 'P1'",
         'left out: 1 line of an id or a place that another has'),
    ),
    'logbook in degrees and minutes': (
        'Buoy,Lat,Long\n1,55\u00b031.0\u2032N,12\u00b046.5\u2032E\n2,55\u00b030.9\u2032N,'
        '12\u00b046.4\u2032E\n',
        ['1', '2'], (55 + 31 / 60, 12 + 46.5 / 60),
        ('no column has a name of ids, as id or station: sensors are called by Buoy',),
    ),
}  # fmt: skip


@pytest.mark.parametrize('name', PUBLIC)
def test_a_public_list_is_read_without_an_edit(tmp_path: Path, name: str) -> None:
    text, ids, place, notes = PUBLIC[name]
    doubles: Doubles = 'first' if name == 'sensors of a time series' else 'refuse'
    (tmp_path / 'list.csv').write_text(text)
    places = read(tmp_path / 'list.csv', ReadOptions(doubles=doubles))
    assert [sensor.id for sensor in places.sensors] == ids
    assert places.sensors[0].at == pytest.approx(place, abs=1e-9)
    assert places.notes == notes


# Of each kind that people bring: what a site's file says besides, and the sensors it then has.
KINDS = {
    'columns that are named twice or not at all': (
        'station_id,lat,lon,elev,notes,,,\nP1,35.0197,126.5474,44,x,,,\nP2,35.0192,126.5463,27,y,,,\n'
        ',,,,,,,\n', '', ['P1', 'P2'],
    ),
    'decimal commas and a column that is there twice': (
        'Site;Height;Type;Longitude;Latitude;Type\n1;3,50;A;-0,35604;39,47534;temp\n'
        '2;2,70;A;-0,35592;39,47448;temp\n', '', ['1', '2'],
    ),
    'a blank first line': ('\nsensor_id,lat,lon\na,46.781,-117.089\n', '', ['a']),
    'amounts that are not used': (
        'sensor_id,lat,lon,data_mbit\na,46.7812,-117.0891,1.5\nb,46.7800,-117.0875,\n', '',
        ['a', 'b'],
    ),
    'deployments in one place, and one without a place': (
        'deployment_id,place,longitude,latitude,start\nD1,S1,-83.3459,8.4071,2025-04-13\n'
        'D2,S1,-83.3459,8.4071,2025-08-10\nD3,S2,-83.3454,8.4111,2025-08-10\n'
        'D4,S3,,,2025-08-11\n', ', doubles: last, blanks: skip', ['D2', 'D3'],
    ),
    'a national grid as metres': (
        'sensor_id,easting_m,northing_m\na,2600123,1200234\nb,2600223,1200334\n',
        ', columns: {x_m: easting_m, y_m: northing_m}', ['a', 'b'],
    ),
    'a national grid by its name': (
        'sensor_id,easting_m,northing_m\na,2600123,1200234\nb,2600223,1200334\n',
        ', crs: "EPSG:2056"', ['a', 'b'],
    ),
}  # fmt: skip


@pytest.mark.parametrize('name', KINDS)
def test_a_list_of_each_kind_is_that_of_a_site(tmp_path: Path, name: str) -> None:
    text, more, ids = KINDS[name]
    (tmp_path / 'list.csv').write_text(text)
    (tmp_path / 'site.yaml').write_text(
        'extends: paper_10x10\n'
        f'sensors: {{kind: csv, file: list.csv, origin: auto{more}}}\n'
        'demand: {cell_share: all, data_mbit: [0.5, 2.0]}\n'
    )
    scenario = load(tmp_path / 'site.yaml')
    assert isinstance(scenario.sensors, ListedSensors)
    assert [sensor.id for sensor in scenario.sensors.entries] == ids
    assert (scenario.area.reference is None) == ('metres' in name)


@pytest.mark.parametrize(
    ('package', 'content', 'crs'),
    [
        ('pyproj', b'id,easting,northing\na,2600123,1200234\n', 'EPSG:2056'),
        ('defusedxml', b'<kml/>', ''),
        ('openpyxl', zip_of('a.txt', b''), ''),
    ],
)
def test_a_package_that_a_list_needs_is_named_where_it_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, content: bytes, crs: str
) -> None:
    for name in [it for it in sys.modules if it.partition('.')[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / 'list').write_bytes(content)
    with pytest.raises(MissingPackageError, match=f'{package} is missing: pip install {package}'):
        read(tmp_path / 'list', ReadOptions(crs=crs))

"""Maps and workbooks of sensors: GeoJSON, KML and xlsx, as other programs write them."""

import io
import json
from pathlib import Path
from typing import Any
import zipfile

from logger_lists import ids_and_places, places_of, zip_of
import openpyxl
import pytest
from uav_collect.errors import ConfigError
from uav_collect.scenario.load import load
from uav_collect.scenario.places import read, read_polygons, ReadOptions

HERE = {'a': (46.7812, -117.0891), 'b': (46.78, -117.0875)}
KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><name>Field</name>
<Folder><name>Loggers</name>
  <Placemark><name>a</name>
    <ExtendedData><Data name="data_mbit"><value>1.5</value></Data></ExtendedData>
    <Point><coordinates>-117.0891,46.7812,770</coordinates></Point></Placemark>
  <Placemark><name>b</name><Point><coordinates>
    -117.0875,46.78 </coordinates></Point></Placemark>
</Folder>
<Placemark><name>Fence</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
  -117.1,46.77,0 -117.08,46.77,0 -117.08,46.79,0 -117.1,46.77,0
</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
<Folder><name>Restricted areas</name><Placemark><name>Mast</name>
  <MultiGeometry><LineString><coordinates>
    -117.09,46.78 -117.08,46.78 -117.08,46.79 -117.09,46.78
  </coordinates></LineString></MultiGeometry></Placemark></Folder>
<Placemark><name>Track</name><LineString><coordinates>-117.1,46.77 -117.0,46.7
</coordinates></LineString></Placemark>
</Document></kml>"""


def point(x: object, y: object, **properties: object) -> dict[str, Any]:
    geometry = {'type': 'Point', 'coordinates': [x, y, 770.0]}
    return {'type': 'Feature', 'properties': properties, 'geometry': geometry}


def square(x: float, y: float, side: float) -> list[list[float]]:
    return [[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]


def polygon(*rings: list[list[float]], **properties: object) -> dict[str, Any]:
    geometry = {'type': 'Polygon', 'coordinates': rings}
    return {'type': 'Feature', 'properties': properties or None, 'geometry': geometry}


def collection(*features: object, **more: object) -> str:
    return json.dumps({'type': 'FeatureCollection', 'features': features, **more})


SENSORS = (point(-117.0891, 46.7812, name='a', data_mbit=1.5), point(-117.0875, 46.78, name='b'))


def problems_of(path: Path, content: str | bytes) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        places_of(path, content)
    return [line.removeprefix(str(path)).removeprefix(': ') for line in caught.value.problems]


def test_what_a_map_has_without_a_place_is_a_row_without_one(tmp_path: Path) -> None:
    lost = {'type': 'Feature', 'properties': {'name': 'lost'}, 'geometry': None}
    path, text = tmp_path / 'map.json', collection(lost, *SENSORS)
    assert problems_of(path, text) == [
        'feature 1: lat,lon are empty: must be numbers, or blanks: skip'
    ]
    places = places_of(path, text, ReadOptions(skips_blanks=True))
    assert ids_and_places(places) == HERE
    assert places.notes == ('left out: 1 feature without a place',)


def test_links_of_kml_to_other_maps_are_not_followed_which_is_said(tmp_path: Path) -> None:
    link = '<NetworkLink><Link><href>http://localhost/other.kml</href></Link></NetworkLink>'
    places = places_of(tmp_path / 'map.kml', KML.replace('</Document>', f'{link}</Document>'))
    assert ids_and_places(places) == HERE
    assert 'not followed: 1 link to other maps' in places.notes


@pytest.mark.parametrize('text', ['[1, 2]', '3', '[' * 100_000])
def test_json_that_is_no_map_is_no_table(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match=r'must be GeoJSON|nested too deep'):
        places_of(tmp_path / 'list.geojson', text)


def test_points_of_geojson_are_sensors_and_polygons_the_area_and_no_fly_zones(
    tmp_path: Path,
) -> None:
    field = polygon(square(-117.125, 46.75, 0.0625), square(-117.09375, 46.78125, 0.015625))
    pond = polygon(square(-117.0, 46.75, 0.5), name='No-fly: pond')
    mast = polygon(square(-118.0, 46.75, 0.5), name='mast', nofly=True)
    here = polygon(square(-118.0, 46.75, 0.25), name='field', no_fly='false')
    places = places_of(tmp_path / 'f.geojson', collection(*SENSORS, field, pond, mast))
    assert ids_and_places(places) == HERE
    assert [sensor.data_mbit for sensor in places.sensors] == [1.5, None]
    assert places.boundary == (
        (46.75, -117.125), (46.75, -117.0625), (46.8125, -117.0625), (46.8125, -117.125)
    )  # fmt: skip
    assert [zone[0] for zone in places.no_fly] == [
        (46.75, -117.0), (46.75, -118.0), (46.78125, -117.09375)
    ]  # fmt: skip
    places = places_of(tmp_path / 'f.geojson', collection(*SENSORS, pond, here))
    assert places.boundary is not None
    assert places.boundary[0] == (46.75, -118.0)


def test_geojson_of_a_grid_is_read_by_it(tmp_path: Path) -> None:
    crs = {'type': 'name', 'properties': {'name': 'urn:ogc:def:crs:EPSG::2056'}}
    features = (
        point(2600000, 1200000, id=7),
        point(2600100, 1200000, id=8),
        polygon(square(2599000.0, 1199000.0, 2000.0)),
    )
    places = places_of(tmp_path / 'f.geojson', collection(*features, crs=crs))
    assert places.sensors[0].at == pytest.approx((46.95108, 7.43864), abs=1e-5)
    assert places.boundary is not None
    assert places.boundary[0] == pytest.approx((46.942, 7.4255), abs=1e-3)
    same = places_of(tmp_path / 'g.json', collection(*features), ReadOptions(crs='EPSG:2056'))
    assert (same.sensors[0].at, same.boundary) == (places.sensors[0].at, places.boundary)
    assert problems_of(tmp_path / 'h.geojson', collection(*features[:2])) == [
        'has lat from 1200000 to 1200000 and lon from 2600000 to 2600100, which are no degrees: '
        'must be read by the grid it is of, as crs: EPSG:2056, or as metres of no grid, of a CSV '
        'with the columns x_m, y_m'
    ]


GEOJSON_PROBLEMS = {
    'a list': ('{"a": [}', [':1: is not valid JSON: Expecting value']),
    'not a number': ('{"type": NaN}', ['is not valid JSON: NaN is no number']),
    'deep': ('{"a":' + '[' * 100_000, ['is not valid JSON: nested too deep']),
    'another thing': (
        '{"type": "Topology"}',
        ["type is 'Topology': must be GeoJSON, a FeatureCollection with features"],
    ),
    'no points': (
        collection(polygon(square(1.0, 2.0, 0.5))),
        ['has no sensors: must have at least one feature with a point'],
    ),
    'odd features': (
        collection(point('1', 2), {'type': 'x'}, point(1, 2), polygon([[1]])),
        [
            "feature 1: coordinates is ['1', 2, 770.0]: must be [longitude, latitude]",
            "feature 2: is {'type': 'x'}: must be a Feature",
            'feature 4: coordinates is [1]: must be [longitude, latitude]',
        ],
    ),
    'odd places': (
        collection(point(1, 2, name='a'), point(1, 95, name='b'), point(1, 2, name='')),
        [
            'feature 2: lat is \'95\': must be a number from -89 to 89 deg',
            "feature 3: name is '': must be 1 to 64 printable characters",
        ],
    ),
    'odd corners': (
        collection(*SENSORS, polygon([[1.0, 2.0], [1.0, 200.0], [1.0, 2.0]])),
        [
            "feature 3: lat of corner 2 is '200.0': must be a number from -89 to 89 deg",
                    ],
    ),
    'no polygon': (
        collection(*SENSORS, polygon([[1.0, 2.0], [2.0, 3.0], [3.0, 4.0], [1.0, 2.0]])),
        ['feature 3: has a polygon without three corners that do not lie on one line'],
    ),
    'too many corners': (
        collection(*SENSORS, polygon([[0.001 * n, 0.001 * n * n] for n in range(1002)])),
        ['feature 3: coordinates has 1,002 entries: must have at most 1,000'],
    ),
    'two areas': (
        collection(*SENSORS, polygon(square(1., 2., 1.), name='A'), polygon(square(2., 2., 1.))),
        [
            "features 3 ('A'), 4 have polygons that may be the area: must be one, and the others "
            'no-fly zones by their name, as "no-fly pond"'
        ],
    ),
    'another grid': (
        collection(*SENSORS, crs={'properties': {'name': 'mine'}}),
        ["crs is 'mine': must be a name like urn:ogc:def:crs:EPSG::25832, or left out"],
    ),
}  # fmt: skip


@pytest.mark.parametrize('name', GEOJSON_PROBLEMS)
def test_geojson_that_cannot_be_used_is_refused_by_feature_and_value(
    tmp_path: Path, name: str
) -> None:
    content, problems = GEOJSON_PROBLEMS[name]
    assert problems_of(tmp_path / 'f.geojson', content) == problems


@pytest.mark.parametrize('is_packed', [False, True])
def test_placemarks_of_kml_are_sensors_area_and_no_fly_zones(
    tmp_path: Path, is_packed: bool
) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, 'w', zipfile.ZIP_DEFLATED) as packed:
        packed.writestr('doc.kml', KML)
    places = places_of(tmp_path / 'f', content.getvalue() if is_packed else KML)
    assert ids_and_places(places) == HERE
    assert [sensor.data_mbit for sensor in places.sensors] == [1.5, None]
    assert places.boundary == ((46.77, -117.1), (46.77, -117.08), (46.79, -117.08))
    assert places.no_fly == (((46.78, -117.09), (46.78, -117.08), (46.79, -117.08)),)
    assert places.notes == ('left out: 1 line of the map',)


KML_PROBLEMS = {
    'entities': (
        KML.replace('<kml', '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><kml'),
        'is no XML that is read: it has a document type',
    ),
    'deep': ('<kml>' * 200, 'is no XML that is read: nested too deep: must be at most 100 levels'),
    'cut': (KML[:300], 'is no XML that is read: unclosed token: line 6, column 45'),
    'another thing': ('<html/>', "is XML of 'html': must be KML"),
    'odd place': (
        KML.replace('-117.0891,46.7812,770', 'here'),
        "placemark 1: coordinates are 'here': must be longitude,latitude",
    ),
    'no place': (
        KML.replace('<coordinates>-117.0891,46.7812,770</coordinates>', ''),
        'placemark 1: has a Point without coordinates',
    ),
    'number in words': (
        KML.replace('46.7812', 'x'),
        "placemark 1: lat is 'x': must be a number from -89 to 89 deg",
    ),
}


@pytest.mark.parametrize('name', KML_PROBLEMS)
def test_kml_that_cannot_be_used_is_refused_by_placemark_and_value(
    tmp_path: Path, name: str
) -> None:
    content, problem = KML_PROBLEMS[name]
    assert problems_of(tmp_path / 'f.kml', content) == [problem]


def workbook(**sheets: list[list[object]]) -> bytes:
    book, content = openpyxl.Workbook(), io.BytesIO()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(content)
    return content.getvalue()


ROWS: list[list[object]] = [
    ['Loggers of 2025'], [], ['Station', 'Latitude', 'Longitude', 'Since', 'Latitude (map)'],
    ['a', 46.7812, -117.0891, '2025-04-13'], [None], ['b', '46,78', -117.0875, None, 'x'],
]  # fmt: skip


def test_the_sheet_of_a_workbook_that_says_where_things_are_is_read(tmp_path: Path) -> None:
    places = places_of(tmp_path / 'list.xlsx', workbook(About=[['by', 'me']], Data=ROWS))
    assert ids_and_places(places) == HERE
    assert places.notes == (
        "of 2 sheets, 'Data' is read",
        'the names of columns stand in row 3',
        'numbers have decimal commas',
        "columns not read: 'Since', 'Latitude (map)'",
    )


def test_a_workbook_is_refused_by_row_column_and_value(tmp_path: Path) -> None:
    rows = [*ROWS, [3.0, 95, -117.0, None], ['c', None, None]]
    assert problems_of(tmp_path / 'list.xlsx', workbook(Data=rows)) == [
        "row 7: Latitude is '95': must be a number from -89 to 89 deg",
        'row 8: Latitude,Longitude are empty: must be numbers, or blanks: skip',
    ]
    assert problems_of(tmp_path / 'list.xlsx', workbook(Data=[])) == [
        'is empty: must have a sheet with a table'
    ]


OTHERS = {
    'cut': (workbook(Data=ROWS)[:3000], 'is no packed file: File is not a zip file'),
    'of something': (zip_of('a.txt', b'x'), 'is no workbook that can be read: '),
    'bomb': (
        zip_of('xl/workbook.xml', bytes(1_000)).replace(
            (1_000).to_bytes(4, 'little'), (300_000_000).to_bytes(4, 'little')
        ),
        'has 300,000,000 bytes in 1 files unpacked: must have at most 268,435,456 in 10,000',
    ),
    'OpenDocument': (
        zip_of('mimetype', b'application/vnd.oasis.opendocument.spreadsheet'),
        'is OpenDocument: must be saved as .xlsx or CSV',
    ),
    'old workbook': (b'\xd0\xcf\x11\xe0\xa1\xb1', 'is an old workbook (.xls): must be saved as'),
    'shapefile': (b'\x00\x00\x27\x0a' + bytes(100), 'is a shapefile: must be exported as GeoJSON'),
    'picture': (b'\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR', ':2: must be text, but is Windows-1252'),
}


@pytest.mark.parametrize('name', OTHERS)
def test_what_is_no_list_of_places_is_refused_by_what_it_is(tmp_path: Path, name: str) -> None:
    content, problem = OTHERS[name]
    [line] = problems_of(tmp_path / 'list', content)
    assert line.startswith(problem)


def test_a_map_whose_points_begin_with_the_latitude_is_not_taken_for_metres(
    tmp_path: Path,
) -> None:
    text = collection(point(46.7812, -117.0891, name='a'), point(46.78, -117.0875, name='b'))
    assert problems_of(tmp_path / 'f.json', text) == [
        'has lat from -117.0891 to -117.0875 and lon from 46.78 to 46.7812, which are longitudes '
        'and latitudes: must be written longitude first'
    ]


def test_polygons_alone_are_read_of_maps_and_of_corners_in_a_table(tmp_path: Path) -> None:
    path, corners = tmp_path / 'area', ((46.75, -117.125), (46.75, -117.0), (46.8125, -117.0))
    ring = [[lon, lat] for lat, lon in (*corners, corners[0])]
    path.write_text(collection(polygon(ring, name='no-fly'), polygon(ring), *SENSORS))
    assert read_polygons(path, ReadOptions()) == (True, (corners, corners), (), (True, False))
    path.write_text('lat,lon\n' + ''.join(f'{lat},{lon}\n' for lat, lon in corners))
    assert read_polygons(path, ReadOptions()) == (True, (corners,), (), (False,))
    path.write_text('x_m;y_m\n0;0\n0;10,5\n10;10\n0;0\n')
    metres = ((0.0, 0.0), (0.0, 10.5), (10.0, 10.0))
    assert read_polygons(path, ReadOptions()) == (False, (metres,), (), (False,))
    for text, problem in (
        (
            'x_m,y_m\n1,2\n3,4\n1,2\n',
            'has a polygon of 3 corners: must have 3 to 1,000 that',
        ),
        (collection(*SENSORS), 'has no polygon: must have at least one'),
    ):
        path.write_text(text)
        with pytest.raises(ConfigError, match=problem):
            read_polygons(path, ReadOptions())


def test_a_map_in_metres_is_refused_once_with_what_would_help(tmp_path: Path) -> None:
    path = tmp_path / 'map'
    ring = [[500.0, 0.0], [900.0, 0.0], [900.0, 800.0], [500.0, 0.0]]
    path.write_text(collection(polygon(ring)))
    for reading in (read, read_polygons):
        with pytest.raises(ConfigError) as raised:
            reading(path, ReadOptions())
        [line] = raised.value.problems
        assert 'has corners like 500.0, 0.0: must be longitude, latitude [deg], or say' in line
        assert 'a CSV with the columns x_m, y_m' in line


def test_outlines_of_a_list_are_those_of_the_area_and_zones_of_both_count(
    tmp_path: Path,
) -> None:
    pond = polygon(square(-117.085, 46.785, 0.0005), name='pond (no fly)')
    (tmp_path / 'f.geojson').write_text(
        collection(*SENSORS, polygon(square(-117.09, 46.78, 0.004)), pond)
    )
    site = tmp_path / 'site.yaml'
    area = 'rows: 6, columns: 4, cell_size_m: 100.0, altitude_m: 80.0'
    text = f'extends: paper_10x10\narea: {{{area}}}\ndemand: {{cell_share: all}}\n' + (
        'sensors: {kind: csv, file: f.geojson, origin: [46.7790, -117.0905]}\n'
        'fleet: {default: {start: {cell: [3, 2]}, home: {cell: [3, 2]}}}\n'
    )
    site.write_text(text)
    read_area = load(site).area
    assert read_area.boundary is not None
    # M(46.78 deg) x 0.0010 deg = 111.17 m; N cos(46.78 deg) x 0.0005 deg = 38.18 m
    assert read_area.boundary[0] == pytest.approx((38.18, 111.17), abs=0.02)
    assert [len(zone) for zone in read_area.no_fly or ()] == [4]
    own = '[[0, 0], [400, 0], [400, 600], [0, 600]]'
    site.write_text(text.replace('rows: 6', f'boundary: {own}, rows: 6'))
    with pytest.raises(
        ConfigError,
        match=r'site\.yaml:2: area\.boundary is given: must be left out, as .*f\.geojson gives',
    ):
        load(site)
    site.write_text(text.replace('rows: 6', 'no_fly: [[[0, 0], [50, 0], [50, 50]]], rows: 6'))
    own_zone = (0.0, 0.0), (50.0, 0.0), (50.0, 50.0)
    assert load(site).area.no_fly == (own_zone, *(read_area.no_fly or ()))


def test_a_map_may_have_a_zone_for_each_cell_but_not_more(tmp_path: Path) -> None:
    zones = [
        polygon(square(-117.085 + 1e-4 * number, 46.785, 5e-5), name='no-fly tree')
        for number in range(4097)
    ]
    path = tmp_path / 'orchard.geojson'
    path.write_text(collection(*SENSORS, *zones[1:]))
    assert len(read(path, ReadOptions()).no_fly) == 4096
    path.write_text(collection(*SENSORS, *zones))
    with pytest.raises(ConfigError, match=r'orchard\.geojson: has 4,097 no-fly zones with'):
        read(path, ReadOptions())


RING = '0,46 1,46 1,47 0,46'
KML_RING = (
    '<Polygon><outerBoundaryIs><LinearRing><coordinates>{}</coordinates></LinearRing>'
    '</outerBoundaryIs></Polygon>'
)
LARGE = {
    'GeoJSON of many polygons': (
        collection({'type': 'Feature', 'geometry': {
            'type': 'MultiPolygon', 'coordinates': [[square(0.0, 46.0, 1.0)]] * 1_000
        }}, *[polygon(square(0.0, 46.0, 1.0))] * 3_098),
        'has more than 4,097 polygons and holes, or 105,097 corners of them: must have at most ',
    ),
    'GeoJSON of many corners': (
        collection(*[polygon([[0, 46], [1, 46], *[[1, 47]] * 997, [0, 46]])] * 106),
        'has more than 4,097 polygons and holes, or 105,097 corners of them: must have at most ',
    ),
    'GeoJSON of many values': (
        f'{{"a": [{"[]," * 2_000_000}1], "type": "FeatureCollection", "features": []}}',
        'is too large: must have at most 4,000,000 values',
    ),
    'KML of many polygons': (
        f'<kml><Placemark><MultiGeometry>{KML_RING.format(RING) * 4_098}</MultiGeometry>'
        '</Placemark></kml>',
        'has more than 4,097 polygons and holes, or 105,097 corners of them: must have at most ',
    ),
}  # fmt: skip


@pytest.mark.parametrize('name', LARGE)
def test_a_map_of_too_many_polygons_or_corners_is_one_line(tmp_path: Path, name: str) -> None:
    content, problem = LARGE[name]
    (tmp_path / 'map.json').write_text(content)
    for reading in (read, read_polygons):
        with pytest.raises(ConfigError) as raised:
            reading(tmp_path / 'map.json', ReadOptions())
        [line] = raised.value.problems
        assert problem in line


def test_a_line_of_a_map_may_be_long_but_not_the_polygon_that_it_closes(tmp_path: Path) -> None:
    path, way = tmp_path / 'map.kml', '0,46 1,46 1,47 ' * 2_000
    line = f'<Placemark><LineString><coordinates>{way}</coordinates></LineString></Placemark>'
    path.write_text(f'<kml>{line}<Placemark>{KML_RING.format(RING)}</Placemark></kml>')
    assert len(read_polygons(path, ReadOptions()).polygons) == 1
    path.write_text(f'<kml>{line.replace(way, way + "0,46")}</kml>')
    with pytest.raises(ConfigError, match='has a polygon of more than 1,000 corners'):
        read_polygons(path, ReadOptions())

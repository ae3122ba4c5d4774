"""Maps and workbooks of sensors that are nearly right."""

from functools import cache
import io
import json
from typing import Any
import zipfile

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn
import openpyxl
from scenario_texts import broken, changed, changes


def _feature(kind: str, coordinates: object, **properties: object) -> dict[str, Any]:
    geometry = {'type': kind, 'coordinates': coordinates}
    return {'type': 'Feature', 'properties': properties, 'geometry': geometry}


_RING = [[12.799, 54.999], [12.802, 54.999], [12.802, 55.002], [12.799, 54.999]]
_MAP = {
    'type': 'FeatureCollection',
    'crs': {'type': 'name', 'properties': {'name': 'urn:ogc:def:crs:OGC:1.3:CRS84'}},
    'features': [
        _feature('Point', [12.8, 55.001, 3.5], name='a', data_mbit=1.5),
        _feature('MultiPoint', [[12.801, 55.0]], name='b', data_mbit=0.5),
        _feature('Polygon', [_RING], name='field'),
        _feature('MultiPolygon', [[_RING]], name='no-fly'),
        {
            'type': 'Feature',
            'geometry': {
                'type': 'GeometryCollection',
                'geometries': [{'type': 'LineString', 'coordinates': _RING}],
            },
        },
    ],
}
_KML = """<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2">
<Folder><name>Loggers</name><Placemark><name>a</name><ExtendedData><Data name="data_mbit">
<value>1.5</value></Data><SimpleData name="x">3</SimpleData></ExtendedData><Point><coordinates>
12.8,55.001,3</coordinates></Point></Placemark><Placemark><name>b</name><MultiGeometry><Point>
<coordinates>12.801,55.0</coordinates></Point></MultiGeometry></Placemark></Folder><Placemark>
<name>field</name><Polygon><outerBoundaryIs><LinearRing><coordinates>12.799,54.999 12.802,54.999
12.802,55.002 12.799,54.999</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
</kml>"""
_WORDS = (
    'Point', 'Polygon', 'coordinates', 'Placemark', 'name', 'Folder', 'LinearRing', 'kml', 'Data',
    '12.8', '55.001', ',', ' ', '>', '</', '"', '?>',
)  # fmt: skip
_INSTEAD = (
    '', 'x', '&lt;', '&a;', '<a>', '</kml>', '<!DOCTYPE a>', '<![CDATA[1,2]]>', '-200', 'nan',
    '1e9', '\x00', '\u00d6', '<!--', ']]>', ',,', 'MultiGeometry', 'innerBoundaryIs', 'no fly',
    '<Folder>',
)  # fmt: skip


@st.composite
def geojson(draw: DrawFn) -> bytes:
    """A map whose values are changed here and there."""
    document = changed(_MAP, draw(st.lists(changes(), max_size=4)))
    try:
        text = json.dumps(document)
    except ValueError:  # Python writes no number of so many digits
        text = '{"type": ' + '9' * 5_000 + '}'
    return text.encode('utf-8', 'surrogatepass')


@st.composite
def kml(draw: DrawFn) -> bytes:
    """A map some of whose words are others."""
    text = _KML
    for _ in range(draw(st.integers(0, 4))):
        word = draw(st.sampled_from(_WORDS))
        parts = text.split(word)
        place = draw(st.integers(1, max(1, len(parts) - 1)))
        instead = draw(st.sampled_from(_INSTEAD))
        text = instead.join((word.join(parts[:place]), word.join(parts[place:])))
    return text.encode()


@cache
def _workbook() -> tuple[tuple[str, bytes], ...]:
    """What is packed in a workbook."""
    book, content = openpyxl.Workbook(), io.BytesIO()
    for row in (('id', 'lat', 'lon', 'note'), ('a', 55.001, 12.8), ('b', '55,0', 12.801, True)):
        book.active.append(row)
    book.save(content)
    with zipfile.ZipFile(content) as packed:
        return tuple((name, packed.read(name)) for name in packed.namelist())


@st.composite
def packed(draw: DrawFn) -> bytes:
    """A workbook, or a map, one of whose parts is broken or gone."""
    parts = _workbook() if draw(st.integers(0, 3)) else (('doc.kml', draw(kml())),)
    chosen = draw(st.sampled_from([name for name, _ in parts if 'theme' not in name]))
    how = draw(st.sampled_from(['broken', 'broken', 'gone', 'empty', 'whole']))
    content = io.BytesIO()
    with zipfile.ZipFile(content, 'w') as file:
        for name, part in parts:
            if name != chosen or how == 'whole':
                file.writestr(name, part)
            elif how != 'gone':
                file.writestr(name, draw(broken(part)) if how == 'broken' else b'')
    return content.getvalue()


@st.composite
def maps(draw: DrawFn) -> bytes:
    """A map or a workbook, now and then with bytes that are changed."""
    content = draw(st.one_of(geojson(), geojson(), kml(), packed()))
    return draw(broken(content)) if draw(st.integers(0, 5)) == 0 else content

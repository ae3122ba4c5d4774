"""Lists of sensors of any kind are refused in plain lines, or their sites are flown over."""

from collections.abc import Iterator
import json
from pathlib import Path
import tempfile

from fuzzing import fuzzed, memory_folder
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn
from map_files import maps
import pytest
from scenario_texts import broken, check_scenario, FLEET, yaml_of
from tiny_world import tiny

_HEADERS = {
    'x_m,y_m': (('10', '190'), ('10.5', '20'), ('1e2', '0')),
    'easting_m,northing_m': (
        ('361469', '6154543'), ('361500.25', '6154600'), ('361469', '6154700')
    ),
    'lat,lon': (('55.001', '12.8'), ('55', '12.801'), ('55.0005', '12.8005')),
}  # fmt: skip
_CELLS = (
    '', ' ', '0', '-0', '-1', '1', '1e3', '5e-324', '1e-310', '1e308', '1e400', '1_0', '0x1f',
    'nan', '-inf', 'inf', '1,5', '"1,5"', '"', '"a""b"', '1;2', '1\t2', '90', '-90', '89', '180',
    '-180.1', '100000', '900000', '1e7', '6154543', 'one', '\u0661', '\u2212', '55\u00b0',
    'x' * 70, '1' * 400, 'a\nb', '"a\nb"', '\x00', '\x1b[2J', '[/b]', 'north gate', '2024-01-01',
    '#', "'", '55.0, 12.8', '"55.0, 12.8"', 'POINT (12.8 55)', '55\u00b030\'N', '1.234,5', '16s',
)  # fmt: skip
_COLUMNS = (
    'sensor_id', 'id', 'x_m', 'y_m', 'lat', 'lon', 'easting_m', 'northing_m', 'data_mbit', 'note',
    '', ' lat ', 'LAT', 'lng', '"lat"', 'x_m\u00b2', 'z' * 300,
    'geo_point_2d', 'WKT', 'UTM zone', 'x', 'y', 'Rechtswert', 'Breite',
)  # fmt: skip
_ENDS = ('\n', '\r\n', '\r', '\n\n', ',\n', ';\n')
_HEADS = ('',) * 30 + ('\ufeff', '\n', '# sensors\n', 'sep=;\n', '\x00')
_SETTINGS = (
    'file: s.csv, origin: auto', 'file: s.csv, origin: auto', 'file: s.csv, origin: [0, 0]',
    'file: s.csv, origin: [55, 12.8]', 'file: s.csv, origin: [361400, 6154500]',
    'file: s.csv, origin: [1e7, -1e7]', 'file: s.csv, origin: [.nan, 0]', 'file: s.csv',
    'file: ../s.csv, origin: auto', 'file: ., origin: auto', 'file: "", origin: auto',
    'file: [s.csv], origin: auto', 'file: s.csv, origin: auto, columns: 5',
    'file: s.csv, origin: auto, columns: {id: note, lat: y_m}',
    'file: s.csv, origin: auto, crs: "EPSG:25833"', 'file: s.csv, origin: auto, crs: UTM 33N',
    'file: s.csv, origin: [361400, 6154500], crs: UTM 33N', 'file: s.csv, origin: auto, crs: x',
    'file: s.csv, origin: auto, crs: "EPSG:4258"', 'file: s.csv, origin: auto, doubles: first',
    'file: s.csv, origin: auto, doubles: last, blanks: skip',
    'file: s.csv, origin: auto, doubles: keep, blanks: refuse',
    'file: s.csv, origin: auto, doubles: 1',
)  # fmt: skip
_ENCODINGS = ('utf-8',) * 30 + ('utf-16', 'latin-1', 'utf-8-sig', 'cp1252')


@st.composite
def tables(draw: DrawFn) -> bytes:
    """A sensor file that is nearly right."""
    columns = draw(st.sampled_from([*_HEADERS]))
    has_data = draw(st.booleans())
    header = ['sensor_id', *columns.split(','), *(['data_mbit'] if has_data else [])]
    rows = [
        [f's{number}', *place, *(['1.5'] if has_data else [])]
        for number, place in enumerate(_HEADERS[columns])
    ]
    rows = rows[: draw(st.integers(0, 3))] if draw(st.integers(0, 9)) == 0 else rows
    for _ in range(draw(st.integers(0, 3))):
        _change(draw, header, rows)
    separator = draw(st.sampled_from([','] * 30 + [';', '\t', '|', ', ']))
    end = draw(st.sampled_from(['\n'] * 20 + [*_ENDS]))
    lines = [separator.join(cells) for cells in (header, *rows)]
    text = draw(st.sampled_from(_HEADS)) + end.join(lines) + draw(st.sampled_from(['', '\n']))
    content = text.encode(draw(st.sampled_from(_ENCODINGS)), 'replace')
    return draw(broken(content)) if draw(st.integers(0, 5)) == 0 else content


def _change(draw: DrawFn, header: list[str], rows: list[list[str]]) -> None:
    how = draw(st.sampled_from(['cell', 'cell', 'cell', 'column', 'drop', 'add', 'twice', 'more']))
    row = draw(st.sampled_from(rows)) if rows else header
    place = draw(st.integers(0, len(row) - 1)) if row else 0
    match how:
        case 'column' if header:
            header[place % len(header)] = draw(st.sampled_from(_COLUMNS))
        case 'drop' if row:
            del row[place]
        case 'add':
            row.append(draw(st.sampled_from(_CELLS)))
        case 'twice':
            rows.append(row)
        case 'more':
            header.insert(place, draw(st.sampled_from(_COLUMNS)))
            for each in rows:
                each.insert(place, draw(st.sampled_from(_CELLS)))
        case _ if row:
            cells = st.sampled_from(_CELLS) | st.floats().map(str) | st.text(max_size=4)
            row[place] = draw(cells)


@pytest.fixture(scope='module')
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(dir=memory_folder('site')) as name:
        folder, document = Path(name), json.loads(json.dumps(tiny(*FLEET).as_mapping()))
        del document['sensors'], document['demand']
        (folder / 'base.yaml').write_bytes(yaml_of(document))
        check_site(folder, b'sensor_id,x_m,y_m\na,1,2\n', _SETTINGS[0], 'all')  # compiles kernels
        yield folder


def check_site(folder: Path, content: bytes, settings: str, cell_share: str) -> None:
    (folder / 's.csv').write_bytes(content)
    amounts = 'csv' if len(content) % 2 else '[0.1, 1.0]'
    text = f'extends: ./base.yaml\nsensors: {{kind: csv, {settings}}}\n'
    demand = f'demand: {{cell_share: {cell_share}, data_mbit: {amounts}}}\n'
    (folder / 'site.yaml').write_text(text + demand)
    check_scenario(folder / 'site.yaml')


@fuzzed(
    share=0.75,
    content=tables(),
    settings=st.sampled_from(_SETTINGS[:2] * 8 + _SETTINGS),
    cell_share=st.sampled_from(['all', '0.5', '1']),
)
def test_a_sensor_file_is_refused_in_plain_lines_or_flown_over(
    folder: Path, content: bytes, settings: str, cell_share: str
) -> None:
    check_site(folder, content, settings, cell_share)


@fuzzed(
    share=0.25,
    content=maps(),
    settings=st.sampled_from(_SETTINGS[:2] * 16 + _SETTINGS),
    cell_share=st.sampled_from(['all', '0.5', '1']),
)
def test_a_map_or_workbook_of_sensors_is_refused_in_plain_lines_or_flown_over(
    folder: Path, content: bytes, settings: str, cell_share: str
) -> None:
    check_site(folder, content, settings, cell_share)

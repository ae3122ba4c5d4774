"""Files that hold lists of places: which kind one is, by its first bytes, and what it says."""

from pathlib import Path

from uav_collect.config.yaml_text import shown_path
from uav_collect.errors import ConfigError
from uav_collect.files import read_bounded
from uav_collect.scenario.geojson import map_of_geojson
from uav_collect.scenario.kml import map_of_kml, map_of_kmz
from uav_collect.scenario.shapes import MapFile
from uav_collect.scenario.spreadsheets import sheet_of_workbook
from uav_collect.scenario.tables import Known, Sheet, sheet_of_text, text_of

MAX_BYTES = 64 * 2**20
_READ = 'CSV, xlsx, GeoJSON or KML'
_JSON = frozenset({'.json', '.geojson'})

_PACKED = b'PK\x03\x04'
_OTHERS = {  # what cannot be read, by its first bytes: what it is, and what to do
    b'\xd0\xcf\x11\xe0': 'an old workbook (.xls): must be saved as .xlsx or CSV',
    b'\x00\x00\x27\x0a': 'a shapefile: must be exported as GeoJSON',
    b'SQLite format 3': f'a database (GeoPackage?): must be exported as {_READ}',
    b'%PDF': f'a PDF: must be {_READ}',
    b'{\\rtf': f'RTF: must be {_READ}',
    b'\x1f\x8b': f'packed by gzip: must be unpacked, {_READ}',
}
_MIMETYPE = b'mimetypeapplication/vnd.oasis.opendocument'
_MIMETYPE_AT = 30  # where a packed OpenDocument says what it is


def open_list(path: Path, known: Known) -> Sheet | MapFile:
    """Read a file of any kind that is read: it holds a table or a map.

    Args:
        known: how a table's header is recognised.

    Raises:
        ConfigError: it is of another kind, too large, or broken.
        MissingPackageError: a package that its kind needs is missing.
    """
    content = _content_of(path)
    for head, what in _OTHERS.items():
        if content.startswith(head):
            raise ConfigError(f'{shown_path(path)}: is {what}')
    if content.startswith(_PACKED):
        return _packed(path, content, known)
    text = text_of(path, content)
    begins = text.lstrip()[:1]
    if begins == '<':
        return map_of_kml(path, content)
    if begins == '{' or path.suffix.lower() in _JSON:
        return map_of_geojson(path, text)
    return sheet_of_text(path, text, known)


def _content_of(path: Path) -> bytes:
    try:
        return read_bounded(path, MAX_BYTES)
    except OSError as error:
        raise ConfigError(f'{shown_path(path)}: cannot be read: {error.strerror}') from error


def _packed(path: Path, content: bytes, known: Known) -> Sheet | MapFile:
    if content.startswith(_MIMETYPE, _MIMETYPE_AT):
        raise ConfigError(f'{shown_path(path)}: is OpenDocument: must be saved as .xlsx or CSV')
    if b'.kml' in content.lower() and b'xl/workbook' not in content:
        return map_of_kmz(path, content)
    return sheet_of_workbook(path, content, known)

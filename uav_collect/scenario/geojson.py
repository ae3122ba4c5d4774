"""Maps as GeoJSON (RFC 7946, and its older form that names another grid)."""

from collections.abc import Iterator
import json
from pathlib import Path
import re
from typing import Any, NoReturn

from uav_collect.config.yaml_text import shown, shown_path
from uav_collect.errors import ConfigError, counted
from uav_collect.limits import MAX_CORNERS
from uav_collect.scenario.shapes import (
    check_names,
    check_number,
    Corner,
    Feature,
    MapFile,
    Ring,
    RingCount,
)
from uav_collect.scenario.tables import where_of

_UNIT = 'feature'
_GEOMETRIES = ('Point', 'MultiPoint', 'Polygon', 'MultiPolygon', 'GeometryCollection')
_LINES = ('LineString', 'MultiLineString')
_CRS = re.compile(r'(?:urn:ogc:def:crs:)?(EPSG):(?:[0-9.]*:)?([1-9][0-9]{0,5})', re.IGNORECASE)
_WGS84 = re.compile(r'(?:urn:ogc:def:crs:)?(?:OGC:(?:1\.3)?:?CRS84|EPSG::?4326)', re.IGNORECASE)
_MAX_VALUES = 4_000_000  # by the signs that begin and part them: 300 MB of memory
_MAX_DEPTH = 5  # of collections in collections


class _OddError(Exception):
    """Something in a feature that is not read."""


def map_of_geojson(path: Path, text: str) -> MapFile:
    """Read a map.

    Raises:
        ConfigError: a line for each feature that cannot be read.
    """
    document = _document(path, text)
    crs = _crs_of(path, document)
    features, problems, n_lines, count = [], [], 0, RingCount(path)
    for number, entry in enumerate(_entries(path, document), start=1):
        try:
            feature, n_lines_of_it = _feature(number, entry, count)
        except _OddError as error:
            problems.append(f'{where_of(path, _UNIT, number)}: {error}')
            continue
        n_lines += n_lines_of_it
        features.append(feature)
    if problems:
        raise ConfigError(*problems)
    notes = (f'left out: {counted(n_lines, "line")} of the map',) if n_lines else ()
    return check_names(MapFile(path, _UNIT, tuple(features), crs, notes))


def _document(path: Path, text: str) -> dict[str, Any]:
    if sum(map(text.count, '[{,')) > _MAX_VALUES:
        what = f'is too large: must have at most {_MAX_VALUES:,} values'
        raise ConfigError(f'{shown_path(path)}: {what}')
    try:
        document = json.loads(text, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        what = f'is not valid JSON: {error.msg}'
        raise ConfigError(f'{shown_path(path)}:{error.lineno}: {what}') from error
    except (RecursionError, ValueError) as error:
        what = 'nested too deep' if isinstance(error, RecursionError) else str(error)
        raise ConfigError(f'{shown_path(path)}: is not valid JSON: {what}') from error
    if not isinstance(document, dict):
        raise ConfigError(f'{shown_path(path)}: must be GeoJSON, a FeatureCollection')
    return document


def _no_number(word: str) -> NoReturn:
    raise ValueError(f'{word} is no number')


def _entries(path: Path, document: dict[str, Any]) -> list[Any]:
    kind, features = document.get('type'), document.get('features')
    if kind == 'FeatureCollection' and isinstance(features, list):
        check_number(path, len(features), _UNIT)
        return features
    if kind == 'Feature':
        return [document]
    if kind in (*_GEOMETRIES, *_LINES):
        return [{'type': 'Feature', 'geometry': document}]
    raise ConfigError(
        f'{shown_path(path)}: type is {shown(kind)}: must be GeoJSON, a FeatureCollection with '
        'features'
    )


def _crs_of(path: Path, document: dict[str, Any]) -> str:
    """The grid that the older form names; '' for WGS84."""
    crs = document.get('crs')
    if crs is None:
        return ''
    properties = crs.get('properties') if isinstance(crs, dict) else None
    name = properties.get('name') if isinstance(properties, dict) else None
    if isinstance(name, str) and _WGS84.fullmatch(name):
        return ''
    found = _CRS.fullmatch(name) if isinstance(name, str) else None
    if not found:
        raise ConfigError(
            f'{shown_path(path)}: crs is {shown(name)}: must be a name like '
            'urn:ogc:def:crs:EPSG::25832, or left out'
        )
    return f'EPSG:{found[2]}'


def _feature(number: int, entry: object, count: RingCount) -> tuple[Feature, int]:
    if not isinstance(entry, dict) or entry.get('type') != 'Feature':
        raise _OddError(f'is {shown(entry)}: must be a Feature')
    properties = entry.get('properties') or {}
    if not isinstance(properties, dict):
        raise _OddError(f'properties is {shown(properties)}: must be a mapping')
    texts = {str(name): _text(value) for name, value in properties.items()}
    if 'id' in entry:
        texts.setdefault('id', _text(entry['id']))
    points: list[Corner] = []
    polygons: list[tuple[Ring, ...]] = []
    n_lines = 0
    for kind, places in _geometries(entry.get('geometry'), 0):
        match kind:
            case 'Point':
                points.append(_corner(places))
            case 'MultiPoint':
                points += map(_corner, _short(places))
            case 'Polygon':
                polygons.append(count.counted(_rings(places)))
            case 'MultiPolygon':
                polygons += (count.counted(_rings(it)) for it in _short(places))
            case _:
                n_lines += 1
    read = Feature(
        number=number,
        properties=texts,
        points=tuple(points),
        polygons=tuple(polygons),
        has_place=entry.get('geometry') is not None,
    )
    return read, n_lines


def _geometries(geometry: object, depth: int) -> Iterator[tuple[str, object]]:
    """Each geometry that is no collection: its type and coordinates."""
    if geometry is None:
        return
    kind = geometry.get('type') if isinstance(geometry, dict) else None
    if not isinstance(geometry, dict) or kind not in (*_GEOMETRIES, *_LINES):
        allowed = ', '.join((*_GEOMETRIES, *_LINES))
        raise _OddError(f'geometry is {shown(kind or geometry)}: must be one of {allowed}')
    if kind != 'GeometryCollection':
        yield kind, geometry.get('coordinates')
        return
    if depth == _MAX_DEPTH:
        raise _OddError(f'geometry is nested too deep: must be at most {_MAX_DEPTH} collections')
    for each in _list(geometry.get('geometries')):
        yield from _geometries(each, depth + 1)


def _rings(places: object) -> tuple[Ring, ...]:
    rings = tuple(tuple(map(_corner, _short(ring))) for ring in _short(places))
    if not rings:
        raise _OddError('coordinates is []: must have a ring of corners')
    return rings


def _corner(place: object) -> Corner:
    numbers = place[:2] if isinstance(place, list) else []
    if len(numbers) != 2 or any(
        isinstance(it, bool) or not isinstance(it, int | float) for it in numbers
    ):
        raise _OddError(f'coordinates is {shown(place)}: must be [longitude, latitude]')
    return _text(numbers[0]), _text(numbers[1])


def _short(value: object) -> list[Any]:
    """A list of no more than a polygon may have."""
    places = _list(value)
    if len(places) > MAX_CORNERS + 1:  # the first corner is there twice
        raise _OddError(
            f'coordinates has {len(places):,} entries: must have at most {MAX_CORNERS:,}'
        )
    return places


def _list(value: object) -> list[Any]:
    if not isinstance(value, list):
        raise _OddError(f'coordinates is {shown(value)}: must be a list')
    return value


def _text(value: object) -> str:
    """A value as text; nothing for what is no plain value."""
    if value is None or isinstance(value, dict | list):
        return ''
    if isinstance(value, bool):
        return str(value).lower()
    try:
        return str(value).strip()
    except ValueError:  # Python writes no number of so many digits
        return 'a number of thousands of digits'

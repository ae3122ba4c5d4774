"""Maps as KML, and packed as KMZ: placemarks, with the folders that they lie in."""

from collections.abc import Iterator
import io
from pathlib import Path
from typing import Any
from xml.etree import ElementTree  # nosec B405
import zipfile
import zlib

from uav_collect.config.packages import late_packages
from uav_collect.config.yaml_text import shown_path
from uav_collect.errors import ConfigError, counted, in_one_line, reason_of
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
from uav_collect.scenario.spreadsheets import check_packed
from uav_collect.scenario.tables import FOLDER, where_of

_UNIT = 'placemark'
_MAX_DEPTH = 100
_MAX_ELEMENTS = 1_000_000
_MAX_WORDS = MAX_CORNERS + 1  # of a polygon: its first corner is there twice

Element = ElementTree.Element  # what is parsed is parsed by defusedxml


class _OddError(Exception):
    """Something in a placemark that is not read."""


def map_of_kmz(path: Path, content: bytes) -> MapFile:
    """Read the map in a KMZ file.

    Raises:
        ConfigError: it holds none, or one that cannot be read.
    """
    check_packed(path, content)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            name = next(it for it in packed.namelist() if it.lower().endswith('.kml'))
            text = packed.read(name)
    except (StopIteration, zipfile.BadZipFile, zlib.error, *_UNPACKING) as error:
        what = in_one_line(reason_of(error), 200)
        raise ConfigError(f'{shown_path(path)}: has no KML that can be read: {what}') from error
    return map_of_kml(path, text)


_UNPACKING = (EOFError, NotImplementedError, OSError, RuntimeError, ValueError)


def map_of_kml(path: Path, content: bytes) -> MapFile:
    """Read a map.

    Raises:
        ConfigError: a line for each placemark that cannot be read.
        MissingPackageError: defusedxml is missing.
    """
    root = _root(path, content)
    if _tag(root) != 'kml':
        raise ConfigError(f'{shown_path(path)}: is XML of {_tag(root)[:50]!r}: must be KML')
    features, problems, n_lines, count = [], [], 0, RingCount(path)
    placemarks = [*_placemarks(root)]
    check_number(path, len(placemarks), _UNIT)
    for number, (placemark, folders) in enumerate(placemarks, start=1):
        try:
            feature, n_lines_of_it = _feature(number, placemark, folders, count)
        except _OddError as error:
            problems.append(f'{where_of(path, _UNIT, number)}: {error}')
            continue
        n_lines += n_lines_of_it
        features.append(feature)
    if problems:
        raise ConfigError(*problems)
    notes = [f'left out: {counted(n_lines, "line")} of the map'] if n_lines else []
    n_links = sum(_tag(element) == 'NetworkLink' for element in root.iter())
    if n_links:
        notes.append(f'not followed: {counted(n_links, "link")} to other maps')
    return check_names(MapFile(path, _UNIT, tuple(features), '', tuple(notes)))


def _root(path: Path, content: bytes) -> Element:
    with late_packages():
        import defusedxml
        import defusedxml.ElementTree
    parser = defusedxml.ElementTree.XMLParser(target=_Builder(), forbid_dtd=True)
    try:
        parser.feed(content)
        root: Element = parser.close()
    except (ElementTree.ParseError, _OddError, LookupError, ValueError) as error:
        # DefusedXmlException is a ValueError
        is_dtd = isinstance(error, defusedxml.DefusedXmlException)
        what = 'it has a document type' if is_dtd else in_one_line(reason_of(error), 200)
        raise ConfigError(f'{shown_path(path)}: is no XML that is read: {what}') from error
    return root


class _Builder(ElementTree.TreeBuilder):
    """Builds a tree that is not too deep and not too large."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = self._n_elements = 0

    def start(self, tag: str, attrs: dict[Any, Any], /) -> Element:
        """Begin an element.

        Raises:
            _OddError: it is one too many.
        """
        self._depth += 1
        self._n_elements += 1
        if self._depth > _MAX_DEPTH:
            raise _OddError(f'nested too deep: must be at most {_MAX_DEPTH} levels')
        if self._n_elements > _MAX_ELEMENTS:
            raise _OddError(f'too large: must have at most {_MAX_ELEMENTS:,} elements')
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> Element:
        """End an element."""
        self._depth -= 1
        return super().end(tag)


def _tag(element: Element) -> str:
    """The name of an element without its namespace: KML has had several."""
    return str(element.tag).rpartition('}')[2]


def _placemarks(root: Element) -> Iterator[tuple[Element, tuple[str, ...]]]:
    """Each placemark, in the order of the file, with the names of the folders around it."""
    waiting: list[tuple[Element, tuple[str, ...]]] = [(root, ())]
    while waiting:
        element, folders = waiting.pop()
        if _tag(element) == 'Placemark':
            yield element, folders
            continue
        if _tag(element) == 'Folder':
            folders = (*folders, _child_text(element, 'name'))
        waiting += [(child, folders) for child in reversed(element)]


def _child_text(element: Element, tag: str) -> str:
    return next(((it.text or '').strip() for it in element if _tag(it) == tag), '')


def _feature(
    number: int, placemark: Element, folders: tuple[str, ...], count: RingCount
) -> tuple[Feature, int]:
    properties = {}
    name = _child_text(placemark, 'name')
    if name:
        properties['name'] = name
    for element in placemark.iter():
        if _tag(element) == 'Data':
            properties.setdefault(element.get('name', ''), _child_text(element, 'value'))
        elif _tag(element) == 'SimpleData':
            properties.setdefault(element.get('name', ''), (element.text or '').strip())
    properties.setdefault(FOLDER, ' / '.join(filter(None, folders)))
    points: list[Corner] = []
    polygons: list[tuple[Ring, ...]] = []
    n_lines = 0
    for element in _geometries(placemark):
        if _tag(element) == 'Point':
            points += _corners(element)[:1]
        elif _tag(element) == 'Polygon':
            polygons.append(count.counted(_rings(element)))
        else:
            ring = _corners(element)
            is_closed = len(ring) > 3 and ring[0] == ring[-1]  # drawn around something
            polygons += [count.counted((ring,))] if is_closed else []
            n_lines += not is_closed
    read = Feature(
        number=number, properties=properties, points=tuple(points), polygons=tuple(polygons)
    )
    return read, n_lines


def _geometries(placemark: Element) -> Iterator[Element]:
    waiting = [*reversed(placemark)]
    while waiting:
        element = waiting.pop()
        if _tag(element) in ('Point', 'Polygon', 'LineString', 'LinearRing'):
            yield element
        elif _tag(element) == 'MultiGeometry':
            waiting += reversed(element)


def _rings(polygon: Element) -> tuple[Ring, ...]:
    outer, holes = [], []
    for side in polygon:
        if _tag(side) == 'outerBoundaryIs':
            outer.append(_corners(side))
        elif _tag(side) == 'innerBoundaryIs':
            holes.append(_corners(side))
    if len(outer) != 1:
        raise _OddError(f'has a polygon of {len(outer)} outer boundaries: must have one')
    return (*outer, *holes)


def _corners(element: Element) -> Ring:
    """The corners in an element's `coordinates`: longitude,latitude[,height], ...

    Of more than a polygon may have, only the first ones and the last: too many all the same.
    """
    texts = [it.text or '' for it in element.iter() if _tag(it) == 'coordinates']
    words = ' '.join(texts).split(maxsplit=_MAX_WORDS)
    if len(words) > _MAX_WORDS:
        words[-1] = words[-1].rsplit(maxsplit=1)[-1]
    corners = [tuple(word.split(',')) for word in words]
    if not corners:
        raise _OddError(f'has a {_tag(element)} without coordinates')
    wrong = next((it for it in corners if len(it) not in (2, 3)), None)
    if wrong:
        raise _OddError(f'coordinates are {",".join(wrong)[:60]!r}: must be longitude,latitude')
    return tuple((corner[0], corner[1]) for corner in corners)

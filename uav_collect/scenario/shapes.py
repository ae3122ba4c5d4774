"""What maps hold: points, which are sensors, and polygons: boundary of the area, no-fly zones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
import re
from typing import NamedTuple

from uav_collect.config.rules import polygon
from uav_collect.config.yaml_text import shown, shown_path
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_CORNERS, MAX_NO_FLY, MAX_NO_FLY_CORNERS
from uav_collect.scenario.columns import DATA, DEGREES, GRID, ID, plain, role_of, System
from uav_collect.scenario.numerals import number_of
from uav_collect.scenario.odd_places import Pair
from uav_collect.scenario.tables import FOLDER, Sheet, SheetRow, where_of

Corner = tuple[str, str]  # east and north, or longitude and latitude, as written
Ring = tuple[Corner, ...]
Polygon = tuple[Pair, ...]  # its corners: latitude, longitude [deg], or x, y; the first once

_MAX_FEATURES = 50_000
_MAX_PROPERTIES = 1_000  # names of them, of a whole map
_MAX_RINGS = 1 + MAX_NO_FLY  # polygons, and holes in them: a boundary, and zones
_MAX_RING_CORNERS = (
    MAX_CORNERS + MAX_NO_FLY_CORNERS
) + _MAX_RINGS  # each first one is there twice
_ANY_POLYGON = polygon(-1e8, 1e8, MAX_CORNERS)

# What says that nobody may fly there, as `plain` leaves it: English, German, French, Spanish, ...
_NO_FLY = re.compile(
    'no_?fly|no_?go|keep_?out|forbidden|prohibited|restricted|exclusion|excluded|obstacle|'
    'flugverbot|sperr|verboten|hindernis|interdit|prohibid|proibid|vietat|verboden|forbud|zakaz'
)
_SAYS_USE = frozenset(
    {'name', 'title', 'label', 'type', 'kind', 'class', 'category', 'role', 'use', 'zone'}
    | {FOLDER, 'fence', 'layer', 'art', 'typ', 'tipo', 'nom', 'nombre', 'nome'}
)
_FULL_TURN_DEG = 360.0
_MOST_ODD = 0.5  # of the places, that are mistakes of some rows
_NO = frozenset({'', '0', 'false', 'no', 'none', 'null', 'off'})


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One thing of a map, with what is written of it."""

    number: int
    properties: dict[str, str]
    points: tuple[Corner, ...]
    polygons: tuple[tuple[Ring, ...], ...]  # each an outer ring and its holes
    has_place: bool = True  # it is drawn somewhere, as a line perhaps


class MapFile(NamedTuple):
    """All things of a map."""

    path: Path
    unit: str  # what they are called in its format
    features: tuple[Feature, ...]
    crs: str  # name of the grid that the map says it is of; '': WGS84
    notes: tuple[str, ...]


class RingCount:
    """Counts what the polygons of a map are made of, while it is read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._n_rings = self._n_corners = 0

    def counted(self, rings: tuple[Ring, ...]) -> tuple[Ring, ...]:
        """The rings of one more polygon.

        Raises:
            ConfigError: they are more than an area and all its no-fly zones may have.
        """
        self._n_rings += len(rings)
        self._n_corners += sum(map(len, rings))
        if self._n_rings > _MAX_RINGS or self._n_corners > _MAX_RING_CORNERS:
            raise ConfigError(
                f'{shown_path(self._path)}: has more than {_MAX_RINGS:,} polygons and holes, or '
                f'{_MAX_RING_CORNERS:,} corners of them: must have at most as many'
            )
        return rings


class Outlines(NamedTuple):
    """Polygons of a list, in its own coordinates."""

    boundary: Polygon | None
    no_fly: tuple[Polygon, ...]


def sheet_of_map(found: MapFile, *, is_angular: bool) -> Sheet:
    """The points of a map as a table: their properties, and where they are.

    What the map has without saying where it is, is a row without a place.

    Raises:
        ConfigError: a thing has several points.
    """
    several = [it for it in found.features if len(it.points) > 1]
    if several:
        raise ConfigError(
            *(
                f'{where_of(found.path, found.unit, it.number)}: has {len(it.points)} points: '
                'must have one, a sensor'
                for it in several
            )
        )
    points = [it for it in found.features if it.points or not it.has_place]
    names = [*dict.fromkeys(name for it in points for name in it.properties)]
    names = [name for name in names if role_of(plain(name)) in (None, ID, DATA)]
    system = DEGREES if is_angular else GRID
    header = SheetRow(0, [*names, *system.roles])
    rows = tuple(
        SheetRow(
            it.number,
            [
                *(it.properties.get(name, '') for name in names),
                *_coordinates(it, is_angular=is_angular),
            ],
        )
        for it in points
    )
    return Sheet(path=found.path, unit=found.unit, header=header, lines=rows, notes=found.notes)


def _coordinates(point: Feature, *, is_angular: bool) -> Corner:
    """As columns have them; empty where there are none."""
    first, second = point.points[0] if point.points else ('', '')
    return (second, first) if is_angular else (first, second)


def outlines_of(found: MapFile, *, is_angular: bool) -> Outlines:
    """The polygons of a map: no-fly zones by what is written of them, and the area's boundary.

    A zone is one whose name, kind or folder says so (`No-fly mast`, `restricted`, `Flugverbot`),
    or that has a property like `no_fly: true`. A hole of the boundary is one, too.

    Raises:
        ConfigError: more than one polygon may be the boundary, or a polygon is none.
    """
    boundaries: list[tuple[Feature, tuple[Polygon, ...]]] = []
    no_fly: list[Polygon] = []
    for feature, rings in polygons_of(found, is_angular=is_angular):
        if is_no_fly(feature.properties):
            no_fly.append(rings[0])
        else:
            boundaries.append((feature, rings))
    if len(boundaries) > 1:
        raise ConfigError(
            f'{shown_path(found.path)}: {_numbers(found, boundaries)} have polygons that may be '
            'the area: must be one, and the others no-fly zones by their name, as "no-fly pond"'
        )
    boundary, *holes = boundaries[0][1] if boundaries else [None]
    zones = (*no_fly, *holes)
    check_zones(shown_path(found.path), zones)
    return Outlines(boundary, zones)


def check_zones(name: str, zones: Sequence[Polygon]) -> None:
    """Refuse more no-fly zones than an area may have, or more of their corners.

    Raises:
        ConfigError: there are more.
    """
    n_corners = sum(map(len, zones))
    if len(zones) > MAX_NO_FLY or n_corners > MAX_NO_FLY_CORNERS:
        raise ConfigError(
            f'{name}: has {len(zones):,} no-fly zones with {n_corners:,} corners in all: must '
            f'have at most {MAX_NO_FLY:,} with {MAX_NO_FLY_CORNERS:,}'
        )


def _numbers(found: MapFile, boundaries: Sequence[tuple[Feature, object]]) -> str:
    first = ', '.join(f'{feature.number}{_called(feature)}' for feature, _ in boundaries[:5])
    more = f' and {len(boundaries) - 5} more' if len(boundaries) > 5 else ''
    return f'{found.unit}s {first}{more}'


def _called(feature: Feature) -> str:
    name = feature.properties.get('name')
    return f' ({shown(name)})' if name else ''


def is_no_fly(properties: dict[str, str]) -> bool:
    """Whether what is written of a polygon says that nobody may fly there."""
    for name, value in properties.items():
        key, said = plain(name), plain(value)
        if key in _SAYS_USE and _NO_FLY.search(said):
            return True
        if _NO_FLY.search(key) and said not in _NO:
            return True
    return False


def polygons_of(found: MapFile, *, is_angular: bool) -> list[tuple[Feature, tuple[Polygon, ...]]]:
    """All polygons, each with its holes, by the thing that has it.

    Raises:
        ConfigError: a line for each corner that is no place, and each ring that is no polygon.
    """
    polygons, problems = [], []
    for feature in found.features:
        where = where_of(found.path, found.unit, feature.number)
        for rings in feature.polygons:
            problems += [f'{where}: {what}' for ring in rings for what in _wrong(ring, is_angular)]
            read = tuple(_polygon(ring, is_angular=is_angular) for ring in rings)
            polygons.append((feature, read))
    if problems:
        raise ConfigError(*problems)
    return polygons


def _system(*, is_angular: bool) -> System:
    return DEGREES if is_angular else GRID._replace(lows=(-1e8, -1e8), highs=(1e8, 1e8))


def _wrong(ring: Ring, is_angular: bool) -> Iterator[str]:
    if len(ring) > MAX_CORNERS + 1:  # the first one is there twice
        yield f'has a polygon of more than {MAX_CORNERS:,} corners: must have at most as many'
        return
    system = _system(is_angular=is_angular)
    n_wrong = 0
    for number, corner in enumerate(ring, start=1):
        texts = corner[::-1] if is_angular else corner
        for role, text, low, high in zip(
            system.roles, texts, system.lows, system.highs, strict=True
        ):
            if not low <= number_of(text, '.') <= high:
                allowed = f'must be a number from {low:.10g} to {high:.10g} {system.unit}'
                n_wrong += 1
                yield f'{role} of corner {number} is {shown(text)}: {allowed}'
    if not n_wrong and not is_polygon(_polygon(ring, is_angular=is_angular)):
        yield 'has a polygon without three corners that do not lie on one line'


def check_degrees(found: MapFile) -> None:
    """Refuse a map without a grid whose polygons are, by most of their corners, in metres.

    Raises:
        ConfigError: it is one.
    """
    places = [
        place for it in found.features for rings in it.polygons for ring in rings for place in ring
    ]
    odd = [place for place in places if _are_metres(place)]
    if len(odd) > _MOST_ODD * len(places):
        written = ', '.join(odd[0])
        raise ConfigError(
            f'{shown_path(found.path)}: has corners like {written}: must be longitude, '
            'latitude [deg], or say its crs, as urn:ogc:def:crs:EPSG::25832; metres of no grid '
            'are read of a CSV with the columns x_m, y_m'
        )


def _are_metres(place: Corner) -> bool:
    return any(_FULL_TURN_DEG < abs(number_of(text, '.')) < math.inf for text in place)


def is_polygon(corners: Polygon) -> bool:
    """Whether corners lie around something."""
    try:
        _ANY_POLYGON.parse(corners)
    except ValueError:
        return False
    return True


def _polygon(ring: Ring, *, is_angular: bool) -> Polygon:
    corners = [
        (number_of(first, '.'), number_of(second, '.'))
        for first, second in (corner[::-1] if is_angular else corner for corner in ring)
    ]
    if len(corners) > 1 and corners[0] == corners[-1]:
        corners.pop()
    return tuple(corners)


def check_number(path: Path, n_features: int, unit: str) -> None:
    """Refuse a map of too many things.

    Raises:
        ConfigError: it is one.
    """
    if n_features > _MAX_FEATURES:
        raise ConfigError(
            f'{shown_path(path)}: has {n_features:,} {unit}s: must have at most {_MAX_FEATURES:,}'
        )


def check_names(found: MapFile) -> MapFile:
    """Refuse a map with too many names of properties.

    Raises:
        ConfigError: it has.
    """
    names = {name for it in found.features for name in it.properties}
    if len(names) > _MAX_PROPERTIES:
        raise ConfigError(
            f'{shown_path(found.path)}: has {len(names):,} names of properties: must have at most '
            f'{_MAX_PROPERTIES:,}'
        )
    return found

"""Lines and rings that cross the 180th meridian, as parts that each lie on one side of it.

Source: RFC 7946, section 3.1.9.
"""

from collections.abc import Sequence
from itertools import pairwise

Degrees = tuple[float, float]  # longitude, latitude
Part = tuple[Degrees, ...]

_EDGE_DEG = 180.0
_TURN_DEG = 360.0


def line_parts(places: Sequence[Degrees]) -> tuple[Part, ...]:
    """A line of places that are near each other; one part unless it crosses the meridian."""
    unwound = _unwound(places)
    parts: list[list[Degrees]] = [[unwound[0]]]
    for here, there in pairwise(unwound):
        if (edge := _edge_between(here, there)) is not None:
            meets = _at_edge(here, there, edge)
            parts[-1].append(meets)
            parts.append([meets])
        parts[-1].append(there)
    return tuple(map(_home, parts))


def ring_parts(ring: Sequence[Degrees]) -> tuple[Part, ...]:
    """A closed ring, counter-clockwise; two of them if it crosses the meridian."""
    unwound = _unwound(ring)
    lons_deg = [lon_deg for lon_deg, _ in unwound]
    edge = next((it for it in (-_EDGE_DEG, _EDGE_DEG) if min(lons_deg) < it < max(lons_deg)), None)
    if edge is None:
        return (_home(unwound),)
    return tuple(_home(_side(unwound, edge, east=east)) for east in (False, True))


def _unwound(places: Sequence[Degrees]) -> list[Degrees]:
    """The places by longitudes that go on beyond 180 degrees, rather than jump."""
    unwound = [places[0]]
    for lon_deg, lat_deg in places[1:]:
        turns = round((unwound[-1][0] - lon_deg) / _TURN_DEG)
        unwound.append((lon_deg + turns * _TURN_DEG, lat_deg))
    return unwound


def _edge_between(here: Degrees, there: Degrees) -> float | None:
    """The meridian that the way from one place to another leads across."""
    low, high = sorted((here[0], there[0]))
    return next((edge for edge in (-_EDGE_DEG, _EDGE_DEG) if low < edge < high), None)


def _at_edge(here: Degrees, there: Degrees, edge: float) -> Degrees:
    share = (edge - here[0]) / (there[0] - here[0])
    return edge, here[1] + share * (there[1] - here[1])


def _side(ring: Sequence[Degrees], edge: float, *, east: bool) -> list[Degrees]:
    """The part of a ring on one side of a meridian, closed."""
    side: list[Degrees] = []
    for here, there in pairwise(ring):
        if (here[0] >= edge) == east or here[0] == edge:
            side.append(here)
        if min(here[0], there[0]) < edge < max(here[0], there[0]):
            side.append(_at_edge(here, there, edge))
    return [*side, side[0]]


def _home(part: Sequence[Degrees]) -> Part:
    """A part by longitudes from -180 to 180 degrees."""
    middle_deg = (min(lon for lon, _ in part) + max(lon for lon, _ in part)) / 2
    turns = round(middle_deg / _TURN_DEG)
    return tuple((lon_deg - turns * _TURN_DEG, lat_deg) for lon_deg, lat_deg in part)

"""The outlines of an area as rings on the Earth: its border, and where nobody may fly."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from uav_collect.handover.date_line import Degrees
from uav_collect.handover.flights import MissionFlights
from uav_collect.scenario.model import Point

AREA = 'area'
NO_FLY = 'no-fly zone'


@dataclass(frozen=True, kw_only=True)
class Outline:
    """What a polygon stands for, and its ring: closed, counter-clockwise, longitudes first."""

    name: str
    ring_deg: tuple[Degrees, ...]


def outlines(mission: MissionFlights) -> Iterator[Outline]:
    """The outlines of a mission's area.

    Raises:
        ConfigError: it is not known where on Earth the area lies.
    """
    area = mission.site.scenario.area
    east_m, north_m = area.width_m, area.height_m
    border_m = ((0.0, 0.0), (east_m, 0.0), (east_m, north_m), (0.0, north_m))
    yield Outline(name=AREA, ring_deg=_ring(mission, area.boundary or border_m))
    for zone in area.no_fly or ():
        yield Outline(name=NO_FLY, ring_deg=_ring(mission, zone))


def _ring(mission: MissionFlights, corners_m: Sequence[Point]) -> tuple[Degrees, ...]:
    is_clockwise = _area_m2(corners_m) < 0.0
    ordered_m = [*reversed(corners_m)] if is_clockwise else [*corners_m]
    places = [mission.lat_lon_deg(corner_m) for corner_m in [*ordered_m, ordered_m[0]]]
    return tuple((lon_deg, lat_deg) for lat_deg, lon_deg in places)


def _area_m2(corners_m: Sequence[Point]) -> float:
    """The area of a polygon, below 0 where its corners go clockwise."""
    pairs = zip(corners_m, [*corners_m[1:], corners_m[0]], strict=True)
    return sum(x_m * next_y_m - next_x_m * y_m for (x_m, y_m), (next_x_m, next_y_m) in pairs) / 2

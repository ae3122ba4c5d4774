"""Places of a list in the plane of a scenario's area."""

from collections.abc import Sequence
import math
from typing import NamedTuple

from uav_collect.config.yaml_text import shown, shown_path
from uav_collect.errors import ConfigError
from uav_collect.scenario.columns import DEGREES
from uav_collect.scenario.earth import east_north_m
from uav_collect.scenario.grids import lat_lon_of
from uav_collect.scenario.odd_places import Pair
from uav_collect.scenario.places import Places
from uav_collect.scenario.rounding import on_edge, ROUNDING_M

_DIGITS = 6  # micrometres: drops the rounding noise of a difference of large coordinates


class Plane(NamedTuple):
    """All that a list has, in one plane [m]: x east and y north of the plane's origin."""

    origin: Pair | None  # latitude and longitude [deg] of x = y = 0; None: not known
    sensors_m: tuple[Pair, ...]
    boundary_m: tuple[Pair, ...] | None
    no_fly_m: tuple[tuple[Pair, ...], ...]

    @property
    def middle_m(self) -> Pair:
        """The middle of the box around the sensors and the boundary [m]."""
        return _middle([*self.sensors_m, *(self.boundary_m or ())])


class OnArea(NamedTuple):
    """What a list says of a site, as the keys and values of a scenario."""

    entries: tuple[dict[str, object], ...]  # `id`, `x_m`, `y_m` and, where given, `data_mbit`
    reference: dict[str, object] | None  # where on Earth the area lies, if latitudes are given
    boundary: tuple[Pair, ...] | None  # of the area [m], from its south-west corner
    no_fly: tuple[tuple[Pair, ...], ...]
    crs: str | None  # the grid of the list, if it is known


def plane_of(places: Places, origin: Pair | None = None) -> Plane:
    """The places in the plane that touches the Earth at an origin; metres as they are.

    Args:
        origin: latitude and longitude [deg] of x = y = 0; None: the middle of the sensors.
    """
    sensors = [place.at for place in places.sensors]
    if not places.is_angular:
        return Plane(None, tuple(sensors), places.boundary, places.no_fly)
    anchor = origin or _middle(_unwrapped(sensors))
    boundary = None if places.boundary is None else _flat(places.boundary, anchor)
    no_fly = tuple(_flat(polygon, anchor) for polygon in places.no_fly)
    return Plane(anchor, _flat(sensors, anchor), boundary, no_fly)


def on_area(places: Places, *, origin: Pair | None, width_m: float, height_m: float) -> OnArea:
    """The places in metres from the south-west corner of an area.

    Args:
        origin: that corner in the list's coordinates; None puts the middle of what the list has
            into the middle of the area.
        width_m: of the area, east to west; `height_m`: north to south.

    Raises:
        ConfigError: a line for each place that lies outside.
    """
    anchor = None if origin is None else _anchor(places, origin)
    plane = plane_of(places, anchor if places.is_angular else None)
    if anchor is None:
        _check_span(places, plane, width_m, height_m)
        middle = plane.middle_m
        corner = middle[0] - width_m / 2, middle[1] - height_m / 2
    else:
        corner = (0.0, 0.0) if places.is_angular else anchor
    placed = [on_edge(it, width_m, height_m) for it in _moved(plane.sensors_m, corner)]
    _check_inside(places, placed, width_m, height_m)
    return OnArea(
        tuple(
            {'id': sensor.id, 'x_m': x_m, 'y_m': y_m}
            | ({} if sensor.data_mbit is None else {'data_mbit': sensor.data_mbit})
            for sensor, (x_m, y_m) in zip(places.sensors, placed, strict=True)
        ),
        None if plane.origin is None else _reference(plane.origin, corner),
        None if plane.boundary_m is None else _moved(plane.boundary_m, corner),
        tuple(_moved(polygon, corner) for polygon in plane.no_fly_m),
        places.grid and places.grid.name,
    )


def place_in(places: Places, at: Pair) -> Pair | None:
    """A place that a user gives by two numbers, as `Places.sensors` have theirs.

    Args:
        at: as the list writes places, or latitude and longitude [deg] if it is of the Earth.

    Returns:
        None: it is no place of the list's kind.
    """
    if places.system.has(at):
        if places.grid is None:
            return at
        [on_earth] = lat_lon_of([at], places.grid)
        if on_earth is not None:
            return on_earth
    return at if places.is_angular and DEGREES.has(at) else None


def _anchor(places: Places, origin: Pair) -> Pair:
    """A corner that is given in the list's coordinates, as latitude and longitude if these are."""
    anchor = place_in(places, origin)
    if anchor is not None:
        return anchor
    system = places.system
    for role, value, low, high in zip(
        system.roles, origin, system.lows, system.highs, strict=True
    ):
        if not low <= value <= high:
            raise ConfigError(
                f'{shown_path(places.path)}: sensors.origin has {role} {shown(value)}: '
                f'must be a number from {low:.10g} to {high:.10g} {system.unit}'
            )
    where = '' if places.grid is None else f'{places.grid.name} ({places.grid.title})'
    raise ConfigError(
        f'{shown_path(places.path)}: sensors.origin is {shown(origin)}: must lie in {where}'
    )


def _flat(points: Sequence[Pair], anchor: Pair) -> tuple[Pair, ...]:
    return tuple(
        east_north_m(lat, lon, origin_lat_deg=anchor[0], origin_lon_deg=anchor[1])
        for lat, lon in points
    )


def _moved(points: Sequence[Pair], corner: Pair) -> tuple[Pair, ...]:
    return tuple((round(x - corner[0], _DIGITS), round(y - corner[1], _DIGITS)) for x, y in points)


def _reference(anchor: Pair, corner: Pair) -> dict[str, object]:
    lat_deg, lon_deg = anchor[0], (anchor[1] + 180) % 360 - 180
    x_m, y_m = (round(0.0 - metres, _DIGITS) for metres in corner)
    position_m = on_edge((x_m, y_m), math.inf, math.inf)
    return {'lat_deg': lat_deg, 'lon_deg': lon_deg, 'position_m': position_m}


def _check_span(places: Places, plane: Plane, width_m: float, height_m: float) -> None:
    points = [*plane.sensors_m, *(plane.boundary_m or ())]
    spans_m = [max(values) - min(values) for values in zip(*points, strict=True)]
    if spans_m[0] <= width_m + ROUNDING_M and spans_m[1] <= height_m + ROUNDING_M:
        return
    raise ConfigError(
        *(f'{line}: must be put right, or the area larger' for line in places.far),
        f'{shown_path(places.path)}: sensors span {spans_m[0]:.10g} m x {spans_m[1]:.10g} m: '
        f'must fit into the area, {width_m:.10g} m x {height_m:.10g} m',
    )


def _check_inside(places: Places, placed: Sequence[Pair], width_m: float, height_m: float) -> None:
    allowed = (
        f'from 0 to {width_m:.10g} m'
        if width_m == height_m
        else f'x from 0 to {width_m:.10g} m, y from 0 to {height_m:.10g} m'
    )
    problems = [
        f'{sensor.where}: {",".join(places.names)} of sensor {sensor.id} lies at '
        f'x = {x_m:.10g} m, y = {y_m:.10g} m in the area: must be {allowed}'
        for sensor, (x_m, y_m) in zip(places.sensors, placed, strict=True)
        if not (0 <= x_m <= width_m and 0 <= y_m <= height_m)
    ]
    if problems:
        raise ConfigError(*problems)


def _unwrapped(places: Sequence[Pair]) -> list[Pair]:
    # A site may lie on both sides of the 180th meridian.
    first = places[0][1]
    return [(lat, (lon - first + 180) % 360 - 180 + first) for lat, lon in places]


def _middle(places: Sequence[Pair]) -> Pair:
    firsts, seconds = zip(*places, strict=True)
    return (min(firsts) + max(firsts)) / 2, (min(seconds) + max(seconds)) / 2

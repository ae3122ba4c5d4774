"""Coordinates of any national grid, as latitudes and longitudes (by pyproj)."""

from collections.abc import Sequence
import math
import re
from typing import Any, NamedTuple

from uav_collect.config.packages import late_packages
from uav_collect.config.yaml_text import shown
from uav_collect.errors import ConfigError

Pair = tuple[float, float]
WGS84 = 'EPSG:4326'
CRS_ALLOWED = 'EPSG:NUMBER, as EPSG:27700, or UTM ZONE N or S, as UTM 33N'
_EPSG = re.compile('EPSG:{1,2}([1-9][0-9]{0,5})', re.IGNORECASE)
_UTM = re.compile('UTM ?(?:ZONE ?)?([1-9]|[1-5][0-9]|60) ?([NS])', re.IGNORECASE)
_ZONE = re.compile('(?:UTM)? ?0?([1-9]|[1-5][0-9]|60) ?([C-HJ-NP-X])', re.IGNORECASE)
_MARGIN_DEG = 1.0  # around where a grid is meant to be used


class Grid(NamedTuple):
    """A system of coordinates, and how to leave it."""

    name: str  # EPSG:27700
    title: str
    is_angular: bool
    transformer: Any
    bounds_deg: tuple[float, float, float, float]  # west, south, east, north; where it is used


def crs_name(text: str) -> str:
    """The name of a system of coordinates, `EPSG:27700`.

    Raises:
        ValueError: the text is none.
    """
    epsg, utm = _EPSG.fullmatch(text.strip()), _UTM.fullmatch(text.strip())
    if epsg:
        return f'EPSG:{epsg[1]}'
    if utm:
        return _utm_name(int(utm[1]), is_north=utm[2].upper() == 'N')
    raise ValueError


def zone_crs_name(text: str) -> str:
    """The system that a UTM zone names, 33N or 33T; '' for what is none.

    33S may mean the south, or the band from 32 to 40 degrees north: it is none.
    """
    zone = _ZONE.fullmatch(text.strip())
    if not zone or zone[2].upper() == 'S':
        return ''
    return _utm_name(int(zone[1]), is_north=zone[2].upper() >= 'N')


def _utm_name(zone: int, *, is_north: bool) -> str:
    return f'EPSG:{32600 + zone if is_north else 32700 + zone}'


def grid_of(name: str, field: str) -> Grid:
    """A system of coordinates by its name.

    Args:
        field: what it is called in messages, and where.

    Raises:
        ConfigError: there is none of that name, or it cannot be used for places on the ground.
        MissingPackageError: pyproj is missing.
    """
    with late_packages():
        import pyproj
    try:
        crs = pyproj.CRS.from_user_input(name)
        transformer = pyproj.Transformer.from_crs(crs, WGS84, always_xy=True)
    except pyproj.exceptions.ProjError:
        crs = None
    if crs is None or not (crs.is_projected or crs.is_geographic) or len(crs.axis_info) != 2:
        raise ConfigError(f'{field} is {shown(name)}: must name a map grid, {CRS_ALLOWED}')
    area = crs.area_of_use
    bounds = (-180.0, -90.0, 180.0, 90.0) if area is None else (*area.bounds,)
    return Grid(name, str(crs.name), crs.is_geographic, transformer, bounds)


def lat_lon_of(places: Sequence[Pair], grid: Grid) -> list[Pair | None]:
    """Latitude and longitude (WGS84) [deg] of places of a grid; None for those outside of it.

    Args:
        places: east and north in the grid's own unit, or latitude and longitude [deg].
    """
    east, north = zip(*places, strict=True) if places else ((), ())
    if grid.is_angular:
        east, north = north, east
    lons, lats = grid.transformer.transform(list(east), list(north))
    return [
        (lat, lon) if _is_inside(grid, lat, lon) else None
        for lat, lon in zip(map(float, lats), map(float, lons), strict=True)
    ]


def _is_inside(grid: Grid, lat_deg: float, lon_deg: float) -> bool:
    if not (math.isfinite(lat_deg) and math.isfinite(lon_deg) and abs(lat_deg) <= 89):
        return False
    west, south, east, north = grid.bounds_deg
    width_deg = (east - west) % 360 or 360.0
    is_across = (lon_deg - west + _MARGIN_DEG) % 360 <= width_deg + 2 * _MARGIN_DEG
    return is_across and south - _MARGIN_DEG <= lat_deg <= north + _MARGIN_DEG

"""What a list of loggers says of a field, and files of polygons besides, in one plane."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from uav_collect.config.yaml_text import shown, shown_path
from uav_collect.errors import ConfigError, counted, noting
from uav_collect.fields.ground import Ground
from uav_collect.fields.outlines import lies_in
from uav_collect.scenario.columns import DEGREES, n_known
from uav_collect.scenario.earth import east_north_m
from uav_collect.scenario.list_files import open_list
from uav_collect.scenario.model import Point
from uav_collect.scenario.places import Places, Polygons, read, read_polygons, ReadOptions
from uav_collect.scenario.plane import place_in, Plane, plane_of
from uav_collect.scenario.shapes import MapFile, Polygon

_LAT_LON = 'latitude and longitude, WGS84'
_PLAIN = 'metres of its own'


@dataclass(frozen=True, kw_only=True)
class Survey:
    """A field, and where that is known from."""

    ground: Ground
    source: str  # the list, for people
    crs: str  # how places are written there, for people
    notes: tuple[str, ...]  # what was found that might have been otherwise


def survey(
    path: Path,
    options: ReadOptions,
    *,
    area: Path | None = None,
    widen_m: float = 0.0,
    no_fly: Path | None = None,
    base: str | None = None,
) -> Survey:
    """Read a field.

    Args:
        path: the list of loggers.
        options: how it is to be read.
        area: file with a polygon that nobody flies beyond, and maybe others that are called
            no-fly zones; None: as the list says.
        widen_m: how far beyond that UAVs may fly all the same [m].
        no_fly: file with polygons that nobody flies over, whatever they are called, besides those
            of the list; the one of the area again adds nothing to what it says.
        base: where UAVs start: a sensor's id, or two numbers: as the list writes places, or
            latitude and longitude [deg] if it is of the Earth.

    Raises:
        ConfigError: a line for each thing that is wrong.
        MissingPackageError: a file needs a package that is missing.
    """
    places, zone_files = _read(path, options, area, no_fly)
    plane = plane_of(places)
    problems: list[str] = []
    noting(problems, lambda: _check_zones(zone_files, plane))
    base_m = None
    if base is not None:
        base_m = noting(problems, lambda: _base_m(base, places, plane.sensors_m, plane.origin))
    if problems:
        raise ConfigError(*problems)
    ground = Ground(
        sensor_ids=tuple(sensor.id for sensor in places.sensors),
        sensor_where=tuple(sensor.where for sensor in places.sensors),
        position_m=np.array(plane.sensors_m),
        data_mbit=tuple(sensor.data_mbit for sensor in places.sensors),
        edge_m=plane.boundary_m,
        widen_m=widen_m,
        no_fly_m=plane.no_fly_m,
        base_m=base_m,
        origin_deg=plane.origin,
        crs=places.grid and places.grid.name,
    )
    return Survey(
        ground=ground,
        source=shown_path(path.name),
        crs=_crs(places),
        notes=(*places.notes, *places.far),
    )


class _Added(NamedTuple):
    """What a file of polygons says of a field besides its list."""

    path: Path
    is_angular: bool  # corners are latitude, longitude (WGS84) [deg]; else x, y [m]
    boundary: Polygon | None
    no_fly: tuple[Polygon, ...]


def _read(
    path: Path, options: ReadOptions, area: Path | None, no_fly: Path | None
) -> tuple[Places, list[Path]]:
    """What the list and the files of polygons have, and the file of each no-fly zone.

    Raises:
        ConfigError: a line for each thing that is wrong in any of them.
    """
    problems: list[str] = []
    places = noting(problems, partial(read, path, options))
    added = []
    if area is not None:
        added.append(noting(problems, partial(_area_of, area, options)))
    if no_fly is not None and not (area is not None and area.samefile(no_fly)):
        added.append(noting(problems, partial(_zones_of, no_fly, options)))
    found = [it for it in added if it is not None]
    if places is not None:
        problems += [
            _other_units(it, places) for it in found if it.is_angular != places.is_angular
        ]
    if problems or places is None:
        raise ConfigError(*problems)
    zone_files = [path] * len(places.no_fly)
    for it in found:
        zone_files += [it.path] * len(it.no_fly)
        # Holes of the list's own edge, which no longer counts, stay closed all the same.
        boundary, no_fly_zones = it.boundary or places.boundary, (*places.no_fly, *it.no_fly)
        places = replace(places, boundary=boundary, no_fly=no_fly_zones)
    return places, zone_files


def _area_of(path: Path, options: ReadOptions) -> _Added:
    """The boundary that a file has, and its no-fly zones besides.

    Raises:
        ConfigError: it has none, or more than one polygon that may be it.
    """
    found = _polygons(path, options)
    if len(found.polygons) == 1:  # it is wanted as the area, whatever it is called
        return _Added(path, found.is_angular, found.polygons[0], found.holes)
    named = list(zip(found.polygons, found.are_no_fly, strict=True))
    edges = [polygon for polygon, is_zone in named if not is_zone]
    if len(edges) != 1:
        raise ConfigError(
            f'{shown_path(path)}: has {counted(len(edges), "polygon")} that may be the area: must '
            'have one, and the others no-fly zones by their name, as "no-fly pond"'
        )
    zones = [polygon for polygon, is_zone in named if is_zone]
    return _Added(path, found.is_angular, edges[0], (*zones, *found.holes))


def _zones_of(path: Path, options: ReadOptions) -> _Added:
    """The polygons of a file, all of them no-fly zones, and their holes as well."""
    found = _polygons(path, options)
    return _Added(path, found.is_angular, None, found.polygons)


def _polygons(path: Path, options: ReadOptions) -> Polygons:
    """The polygons of a map, or of a table that is written as the list is."""
    is_map = isinstance(open_list(path, partial(n_known, columns={})), MapFile)
    return read_polygons(path, ReadOptions(crs='' if is_map else options.crs))


def _other_units(added: _Added, places: Places) -> str:
    """What is wrong with a file that does not write places as the list does."""
    of_list, of_file = ('degrees', 'metres') if places.is_angular else ('metres', 'degrees')
    return (
        f'{shown_path(added.path)}: has places in {of_file}: must have {of_list}, as '
        f'{shown_path(places.path)}'
    )


def _check_zones(files: Sequence[Path], plane: Plane) -> None:
    """Refuse a no-fly zone that has all sensors in it.

    Args:
        files: that of each zone.

    Raises:
        ConfigError: there is one; it may be the field's own outline.
    """
    for at, (path, zone) in enumerate(zip(files, plane.no_fly_m, strict=True)):
        if all(lies_in(sensor, zone) for sensor in plane.sensors_m):
            which = f'no-fly zone {files[: at + 1].count(path)} of {files.count(path)}'
            raise ConfigError(
                f'{shown_path(path)}: {which} has all sensors in it: must leave out '
                'the outline of the field, which --area takes'
            )


def _base_m(text: str, places: Places, sensors_m: Sequence[Point], origin: Point | None) -> Point:
    """Where UAVs start, in the plane."""
    for sensor, place_m in zip(places.sensors, sensors_m, strict=True):
        if sensor.id == text:
            return place_m
    try:
        first, second = (float(part) for part in text.split(','))
        at = place_in(places, (first, second))
    except ValueError:
        at = None
    if at is None:
        written = ','.join(places.system.roles)
        if places.is_angular and not places.system.is_angular:
            written += f', or {",".join(DEGREES.roles)}'
        raise ConfigError(f'--base is {shown(text)}: must be the id of a sensor, or {written}')
    if origin is None:
        return at
    return east_north_m(*at, origin_lat_deg=origin[0], origin_lon_deg=origin[1])


def _crs(places: Places) -> str:
    if places.grid is not None:
        return f'{places.grid.name}, {places.grid.title}'
    return _LAT_LON if places.is_angular else _PLAIN

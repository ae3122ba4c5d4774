"""Lists of places as people have them: what sensors there are, and where, by one call.

`read` knows CSV of any usual form, xlsx, GeoJSON and KML, and says all that is wrong with a file
at once. `read_polygons` reads outlines alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from uav_collect.config.yaml_text import shown, shown_path
from uav_collect.errors import ConfigError, counted, noting
from uav_collect.limits import MAX_CORNERS
from uav_collect.scenario.columns import DEGREES, n_known, System
from uav_collect.scenario.gridded import (
    by_zones,
    grids_of_zones,
    transformed,
    transformed_polygon,
)
from uav_collect.scenario.grids import CRS_ALLOWED, crs_name, Grid, grid_of
from uav_collect.scenario.list_files import open_list
from uav_collect.scenario.odd_places import (
    Doubles,
    FAR_IN_ANY_AREA_M,
    far_places,
    SensorPlace,
    without_doubles,
)
from uav_collect.scenario.place_cells import with_places_apart
from uav_collect.scenario.place_rows import check_number_of_rows, layout_of, ReadRows, rows_of
from uav_collect.scenario.shapes import (
    check_degrees,
    is_no_fly,
    is_polygon,
    MapFile,
    Outlines,
    outlines_of,
    Polygon,
    polygons_of,
    sheet_of_map,
)
from uav_collect.scenario.tables import NAMES_PLACES, Sheet


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What a user says of a list of places besides its name."""

    columns: Mapping[str, str] = field(default_factory=dict)  # `columns.ROLES`, each by its name
    crs: str = ''  # `grids.crs_name` of its coordinates; '': what their columns' names mean
    doubles: Doubles = 'refuse'  # which row to keep of two of one id or one place
    skips_blanks: bool = False  # leave out rows without a place
    needs_data: bool = False  # each row must have an amount of data


@dataclass(frozen=True, kw_only=True)
class Places:
    """The sensors of a list, and the outlines that it has besides."""

    path: Path
    is_angular: bool  # places are latitude, longitude (WGS84) [deg]; else x, y [m], east and north
    system: System  # of the coordinates that the list has
    names: tuple[str, str]  # what the list calls its two coordinates
    grid: Grid | None  # of which coordinates were, before they became latitudes and longitudes
    sensors: tuple[SensorPlace, ...]  # in the order of their rows
    boundary: Polygon | None  # of the area
    no_fly: tuple[Polygon, ...]
    far: tuple[str, ...]  # a line for each place that lies far from the others, if not too far
    notes: tuple[str, ...]  # what was found that might have been otherwise


def read(path: Path, options: ReadOptions) -> Places:
    """Read a list of sensors.

    Raises:
        ConfigError: a line for each thing that is wrong with the file: where, what, the value,
            what is allowed.
        MissingPackageError: it needs a package that is missing.
    """
    opened = open_list(path, partial(n_known, columns=options.columns))
    if isinstance(opened, Sheet):
        return _places_of(opened, _grid_of(options.crs, path), options)
    return _places_of_map(opened, _grid_of(options.crs or opened.crs, path), options)


def _places_of_map(found: MapFile, grid: Grid | None, options: ReadOptions) -> Places:
    if grid is None:
        check_degrees(found)
    is_angular = grid is None or grid.is_angular
    problems: list[str] = []
    places = noting(
        problems,
        lambda: _places_of(sheet_of_map(found, is_angular=is_angular), grid, options),
    )
    outlines = noting(problems, lambda: _outlines(found, grid, is_angular=is_angular))
    if places is None or outlines is None:
        raise ConfigError(*problems)
    return replace(places, boundary=outlines.boundary, no_fly=outlines.no_fly)


def _outlines(found: MapFile, grid: Grid | None, *, is_angular: bool) -> Outlines:
    """The outlines of a map; of one with a grid as latitudes and longitudes."""
    boundary, no_fly = outlines_of(found, is_angular=is_angular)
    if grid is None:
        return Outlines(boundary, no_fly)
    return Outlines(
        boundary and transformed_polygon(boundary, grid, found.path),
        tuple(transformed_polygon(polygon, grid, found.path) for polygon in no_fly),
    )


class Polygons(NamedTuple):
    """Outlines of a file."""

    is_angular: bool  # corners are latitude, longitude (WGS84) [deg]; else x, y [m]
    polygons: tuple[Polygon, ...]
    holes: tuple[Polygon, ...]  # in any of them
    are_no_fly: tuple[bool, ...]  # by polygon: whether it is called a no-fly zone


def read_polygons(path: Path, options: ReadOptions) -> Polygons:
    """Read the polygons of a map, whatever their names, or one from a table of its corners.

    Raises:
        ConfigError: a line for each thing that is wrong with the file, or it has no polygon.
        MissingPackageError: it needs a package that is missing.
    """
    opened = open_list(path, partial(n_known, columns=options.columns))
    if isinstance(opened, Sheet):
        corners = _checked(opened, _grid_of(options.crs, path), replace(options, doubles='keep'))
        polygon = tuple(corner.at for corner in corners.sensors)
        if not is_polygon(polygon):
            raise ConfigError(
                f'{shown_path(path)}: has a polygon of {counted(len(polygon), "corner")}: must '
                f'have 3 to {MAX_CORNERS:,} that do not lie on one line'
            )
        is_closed = polygon[0] == polygon[-1]
        polygon = polygon[:-1] if is_closed else polygon
        return Polygons(corners.is_angular, (polygon,), (), (False,))
    return _polygons_of(opened, _grid_of(options.crs or opened.crs, path))


def _polygons_of(found: MapFile, grid: Grid | None) -> Polygons:
    if grid is None:
        check_degrees(found)
    is_angular = grid is None or grid.is_angular
    named_rings = polygons_of(found, is_angular=is_angular)
    found_rings = [rings for _, rings in named_rings]
    are_no_fly = tuple(is_no_fly(feature.properties) for feature, _ in named_rings)
    if not found_rings:
        raise ConfigError(f'{shown_path(found.path)}: has no polygon: must have at least one')
    polygons = [rings[0] for rings in found_rings]
    holes = [hole for rings in found_rings for hole in rings[1:]]
    if grid is not None:
        polygons, holes = (
            [transformed_polygon(it, grid, found.path) for it in each]
            for each in (polygons, holes)
        )
    return Polygons(True, tuple(polygons), tuple(holes), are_no_fly)


class _Checked(NamedTuple):
    """The places of a table, of which nothing is wrong."""

    is_angular: bool
    system: System
    names: tuple[str, str]
    grid: Grid | None
    sensors: tuple[SensorPlace, ...]
    far: tuple[str, ...]
    notes: tuple[str, ...]


def _places_of(sheet: Sheet, grid: Grid | None, options: ReadOptions) -> Places:
    """The places of a table, which has no outlines."""
    checked = _checked(sheet, grid, options)
    return Places(path=sheet.path, boundary=None, no_fly=(), **checked._asdict())


def _checked(sheet: Sheet, grid: Grid | None, options: ReadOptions) -> _Checked:
    """The places of a table.

    Raises:
        ConfigError: a line for each thing that is wrong with it.
    """
    found = _found(sheet, grid, options)
    doubled = without_doubles(
        found.rows.places, options.doubles, found.id_name, found.names, sheet.unit
    )
    notes = [*found.notes]
    if doubled.n_left_out:
        n_rows = counted(doubled.n_left_out, sheet.unit)
        notes.append(f'left out: {n_rows} of an id or a place that another has')
    far = far_places(doubled.kept, is_angular=found.system.is_angular)
    problems = [*found.rows.problems, *doubled.problems]
    problems += [
        (it.place.number, f'{it.said(found.names)}: must be put right, or its row left out')
        for it in far
        if it.distance_m > FAR_IN_ANY_AREA_M
    ]
    sensors = doubled.kept
    if found.grid is not None:
        sensors, outside = transformed(sensors, found.grid, found.names, sheet.path)
        problems += outside
    if problems:
        raise ConfigError(*(line for _, line in sorted(problems, key=lambda it: it[0])))
    if not sensors:
        raise ConfigError(f'{shown_path(sheet.path)}: has no sensors with a place')
    return _Checked(
        is_angular=found.system.is_angular or found.grid is not None,
        system=found.system,
        names=found.names,
        grid=found.grid,
        sensors=sensors,
        far=tuple(it.said(found.names) for it in far),
        notes=tuple(notes),
    )


class _Found(NamedTuple):
    """The rows of a table, and by which columns they have their places."""

    rows: ReadRows
    system: System
    names: tuple[str, str]
    grid: Grid | None  # that the places are of
    id_name: str
    notes: tuple[str, ...]


def _found(sheet: Sheet, grid: Grid | None, options: ReadOptions) -> _Found:
    check_number_of_rows(sheet)
    sheet = _with_places(sheet, options)
    is_angular = grid is not None and grid.is_angular
    layout = layout_of(sheet, options.columns, grid.name if grid else '', is_angular=is_angular)
    rows = rows_of(sheet, layout, needs_data=options.needs_data, skips_blanks=options.skips_blanks)
    notes = [*sheet.notes, *layout.notes]
    if rows.n_blank:
        notes.append(f'left out: {counted(rows.n_blank, sheet.unit)} without a place')
    id_name = 'id' if layout.id is None else sheet.header.cells[layout.id]
    zones = None if grid else grids_of_zones(rows, layout, notes)
    if zones and len({it.name for it in zones.values()}) > 1:
        zoned = by_zones(rows, layout, zones)
        return _Found(zoned, DEGREES, DEGREES.roles, None, id_name, tuple(notes))
    if zones:
        grid = next(iter(zones.values()))
    return _Found(rows, layout.system, layout.names, grid, id_name, tuple(notes))


def _with_places(sheet: Sheet, options: ReadOptions) -> Sheet:
    """The table, its places in two columns each."""
    has_places = n_known(sheet.header.cells, options.columns) >= NAMES_PLACES
    return sheet if has_places else with_places_apart(sheet)


def _grid_of(crs: str, path: Path) -> Grid | None:
    if not crs:
        return None
    field = f'{shown_path(path)}: crs'
    try:
        name = crs_name(crs)
    except ValueError:
        raise ConfigError(f'{field} is {shown(crs)}: must be {CRS_ALLOWED}') from None
    return grid_of(name, field)

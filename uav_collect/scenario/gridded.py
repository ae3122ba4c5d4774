"""Places of map grids, put on the Earth: by one grid, or by zones of UTM."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from uav_collect.config.yaml_text import shown, shown_path
from uav_collect.errors import ConfigError
from uav_collect.scenario.columns import GRID, ZONE
from uav_collect.scenario.grids import Grid, grid_of, lat_lon_of, zone_crs_name
from uav_collect.scenario.odd_places import Pair, SensorPlace
from uav_collect.scenario.place_rows import PlaceColumns, ReadRows


def grids_of_zones(
    rows: ReadRows, layout: PlaceColumns, notes: list[str]
) -> dict[str, Grid] | None:
    """The grid of each UTM zone, as the rows write it, if each row names its own."""
    if layout.zone is None or layout.system != GRID or not rows.places:
        return None
    names = {zone: zone_crs_name(zone) for zone in rows.zones}
    without = [zone for zone, name in names.items() if not name]
    if without:
        notes.append(
            f'utm_zone {shown(without[0])} does not say of which half of the Earth it is, as 33T '
            'does: places are plain metres'
        )
        return None
    by_name = {name: grid_of(name, ZONE) for name in sorted({*names.values()})}
    notes.append(f'places are UTM, {", ".join(by_name)}')
    return {zone: by_name[name] for zone, name in names.items()}


def by_zones(rows: ReadRows, layout: PlaceColumns, grids: Mapping[str, Grid]) -> ReadRows:
    """The places as latitudes and longitudes, each by the grid of its row's zone."""
    placed = []
    for place, zone in zip(rows.places, rows.zones, strict=True):
        [at] = lat_lon_of([place.at], grids[zone])
        if at is not None:
            placed.append(place._replace(at=at))
            continue
        what = f'{",".join(layout.names)} is {_shown_pair(place.at)}: lies outside of zone {zone}'
        rows.problems.append((place.number, f'{place.where}: {what}'))
    return replace(rows, places=placed)


def transformed(
    sensors: Sequence[SensorPlace], grid: Grid, names: tuple[str, str], path: Path
) -> tuple[tuple[SensorPlace, ...], list[tuple[int, str]]]:
    """Places of a grid as latitudes and longitudes, and what is said of those outside of it.

    Args:
        names: what the list calls its coordinates.
    """
    ats = lat_lon_of([place.at for place in sensors], grid)
    outside = [place for place, at in zip(sensors, ats, strict=True) if at is None]
    where = f'{grid.name} ({grid.title})'
    if 2 * len(outside) > len(sensors):
        at = _shown_pair(outside[0].at)
        line = (
            f'{shown_path(path)}: {len(outside)} of {len(sensors)} places, as {",".join(names)} '
            f'{at}, lie outside of {where}: must be of that grid, or crs another one'
        )
        return (), [(0, line)]
    problems = [
        (
            place.number,
            f'{place.where}: {",".join(names)} is {_shown_pair(place.at)}: must lie in {where}',
        )
        for place in outside
    ]
    placed = [
        place._replace(at=at) for place, at in zip(sensors, ats, strict=True) if at is not None
    ]
    return tuple(placed), problems


def _shown_pair(at: Pair) -> str:
    return ', '.join(f'{it:.10g}' for it in at)


def transformed_polygon(polygon: Sequence[Pair], grid: Grid, path: Path) -> tuple[Pair, ...]:
    """A polygon of a grid as latitudes and longitudes.

    Raises:
        ConfigError: a corner lies outside of the grid.
    """
    placed = lat_lon_of(polygon, grid)
    inside = [at for at in placed if at is not None]
    if len(inside) < len(placed):
        corner = polygon[placed.index(None)]
        raise ConfigError(
            f'{shown_path(path)}: a polygon has the corner {_shown_pair(corner)}: must lie in '
            f'{grid.name} ({grid.title})'
        )
    return tuple(inside)

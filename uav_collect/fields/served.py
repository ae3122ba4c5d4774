"""Which sensors of a field no UAV can serve, why, and what would help."""

import math

from uav_collect.config.yaml_text import shown
from uav_collect.errors import ConfigError
from uav_collect.fields.grid import best_grid, CellGrid, least_size_m, smaller_size_m, under_zones
from uav_collect.fields.outlines import distance_m

_MOST_CORNERS = 5_000  # of all grids of one size: no refusal is worth a long wait


def check_served(grid: CellGrid, least_cell_size_m: float) -> None:
    """Refuse a grid in which sensors cannot be served.

    Args:
        grid: the cells.
        least_cell_size_m: down to which smaller cells are tried, to be named if they would do [m].

    Raises:
        ConfigError: the base or some sensors lie where no UAV may fly, or can get to; a line each.
    """
    base_m = grid.ground.base_m
    is_base_closed = base_m is not None and not grid.is_open[grid.base_cell]
    if not is_base_closed and not grid.unserved.size:
        return
    size_m = _size_that_serves_m(grid, least_cell_size_m)
    smaller = '' if size_m is None else f', give --cell-size {size_m:g}'
    if is_base_closed:
        what = _closed_by(grid, grid.base_cell, smaller)
        raise ConfigError(f'the base lies in a cell {what}, or leave --base out')
    raise ConfigError(*(_unserved(grid, sensor, smaller) for sensor in grid.unserved.tolist()))


def _size_that_serves_m(grid: CellGrid, least_cell_size_m: float) -> float | None:
    """The largest of smaller cells that serve all sensors that cells can; None: none were found.

    Still smaller ones need not do: by luck, a zone lies just between lines of a grid.
    """
    least_m = max(least_cell_size_m, least_size_m(grid.ground))
    helpless = {*under_zones(grid.ground).nonzero()[0].tolist()}
    helpless |= {it for it in grid.unserved.tolist() if _is_beyond_edge(grid, it)}
    size_m = smaller_size_m(grid.cell_size_m)
    while size_m >= least_m:
        smaller = best_grid(
            grid.ground, size_m, grid.altitude_m, is_fixed=True, most_corners=_MOST_CORNERS
        )
        if helpless.issuperset(smaller.unserved.tolist()):
            return size_m
        size_m = smaller_size_m(size_m)
    return None


def _is_beyond_edge(grid: CellGrid, sensor: int) -> bool:
    """Whether it is the area's edge that closes a sensor's cell."""
    return grid.ground.edge_m is not None and not grid.is_inside[grid.sensor_cell[sensor]]


def _unserved(grid: CellGrid, sensor: int, smaller: str) -> str:
    """Why a sensor cannot be served, and what would help."""
    ground, cell = grid.ground, int(grid.sensor_cell[sensor])
    who = f'{ground.sensor_where[sensor]}: sensor {shown(ground.sensor_ids[sensor])}'
    if under_zones(grid.ground)[sensor]:
        return f'{who} lies in a no-fly zone: draw the zone smaller, or leave the sensor out'
    if not grid.is_open[cell]:
        return f'{who} lies in a cell {_closed_by(grid, cell, smaller)}, or leave the sensor out'
    return (
        f'{who} cannot be reached from the base over open cells: leave a gap of a cell, '
        f'{grid.cell_size_m:g} m, between zones{smaller}, or leave the sensor out'
    )


def _closed_by(grid: CellGrid, cell: int, smaller: str) -> str:
    """What closes a cell, and what would open it."""
    edge_m = grid.ground.edge_m
    if edge_m is None or grid.is_inside[cell]:
        return (
            f'of {grid.cell_size_m:g} m that a no-fly zone touches: draw the zone smaller{smaller}'
        )
    away_m = distance_m(grid.centre_m(cell), grid.from_corner(edge_m))
    return (
        f"whose middle, where UAVs hover, is {away_m:.1f} m beyond the area's edge: give --widen "
        f'{math.ceil(away_m)} if they may fly there'
    )

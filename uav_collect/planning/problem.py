"""What a fleet that knows all demand has to do: the data cells, the ways, the hovers."""

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np
from uav_collect.kernels.arrays import Floats, Ints, new_row, Row, row_of
from uav_collect.kernels.compile import kernel
from uav_collect.physics.bandwidth import EQUAL, EXACT, share_bandwidth
from uav_collect.scenario.site import Site
from uav_collect.uav.actions import start_cells
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.open_ways import OpenCells
from uav_collect.world.dynamics import draw_channel
from uav_collect.world.sensor_field import draw_demand, lay_out, most_sensors, SensorField

FAR = 1e300  # more than any time, energy or price

# The largest normal number that `keyed_random.normal_pair` makes of 32 bits.
_MAX_NORMAL = math.sqrt(64.0 * math.log(2.0))
_ROUNDING = 1e-9  # relative; what a sum of energies may lose in the world


class PlanProblem(NamedTuple):
    """The data cells of a mission and what serving them takes, as kernels read it.

    Points are the data cells, by index from 0, then the start of each UAV, then its home: N of
    them. Tables are flat, row after row.
    """

    n_cells: int
    n_uavs: int
    n_columns: int
    is_open: Row[int]  # (C,) 1 where UAVs may fly
    total_bit: float
    start_cell: Row[int]  # (U,)
    cell: Row[int]  # (n_cells,) which cell of the area
    way_m: Row[float]  # (N * N) moves between cells, the straight line home
    nearest: Row[int]  # (n_cells * n_cells) of each data cell all of them, the nearest first
    hover_s: Row[float]  # (U * n_cells) at the UAV's first visit
    least_hover_s: Row[float]  # (n_cells,) no UAV can be faster, at whatever visit
    speed_mps: Row[float]  # (U,) as the rest
    flight_power_w: Row[float]
    hover_power_w: Row[float]
    allowance_j: Row[float]  # what the UAV may use, its margin kept


class _Workspace(NamedTuple):
    """Rows to share bandwidth at; by sensor of a cell."""

    demand_bit: Row[float]
    signal_w: Row[float]
    error_w: Row[float]
    share_hz: Row[float]


def problem_of(site: Site, mission_seed: int, allocator: str) -> PlanProblem:
    """What a plan of a mission has to serve, by the mission's own draws of demand and channels.

    The channels are those of a UAV's first visit to a cell: a plan serves a cell the first time
    that its UAV comes there.

    Args:
        allocator: how bandwidth is shared, one of `limits.ALLOCATOR_NAMES`; cvxpy counts as exact.
    """
    briefing, sensor_field = briefing_of(site), lay_out(site)
    demand_bit = new_row(site.n_sensors, 0.0)
    draw_demand(sensor_field, mission_seed, demand_bit)
    first = sensor_field.first_sensor
    cells = [
        cell
        for cell in range(site.scenario.n_cells)
        if any(demand_bit[sensor] > 0.0 for sensor in range(first[cell], first[cell + 1]))
    ]
    way_m = ways_m(briefing, np.array(cells, dtype=np.int64))
    between_m = way_m[: len(cells), : len(cells)]
    problem = PlanProblem(
        n_cells=len(cells),
        n_uavs=briefing.n_uavs,
        n_columns=briefing.n_columns,
        is_open=briefing.is_open,
        total_bit=math.fsum(demand_bit),
        start_cell=_int_row(start_cells(briefing)),
        cell=_int_row(cells),
        way_m=row_of(way_m.ravel().tolist()),
        nearest=_int_row(np.argsort(between_m, axis=1, kind='stable').ravel().tolist()),
        hover_s=new_row(briefing.n_uavs * len(cells), 0.0),
        least_hover_s=new_row(len(cells), 0.0),
        speed_mps=briefing.speed_mps,
        flight_power_w=briefing.flight_power_w,
        hover_power_w=briefing.hover_power_w,
        allowance_j=_allowances_j(briefing),
    )
    share = EQUAL if allocator == 'equal' else EXACT
    write_hovers(
        share,
        briefing,
        sensor_field,
        mission_seed,
        demand_bit,
        problem,
        _new_workspace(sensor_field),
    )
    return problem


def _int_row(values: Sequence[int]) -> Row[int]:
    row = new_row(len(values), 0)  # of whole numbers also where there is none
    for index, value in enumerate(values):
        row[index] = value
    return row


def _allowances_j(briefing: Briefing) -> Row[float]:
    pairs = zip(briefing.energy_budget_j, briefing.energy_margin_j, strict=True)
    return row_of(
        [float((budget_j - margin_j) * (1.0 - _ROUNDING)) for budget_j, margin_j in pairs]
    )


def ways_m(briefing: Briefing, cells: Ints) -> Floats:
    """The shortest way between any two points, (N, N); 0 where no way leads."""
    n_cells, n_uavs = len(cells), briefing.n_uavs
    rows, columns = np.divmod(cells, briefing.n_columns)
    x_m, y_m = (columns + 0.5) * briefing.cell_size_m, (rows + 0.5) * briefing.cell_size_m
    way_m = np.zeros((n_cells + 2 * n_uavs, n_cells + 2 * n_uavs))
    way_m[:n_cells, :n_cells] = np.abs(x_m[:, None] - x_m) + np.abs(y_m[:, None] - y_m)
    for uav in range(n_uavs):
        start, home = n_cells + uav, n_cells + n_uavs + uav
        start_x_m, start_y_m = briefing.start_x_m[uav], briefing.start_y_m[uav]
        home_x_m, home_y_m = briefing.home_x_m[uav], briefing.home_y_m[uav]
        way_m[start, :n_cells] = np.abs(x_m - start_x_m) + np.abs(y_m - start_y_m)
        way_m[home, :n_cells] = np.hypot(x_m - home_x_m, y_m - home_y_m)
        way_m[start, home] = math.hypot(start_x_m - home_x_m, start_y_m - home_y_m)
    _lead_around(briefing, cells, way_m)
    return np.maximum(way_m, way_m.T)


def _lead_around(briefing: Briefing, cells: Ints, way_m: Floats) -> None:
    """Write the ways that lead around closed cells."""
    n_cells, n_uavs = len(cells), briefing.n_uavs
    n_moving, starts = n_cells + n_uavs, start_cells(briefing)
    open_cells = OpenCells(briefing.n_rows, briefing.n_columns, briefing.is_open)
    if open_cells.has_closed:
        moves = open_cells.moves_between([*cells.tolist(), *starts])
        way_m[:n_moving, :n_cells] = moves[:, :n_cells] * briefing.cell_size_m
    if briefing.has_obstacles:
        home_m = np.array(briefing.home_m).reshape(n_uavs, -1)
        way_m[n_moving:, :n_cells] = home_m[:, cells]
        for uav in range(n_uavs):
            way_m[n_cells + uav, n_moving + uav] = home_m[uav, starts[uav]]


def _new_workspace(sensor_field: SensorField) -> _Workspace:
    size = most_sensors(sensor_field)
    return _Workspace(
        demand_bit=new_row(size, 0.0),
        signal_w=new_row(size, 0.0),
        error_w=new_row(size, 0.0),
        share_hz=new_row(size, 0.0),
    )


@kernel
def write_hovers(
    allocator: int,
    briefing: Briefing,
    sensor_field: SensorField,
    mission_seed: int,
    demand_bit: Row[float],
    problem: PlanProblem,
    workspace: _Workspace,
) -> None:
    """Write the hover times of all data cells into the problem."""
    for index in range(problem.n_cells):
        cell = problem.cell[index]
        for uav in range(problem.n_uavs):
            # A UAV that starts in the cell hovers there before it ever came to it.
            visit = 0 if cell == problem.start_cell[uav] else 1
            n_sensors = _listen(
                briefing, sensor_field, mission_seed, demand_bit, uav, cell, visit, workspace
            )
            hover_s = _hover_s(allocator, briefing, workspace, n_sensors)
            problem.hover_s[uav * problem.n_cells + index] = hover_s
        hover_s = _least_hover_s(allocator, briefing, sensor_field, demand_bit, cell, workspace)
        problem.least_hover_s[index] = hover_s


@kernel
def _listen(
    briefing: Briefing,
    sensor_field: SensorField,
    mission_seed: int,
    demand_bit: Row[float],
    uav: int,
    cell: int,
    visit: int,
    workspace: _Workspace,
) -> int:
    """Draw the channels of a visit into the workspace; how many sensors there have data."""
    n_sensors = 0
    for sensor in range(sensor_field.first_sensor[cell], sensor_field.first_sensor[cell + 1]):
        if demand_bit[sensor] > 0.0:
            gain, error_gain = draw_channel(sensor_field, mission_seed, uav, sensor, visit)
            workspace.demand_bit[n_sensors] = demand_bit[sensor]
            workspace.signal_w[n_sensors] = briefing.tx_power_w * gain
            workspace.error_w[n_sensors] = briefing.tx_power_w * error_gain
            n_sensors += 1
    return n_sensors


@kernel
def _least_hover_s(
    allocator: int,
    briefing: Briefing,
    sensor_field: SensorField,
    demand_bit: Row[float],
    cell: int,
    workspace: _Workspace,
) -> float:
    """A hover over the best channels that can ever be drawn: in sight, all fading in phase.

    An estimation error shrinks with the path gain, and the rate with both: sight is best with it
    too.
    """
    n_sensors = 0
    for sensor in range(sensor_field.first_sensor[cell], sensor_field.first_sensor[cell + 1]):
        if demand_bit[sensor] > 0.0:
            factor = sensor_field.rician_factor[sensor]
            steady = math.sqrt(factor / (factor + 1.0))
            amplitude = steady + _MAX_NORMAL * math.sqrt(0.5 / (factor + 1.0))
            path_w = briefing.tx_power_w * sensor_field.path_gain[sensor]
            workspace.demand_bit[n_sensors] = demand_bit[sensor]
            workspace.signal_w[n_sensors] = (
                path_w * sensor_field.n_antennas * amplitude * amplitude
            )
            workspace.error_w[n_sensors] = path_w * sensor_field.csi_error_variance
            n_sensors += 1
    return _hover_s(allocator, briefing, workspace, n_sensors) * (1.0 - _ROUNDING)


@kernel
def _hover_s(allocator: int, briefing: Briefing, workspace: _Workspace, n_sensors: int) -> float:
    hover_s, _ = share_bandwidth(
        allocator,
        workspace.signal_w,
        workspace.error_w,
        workspace.demand_bit,
        n_sensors,
        briefing.bandwidth_hz,
        briefing.noise_w_per_hz,
        workspace.share_hz,
    )
    return hover_s

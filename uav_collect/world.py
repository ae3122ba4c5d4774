"""The world: an event-driven simulation of missions, exactly as their UAVs fly them.

There is no time step. Every UAV has one running action with a start and an end; the next event is
the earliest end, and then exactly one UAV, the deciding one, looks, hears and starts its next
action. Kernels read and write the rows of one mission; a batch is a table of them.
"""

from collections.abc import Sequence
import math
from typing import Any, NamedTuple

from uav_collect import actions
from uav_collect.actions import COLUMN_STEP, HOME, HOVER, NONE, ROW_STEP
from uav_collect.arrays import Row
from uav_collect.briefing import Briefing
from uav_collect.compiled import kernel, row_kernel
from uav_collect.ground import draw_demand, Ground
from uav_collect.radio import channel_draw, uplink_rate_bps
from uav_collect.rows import new_row, new_table

# Phases of a UAV.
ACTIVE = 0
FLYING_HOME = 1

VIEW_CELLS = 9  # the 3 x 3 region a UAV sees


class Mission(NamedTuple):
    """One mission in flight: rows by UAV, sensor or cell. Only this module's kernels write it."""

    seed: Row[int]  # (1,)
    clock_s: Row[float]  # (1,) time of the latest event
    collected_bit: Row[float]  # (1,)
    leg_start_x_m: Row[float]  # (U,) where the running action began
    leg_start_y_m: Row[float]
    leg_end_x_m: Row[float]  # (U,) where it ends
    leg_end_y_m: Row[float]
    leg_start_s: Row[float]  # (U,)
    leg_end_s: Row[float]
    duration_s: Row[float]  # (U,) of the running action
    energy_j: Row[float]  # (U,) its cost
    phase: Row[int]  # (U,)
    action: Row[int]  # (U,) the running action; NONE before the first
    n_decisions: Row[int]  # (U,) actions started; turning home is none
    energy_left_j: Row[float]  # (U,) at the end of the running action
    n_visits: Row[int]  # (U * C,) times that the UAV came to the cell
    demand_bit: Row[float]  # (S,) at the start of the mission
    waiting_bit: Row[float]  # (S,) not yet claimed by a hover
    cell_bit: Row[float]  # (C,) the same, summed over the cell's sensors
    gain: Row[float]  # (S,) of the channel to the UAV that looked last
    error_gain: Row[float]  # (S,) its estimation error
    rate_bps: Row[float]  # (S,) while being served, 0 before
    upload_s: Row[float]  # (S,) how long its data takes


class Missions(NamedTuple):
    """Many missions side by side: the rows of `Mission`, one table each, (W, ...)."""

    seed: Row[Row[int]]
    clock_s: Row[Row[float]]
    collected_bit: Row[Row[float]]
    leg_start_x_m: Row[Row[float]]
    leg_start_y_m: Row[Row[float]]
    leg_end_x_m: Row[Row[float]]
    leg_end_y_m: Row[Row[float]]
    leg_start_s: Row[Row[float]]
    leg_end_s: Row[Row[float]]
    duration_s: Row[Row[float]]
    energy_j: Row[Row[float]]
    phase: Row[Row[int]]
    action: Row[Row[int]]
    n_decisions: Row[Row[int]]
    energy_left_j: Row[Row[float]]
    n_visits: Row[Row[int]]
    demand_bit: Row[Row[float]]
    waiting_bit: Row[Row[float]]
    cell_bit: Row[Row[float]]
    gain: Row[Row[float]]
    error_gain: Row[Row[float]]
    rate_bps: Row[Row[float]]
    upload_s: Row[Row[float]]


class LocalView(NamedTuple):
    """What one UAV sees when it decides: itself, the 3 x 3 region and its own cell's sensors."""

    time_s: float
    x_m: float
    y_m: float
    cell: int
    energy_left_j: float
    previous_action: int  # NONE at the start
    region_bit: Row[
        float
    ]  # (9,) waiting data per cell from the south-west, row first; nan outside
    n_sensors: int  # of the own cell that have data
    sensor: Row[int]  # (n_sensors,) or longer
    sensor_bit: Row[float]  # their data
    sensor_gain: Row[float]  # estimated channel gain ||h||^2, linear
    sensor_error_gain: Row[float]  # variance of its error, linear


class ViewRows(NamedTuple):
    """Rows that local views are written to."""

    region_bit: Row[float]
    sensor: Row[int]
    sensor_bit: Row[float]
    sensor_gain: Row[float]
    sensor_error_gain: Row[float]


def new_missions(briefing: Briefing, ground: Ground, mission_seeds: Sequence[int]) -> Missions:
    """Missions at their start: fully charged UAVs at their starts, demand drawn."""
    n_worlds, n_uavs = len(mission_seeds), briefing.n_uavs
    n_cells, n_sensors = len(ground.first_sensor) - 1, len(ground.path_gain)
    sizes = {
        'seed': 1, 'clock_s': 1, 'collected_bit': 1, 'n_visits': n_uavs * n_cells,
        'cell_bit': n_cells,
    } | dict.fromkeys(
        ('demand_bit', 'waiting_bit', 'gain', 'error_gain', 'rate_bps', 'upload_s'), n_sensors
    )  # fmt: skip
    counts = {'seed', 'phase', 'action', 'n_decisions', 'n_visits'}
    tables: dict[str, Any] = {
        name: new_table(n_worlds, sizes.get(name, n_uavs), 0 if name in counts else 0.0)
        for name in Missions._fields
    }
    missions = Missions(**tables)
    for world, seed in enumerate(mission_seeds):
        missions.seed[world][0] = seed
    restart(briefing, ground, missions, n_worlds)
    return missions


def new_view_rows(ground: Ground) -> ViewRows:
    """Rows for the local view of any UAV on this ground."""
    first = ground.first_sensor
    size = max(1, *(first[cell + 1] - first[cell] for cell in range(len(first) - 1)))
    return ViewRows(
        region_bit=new_row(VIEW_CELLS, 0.0),
        sensor=new_row(size, 0),
        sensor_bit=new_row(size, 0.0),
        sensor_gain=new_row(size, 0.0),
        sensor_error_gain=new_row(size, 0.0),
    )


@row_kernel
def mission_of(missions: Missions, world: int) -> Mission:
    """One mission of a batch."""
    return Mission(
        missions.seed[world],
        missions.clock_s[world],
        missions.collected_bit[world],
        missions.leg_start_x_m[world],
        missions.leg_start_y_m[world],
        missions.leg_end_x_m[world],
        missions.leg_end_y_m[world],
        missions.leg_start_s[world],
        missions.leg_end_s[world],
        missions.duration_s[world],
        missions.energy_j[world],
        missions.phase[world],
        missions.action[world],
        missions.n_decisions[world],
        missions.energy_left_j[world],
        missions.n_visits[world],
        missions.demand_bit[world],
        missions.waiting_bit[world],
        missions.cell_bit[world],
        missions.gain[world],
        missions.error_gain[world],
        missions.rate_bps[world],
        missions.upload_s[world],
    )


@kernel
def restart(briefing: Briefing, ground: Ground, missions: Missions, n_worlds: int) -> None:
    """Put the first missions of a batch back to their start, each by its own seed."""
    for world in range(n_worlds):
        restart_mission(briefing, ground, mission_of(missions, world))


@kernel
def restart_mission(briefing: Briefing, ground: Ground, mission: Mission) -> None:
    """Put one mission back to its start, by its own seed."""
    mission.clock_s[0] = 0.0
    mission.collected_bit[0] = 0.0
    for uav in range(briefing.n_uavs):
        mission.leg_start_x_m[uav] = briefing.start_x_m[uav]
        mission.leg_start_y_m[uav] = briefing.start_y_m[uav]
        mission.leg_end_x_m[uav] = briefing.start_x_m[uav]
        mission.leg_end_y_m[uav] = briefing.start_y_m[uav]
        mission.leg_start_s[uav] = 0.0
        mission.leg_end_s[uav] = 0.0
        mission.duration_s[uav] = 0.0
        mission.energy_j[uav] = 0.0
        mission.phase[uav] = ACTIVE
        mission.action[uav] = NONE
        mission.n_decisions[uav] = 0
        mission.energy_left_j[uav] = briefing.energy_budget_j[uav]
    for index in range(len(mission.n_visits)):
        mission.n_visits[index] = 0
    draw_demand(ground, mission.seed[0], mission.demand_bit)
    for cell in range(len(mission.cell_bit)):
        mission.cell_bit[cell] = 0.0
        for sensor in range(ground.first_sensor[cell], ground.first_sensor[cell + 1]):
            mission.waiting_bit[sensor] = mission.demand_bit[sensor]
            mission.cell_bit[cell] += mission.demand_bit[sensor]
            mission.rate_bps[sensor] = 0.0
            mission.upload_s[sensor] = 0.0


@kernel
def next_uav(mission: Mission) -> int:
    """The UAV that decides next: earliest end, ties to the lowest index; -1 when none decides."""
    chosen = -1
    for uav in range(len(mission.phase)):
        if mission.phase[uav] == ACTIVE and (
            chosen < 0 or mission.leg_end_s[uav] < mission.leg_end_s[chosen]
        ):
            chosen = uav
    return chosen


@kernel
def end_s(mission: Mission) -> float:
    """When the last running action ends: the completion time once every UAV flies home."""
    latest_s = 0.0
    for uav in range(len(mission.leg_end_s)):
        latest_s = max(latest_s, mission.leg_end_s[uav])
    return latest_s


@kernel
def has_landed(mission: Mission, uav: int, time_s: float) -> bool:
    """Whether the UAV is home for good, and silent."""
    return mission.phase[uav] == FLYING_HOME and mission.leg_end_s[uav] <= time_s


@kernel
def _progress(mission: Mission, uav: int, time_s: float) -> float:
    duration_s = mission.leg_end_s[uav] - mission.leg_start_s[uav]
    if time_s >= mission.leg_end_s[uav] or duration_s <= 0.0:
        return 1.0
    return (time_s - mission.leg_start_s[uav]) / duration_s


@kernel
def x_m_at(mission: Mission, uav: int, time_s: float) -> float:
    """East coordinate of a UAV during its running action, or after."""
    start_m, stop_m = mission.leg_start_x_m[uav], mission.leg_end_x_m[uav]
    return start_m + (stop_m - start_m) * _progress(mission, uav, time_s)


@kernel
def y_m_at(mission: Mission, uav: int, time_s: float) -> float:
    """North coordinate of a UAV during its running action, or after."""
    start_m, stop_m = mission.leg_start_y_m[uav], mission.leg_end_y_m[uav]
    return start_m + (stop_m - start_m) * _progress(mission, uav, time_s)


@kernel
def in_contact(briefing: Briefing, mission: Mission, uav: int, other: int, time_s: float) -> bool:
    """Whether two UAVs, neither landed, are within communication range of each other."""
    if uav == other or has_landed(mission, uav, time_s) or has_landed(mission, other, time_s):
        return False
    east_m = x_m_at(mission, uav, time_s) - x_m_at(mission, other, time_s)
    north_m = y_m_at(mission, uav, time_s) - y_m_at(mission, other, time_s)
    return math.sqrt(east_m * east_m + north_m * north_m) <= briefing.contact_range_m


@kernel
def look(
    briefing: Briefing, ground: Ground, mission: Mission, uav: int, rows: ViewRows
) -> LocalView:
    """What the deciding UAV sees as its action ends; its channels are drawn here.

    A channel stays as drawn while the UAV stays: the key is the visit, not the look.
    """
    time_s = mission.leg_end_s[uav]
    x_m, y_m = mission.leg_end_x_m[uav], mission.leg_end_y_m[uav]
    cell = actions.cell_at(briefing, x_m, y_m)
    mission.clock_s[0] = time_s
    for index in range(VIEW_CELLS):
        seen = actions.neighbour(briefing, cell, index // 3 - 1, index % 3 - 1)
        rows.region_bit[index] = mission.cell_bit[seen] if seen >= 0 else math.nan
    n_sensors = 0
    if mission.cell_bit[cell] > 0.0:
        visit = mission.n_visits[uav * len(mission.cell_bit) + cell]
        for sensor in range(ground.first_sensor[cell], ground.first_sensor[cell + 1]):
            if mission.waiting_bit[sensor] > 0.0:
                _draw_channel(ground, mission, uav, sensor, visit)
                rows.sensor[n_sensors] = sensor
                rows.sensor_bit[n_sensors] = mission.waiting_bit[sensor]
                rows.sensor_gain[n_sensors] = mission.gain[sensor]
                rows.sensor_error_gain[n_sensors] = mission.error_gain[sensor]
                n_sensors += 1
    return LocalView(
        time_s,
        x_m,
        y_m,
        cell,
        mission.energy_left_j[uav],
        mission.action[uav],
        rows.region_bit,
        n_sensors,
        rows.sensor,
        rows.sensor_bit,
        rows.sensor_gain,
        rows.sensor_error_gain,
    )


@kernel
def _draw_channel(ground: Ground, mission: Mission, uav: int, sensor: int, visit: int) -> None:
    gain, path_gain = channel_draw(
        mission.seed[0],
        uav,
        sensor,
        visit,
        ground.n_antennas,
        ground.los_probability[sensor],
        ground.path_gain[sensor],
        ground.nlos_attenuation,
        ground.rician_factor[sensor],
    )
    mission.gain[sensor] = gain
    mission.error_gain[sensor] = path_gain * ground.csi_error_variance


@kernel
def start_action(
    briefing: Briefing,
    mission: Mission,
    uav: int,
    view: LocalView,
    action: int,
    share_hz: Row[float],
) -> float:
    """Start the deciding UAV's next action.

    Args:
        view: what `look` gave it.
        share_hz: bandwidth of each of the view's sensors [Hz], (n_sensors,); read for a hover.

    Returns:
        The data that the action collects [bit].
    """
    if action == HOVER:
        return _hover(briefing, mission, uav, view, share_hz)
    if action == HOME:
        _fly_home(briefing, mission, uav)
    else:
        _move(briefing, mission, uav, action)
    return 0.0


@kernel
def _hover(
    briefing: Briefing, mission: Mission, uav: int, view: LocalView, share_hz: Row[float]
) -> float:
    # The cell's data counts as collected from now on: nobody else sees or serves it.
    # Eqs (data_rate), (hovering_time), (total_data).
    collected_bit = 0.0
    duration_s = 0.0
    for index in range(view.n_sensors):
        sensor = view.sensor[index]
        rate_bps = uplink_rate_bps(
            share_hz[index],
            briefing.tx_power_w * mission.gain[sensor],
            briefing.tx_power_w * mission.error_gain[sensor],
            briefing.noise_w_per_hz,
        )
        mission.rate_bps[sensor] = rate_bps
        mission.upload_s[sensor] = mission.waiting_bit[sensor] / rate_bps
        duration_s = max(duration_s, mission.upload_s[sensor])
        collected_bit += mission.waiting_bit[sensor]
        mission.waiting_bit[sensor] = 0.0
    mission.cell_bit[view.cell] = 0.0
    mission.collected_bit[0] += collected_bit
    energy_j = briefing.hover_power_w[uav] * duration_s
    _start_leg(mission, uav, HOVER, view.x_m, view.y_m, duration_s, energy_j)
    mission.n_decisions[uav] += 1
    return collected_bit


@kernel
def _move(briefing: Briefing, mission: Mission, uav: int, action: int) -> None:
    x_m, y_m = mission.leg_end_x_m[uav], mission.leg_end_y_m[uav]
    cell = actions.cell_at(briefing, x_m, y_m)
    target = actions.neighbour(briefing, cell, ROW_STEP[action], COLUMN_STEP[action])
    mission.n_visits[uav * len(mission.cell_bit) + target] += 1
    duration_s = actions.move_duration_s(briefing, uav)
    side = briefing.cells_per_side
    x_m = (target % side + 0.5) * briefing.cell_size_m
    y_m = (target // side + 0.5) * briefing.cell_size_m
    energy_j = briefing.flight_power_w[uav] * duration_s
    _start_leg(mission, uav, action, x_m, y_m, duration_s, energy_j)
    mission.n_decisions[uav] += 1


@kernel
def _fly_home(briefing: Briefing, mission: Mission, uav: int) -> None:
    x_m, y_m = mission.leg_end_x_m[uav], mission.leg_end_y_m[uav]
    duration_s = actions.home_duration_s(briefing, uav, x_m, y_m)
    energy_j = actions.home_energy_j(briefing, uav, x_m, y_m)
    home_x_m, home_y_m = briefing.home_x_m[uav], briefing.home_y_m[uav]
    _start_leg(mission, uav, HOME, home_x_m, home_y_m, duration_s, energy_j)
    mission.phase[uav] = FLYING_HOME


@kernel
def _start_leg(
    mission: Mission,
    uav: int,
    action: int,
    x_m: float,
    y_m: float,
    duration_s: float,
    energy_j: float,
) -> None:
    mission.leg_start_x_m[uav] = mission.leg_end_x_m[uav]
    mission.leg_start_y_m[uav] = mission.leg_end_y_m[uav]
    mission.leg_end_x_m[uav] = x_m
    mission.leg_end_y_m[uav] = y_m
    mission.leg_start_s[uav] = mission.leg_end_s[uav]
    mission.leg_end_s[uav] = mission.leg_start_s[uav] + duration_s
    mission.duration_s[uav] = duration_s
    mission.energy_j[uav] = energy_j
    mission.action[uav] = action
    mission.energy_left_j[uav] -= energy_j

"""The world: an event-driven simulation of missions, exactly as their UAVs fly them.

There is no time step. Every UAV has one running action with a start and an end; the next event is
the earliest end, and then exactly one UAV, the deciding one, looks, hears and starts its next
action.
"""

import math
from typing import Generic, NamedTuple, TypeVar

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel, row_kernel
from uav_collect.physics.radio import channel_draw, uplink_rate_bps
from uav_collect.uav import actions
from uav_collect.uav.action_codes import COLUMN_STEP, HOME, HOVER, ROW_STEP
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.view import LocalView, VIEW_CELLS, ViewRows
from uav_collect.world.sensor_field import SensorField

# Phases of a UAV.
ACTIVE = 0
FLYING_HOME = 1
LANDED = 2  # no row holds it: it follows from the time

# What may befall a UAV, see `faults`; the first part of a place in the rows of faults, (K * U,).
GONE = 0
SILENT = 1
SLOW = 2
N_FAULT_KINDS = 3

_Ints = TypeVar('_Ints')
_Floats = TypeVar('_Floats')


class MissionRows(NamedTuple, Generic[_Ints, _Floats]):
    """A mission in flight: rows by UAV, sensor or cell; or many, tables of rows, (W, ...)."""

    seed: _Ints  # (1,)
    clock_s: _Floats  # (1,) time of the latest event
    collected_bit: _Floats  # (1,)
    leg_start_x_m: _Floats  # (U,) where the running action began
    leg_start_y_m: _Floats
    leg_end_x_m: _Floats  # (U,) where it ends
    leg_end_y_m: _Floats
    leg_start_s: _Floats  # (U,)
    leg_end_s: _Floats
    duration_s: _Floats  # (U,) of the running action
    energy_j: _Floats  # (U,) its cost
    phase: _Ints  # (U,)
    action: _Ints  # (U,) the running action; NONE before the first
    n_decisions: _Ints  # (U,) actions started; turning home is none
    energy_left_j: _Floats  # (U,) at the end of the running action
    n_visits: _Ints  # (U * C,) times that the UAV came to the cell
    demand_bit: _Floats  # (S,) at the start of the mission
    waiting_bit: _Floats  # (S,) not yet claimed by a hover
    cell_bit: _Floats  # (C,) the same, summed over the cell's sensors
    gain: _Floats  # (S,) of the channel to the UAV that looked last
    error_gain: _Floats  # (S,) its estimation error
    rate_bps: _Floats  # (S,) while being served, 0 before
    upload_s: _Floats  # (S,) how long its data takes
    fault_s: _Floats  # (K * U,) from when on a fault of a kind has befallen a UAV; inf: never
    fault_decision: _Ints  # (K * U,) the UAV's decision that it begins at; NONE: at no one
    fault_event: _Ints  # (K * U,) the first event with it; NONE
    place_x_m: _Floats  # (U,) scratch of `contacts`: where the UAVs are
    place_y_m: _Floats


Mission = MissionRows[Row[int], Row[float]]
Missions = MissionRows[Row[Row[int]], Row[Row[float]]]


@row_kernel
def mission_of(missions: Missions, world: int) -> Mission:
    """One mission of a batch."""
    return MissionRows(
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
        missions.fault_s[world],
        missions.fault_decision[world],
        missions.fault_event[world],
        missions.place_x_m[world],
        missions.place_y_m[world],
    )


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
def wait_for_the_slowest(briefing: Briefing, mission: Mission) -> None:
    """Let the UAVs that are done first wait, hovering, until every active one is done.

    Synchronous missions decide so, all at the same instants. Nothing happens while a UAV has yet
    to start its next action. A UAV waits until it has but its reserve left, and is then to turn
    home alone: see `has_but_its_reserve`.
    """
    latest_s = 0.0
    for uav in range(briefing.n_uavs):
        if mission.phase[uav] == ACTIVE:
            if mission.leg_end_s[uav] <= mission.clock_s[0]:
                return
            latest_s = max(latest_s, mission.leg_end_s[uav])
    for uav in range(briefing.n_uavs):
        if mission.phase[uav] == ACTIVE:
            _wait(briefing, mission, uav, latest_s)


@kernel
def _wait(briefing: Briefing, mission: Mission, uav: int, until_s: float) -> None:
    hover_w, left_j = briefing.hover_power_w[uav], mission.energy_left_j[uav]
    kept_j = _reserve_j(briefing, mission, uav)
    waiting_j = hover_w * (until_s - mission.leg_end_s[uav])
    if left_j - waiting_j >= kept_j:
        mission.leg_end_s[uav] = until_s
        mission.energy_left_j[uav] = left_j - waiting_j
    else:
        waiting_j = max(left_j - kept_j, 0.0)
        mission.leg_end_s[uav] += waiting_j / hover_w
        mission.energy_left_j[uav] = min(left_j, kept_j)
    mission.energy_j[uav] += waiting_j


@kernel
def has_but_its_reserve(briefing: Briefing, mission: Mission, uav: int) -> bool:
    """Whether a UAV has no more energy left at the end of its action than what takes it home."""
    return mission.energy_left_j[uav] <= _reserve_j(briefing, mission, uav)


@kernel
def _reserve_j(briefing: Briefing, mission: Mission, uav: int) -> float:
    x_m, y_m = mission.leg_end_x_m[uav], mission.leg_end_y_m[uav]
    return actions.reserve_j(briefing, uav, x_m, y_m)


@kernel
def has_landed(mission: Mission, uav: int, time_s: float) -> bool:
    """Whether the UAV is home for good, and silent."""
    return mission.phase[uav] == FLYING_HOME and mission.leg_end_s[uav] <= time_s


@kernel
def has_fault(mission: Mission, kind: int, uav: int, time_s: float) -> bool:
    """Whether a fault of a kind has befallen a UAV by a time."""
    return mission.fault_s[kind * len(mission.phase) + uav] <= time_s


@kernel
def _is_mute(mission: Mission, uav: int, time_s: float) -> bool:
    return has_landed(mission, uav, time_s) or has_fault(mission, SILENT, uav, time_s)


@kernel
def _progress(mission: Mission, uav: int, time_s: float) -> float:
    # Not until the leg's end: a UAV that waits for others has come to the place before.
    start_s = mission.leg_start_s[uav]
    acted_s = start_s + mission.duration_s[uav]
    if time_s >= acted_s or acted_s <= start_s:
        return 1.0
    return (time_s - start_s) / (acted_s - start_s)


@kernel
def place_at(briefing: Briefing, mission: Mission, uav: int, time_s: float) -> tuple[float, float]:
    """Where a UAV is during its running action, or after: east and north [m]."""
    x_m, y_m, end_x_m, end_y_m, share = straight_at(briefing, mission, uav, time_s)
    return x_m + (end_x_m - x_m) * share, y_m + (end_y_m - y_m) * share


@kernel
def straight_at(
    briefing: Briefing, mission: Mission, uav: int, time_s: float
) -> tuple[float, float, float, float, float]:
    """The straight part of its running action on which a UAV is.

    An action is one as a whole, but for a way home around closed cells.

    Returns:
        As `actions.on_way_home`.
    """
    share = _progress(mission, uav, time_s)
    x_m, y_m = mission.leg_start_x_m[uav], mission.leg_start_y_m[uav]
    if briefing.has_obstacles == 1 and mission.phase[uav] == FLYING_HOME:
        return actions.on_way_home(briefing, uav, x_m, y_m, share)
    return x_m, y_m, mission.leg_end_x_m[uav], mission.leg_end_y_m[uav], share


@kernel
def contacts(briefing: Briefing, mission: Mission, uav: int, time_s: float) -> int:
    """The UAVs in contact with one, as bits: within range of it, none landed or silent."""
    x_m, y_m, found = mission.place_x_m, mission.place_y_m, 0
    if _is_mute(mission, uav, time_s):
        return found
    for other in range(briefing.n_uavs):
        x_m[other], y_m[other] = place_at(briefing, mission, other, time_s)
    for other in range(briefing.n_uavs):
        east_m, north_m = x_m[uav] - x_m[other], y_m[uav] - y_m[other]
        distance_m = math.sqrt(east_m * east_m + north_m * north_m)
        is_near = other != uav and distance_m <= briefing.contact_range_m
        if is_near and not _is_mute(mission, other, time_s):
            found |= 1 << other
    return found


@kernel
def look(
    briefing: Briefing, sensor_field: SensorField, mission: Mission, uav: int, rows: ViewRows
) -> LocalView:
    """What the deciding UAV sees as its action ends; its channels are drawn here.

    A channel stays as drawn while the UAV stays: the key is the visit, not the look.
    """
    time_s = mission.leg_end_s[uav]
    x_m, y_m = mission.leg_end_x_m[uav], mission.leg_end_y_m[uav]
    cell = actions.cell_under(briefing, x_m, y_m)
    mission.clock_s[0] = time_s
    for index in range(VIEW_CELLS):
        seen = actions.neighbour(briefing, cell, index // 3 - 1, index % 3 - 1)
        rows.region_bit[index] = mission.cell_bit[seen] if seen >= 0 else math.nan
    n_sensors = 0
    if mission.cell_bit[cell] > 0.0:
        visit = mission.n_visits[uav * len(mission.cell_bit) + cell]
        for sensor in range(sensor_field.first_sensor[cell], sensor_field.first_sensor[cell + 1]):
            if mission.waiting_bit[sensor] > 0.0:
                gain, error_gain = draw_channel(sensor_field, mission.seed[0], uav, sensor, visit)
                mission.gain[sensor] = gain
                mission.error_gain[sensor] = error_gain
                rows.sensor[n_sensors] = sensor
                rows.sensor_bit[n_sensors] = mission.waiting_bit[sensor]
                rows.sensor_gain[n_sensors] = gain
                rows.sensor_error_gain[n_sensors] = error_gain
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
def draw_channel(
    sensor_field: SensorField, mission_seed: int, uav: int, sensor: int, visit: int
) -> tuple[float, float]:
    """The gain of a channel on a UAV's visit to the sensor's cell, and its estimation error."""
    gain, path_gain = channel_draw(
        mission_seed,
        uav,
        sensor,
        visit,
        sensor_field.n_antennas,
        sensor_field.los_probability[sensor],
        sensor_field.path_gain[sensor],
        sensor_field.nlos_attenuation,
        sensor_field.rician_factor[sensor],
    )
    return gain, path_gain * sensor_field.csi_error_variance


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
    start_leg(mission, uav, HOVER, view.x_m, view.y_m, duration_s, energy_j)
    mission.n_decisions[uav] += 1
    return collected_bit


@kernel
def _move(briefing: Briefing, mission: Mission, uav: int, action: int) -> None:
    x_m, y_m = mission.leg_end_x_m[uav], mission.leg_end_y_m[uav]
    cell = actions.cell_under(briefing, x_m, y_m)
    target = actions.neighbour(briefing, cell, ROW_STEP[action], COLUMN_STEP[action])
    mission.n_visits[uav * len(mission.cell_bit) + target] += 1
    duration_s = actions.move_duration_s(briefing, uav)
    x_m = (target % briefing.n_columns + 0.5) * briefing.cell_size_m
    y_m = (target // briefing.n_columns + 0.5) * briefing.cell_size_m
    energy_j = briefing.flight_power_w[uav] * duration_s
    start_leg(mission, uav, action, x_m, y_m, duration_s, energy_j)
    mission.n_decisions[uav] += 1


@kernel
def _fly_home(briefing: Briefing, mission: Mission, uav: int) -> None:
    x_m, y_m = mission.leg_end_x_m[uav], mission.leg_end_y_m[uav]
    duration_s = actions.home_duration_s(briefing, uav, x_m, y_m)
    energy_j = actions.home_energy_j(briefing, uav, x_m, y_m)
    home_x_m, home_y_m = briefing.home_x_m[uav], briefing.home_y_m[uav]
    start_leg(mission, uav, HOME, home_x_m, home_y_m, duration_s, energy_j)
    mission.phase[uav] = FLYING_HOME


@kernel
def start_leg(
    mission: Mission,
    uav: int,
    action: int,
    x_m: float,
    y_m: float,
    duration_s: float,
    energy_j: float,
) -> None:
    """Let a UAV's next leg begin where and when its last one ended; an action is one leg."""
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

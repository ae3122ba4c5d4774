"""Missions as kernels read and write them: the rows of one, the tables of many."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel, row_kernel
from uav_collect.kernels.rows import new_table
from uav_collect.uav.actions import NONE
from uav_collect.uav.briefing import Briefing
from uav_collect.world.sensor_field import draw_demand, Ground

# Phases of a UAV.
ACTIVE = 0
FLYING_HOME = 1


class Mission(NamedTuple):
    """One mission in flight: rows by UAV, sensor or cell. Only this module and `world` write."""

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

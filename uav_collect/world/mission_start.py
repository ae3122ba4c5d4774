"""Missions at their start, and back there."""

from collections.abc import Sequence
import math
from typing import Any

from uav_collect.kernels.arrays import new_table
from uav_collect.kernels.compile import kernel
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.briefing import Briefing
from uav_collect.world.dynamics import (
    ACTIVE,
    Mission,
    mission_of,
    MissionRows,
    Missions,
    N_FAULT_KINDS,
)
from uav_collect.world.sensor_field import draw_demand, SensorField


def new_missions(
    briefing: Briefing, sensor_field: SensorField, mission_seeds: Sequence[int]
) -> Missions:
    """Missions at their start: fully charged UAVs at their starts, demand drawn."""
    n_worlds, n_uavs = len(mission_seeds), briefing.n_uavs
    n_cells, n_sensors = len(sensor_field.first_sensor) - 1, len(sensor_field.path_gain)
    sizes = {
        'seed': 1, 'clock_s': 1, 'collected_bit': 1, 'n_visits': n_uavs * n_cells,
        'cell_bit': n_cells,
    } | dict.fromkeys(
        ('demand_bit', 'waiting_bit', 'gain', 'error_gain', 'rate_bps', 'upload_s'), n_sensors
    ) | dict.fromkeys(
        ('fault_s', 'fault_decision', 'fault_event'), N_FAULT_KINDS * n_uavs
    )  # fmt: skip
    counts = {
        'seed', 'phase', 'action', 'n_decisions', 'n_visits', 'fault_decision', 'fault_event'
    }  # fmt: skip
    tables: dict[str, Any] = {
        name: new_table(n_worlds, sizes.get(name, n_uavs), 0 if name in counts else 0.0)
        for name in MissionRows._fields
    }
    missions: Missions = MissionRows(**tables)
    for world, seed in enumerate(mission_seeds):
        missions.seed[world][0] = seed
    restart(briefing, sensor_field, missions, n_worlds)
    return missions


@kernel
def restart(
    briefing: Briefing, sensor_field: SensorField, missions: Missions, n_worlds: int
) -> None:
    """Put the first missions of a batch back to their start, each by its own seed."""
    for world in range(n_worlds):
        restart_mission(briefing, sensor_field, mission_of(missions, world))


@kernel
def restart_mission(briefing: Briefing, sensor_field: SensorField, mission: Mission) -> None:
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
    for place in range(len(mission.fault_s)):
        mission.fault_s[place] = math.inf
        mission.fault_decision[place] = NONE
        mission.fault_event[place] = NONE
    for index in range(len(mission.n_visits)):
        mission.n_visits[index] = 0
    draw_demand(sensor_field, mission.seed[0], mission.demand_bit)
    for cell in range(len(mission.cell_bit)):
        mission.cell_bit[cell] = 0.0
        for sensor in range(sensor_field.first_sensor[cell], sensor_field.first_sensor[cell + 1]):
            mission.waiting_bit[sensor] = mission.demand_bit[sensor]
            mission.cell_bit[cell] += mission.demand_bit[sensor]
            mission.rate_bps[sensor] = 0.0
            mission.upload_s[sensor] = 0.0

"""Rows that kernels log events to, one column per field of the mission log."""

from collections.abc import Iterable, Sequence
import math
from typing import Any, NamedTuple

import numpy as np
from uav_collect.kernels.arrays import grow_table, new_table, Row
from uav_collect.limits import GUARD_AFTER
from uav_collect.recording.log_model import EVENT_DTYPE
from uav_collect.recording.mission_log import (
    Events,
    FaultRecord,
    MissionHeader,
    UavHeader,
)
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import FAULT_KINDS, Scenario
from uav_collect.uav.action_codes import NONE

_ALL_BITS = 2**64 - 1


class EventLog(NamedTuple):
    """Tables of one row per mission, (W, capacity); the fields of mission_log.EVENT_DTYPE."""

    event: Row[Row[int]]
    time_s: Row[Row[float]]
    uav: Row[Row[int]]
    decision: Row[Row[int]]
    x_m: Row[Row[float]]
    y_m: Row[Row[float]]
    action: Row[Row[int]]
    reason: Row[Row[int]]
    duration_s: Row[Row[float]]
    energy_left_j: Row[Row[float]]
    energy_j: Row[Row[float]]
    collected_bit: Row[Row[float]]
    n_sensors: Row[Row[int]]
    heard: Row[Row[int]]
    known_complete: Row[Row[int]]
    interval_s: Row[Row[float]]
    reward: Row[Row[float]]


def new_log(n_worlds: int, capacity: int) -> EventLog:
    """Room for so many events of each mission."""
    tables: dict[str, Any] = {
        name: new_table(n_worlds, capacity, 0.0 if EVENT_DTYPE[name].kind == 'f' else 0)
        for name in EVENT_DTYPE.names or ()
    }
    return EventLog(**tables)


def grown_log(log: EventLog, n_worlds: int) -> EventLog:
    """Twice the room, the events kept."""
    capacity = 2 * len(log.event[0])
    tables: list[Any] = [grow_table(table, n_worlds, capacity) for table in log]
    return EventLog(*tables)


def logged_events(log: EventLog, world: int, n_events: int, first: int = 0) -> Events:
    """The events of one mission as the mission log keeps them, from one of them on."""
    events = np.zeros(n_events - first, dtype=EVENT_DTYPE)
    for name in EVENT_DTYPE.names or ():
        column = getattr(log, name)[world][first:n_events]
        # The bits of 64 UAVs stand in signed integers: an array wraps them back, a list does not.
        if name == 'heard' and isinstance(column, list):
            column = [bits & _ALL_BITS for bits in column]
        events[name] = column
    return events


def mission_header(
    scenario: Scenario,
    mission_seed: int,
    demand_bit: Iterable[float],
    policies: Sequence[str],
    allocators: Sequence[str],
    guards: Sequence[int],
) -> MissionHeader:
    """The log header of a mission; policies, allocators and guards by UAV.

    Args:
        guards: decisions without news after which each guard decides; NONE: there is none to tell.
    """
    uavs = tuple(
        UavHeader(
            id=index + 1,
            speed_mps=uav.speed_mps,
            energy_budget_j=uav.energy_budget_j,
            energy_margin_j=uav.energy_margin_j,
            policy=policies[index],
            allocator=allocators[index],
            guard_after=GUARD_AFTER if guards[index] == NONE else guards[index],
        )
        for index, uav in enumerate(scenario.uavs)
    )
    return MissionHeader(
        scenario=scenario.name,
        scenario_fingerprint=fingerprint(scenario),
        mission_seed=mission_seed,
        n_rows=scenario.area.n_rows,
        n_columns=scenario.area.n_columns,
        cell_size_m=scenario.area.cell_size_m,
        total_bit=math.fsum(demand_bit),
        uavs=uavs,
    )


def fault_fields(faults: Sequence[FaultRecord]) -> dict[str, list[Any]]:
    """What an Epoch message says of faults, by field."""
    return {
        'fault': [FAULT_KINDS.index(fault.fault) for fault in faults],
        'fault_uav': [fault.uav for fault in faults],
        'fault_s': [fault.time_s for fault in faults],
    }

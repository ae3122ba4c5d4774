"""Rows that kernels log events to, one column per field of the mission log."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.rows import grow_table, new_table
from uav_collect.recording.mission_log import EVENT_DTYPE, Events
from uav_collect.uav.actions import HOME
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.view import LocalView
from uav_collect.world.reward import interval_reward, terminal_reward
from uav_collect.world.sensor_field import Ground
from uav_collect.world.state import Mission

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


def signed_bits(places: Iterable[int]) -> int:
    """The 64-bit integer with these bits set; the last of them is the sign, as in a kernel."""
    bits: int = sum(1 << place for place in places)
    return bits - (bits >> 63 << 64)


@kernel
def log_event(
    log: EventLog,
    world: int,
    index: int,
    mission: Mission,
    belief_complete: int,
    uav: int,
    view: LocalView,
    reason: int,
    collected_bit: float,
    heard: int,
) -> None:
    """Log an event right after the deciding UAV's action started.

    Args:
        index: running number of the event.
        belief_complete: completed cells in the UAV's map.
        heard: bits of the UAVs in contact, as a signed 64-bit integer.
    """
    started = 0 if mission.action[uav] == HOME else 1
    log.event[world][index] = index
    log.time_s[world][index] = view.time_s
    log.uav[world][index] = uav + 1
    log.decision[world][index] = mission.n_decisions[uav] - started
    log.x_m[world][index] = view.x_m
    log.y_m[world][index] = view.y_m
    log.action[world][index] = mission.action[uav]
    log.reason[world][index] = reason
    log.duration_s[world][index] = mission.duration_s[uav]
    log.energy_left_j[world][index] = view.energy_left_j
    log.energy_j[world][index] = mission.energy_j[uav]
    log.collected_bit[world][index] = collected_bit
    log.n_sensors[world][index] = view.n_sensors if collected_bit > 0.0 else 0
    log.heard[world][index] = heard
    log.known_complete[world][index] = belief_complete


@kernel
def log_interval(
    log: EventLog,
    world: int,
    index: int,
    briefing: Briefing,
    ground: Ground,
    mission: Mission,
    stop_s: float,
) -> None:
    """Add the interval after an event, and its reward, when the next event or the end is known."""
    start_s = log.time_s[world][index]
    log.interval_s[world][index] = stop_s - start_s
    log.reward[world][index] = interval_reward(
        briefing, ground, mission, start_s, stop_s
    ) + terminal_reward(briefing, ground, mission, start_s)

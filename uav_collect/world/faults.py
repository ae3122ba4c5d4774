"""What befalls UAVs on purpose: which fault, which UAV, from when on.

- gone: its agent is. From its next decision on the UAV decides nothing; the failsafe flies it
  home, its radio on.
- silent: its radio neither sends nor hears.
- slow: what it does takes twice as long, at the same power, as against a head wind; less where it
  could then not fly home any more. The way home takes no longer.

The others are told of none of it. What a scenario says is drawn by the mission's seed; an
injected fault begins with the next event that is not drawn yet.
"""

from collections.abc import Iterator
from typing import NamedTuple

from uav_collect.kernels.arrays import filled_row, Row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.keyed_random import draw_uniform, FAULT
from uav_collect.recording.mission_log import FaultRecord
from uav_collect.scenario.model import FAULT_KINDS, Scenario
from uav_collect.uav.action_codes import HOME, NONE
from uav_collect.uav.actions import home_energy_j
from uav_collect.uav.briefing import Briefing
from uav_collect.world.dynamics import (
    has_fault,
    Mission,
    mission_of,
    Missions,
    N_FAULT_KINDS,
    SLOW,
)

_MOST_SLOWED = 1.0  # times its duration that an action of a slow UAV takes longer

# What is drawn of a fault, an index of its stream.
_HAPPENS = 0
_UAV = 1
_WHEN = 2


class Faults(NamedTuple):
    """The faults of a scenario, rows by fault."""

    kind: Row[int]
    uav: Row[int]  # index; NONE: any, drawn
    share: Row[float]  # of missions that it happens in
    first_s: Row[float]  # begins at a time from here; nan: at a decision
    last_s: Row[float]  # to here
    first_decision: Row[int]  # begins at a decision from here; NONE: at a time
    last_decision: Row[int]  # to here


def faults_of(scenario: Scenario) -> Faults:
    """The rows of a scenario's faults."""
    faults = scenario.faults or ()
    return Faults(
        kind=filled_row([FAULT_KINDS.index(fault.kind) for fault in faults], 0),
        uav=filled_row([NONE if fault.uav == 'any' else fault.uav - 1 for fault in faults], 0),
        share=filled_row([fault.mission_share for fault in faults], 0.0),
        first_s=filled_row([fault.span_s[0] for fault in faults], 0.0),
        last_s=filled_row([fault.span_s[1] for fault in faults], 0.0),
        first_decision=filled_row([fault.span_decisions[0] for fault in faults], 0),
        last_decision=filled_row([fault.span_decisions[1] for fault in faults], 0),
    )


@kernel
def draw_faults(faults: Faults, mission: Mission) -> None:
    """Draw when which UAV has which fault, for a mission at its start."""
    n_uavs, seed = len(mission.phase), mission.seed[0]
    for index in range(len(faults.kind)):
        if draw_uniform(seed, FAULT, index, _HAPPENS, 0) >= faults.share[index]:
            continue
        uav = faults.uav[index]
        if uav == NONE:
            uav = int(draw_uniform(seed, FAULT, index, _UAV, 0) * n_uavs)
        place, when = faults.kind[index] * n_uavs + uav, draw_uniform(seed, FAULT, index, _WHEN, 0)
        if faults.first_decision[index] == NONE:
            span_s = faults.last_s[index] - faults.first_s[index]
            begin_s = faults.first_s[index] + span_s * when
            mission.fault_s[place] = min(mission.fault_s[place], begin_s)
            continue
        n_decisions = faults.last_decision[index] - faults.first_decision[index] + 1
        decision = faults.first_decision[index] + int(n_decisions * when)
        earlier = mission.fault_decision[place]
        mission.fault_decision[place] = decision if earlier == NONE else min(earlier, decision)


@kernel
def draw_all_faults(faults: Faults, missions: Missions, n_worlds: int) -> None:
    """Draw the faults of the first missions of a batch, all at their start."""
    for world in range(n_worlds):
        draw_faults(faults, mission_of(missions, world))


@kernel
def note_faults(mission: Mission, uav: int, time_s: float, event: int) -> None:
    """Begin what begins at a UAV's decision, and note what has begun by this event."""
    n_uavs = len(mission.phase)
    for kind in range(N_FAULT_KINDS):
        place = kind * n_uavs + uav
        is_due = 0 <= mission.fault_decision[place] <= mission.n_decisions[uav]
        if is_due and mission.fault_s[place] > time_s:
            mission.fault_s[place] = time_s
    for place in range(len(mission.fault_s)):
        if mission.fault_s[place] <= time_s and mission.fault_event[place] == NONE:
            mission.fault_event[place] = event


@kernel
def slow_down(briefing: Briefing, mission: Mission, uav: int) -> None:
    """Let the action that a UAV has just started take longer if it is slow."""
    duration_s, energy_j = mission.duration_s[uav], mission.energy_j[uav]
    if not has_fault(mission, SLOW, uav, mission.leg_start_s[uav]) or energy_j <= 0.0:
        return
    if mission.action[uav] == HOME:
        return
    x_m, y_m = mission.leg_end_x_m[uav], mission.leg_end_y_m[uav]
    reserve_j = home_energy_j(briefing, uav, x_m, y_m) + briefing.energy_margin_j[uav]
    spare_j = max(mission.energy_left_j[uav] - reserve_j, 0.0)
    slowed = min(_MOST_SLOWED, spare_j / energy_j)
    mission.duration_s[uav] = duration_s * (1.0 + slowed)
    mission.energy_j[uav] = energy_j * (1.0 + slowed)
    mission.leg_end_s[uav] = mission.leg_start_s[uav] + mission.duration_s[uav]
    mission.energy_left_j[uav] -= energy_j * slowed


def inject_fault(mission: Mission, kind: int, uav: int) -> None:
    """Let a fault befall a UAV now: from the latest event on, but for that event itself."""
    place = kind * len(mission.phase) + uav
    mission.fault_s[place] = min(mission.fault_s[place], mission.clock_s[0])


def fault_records(mission: Mission) -> tuple[FaultRecord, ...]:
    """The faults that have begun, in the order of the events that they were there at."""
    return tuple(sorted(_records(mission), key=lambda it: (it.event, it.time_s, it.uav)))


def _records(mission: Mission) -> Iterator[FaultRecord]:
    n_uavs = len(mission.phase)
    for place, event in enumerate(mission.fault_event):
        if event != NONE:
            yield FaultRecord(
                event=int(event),
                time_s=float(mission.fault_s[place]),
                uav=place % n_uavs + 1,
                fault=FAULT_KINDS[place // n_uavs],
            )

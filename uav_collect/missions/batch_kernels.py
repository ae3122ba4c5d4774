"""Carries many missions from one decision to the next: the kernels under `stepping`."""

from typing import NamedTuple

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel
from uav_collect.missions.batch import arrive, Batch
from uav_collect.missions.event_log import EventLog, log_event, log_interval
from uav_collect.missions.experience import record, Records
from uav_collect.uav import actions
from uav_collect.uav.actions import HOME, HOVER, N_ACTIONS, NONE
from uav_collect.uav.agent import allocate
from uav_collect.uav.belief import belief_of, forget
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.exploration import explore
from uav_collect.uav.observation import encode
from uav_collect.uav.view import LocalView
from uav_collect.world.dynamics import end_s, look, next_uav, start_action, wait_for_the_slowest
from uav_collect.world.reward import (
    discount,
    energy_reward,
    interval_reward,
    news_reward,
    Reward,
    terminal_reward,
)
from uav_collect.world.sensor_field import Ground
from uav_collect.world.state import Mission, mission_of, restart_mission

_ENERGY = int(Reward.ENERGY)


class Rules(NamedTuple):
    """What `vector_env.Stepping` says, as kernels read it."""

    layout: int
    allocator: int
    reward: int
    is_synchronous: int
    is_logged: int
    n_rows: int  # records that a mission has room for


class Desks(NamedTuple):
    """What each mission waits for; kernels write it."""

    uav: Row[int]  # (W,) NONE once the mission is over
    time_s: Row[float]  # (W,)
    duration_s: Row[float]  # (W,)
    reward: Row[float]  # (W,)
    legal: Row[Row[int]]  # (W, N_ACTIONS)
    observation: Row[Row[float]]  # (W, observation_size)
    heard: Row[int]  # (W,) UAVs in contact, as bits
    n_records: Row[int]  # (W,)
    complete: Row[Row[int]]  # (W, C) the union of the UAVs' maps


class Air(NamedTuple):
    """All that kernels need of the flights."""

    rules: Rules
    briefing: Briefing
    ground: Ground
    batch: Batch
    desks: Desks
    log: EventLog
    records: Records


@kernel
def explore_batch(air: Air, epsilon: float, hover_share: float, actions: Row[int]) -> None:
    """Write the random action of each mission's decision; NONE stays where nobody explores."""
    for world in range(len(actions)):
        uav = air.desks.uav[world]
        if uav != NONE:
            mission = mission_of(air.batch.missions, world)
            seed, decision = mission.seed[0], mission.n_decisions[uav]
            legal = air.desks.legal[world]
            actions[world] = explore(seed, uav, decision, epsilon, hover_share, legal)


@kernel
def step_batch(air: Air, answers: Row[int]) -> None:
    """Carry out a decision of each mission and go on to its next one."""
    briefing, batch, desks = air.briefing, air.batch, air.desks
    for world in range(len(answers)):
        uav = desks.uav[world]
        if uav == NONE:
            desks.duration_s[world] = 0.0
            desks.reward[world] = 0.0
            continue
        mission = mission_of(batch.missions, world)
        # A second look shows the same channels as the first.
        view = look(briefing, air.ground, mission, uav, batch.view_rows)
        if answers[world] == HOVER:
            allocate(air.rules.allocator, briefing, view, batch.desk)
        if desks.n_records[world] > 0:
            row = world * air.rules.n_rows + desks.n_records[world] - 1
            air.records.action[row] = answers[world]
        bit = start_action(briefing, mission, uav, view, answers[world], batch.desk.share_hz)
        _log(air, world, uav, view, actions.BY_POLICY, bit, desks.heard[world])
        go_on(air, world)


@kernel
def put_back(air: Air, world: int) -> None:
    """Put a mission back to its start."""
    briefing, batch = air.briefing, air.batch
    restart_mission(briefing, air.ground, mission_of(batch.missions, world))
    for uav in range(briefing.n_uavs):
        forget(belief_of(batch.beliefs, world * briefing.n_uavs + uav))
    batch.n_events[world][0] = 0
    air.desks.n_records[world] = 0
    for cell in range(briefing.cells_per_side * briefing.cells_per_side):
        air.desks.complete[world][cell] = 0


@kernel
def go_on(air: Air, world: int) -> None:
    """Go on to a mission's next decision, past the UAVs that turn home."""
    briefing, ground, batch, desks = air.briefing, air.ground, air.batch, air.desks
    mission = mission_of(batch.missions, world)
    first_s = mission.clock_s[0]
    start_s = first_s
    reward = 0.0
    last = desks.n_records[world] - 1
    while True:
        if air.rules.is_synchronous == 1:
            wait_for_the_slowest(briefing, mission)
        uav = next_uav(mission)
        stop_s = mission.leg_end_s[uav] if uav >= 0 else end_s(mission)
        gained = _interval_reward(air, mission, start_s, stop_s)
        reward += discount(ground, start_s - first_s) * gained
        n_events = batch.n_events[world][0]
        if air.rules.is_logged == 1 and n_events > 0:
            log_interval(air.log, world, n_events - 1, briefing, ground, mission, stop_s)
        start_s = stop_s
        if uav < 0:
            break
        view, reason, heard = arrive(air.rules.allocator, briefing, ground, batch, world, uav)
        reward += discount(ground, start_s - first_s) * _news_reward(air, world, uav)
        if reason == NONE:
            belief = belief_of(batch.beliefs, world * briefing.n_uavs + uav)
            encode(air.rules.layout, briefing, uav, belief, view, desks.observation[world])
            desks.heard[world] = heard
            _record(air, world, uav, view)
            break
        start_action(briefing, mission, uav, view, HOME, batch.desk.share_hz)
        _log(air, world, uav, view, reason, 0.0, heard)
    for action in range(N_ACTIONS):
        desks.legal[world][action] = batch.desk.legal[action] if uav >= 0 else 0
    desks.uav[world] = uav
    desks.time_s[world] = start_s
    desks.duration_s[world] = start_s - first_s
    desks.reward[world] = reward
    if last >= 0:
        air.records.reward[world * air.rules.n_rows + last] = reward
        air.records.duration_s[world * air.rules.n_rows + last] = start_s - first_s


@kernel
def _interval_reward(air: Air, mission: Mission, start_s: float, stop_s: float) -> float:
    if air.rules.reward == _ENERGY:
        return energy_reward(air.briefing, air.ground, mission, start_s, stop_s)
    return interval_reward(air.briefing, air.ground, mission, start_s, stop_s) + terminal_reward(
        air.briefing, air.ground, mission, start_s
    )


@kernel
def _news_reward(air: Air, world: int, uav: int) -> float:
    if air.rules.reward != _ENERGY:
        return 0.0
    known = air.batch.beliefs.complete[world * air.briefing.n_uavs + uav]
    return news_reward(known, air.desks.complete[world])


@kernel
def _log(
    air: Air, world: int, uav: int, view: LocalView, reason: int, bit: float, heard: int
) -> None:
    if air.rules.is_logged == 0:
        return
    index = air.batch.n_events[world][0]
    mission = mission_of(air.batch.missions, world)
    n_complete = air.batch.beliefs.n_complete[world * air.briefing.n_uavs + uav][0]
    log_event(air.log, world, index, mission, n_complete, uav, view, reason, bit, heard)
    air.batch.n_events[world][0] = index + 1


@kernel
def _record(air: Air, world: int, uav: int, view: LocalView) -> None:
    """Open the record of the decision waited for."""
    n_records = air.desks.n_records[world]
    if n_records == air.rules.n_rows:
        return
    row = world * air.rules.n_rows + n_records
    mission, beliefs = mission_of(air.batch.missions, world), air.batch.beliefs
    first_belief, legal = world * air.briefing.n_uavs, air.batch.desk.legal
    record(air.records, row, air.briefing, mission, beliefs, first_belief, uav, view, legal)
    air.desks.n_records[world] = n_records + 1

"""Flies whole missions in one process: compiled, many side by side, or agent by agent.

Both ways, and the ROS nodes, leave the same log of the same mission, to the byte.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
import math
from typing import NamedTuple

from uav_collect import actions
from uav_collect.actions import HOME, NONE
from uav_collect.agent import (
    Agent,
    allocate,
    allocator_named,
    Desk,
    must_go_home,
    new_desk,
)
from uav_collect.arrays import Row
from uav_collect.belief import belief_of, Beliefs, hear, new_beliefs, observe
from uav_collect.briefing import brief, Briefing
from uav_collect.compiled import kernel, row_kernel
from uav_collect.event_log import (
    EventLog,
    grown_log,
    log_event,
    log_interval,
    logged_events,
    new_log,
)
from uav_collect.ground import Ground, lay_out
from uav_collect.heuristics import choose, MEMORY_SIZE
from uav_collect.limits import ALLOCATOR_NAMES
from uav_collect.mission_log import MissionLog
from uav_collect.missions import (
    LocalView,
    mission_of,
    Missions,
    new_missions,
    new_view_rows,
    ViewRows,
)
from uav_collect.policy import Policy, policy_named, PolicyMismatchError, RulePolicy
from uav_collect.preflight import check_can_start
from uav_collect.rows import new_table
from uav_collect.scenario import Scenario
from uav_collect.simulation import mission_header, Simulation
from uav_collect.site import Site
from uav_collect.world import end_s, in_contact, look, next_uav, start_action, x_m_at, y_m_at

_FIRST_CAPACITY = 256  # events of a mission that the log has room for before it must grow


class Batch(NamedTuple):
    """Missions side by side, and what their UAVs believe and remember."""

    missions: Missions
    beliefs: Beliefs  # by mission, then UAV: (W * U, ...)
    memory: Row[Row[int]]  # of the rules, the same
    n_events: Row[Row[int]]  # (W, 1)
    desk: Desk
    view_rows: ViewRows


def fly(
    scenario: Scenario,
    site: Site,
    mission_seeds: Sequence[int],
    policy: str | Callable[[], Policy],
    allocator: str = 'exact',
) -> list[MissionLog]:
    """Fly missions, all UAVs by the same policy.

    Args:
        policy: a name that `policy.policy_named` knows, or what makes one UAV's policy.
        mission_seeds: one per mission, 0..2^63-1.
        allocator: how bandwidth is shared, one of `limits.ALLOCATOR_NAMES`.

    Raises:
        PolicyMismatchError: there is no such policy, or it breaks the rules in flight.
        AllocationError: there is no such allocator.
        ConfigError: the fleet has not the energy to start.
    """
    make_policy = partial(policy_named, policy) if isinstance(policy, str) else policy
    pilot = make_policy()
    allocator_named(allocator)  # raises before anything flies
    if isinstance(pilot, RulePolicy) and allocator != 'cvxpy':
        return _fly_compiled(scenario, site, mission_seeds, pilot, allocator)
    return [_fly_by_agents(scenario, site, seed, make_policy, allocator) for seed in mission_seeds]


def _fly_by_agents(
    scenario: Scenario,
    site: Site,
    mission_seed: int,
    make_policy: Callable[[], Policy],
    allocator: str,
) -> MissionLog:
    simulation = Simulation(scenario, site, mission_seed)
    n_uavs = scenario.n_uavs
    agents = [
        Agent(simulation.briefing, uav, make_policy(), allocator_named(allocator))
        for uav in range(n_uavs)
    ]
    while (event := simulation.next_event()) is not None:
        agent = agents[event.uav]
        for message in event.heard:
            agent.hear(message)
        agent.observe(event.view)
        hearers = simulation.transmit(event.uav, agent.belief.complete)
        for hearer in hearers:
            agents[hearer].hear(simulation.radio(event.uav))
        decision = agent.decide(event.view)
        refusal = simulation.refusal(event, decision)
        if refusal is not None:
            raise PolicyMismatchError(f'UAV {event.uav + 1}, event {event.index}: {refusal}')
        simulation.start(event, decision)
    names, allocators = [agent.policy.name for agent in agents], [allocator] * n_uavs
    header = mission_header(scenario, mission_seed, simulation.demand_bit, names, allocators)
    return simulation.log(header)


def _fly_compiled(
    scenario: Scenario,
    site: Site,
    mission_seeds: Sequence[int],
    policy: RulePolicy,
    allocator: str,
) -> list[MissionLog]:
    briefing, ground = brief(scenario), lay_out(scenario, site)
    check_can_start(scenario, briefing)
    n_worlds = len(mission_seeds)
    batch = new_batch(briefing, ground, mission_seeds)
    log = new_log(n_worlds, _FIRST_CAPACITY)
    rule, share = int(policy.heuristic), ALLOCATOR_NAMES.index(allocator)
    flown = fly_batch(rule, share, briefing, ground, batch, log, 0)
    while flown < n_worlds:
        log = grown_log(log, n_worlds)
        flown = fly_batch(rule, share, briefing, ground, batch, log, flown)
    names, allocators = [policy.name] * briefing.n_uavs, [allocator] * briefing.n_uavs
    header = mission_header(scenario, 0, (), names, allocators)
    return [
        MissionLog(
            header=replace(header, mission_seed=seed, total_bit=math.fsum(demand_bit)),
            events=logged_events(log, world, batch.n_events[world][0]),
        )
        for world, (seed, demand_bit) in enumerate(
            zip(mission_seeds, batch.missions.demand_bit, strict=True)
        )
    ]


def new_batch(briefing: Briefing, ground: Ground, mission_seeds: Sequence[int]) -> Batch:
    """Missions at their start."""
    n_worlds, n_uavs = len(mission_seeds), briefing.n_uavs
    view_rows = new_view_rows(ground)
    return Batch(
        missions=new_missions(briefing, ground, mission_seeds),
        beliefs=new_beliefs(briefing, n_worlds * n_uavs),
        memory=new_table(n_worlds * n_uavs, MEMORY_SIZE, 0),
        n_events=new_table(n_worlds, 1, 0),
        desk=new_desk(len(view_rows.sensor)),
        view_rows=view_rows,
    )


@kernel
def fly_batch(
    heuristic: int,
    allocator: int,
    briefing: Briefing,
    ground: Ground,
    batch: Batch,
    log: EventLog,
    first: int,
) -> int:
    """Fly the missions of a batch by a rule, from one of them on.

    Returns:
        The mission at which the log had no more room, to go on with; past the last when done.
    """
    n_worlds = len(batch.n_events)
    for world in range(first, n_worlds):
        mission = mission_of(batch.missions, world)
        while next_uav(mission) >= 0:
            if batch.n_events[world][0] == len(log.event[world]):
                return world
            _fly_event(heuristic, allocator, briefing, ground, batch, log, world)
        last = batch.n_events[world][0] - 1
        log_interval(log, world, last, briefing, ground, mission, end_s(mission))
    return n_worlds


@kernel
def _fly_event(
    heuristic: int,
    allocator: int,
    briefing: Briefing,
    ground: Ground,
    batch: Batch,
    log: EventLog,
    world: int,
) -> None:
    mission = mission_of(batch.missions, world)
    uav = next_uav(mission)
    index = batch.n_events[world][0]
    if index > 0:
        log_interval(log, world, index - 1, briefing, ground, mission, mission.leg_end_s[uav])
    view, reason, heard = arrive(allocator, briefing, ground, batch, world, uav)
    belief = belief_of(batch.beliefs, world * briefing.n_uavs + uav)
    action = HOME
    if reason == NONE:
        reason = actions.BY_POLICY
        memory = batch.memory[world * briefing.n_uavs + uav]
        action = choose(heuristic, briefing, uav, belief, view, batch.desk.legal, memory)
    bit = start_action(briefing, mission, uav, view, action, batch.desk.share_hz)
    log_event(log, world, index, mission, belief.n_complete[0], uav, view, reason, bit, heard)
    batch.n_events[world][0] = index + 1


@row_kernel
def arrive(
    allocator: int, briefing: Briefing, ground: Ground, batch: Batch, world: int, uav: int
) -> tuple[LocalView, int, int]:
    """Let a UAV do what it does at its action's end before it chooses: look, talk, allocate.

    The bandwidth shares and the legal actions lie on the batch's desk.

    Returns:
        What it sees; why it must go home, or NONE; the UAVs in contact, as bits.
    """
    mission = mission_of(batch.missions, world)
    view = look(briefing, ground, mission, uav, batch.view_rows)
    belief = belief_of(batch.beliefs, world * briefing.n_uavs + uav)
    observe(belief, briefing, view)
    heard = _exchange(briefing, batch, world, uav, view.time_s)
    hover_s = allocate(allocator, briefing, view, batch.desk)
    legal = batch.desk.legal
    return view, must_go_home(briefing, uav, belief.n_complete[0], view, hover_s, legal), heard


@kernel
def _exchange(briefing: Briefing, batch: Batch, world: int, uav: int, time_s: float) -> int:
    """The deciding UAV hears all in contact, then they hear it; a bit mask of who they are."""
    mission = mission_of(batch.missions, world)
    first = world * briefing.n_uavs
    belief = belief_of(batch.beliefs, first + uav)
    heard = 0
    for other in range(briefing.n_uavs):
        if in_contact(briefing, mission, uav, other, time_s):
            heard |= 1 << other
            x_m, y_m = x_m_at(mission, other, time_s), y_m_at(mission, other, time_s)
            hear(belief, other, batch.beliefs.complete[first + other], x_m, y_m, time_s)
    x_m, y_m = x_m_at(mission, uav, time_s), y_m_at(mission, uav, time_s)
    for other in range(briefing.n_uavs):
        if heard >> other & 1:
            peer = belief_of(batch.beliefs, first + other)
            hear(peer, uav, belief.complete, x_m, y_m, time_s)
    return heard

"""Flies whole missions in one process: many side by side, or agent by agent.

All ways, and the ROS nodes, leave the same log of the same mission, to the byte.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
import math

import numpy as np
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.compile import kernel
from uav_collect.limits import ALLOCATOR_NAMES
from uav_collect.missions.batch import arrive, Batch, new_batch
from uav_collect.missions.event_log import (
    EventLog,
    grown_log,
    log_event,
    log_interval,
    logged_events,
    new_log,
)
from uav_collect.missions.simulation import mission_header, Simulation
from uav_collect.missions.vector_env import Flights, Stepping
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav import actions
from uav_collect.uav.actions import check_can_start, HOME, NONE
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.belief import belief_of
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.heuristics import choose
from uav_collect.uav.policy import LearnedPolicy, Policy, policy_for, RulePolicy
from uav_collect.uav.policy_network import best_actions
from uav_collect.world.dynamics import end_s, next_uav, start_action
from uav_collect.world.sensor_field import Ground, lay_out
from uav_collect.world.state import mission_of

_FIRST_CAPACITY = 256  # events of a mission that the log has room for before it must grow


def fly(
    site: Site,
    mission_seeds: Sequence[int],
    policy: str | Callable[[], Policy],
    allocator: str = 'exact',
) -> list[MissionLog]:
    """Fly missions, all UAVs by the same policy.

    Args:
        policy: a name that `policy.policy_for` knows, or what makes one UAV's policy.
        mission_seeds: one per mission, 0..2^63-1.
        allocator: how bandwidth is shared, one of `limits.ALLOCATOR_NAMES`.

    Raises:
        PolicyMismatchError: there is no such policy, it does not fit the scenario, or it breaks
            the rules in flight.
        AllocationError: there is no such allocator.
        ConfigError: the fleet has not the energy to start.
    """
    make_policy = _maker(policy, site.scenario)
    pilot = make_policy()
    allocator_named(allocator)  # raises before anything flies
    if allocator != 'cvxpy':
        if isinstance(pilot, RulePolicy):
            return _fly_by_rule(site, mission_seeds, pilot, allocator)
        if isinstance(pilot, LearnedPolicy):
            return _fly_learned(site, mission_seeds, pilot, allocator)
    return [_fly_by_agents(site, seed, make_policy, allocator) for seed in mission_seeds]


def _maker(policy: str | Callable[[], Policy], scenario: Scenario) -> Callable[[], Policy]:
    if not isinstance(policy, str):
        return policy
    # Each UAV gets a memory of its own; a file is read once.
    return partial(replace, policy_for(policy, scenario))


def _fly_by_agents(
    site: Site,
    mission_seed: int,
    make_policy: Callable[[], Policy],
    allocator: str,
) -> MissionLog:
    simulation = Simulation(site, mission_seed)
    n_uavs = site.scenario.n_uavs
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
    header = mission_header(site.scenario, mission_seed, simulation.demand_bit, names, allocators)
    return simulation.log(header)


def _fly_by_rule(
    site: Site,
    mission_seeds: Sequence[int],
    policy: RulePolicy,
    allocator: str,
) -> list[MissionLog]:
    briefing, ground = brief(site.scenario), lay_out(site)
    check_can_start(site.scenario, briefing)
    n_worlds = len(mission_seeds)
    batch = new_batch(briefing, ground, mission_seeds)
    log = new_log(n_worlds, _FIRST_CAPACITY)
    rule, share = int(policy.heuristic), ALLOCATOR_NAMES.index(allocator)
    flown = fly_batch(rule, share, briefing, ground, batch, log, 0)
    while flown < n_worlds:
        log = grown_log(log, n_worlds)
        flown = fly_batch(rule, share, briefing, ground, batch, log, flown)
    names, allocators = [policy.name] * briefing.n_uavs, [allocator] * briefing.n_uavs
    header = mission_header(site.scenario, 0, (), names, allocators)
    return [
        MissionLog(
            header=replace(header, mission_seed=seed, total_bit=math.fsum(demand_bit)),
            events=logged_events(log, world, batch.n_events[world][0]),
        )
        for world, (seed, demand_bit) in enumerate(
            zip(mission_seeds, batch.missions.demand_bit, strict=True)
        )
    ]


def _fly_learned(
    site: Site,
    mission_seeds: Sequence[int],
    policy: LearnedPolicy,
    allocator: str,
) -> list[MissionLog]:
    """All missions at once: what they wait for is one batch of decisions after the other."""
    policy.begin(brief(site.scenario), 0)
    frozen = policy.frozen
    rules = Stepping(layout=frozen.header.layout, allocator=allocator, is_logged=True)
    flights = Flights(site, mission_seeds, rules)
    n_worlds, n_uavs = len(mission_seeds), site.scenario.n_uavs
    hidden = frozen.new_hidden(n_worlds * n_uavs)  # by mission, then UAV
    chosen = np.zeros(n_worlds, dtype=np.int64)
    decisions = flights.decisions
    while len(waiting := np.flatnonzero(decisions.uav != NONE)):
        rows = waiting * n_uavs + decisions.uav[waiting]
        values, hidden[rows] = frozen.step(decisions.observation[waiting], hidden[rows])
        chosen[waiting] = best_actions(values, decisions.legal[waiting])
        decisions = flights.step(chosen)
    return [flights.mission_log(world, policy.name) for world in range(n_worlds)]


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


KERNELS = (fly_batch,)  # that fly missions by a rule

"""Flies whole missions in one process.

All ways, and the ROS nodes, leave the same log of the same mission, to the byte.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.batch_metrics import BatchMetrics
from uav_collect.missions.simulation import fly_by_agents
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav.agent import allocator_named
from uav_collect.uav.briefing import briefing_of
from uav_collect.uav.policy import guard_for, Policy, policy_for, rule_of
from uav_collect.uav.policy_network import LearnedPolicy


def fly(
    site: Site,
    mission_seeds: Sequence[int],
    policy: str | Callable[[], Policy],
    allocator: str = 'exact',
    guard_after: int = GUARD_AFTER,
    between_decisions: Callable[[], None] | None = None,
) -> list[MissionLog]:
    """Fly missions, all UAVs by the same policy.

    Args:
        policy: a name that `policy.policy_for` knows, or what makes one UAV's policy.
        mission_seeds: one per mission, 0..2^63-1.
        allocator: how bandwidth is shared, one of `limits.ALLOCATOR_NAMES`.
        guard_after: decisions without news after which a UAV's guard decides, unless a rule flies;
            0: never.
        between_decisions: called again and again while a network flies; what it raises ends that.

    Raises:
        PolicyMismatchError: there is no such policy, it does not fit the scenario, or it breaks
            the rules in flight.
        AllocationError: there is no such allocator.
        ConfigError: the fleet has not the energy to start.
    """
    make_policy = _maker(policy, site.scenario)
    allocator_named(allocator)  # raises before anything flies
    if allocator == 'cvxpy':  # no kernel: each UAV's agent shares its bandwidth by itself
        return [
            fly_by_agents(site, seed, make_policy, allocator, guard_after)
            for seed in mission_seeds
        ]
    config = _config(allocator, guard_after, is_logged=True)
    env, name = _flown(site, mission_seeds, make_policy, config, between_decisions)
    return env.mission_logs(name)


def fly_for_metrics(
    site: Site,
    mission_seeds: Sequence[int],
    policy: str | Callable[[], Policy],
    allocator: str = 'exact',
    guard_after: int = GUARD_AFTER,
) -> BatchMetrics:
    """Fly missions as `fly` does, without logs: only their metrics are kept.

    Args:
        allocator: exact or equal.

    Raises:
        PolicyMismatchError, AllocationError, ConfigError: as `fly`.
    """
    make_policy = _maker(policy, site.scenario)
    config = _config(allocator, guard_after, is_logged=False)
    env, _ = _flown(site, mission_seeds, make_policy, config)
    return env.metrics()


def _config(allocator: str, guard_after: int, *, is_logged: bool) -> VectorEnvConfig:
    return VectorEnvConfig(
        layout=None,
        allocator=allocator,
        reward=None,
        is_logged=is_logged,
        guard_after=guard_after,
    )


def _flown(
    site: Site,
    mission_seeds: Sequence[int],
    make_policy: Callable[[], Policy],
    config: VectorEnvConfig,
    between_decisions: Callable[[], None] | None = None,
) -> tuple[VectorEnv, str]:
    """Missions flown to their end, and the name of the policy that flew them.

    Args:
        config: without layout and rule; its guard is one for policies that need one.
    """
    pilot, briefing = make_policy(), briefing_of(site)
    if isinstance(pilot, LearnedPolicy):
        pilot.begin(briefing, 0)  # raises if it does not fit
    config = replace(config, guard_after=guard_for(pilot, config.guard_after, briefing))
    rule = rule_of(pilot, briefing)
    if rule is not None:
        return VectorEnv(site, mission_seeds, replace(config, rule=rule)), pilot.name
    if isinstance(pilot, LearnedPolicy):
        layout = pilot.frozen.header.layout
        env = VectorEnv(site, mission_seeds, replace(config, layout=layout))
        env.fly_by_network(pilot.frozen.over(briefing), between_decisions)
        return env, pilot.name
    env = VectorEnv(site, mission_seeds, config)
    env.fly_by_policies(make_policy)
    return env, pilot.name


def _maker(policy: str | Callable[[], Policy], scenario: Scenario) -> Callable[[], Policy]:
    if not isinstance(policy, str):
        return policy
    # Each UAV gets a memory of its own; a file is read once.
    return partial(replace, policy_for(policy, scenario))

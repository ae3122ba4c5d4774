"""Clairvoyant bounds of scenarios, and missions that fly their plans."""

from tiny_world import fly_scripts
from uav_collect.analysis.metrics import check_log, mission_metrics, MissionMetrics
from uav_collect.planning.bound import Bound, bound_of, flight_actions, Plan
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site


def bound(scenario: Scenario, seed: int = 0, allocator: str = 'exact') -> Bound:
    return bound_of(build_site(scenario), seed, allocator)


def plans(found: Bound) -> tuple[Plan, Plan]:
    assert found.shortest is not None
    assert found.thriftiest is not None
    return found.shortest, found.thriftiest


def flown(
    scenario: Scenario, plan: Plan, seed: int = 0, allocator: str = 'exact'
) -> MissionMetrics:
    log = fly_scripts(scenario, *flight_actions(scenario, plan), seed=seed, allocator=allocator)
    check_log(log)
    return mission_metrics(log)

"""What users call from Python, by way of the package itself: fly, evaluate, bound.

Scenarios are given by a shipped one's name, a YAML file or as loaded; policies by the names that
the commands know, or as a function or class of a `Situation`. As with the commands, small jobs do
not wait for kernels to be compiled.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TYPE_CHECKING

from uav_collect.errors import counted, PolicyMismatchError
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import GUARD_AFTER, MAX_GUARD_AFTER, MAX_SEED
from uav_collect.missions.small_jobs import choose_kernels, FLIGHTS_OF_A_PLAN
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario

if TYPE_CHECKING:  # loaded when flying, once it is settled how kernels run
    from uav_collect.analysis.choice import Choice
    from uav_collect.analysis.metrics import MissionMetrics
    from uav_collect.analysis.results import Evaluation, FlownMission
    from uav_collect.planning.bound import Bound
    from uav_collect.recording.mission_log import MissionLog
    from uav_collect.scenario.site import Site
    from uav_collect.uav.policy import NamedPolicy

AnyScenario = Scenario | str | Path
AnyPolicy = str | Callable[..., Any]

_AT_ONCE = 250  # missions whose logs are held in memory
_CANDIDATES = 6  # that are there for any scenario, more or less


def fly(
    scenario: AnyScenario,
    policy: AnyPolicy,
    *,
    seed: int = 0,
    bandwidth: str = 'exact',
    guard_after: int = GUARD_AFTER,
) -> 'FlownMission':
    """Fly one mission in this process.

    Args:
        policy: of every UAV.
        seed: draws demand and channels, 0..2^62; the mission is that of `mission --seed`.
        bandwidth: how a hover shares it: exact, equal or cvxpy.
        guard_after: decisions that teach a UAV of no complete cell, after which its guard takes
            over, unless a rule flies, until it knows more; 0: never.

    Raises:
        UavCollectError: the scenario is not valid, there is no such policy or bandwidth, or the
            policy does not fit the scenario or takes an illegal action.
        ValueError: the seed or the guard's patience is out of range.
    """
    _check_range('seed', seed, 0, MAX_SEED)
    _check_range('guard_after', guard_after, 0, MAX_GUARD_AFTER)
    loaded = _loaded(scenario)
    choose_kernels(1, loaded.n_cells, _names([policy]))
    from uav_collect.analysis.results import flown_mission
    from uav_collect.scenario.site import build_site

    site = build_site(loaded)
    with waiting_for('a mission'):
        [log] = _fly(site, [seed], _policy(policy, loaded), bandwidth, guard_after)
    return flown_mission(log, site)


def evaluate(
    scenario: AnyScenario,
    policies: AnyPolicy | Sequence[AnyPolicy],
    missions: int = 1000,
    *,
    seed: int = 0,
    bandwidth: str = 'exact',
    guard_after: int = GUARD_AFTER,
) -> 'Evaluation':
    """Fly the same missions with each policy.

    Args:
        policies: one, or several.
        missions: how many to fly with each.
        seed: of the first mission; the others have those after it.
        bandwidth: how a hover shares it: exact, equal or cvxpy.
        guard_after: as for `fly`.

    Raises:
        UavCollectError: as for `fly`, or two policies have the same name.
        ValueError: seed, number of missions or the guard's patience is out of range.
    """
    _check_range('missions', missions, 1, MAX_SEED)
    _check_range('seed', seed, 0, MAX_SEED - missions + 1)
    _check_range('guard_after', guard_after, 0, MAX_GUARD_AFTER)
    loaded, given = _loaded(scenario), _listed(policies)
    n_flights = missions * len(given)
    choose_kernels(n_flights, loaded.n_cells, _names(given))
    from uav_collect.analysis.results import by_measure, Evaluation
    from uav_collect.analysis.statistics import estimates, mission_seeds
    from uav_collect.scenario.site import build_site

    site, contenders = build_site(loaded), _by_name(given, loaded)
    seeds = mission_seeds(seed, missions)
    with waiting_for(counted(n_flights, 'mission')):
        flown = {
            name: _metrics(site, seeds, it, bandwidth, guard_after)
            for name, it in contenders.items()
        }
    return Evaluation(
        title=f'{loaded.name}, {counted(loaded.n_uavs, "UAV")}, {counted(missions, "mission")}'
        f' from seed {seed}, {bandwidth} bandwidth',
        metrics=flown,
        estimates={name: by_measure(estimates(rows, seed)) for name, rows in flown.items()},
        seed=seed,
    )


def choose_policy(
    scenario: AnyScenario,
    candidates: AnyPolicy | Sequence[AnyPolicy] = (),
    *,
    missions: int | None = None,
    bandwidth: str = 'exact',
    guard_after: int = GUARD_AFTER,
) -> 'Choice':
    """Find the best policy for a scenario: candidates fly the same sampled missions of it.

    Args:
        candidates: besides the policies that are shipped for the scenario, those that lie beside
            its file, sweep and hert.
        missions: that each flies; None: up to 200, fewer on large areas or by interpreted kernels.
        bandwidth: how a hover shares it: exact, equal or cvxpy.
        guard_after: as for `fly`.

    Returns:
        What each achieved. Its `policy` names the best; a function by its own name.

    Raises:
        UavCollectError: as for `fly`, or two policies have the same name.
        ValueError: the number of missions or the guard's patience is out of range.
    """
    if missions is not None:
        _check_range('missions', missions, 1, MAX_SEED)
    _check_range('guard_after', guard_after, 0, MAX_GUARD_AFTER)
    loaded, given = _loaded(scenario), _listed(candidates) if candidates else []
    # Unless they are counted, they are as many as kernels fly in a moment, however they run.
    n_flights = (missions or 0) * (_CANDIDATES + len(given))
    choose_kernels(n_flights, loaded.n_cells, _names(given))
    from uav_collect.analysis.choosing import Candidate, candidates_for, choose
    from uav_collect.scenario.site import build_site
    from uav_collect.uav.agent import allocator_named
    from uav_collect.uav.own_policy import own_policies

    allocator_named(bandwidth)  # raises where there is none
    own = _by_name(given, loaded) if given else {}
    refined = [] if isinstance(scenario, Scenario) else own_policies(scenario, loaded.n_uavs)
    found, _ = candidates_for(loaded, own=refined)
    known = {it.name for it in found}
    for policy, name in zip(given, own, strict=True):
        if not isinstance(policy, str) and name in known:
            raise PolicyMismatchError(f'policy {name} is a candidate already: rename your own')
    found += [Candidate(name=name, policy=it) for name, it in own.items() if name not in known]
    return choose(
        build_site(loaded),
        found,
        allocator=bandwidth,
        guard_after=guard_after,
        n_missions=missions,
    )


def bound(scenario: AnyScenario, *, seed: int = 0, bandwidth: str = 'exact') -> 'Bound':
    """What is possible in a mission for a fleet that knows all demand: plans, and their limits.

    Raises:
        UavCollectError: the scenario is not valid, or there is no such bandwidth.
        ValueError: the seed is out of range.
    """
    _check_range('seed', seed, 0, MAX_SEED)
    loaded = _loaded(scenario)
    choose_kernels(FLIGHTS_OF_A_PLAN, loaded.n_cells)
    from uav_collect.planning.bound import bound_of
    from uav_collect.scenario.site import build_site
    from uav_collect.uav.agent import allocator_named

    allocator_named(bandwidth)  # raises where there is none
    site = build_site(loaded)
    with waiting_for('the plans of a fleet that knows all demand'):
        return bound_of(site, seed, bandwidth)


def _loaded(scenario: AnyScenario) -> Scenario:
    return scenario if isinstance(scenario, Scenario) else load(scenario)


def _policy(policy: AnyPolicy, scenario: Scenario) -> 'NamedPolicy':
    from uav_collect.uav.policy import policy_for
    from uav_collect.uav.user_policy import policy_of

    return policy_for(policy, scenario) if isinstance(policy, str) else policy_of(policy)


def _listed(policies: AnyPolicy | Sequence[AnyPolicy]) -> Sequence[AnyPolicy]:
    return [policies] if isinstance(policies, str) or callable(policies) else policies


def _names(given: Sequence[AnyPolicy]) -> list[str]:
    """The names among policies, of which others are functions and classes."""
    return [policy for policy in given if isinstance(policy, str)]


def _by_name(given: Sequence[AnyPolicy], scenario: Scenario) -> 'dict[str, NamedPolicy]':
    """The policies by the names that they were given by; a function by its own."""
    policies = [_policy(policy, scenario) for policy in given]
    names = [
        name if isinstance(name, str) else policy.name
        for name, policy in zip(given, policies, strict=True)
    ]
    if not names or len({*names}) < len(names):
        shown = ', '.join(names) or 'none'
        raise PolicyMismatchError(f'policies are {shown}: must be one or more, each once')
    return dict(zip(names, policies, strict=True))


def _fly(
    site: 'Site', seeds: Sequence[int], policy: 'NamedPolicy', bandwidth: str, guard_after: int
) -> 'list[MissionLog]':
    from uav_collect.missions import rollout

    # Each UAV gets a memory of its own.
    return rollout.fly(site, seeds, partial(replace, policy), bandwidth, guard_after)


def _metrics(
    site: 'Site', seeds: Sequence[int], policy: 'NamedPolicy', bandwidth: str, guard_after: int
) -> 'list[MissionMetrics]':
    from uav_collect.analysis.metrics import mission_metrics

    flown = []
    for start in range(0, len(seeds), _AT_ONCE):
        logs = _fly(site, seeds[start : start + _AT_ONCE], policy, bandwidth, guard_after)
        flown += [mission_metrics(log) for log in logs]
    return flown


def _check_range(name: str, value: int, least: int, most: int) -> None:
    if not least <= value <= most:
        raise ValueError(f'{name} is {value}: must be {least}..{most}')

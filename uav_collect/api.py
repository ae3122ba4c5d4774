"""What users call from Python, by way of the package itself: fly, evaluate, bound.

Scenarios are given by a shipped one's name, a YAML file or as loaded; policies by the names that
the commands know, or as a function or class of a `Situation`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType
from uav_collect import files
from uav_collect.analysis.choice import Choice
from uav_collect.analysis.choosing import Candidate, candidates_for, choose
from uav_collect.analysis.console import plain_console
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.analysis.readings import is_left, mission_readings, Reading
from uav_collect.analysis.statistics import (
    Estimate,
    estimates,
    MEASURES,
    mission_seeds,
    paired_differences,
)
from uav_collect.analysis.tables import evaluation_table, mission_tables
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Floats
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import GUARD_AFTER, MAX_GUARD_AFTER, MAX_SEED
from uav_collect.missions import rollout
from uav_collect.planning.bound import Bound, bound_of
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.agent import allocator_named
from uav_collect.uav.own_policy import own_policies
from uav_collect.uav.policy import NamedPolicy, policy_for
from uav_collect.uav.user_policy import policy_of
from uav_collect.world.sensor_field import demand_of

AnyScenario = Scenario | str | Path
AnyPolicy = str | Callable[..., Any]

_AT_ONCE = 250  # missions whose logs are held in memory
_COLUMNS = 99  # of a table as text


@dataclass(frozen=True, kw_only=True, eq=False)
class FlownMission:
    """A mission that was flown, and where; printed, it is what it achieved, UAV by UAV."""

    log: MissionLog
    site: Site
    demand_bit: Floats  # (S,) at the start
    n_radio_messages: int | None = None  # None: a log does not tell
    is_whole: bool = True  # its end was recorded

    @cached_property
    def metrics(self) -> MissionMetrics:
        """What the mission achieved, and each UAV's part."""
        return mission_metrics(self.log)

    @cached_property
    def readings(self) -> tuple[Reading, ...]:
        """Which sensor was read when, by whom and at which rate, in the order of the hovers."""
        return mission_readings(self.log, self.site, self.demand_bit)

    @cached_property
    def unread(self) -> tuple[str, ...]:
        """The ids of the sensors whose data were left behind."""
        left = np.flatnonzero(is_left(self.log, self.site, self.demand_bit)).tolist()
        return tuple(self.site.sensor_ids[sensor] for sensor in left)

    def draw(self, file: str | Path) -> None:
        """Draw who flew where into a PNG file; the same mission gives the same bytes.

        Raises:
            OSError: the file cannot be written.
        """
        from uav_collect.analysis.trajectories import trajectories

        drawn = BytesIO()
        trajectories(self.log, self.site, self.demand_bit, drawn)
        files.write_result(Path(file), drawn.getvalue())

    def __str__(self) -> str:
        n_messages, left = self.n_radio_messages, self.unread
        return _text(mission_tables(self.log.header, self.metrics, n_messages, left=left))


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """What policies achieve in the same missions; printed, it is a table of means."""

    title: str
    metrics: Mapping[str, Sequence[MissionMetrics]]  # by policy as given, in the seeds' order
    estimates: Mapping[str, Mapping[str, Estimate]]  # by policy and measure, such as completion_s
    seed: int  # of the first mission; keys the bootstrap

    def difference(self, policy: str, other: str) -> Mapping[str, Estimate]:
        """By how much a policy is above another one, mission by mission; by measure.

        Raises:
            KeyError: a policy was not evaluated.
        """
        rows = paired_differences(self.metrics[policy], self.metrics[other], self.seed)
        return _by_measure(rows)

    def __str__(self) -> str:
        rows = {policy: [*row.values()] for policy, row in self.estimates.items()}
        return f'{self.title}\n{_text(evaluation_table(self.metrics, rows, _COLUMNS))}'


def flown_mission(log: MissionLog, site: Site) -> FlownMission:
    """A mission of which the log is left; its demand is drawn again."""
    demand_bit = demand_of(site, log.header.mission_seed)
    return FlownMission(log=log, site=site, demand_bit=demand_bit)


def fly(
    scenario: AnyScenario,
    policy: AnyPolicy,
    *,
    seed: int = 0,
    bandwidth: str = 'exact',
    guard_after: int = GUARD_AFTER,
) -> FlownMission:
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
    site = build_site(_loaded(scenario))
    [log] = _fly(site, [seed], _policy(policy, site.scenario), bandwidth, guard_after)
    return flown_mission(log, site)


def evaluate(
    scenario: AnyScenario,
    policies: AnyPolicy | Sequence[AnyPolicy],
    missions: int = 1000,
    *,
    seed: int = 0,
    bandwidth: str = 'exact',
    guard_after: int = GUARD_AFTER,
) -> Evaluation:
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
    _check_range('seed', seed, 0, MAX_SEED - missions)
    _check_range('guard_after', guard_after, 0, MAX_GUARD_AFTER)
    site = build_site(_loaded(scenario))
    contenders = _by_name(_listed(policies), site.scenario)
    seeds = mission_seeds(seed, missions)
    flown = {
        name: _metrics(site, seeds, it, bandwidth, guard_after) for name, it in contenders.items()
    }
    return Evaluation(
        title=f'{site.scenario.name}, {site.scenario.n_uavs} UAVs, {missions} missions from seed'
        f' {seed}, {bandwidth} bandwidth',
        metrics=flown,
        estimates={name: _by_measure(estimates(rows, seed)) for name, rows in flown.items()},
        seed=seed,
    )


def choose_policy(
    scenario: AnyScenario,
    candidates: AnyPolicy | Sequence[AnyPolicy] = (),
    *,
    missions: int | None = None,
    bandwidth: str = 'exact',
    guard_after: int = GUARD_AFTER,
) -> Choice:
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
        UavCollectError: as for `fly`.
        ValueError: the number of missions or the guard's patience is out of range.
    """
    if missions is not None:
        _check_range('missions', missions, 1, MAX_SEED)
    _check_range('guard_after', guard_after, 0, MAX_GUARD_AFTER)
    allocator_named(bandwidth)  # raises where there is none
    site = build_site(_loaded(scenario))
    own = _by_name(_listed(candidates), site.scenario) if candidates else {}
    refined = (
        [] if isinstance(scenario, Scenario) else own_policies(scenario, site.scenario.n_uavs)
    )
    found, _ = candidates_for(site.scenario, own=refined)
    known = {it.name for it in found}
    found += [Candidate(name=name, policy=it) for name, it in own.items() if name not in known]
    return choose(site, found, allocator=bandwidth, guard_after=guard_after, n_missions=missions)


def bound(scenario: AnyScenario, *, seed: int = 0, bandwidth: str = 'exact') -> Bound:
    """What is possible in a mission for a fleet that knows all demand: plans, and their limits.

    Raises:
        UavCollectError: the scenario is not valid, or there is no such bandwidth.
        ValueError: the seed is out of range.
    """
    _check_range('seed', seed, 0, MAX_SEED)
    allocator_named(bandwidth)  # raises where there is none
    site = build_site(_loaded(scenario))
    with waiting_for('the plans of a fleet that knows all demand'):
        return bound_of(site, seed, bandwidth)


def _loaded(scenario: AnyScenario) -> Scenario:
    return scenario if isinstance(scenario, Scenario) else load(scenario)


def _policy(policy: AnyPolicy, scenario: Scenario) -> NamedPolicy:
    return policy_for(policy, scenario) if isinstance(policy, str) else policy_of(policy)


def _listed(policies: AnyPolicy | Sequence[AnyPolicy]) -> Sequence[AnyPolicy]:
    return [policies] if isinstance(policies, str) or callable(policies) else policies


def _by_name(given: Sequence[AnyPolicy], scenario: Scenario) -> dict[str, NamedPolicy]:
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
    site: Site, seeds: Sequence[int], policy: NamedPolicy, bandwidth: str, guard_after: int
) -> list[MissionLog]:
    # Each UAV gets a memory of its own.
    return rollout.fly(site, seeds, partial(replace, policy), bandwidth, guard_after)


def _metrics(
    site: Site, seeds: Sequence[int], policy: NamedPolicy, bandwidth: str, guard_after: int
) -> list[MissionMetrics]:
    flown = []
    for start in range(0, len(seeds), _AT_ONCE):
        logs = _fly(site, seeds[start : start + _AT_ONCE], policy, bandwidth, guard_after)
        flown += [mission_metrics(log) for log in logs]
    return flown


def _by_measure(row: Sequence[Estimate]) -> dict[str, Estimate]:
    return {measure.key: estimate for measure, estimate in zip(MEASURES, row, strict=True)}


def _check_range(name: str, value: int, least: int, most: int) -> None:
    if not least <= value <= most:
        raise ValueError(f'{name} is {value}: must be {least}..{most}')


def _text(table: RenderableType) -> str:
    console = plain_console(file=StringIO(), width=_COLUMNS)
    with console.capture() as shown:
        console.print(table)
    return '\n'.join(line.rstrip() for line in shown.get().splitlines()).rstrip()

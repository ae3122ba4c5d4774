"""Chooses who flies a scenario: candidates fly the same sampled missions of it, without logs.

How many missions is settled beforehand, by what such missions take on a usual core, not by a
clock: so the same candidates lead to the same choice on every machine. The missions are drawn as
the scenario draws them, but none of them is one that anybody flies, learns from or tests on.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
import math
from time import process_time

import numpy as np
from uav_collect.analysis.choice import Choice, MOST_MISSIONS, Tried
from uav_collect.analysis.statistics import column_estimates, MEASURES, mission_seeds
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Bools, Floats
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.batch_metrics import BatchMetrics, joined, TOLERANCE
from uav_collect.missions.rollout import fly_for_metrics
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav.briefing import brief
from uav_collect.uav.heuristics import RulePolicy
from uav_collect.uav.lookahead import decision_us, LookaheadPolicy
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import (
    ANYWHERE,
    NamedPolicy,
    policy_for,
    rule_of,
    shipped_policies,
    specialist_name,
)
from uav_collect.uav.policy_network import LearnedPolicy

CHOICE_SEED = 2**59  # of the first mission; users evaluate below, trainings fly above
_LEAST_MISSIONS = 10
# That all candidates' missions take on a usual core; and where one of them looks ahead.
_WORK_S, _AHEAD_WORK_S = 4.0, 20.0
_RULES = ('sweep', 'hert')
# What a mission takes for each cell of the area [us], by compiled and by interpreted kernels.
_RULE_US, _FUNCTION_US = (1.5, 130.0), (400.0, 600.0)
_NETWORK_US = {
    Layout.PAPER: (12.0, 240.0),
    Layout.EGOCENTRIC: (12.0, 240.0),
    Layout.RELATIVE: (20.0, 390.0),
}
# And besides, for a recurrence of so many units; it grows with their square.
_RECURRENCE_US, _RECURRENCE_UNITS = (8.0, 10.0), 64
_CHUNK_S = 0.3  # the same, of what is flown between two looks at the clock


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A policy that may fly."""

    name: str  # by which agents are told of it
    policy: NamedPolicy


def candidates_for(
    scenario: Scenario, given: Iterable[str] = (), own: Iterable[str] = ()
) -> tuple[list[Candidate], list[str]]:
    """Who may fly a scenario: its own policies, the shipped ones, the rules, and who is named.

    Args:
        given: by a user, names as `policy_for` takes them.
        own: files of policies that were refined for the scenario.

    Returns:
        The candidates, the earlier preferred to an equal one, and a line for each policy that is
        left out though it was made for the scenario.

    Raises:
        PolicyMismatchError: a policy that the user names does not fit, or there is none.
    """
    made, left_out = _made_for(scenario, own)
    names = [*dict.fromkeys([*_RULES, *given])]
    named = [Candidate(name=it, policy=policy_for(it, scenario)) for it in names]
    known = {it.name for it in made}
    return [*made, *(it for it in named if it.name not in known)], left_out


def _made_for(scenario: Scenario, own: Iterable[str]) -> tuple[list[Candidate], list[str]]:
    names = [*own]
    found: list[Candidate] = []
    left_out: list[str] = []
    with suppress(PolicyMismatchError):  # most scenarios have none
        names.append(specialist_name(scenario))
    for name in names:
        try:
            found.append(Candidate(name=name, policy=policy_for(name, scenario)))
        except PolicyMismatchError as error:
            left_out.append(f'{name} cannot be chosen: {error}')
    if ANYWHERE in shipped_policies():
        with suppress(PolicyMismatchError):  # it was not made for this one
            policy = policy_for(ANYWHERE, scenario)
            if rule_of(policy, brief(scenario)) is None:  # else it is a rule's equal
                found.append(Candidate(name=ANYWHERE, policy=policy))
    return found, left_out


def planned_missions(candidates: Sequence[Candidate], n_cells: int, *, is_compiled: bool) -> int:
    """How many missions each candidate is to fly; the same on every machine.

    Args:
        candidates: all of them, at least one.
        n_cells: of the area.
        is_compiled: whether kernels are.
    """
    mission_s = sum(_mission_s(it, n_cells, is_compiled=is_compiled) for it in candidates)
    looks_ahead = any(isinstance(it.policy, LookaheadPolicy) for it in candidates)
    tens = int((_AHEAD_WORK_S if looks_ahead else _WORK_S) / mission_s) // 10
    return max(_LEAST_MISSIONS, min(MOST_MISSIONS, 10 * tens))


def _mission_s(candidate: Candidate, n_cells: int, *, is_compiled: bool) -> float:
    """What a mission takes on a usual core [s]."""
    match candidate.policy:
        case RulePolicy():
            compiled_us, interpreted_us = _RULE_US
        case LookaheadPolicy() as ahead:  # about as many decisions as there are cells
            compiled_us = decision_us(ahead, n_cells, is_compiled=True)
            interpreted_us = decision_us(ahead, n_cells, is_compiled=False)
        case LearnedPolicy(frozen=network):
            size = (network.header.hidden_size / _RECURRENCE_UNITS) ** 2
            compiled_us, interpreted_us = (
                own_us + size * recurrence_us
                for own_us, recurrence_us in zip(
                    _NETWORK_US[network.header.layout.base], _RECURRENCE_US, strict=True
                )
            )
        case _:
            compiled_us, interpreted_us = _FUNCTION_US
    return (compiled_us if is_compiled else interpreted_us) * 1e-6 * n_cells


class Choosing:
    """The missions of a choice, flown some at a time by one candidate after the other."""

    def __init__(
        self,
        site: Site,
        candidates: Sequence[Candidate],
        *,
        allocator: str = 'exact',
        guard_after: int = GUARD_AFTER,
        n_missions: int | None = None,
    ) -> None:
        """Have flown nothing.

        Args:
            candidates: at least one; of two equal ones the earlier is taken.
            allocator: how bandwidth is shared; for cvxpy exact is flown, which finds the same.
            guard_after: as for `rollout.fly`.
            n_missions: that each candidate flies; None: as `planned_missions` has it.
        """
        n_cells, is_compiled = site.scenario.n_cells, kernels_are_compiled()
        self._site, self._candidates = site, candidates
        self._allocator, self._guard_after = allocator, guard_after
        self._is_compiled = is_compiled
        self.n_planned = n_missions or planned_missions(
            candidates, n_cells, is_compiled=is_compiled
        )
        slowest_s = max(_mission_s(it, n_cells, is_compiled=is_compiled) for it in candidates)
        self._at_once = max(1, int(_CHUNK_S / slowest_s))
        self._flown: dict[str, list[BatchMetrics]] = {it.name: [] for it in candidates}
        self._n_flown = dict.fromkeys(self._flown, 0)  # missions
        self._computing_s = dict.fromkeys(self._flown, 0.0)

    @property
    def n_missions(self) -> int:
        """How many missions every candidate has flown."""
        return min(self._n_flown.values())

    @property
    def is_even(self) -> bool:
        """Whether all candidates have flown the same missions."""
        return len({*self._n_flown.values()}) == 1

    @property
    def is_over(self) -> bool:
        """Whether all missions are flown."""
        return self.n_missions == self.n_planned

    def fly_some(self) -> int:
        """Let the candidate that is behind fly some missions; how many.

        Raises:
            PolicyMismatchError: it breaks the rules in flight.
            ConfigError: the fleet has not the energy to start.
        """
        candidate = min(self._candidates, key=lambda it: self._n_flown[it.name])
        start, begun_s = self._n_flown[candidate.name], process_time()
        seeds = mission_seeds(CHOICE_SEED, self.n_planned)[start : start + self._at_once]
        metrics = fly_for_metrics(
            self._site,
            seeds,
            partial(replace, candidate.policy),  # each UAV gets a memory of its own
            'exact' if self._allocator == 'cvxpy' else self._allocator,
            self._guard_after,
        )
        self._flown[candidate.name].append(metrics)
        self._n_flown[candidate.name] += len(seeds)
        self._computing_s[candidate.name] += process_time() - begun_s
        return len(seeds)

    def choice(self) -> Choice:
        """The choice by what was flown, when that is even, and is anything."""
        if not (self.is_even and self.n_missions):
            raise RuntimeError('candidates must have flown the same missions')
        scenario = self._site.scenario
        values = {name: _values(joined(it), scenario) for name, it in self._flown.items()}
        choice = Choice(
            scenario=scenario.name,
            fingerprint=fingerprint(scenario),
            bandwidth=self._allocator,
            first_seed=CHOICE_SEED,
            n_missions=self.n_missions,
            n_planned=self.n_planned,
            is_compiled=self._is_compiled,
            tried=tuple(
                _tried(it, values[it.name], self._computing_s[it.name]) for it in self._candidates
            ),
        )
        if choice.next_best is None:
            return choice
        ahead = values[choice.policy][:, :1] - values[choice.next_best.policy][:, :1]
        return replace(choice, lead=column_estimates(ahead, CHOICE_SEED)[0])


def choose(
    site: Site,
    candidates: Sequence[Candidate],
    *,
    allocator: str = 'exact',
    guard_after: int = GUARD_AFTER,
    n_missions: int | None = None,
    most_s: float = math.inf,
) -> Choice:
    """The best of candidates in missions of a scenario.

    Args:
        candidates, allocator, guard_after, n_missions: as for `Choosing`.
        most_s: processor time after which no more missions are begun, counted once each candidate
            has flown some, as the first ones may compile kernels; the choice tells how many
            missions they were. What else a machine is busy with changes nothing.

    Raises:
        PolicyMismatchError, ConfigError: as `Choosing.fly_some`.
    """
    choosing = Choosing(
        site, candidates, allocator=allocator, guard_after=guard_after, n_missions=n_missions
    )
    begun_s = math.inf
    while not choosing.is_over:
        choosing.fly_some()
        if choosing.is_even:
            now_s = process_time()
            begun_s = min(begun_s, now_s)
            if now_s - begun_s >= most_s:
                break
    return choosing.choice()


def _tried(candidate: Candidate, values: Floats, computing_s: float) -> Tried:
    keys = [measure.key for measure in MEASURES]
    found = column_estimates(values, CHOICE_SEED)
    return Tried(
        policy=candidate.name,
        version=candidate.policy.version,
        estimates=dict(zip(keys, found, strict=True)),
        computing_s=computing_s,
    )


def _values(metrics: BatchMetrics, scenario: Scenario) -> Floats:
    """MEASURES by mission, (N, M)."""
    energy_j: Floats = metrics.energy_j.sum(axis=1)
    used_j = np.where(energy_j > 0.0, energy_j, 1.0)
    efficiency = np.where(energy_j > 0.0, metrics.collected_bit / used_j, 0.0)
    columns = {
        'efficiency_kbit_per_j': efficiency / 1e3,
        'completion_s': metrics.completion_s,
        'energy_kj': energy_j / 1e3,
        'collected_share': metrics.collected_share,
        'complete_share': metrics.is_complete.astype(np.float64),
        'safe_share': _is_safe(metrics, scenario),
    }
    return np.column_stack([columns[measure.key] for measure in MEASURES])


def _is_safe(metrics: BatchMetrics, scenario: Scenario) -> Floats:
    """1 for each mission in which every UAV landed with its margin, else 0, (N,)."""
    budget_j = np.array([uav.energy_budget_j for uav in scenario.uavs])
    margin_j = np.array([uav.energy_margin_j for uav in scenario.uavs])
    left_j = budget_j - metrics.energy_j
    has_margin: Bools = left_j >= margin_j - TOLERANCE * budget_j
    return np.where(has_margin.all(axis=1), 1.0, 0.0)

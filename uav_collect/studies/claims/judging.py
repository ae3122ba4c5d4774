"""Judges a statement by what was measured: paired values, bootstrap intervals, one rule each.

A difference is paired: by mission where policies flew the same missions, by seed where algorithms
were trained from the same seeds. The interval decides, never a person.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from uav_collect.analysis.statistics import column_estimates, Estimate
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.findings import Findings
from uav_collect.studies.study import (
    CurvesPanel,
    CurvesStudy,
    LinesStudy,
    MissionSet,
    PanelMeasure,
    Study,
    TrainedPolicies,
    TrajectoriesStudy,
)

# Fewer seeds agree by chance too often: of five that toss a coin, all fall alike once in sixteen.
MIN_SEEDS = 6
_BOOTSTRAP_SEED = 0
_ROUNDING = 1e-9  # relative
_Rule = Callable[[Estimate], tuple[bool, bool]]  # whether it holds, whether it fails


class ClaimStatus(StrEnum):
    """Whether a statement holds, by what was measured."""

    HOLDS = 'holds'
    FAILS = 'does not hold'
    OPEN = 'not resolvable at this scale'
    NOT_RUN = 'not run'


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """One number that a statement stands or falls by."""

    what: str
    unit: str
    n: int  # missions or seeds that count
    noun: str
    estimate: Estimate | None  # None where nothing counts
    status: ClaimStatus


@dataclass(frozen=True, kw_only=True)
class Samples:
    """A measure of things that can be paired: missions, or trainings by their seed."""

    value: Floats  # (N,)
    noun: str  # 'mission' or 'seed'

    def paired(self, other: 'Samples') -> tuple[Floats, Floats]:
        """The values of both, pair by pair, where both are known."""
        if self.noun != other.noun or len(self.value) != len(other.value):
            raise ValueError(
                f'{len(self.value)} {self.noun}s and {len(other.value)} {other.noun}s'
            )
        known = np.isfinite(self.value) & np.isfinite(other.value)
        return self.value[known], other.value[known]


@dataclass(frozen=True)
class StudyResults:
    """The studies that were run and their results, as claims ask for them."""

    studies: Mapping[str, Study]
    findings: Findings

    def lines(self, name: str) -> LinesStudy:
        """The study of that name, which must be one of tests."""
        study = self.studies[name]
        if not isinstance(study, LinesStudy):
            raise TypeError(f'{name} is no study of tests')
        return study

    def panels(self, name: str) -> tuple[CurvesPanel, ...]:
        """The panels of the study of that name, which must be one of trainings."""
        study = self.studies[name]
        if not isinstance(study, CurvesStudy):
            raise TypeError(f'{name} is no study of trainings')
        return study.panels

    def trajectories(self, name: str) -> TrajectoriesStudy:
        """The study of that name, which must be one of single missions."""
        study = self.studies[name]
        if not isinstance(study, TrajectoriesStudy):
            raise TypeError(f'{name} is no study of single missions')
        return study

    def missions(self, tested: MissionSet, measure: PanelMeasure) -> Samples:
        """The values of a measure, mission by mission."""
        column = self.findings.column(tested, measure)
        if column is None:
            raise ValueError(f'plans have no {measure.title}')
        return Samples(value=column.value, noun='mission')

    def final_values(
        self, trained: TrainedPolicies, key: str, n_seeds: int | None = None
    ) -> Samples:
        """What trainings achieved in their last fifth, by seed."""
        return Samples(value=self.findings.final_values(trained, key)[:n_seeds], noun='seed')


def is_above(what: str, unit: str, high: Samples, low: Samples) -> Evidence:
    """Whether one is larger than the other, pair by pair on average."""
    first, second = high.paired(low)
    # Sums of the same data in another order differ by rounding, which must not decide.
    ahead = np.where(np.isclose(first, second, rtol=_ROUNDING, atol=0.0), 0.0, first - second)
    return _judged(what, unit, ahead, high.noun, lambda it: (it.low > 0, it.high < 0))


def is_within(what: str, unit: str, samples: Samples, low: float, high: float) -> Evidence:
    """Whether a mean lies between two values."""
    values = samples.value[np.isfinite(samples.value)]
    return _judged(
        f'{what} (from {low:g} to {high:g})', unit, values, samples.noun,
        lambda it: (low <= it.low and it.high <= high, it.high < low or it.low > high),
    )  # fmt: skip


def changed_percent(after: Samples, before: Samples) -> Samples:
    """By how much the mean changes, in per cent: its ratio, linear in the pairs."""
    new, old = after.paired(before)
    if not len(old) or old.mean() == 0.0:
        return Samples(value=np.zeros(0), noun=after.noun)
    ratio = new.mean() / old.mean()
    # To first order, resampling these resamples the ratio of the means.
    values = ratio - 1.0 + (new - ratio * old) / old.mean()
    return Samples(value=100.0 * values, noun=after.noun)


def combined_status(evidence: Sequence[Evidence]) -> ClaimStatus:
    """The status of a statement: it holds if each part does, and fails if one does."""
    statuses = {it.status for it in evidence}
    if not statuses:
        return ClaimStatus.NOT_RUN
    for status in (ClaimStatus.FAILS, ClaimStatus.OPEN):
        if status in statuses:
            return status
    return ClaimStatus.HOLDS


def _judged(what: str, unit: str, values: Floats, noun: str, rule: _Rule) -> Evidence:
    if not len(values):
        return Evidence(
            what=what, unit=unit, n=0, noun=noun, estimate=None, status=ClaimStatus.OPEN
        )
    estimate = column_estimates(values[:, None], _BOOTSTRAP_SEED)[0]
    holds, fails = rule(estimate)
    status = ClaimStatus.HOLDS if holds else ClaimStatus.FAILS if fails else ClaimStatus.OPEN
    if len(values) < 2 or (noun == 'seed' and len(values) < MIN_SEEDS):
        status = ClaimStatus.OPEN
    return Evidence(
        what=what, unit=unit, n=len(values), noun=noun, estimate=estimate, status=status
    )

"""Judges a statement by what was measured: resampled trainings and missions, one rule each.

Policies that flew the same missions are compared mission by mission, and trainings that serve both
sides of a comparison are drawn once for both. The interval decides, never a person.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
import math

import numpy as np
from uav_collect.analysis.resampling import (
    expanded_interval,
    resampled_deviations,
    resampled_means,
    student_quantile,
)
from uav_collect.analysis.statistics import CONFIDENCE_LEVEL, Estimate
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.claims.words import ALIKE_PERCENT
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

MIN_TRAININGS = 3  # fewer decide nothing, whatever they say
_ROUNDING = 1e-9  # relative
_Statistic = Callable[..., Floats]  # of the summaries of samples, each resampled alike
_Rule = Callable[[float, float], 'ClaimStatus']  # by an interval


class ClaimStatus(StrEnum):
    """Whether a statement holds, by what was measured."""

    HOLDS = 'holds'
    TIE = 'tie'
    FAILS = 'does not hold'
    OPEN = 'not resolvable at this scale'
    SAME = 'not judged'  # a thing beside itself
    NOT_RUN = 'not run'


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """One number that a statement stands or falls by."""

    what: str
    unit: str
    n_missions: int  # that count
    n_trainings: int  # of each that was trained, at least; 0 where nothing was
    estimate: Estimate | None  # None where nothing counts
    margin_percent: float  # how far within what was said, or how far beside it if negative
    status: ClaimStatus
    n_least: int = 0  # the fewest trainings, or missions, that it was measured in
    errors_beside: float = -np.inf  # how far beside what was said it lies, in standard errors

    def is_beside_among(self, number: int) -> bool:
        """Whether it is beside what was said even if it is one of many (Bonferroni)."""
        if number == 1:  # its interval has said so
            return self.status is ClaimStatus.FAILS
        chance = (1.0 - CONFIDENCE_LEVEL) / (2 * number)
        return self.errors_beside > student_quantile(1.0 - chance, self.n_least - 1)

    @property
    def count(self) -> str:
        """Of how many missions and trainings, for people."""
        numbers = ((self.n_missions, 'mission'), (self.n_trainings, 'training'))
        texts = [f'{n} {noun}{"" if n == 1 else "s"}' for n, noun in numbers if n]
        return ', '.join(texts) or 'none'


@dataclass(frozen=True, kw_only=True)
class Samples:
    """A measure of policies, mission by mission; or of their trainings."""

    value: Floats  # (T, M): a row for each training, or one; M is 1 where trainings are measured
    trainings: tuple[str, ...] = ()  # names, (T,); none where nothing was trained
    source: tuple[str, ...] = ()  # what it is of: the same twice is no comparison
    is_spread: bool = False  # how far trainings lie apart counts, as deviation, and not the mean

    @property
    def is_of_missions(self) -> bool:
        """Whether missions are measured, and not trainings."""
        return self.value.shape[1] > 1 or not self.trainings

    @property
    def summary(self) -> float:
        """The mean, or the standard deviation; that of a single training is nan."""
        if not self.is_spread:
            return float(self.value.mean())
        return float(self.value.std(ddof=1)) if len(self.value) > 1 else np.nan

    def resampled(self) -> Floats:
        """The summary in each resampling; nan where there is none."""
        if self.is_spread:
            return resampled_deviations(self.value[:, 0], self.trainings)
        return resampled_means(self.value, self.trainings)


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
        return self._samples(tested, column.value, measure.key)

    def overlap_percent(self, tested: MissionSet) -> Samples:
        """Cells that several UAVs flew to, in per cent of all that were flown to, by mission."""
        shared, visited = (
            self.findings.numbers(tested, key) for key in ('shared_cells', 'visited_cells')
        )
        return self._samples(tested, 100.0 * shared / np.maximum(visited, 1.0), 'overlap')

    def final_values(self, trained: TrainedPolicies, key: str) -> Samples:
        """What trainings achieved in their last fifth."""
        return by_training(trained, self.findings.final_values(trained, key), key)

    def _samples(self, tested: MissionSet, value: Floats, key: str) -> Samples:
        source = key, *(digest for row in tested.digests for digest in row)
        return Samples(value=value, trainings=tested.trainings, source=source)


def by_training(trained: TrainedPolicies, values: Floats, key: str) -> Samples:
    """A number of each training; nan, of one that failed at once, leaves all undecided."""
    source = key, *trained.digests
    return Samples(value=values[:, None], trainings=trained.digests, source=source)


def ranked(samples: Mapping[str, Samples]) -> Samples:
    """The rank of the mean of each training's policy among those of all algorithms, from 0.

    Means are over the missions that are known of all. A policy of which no mission is known, as it
    finishes none, ranks as the slowest.

    Args:
        samples: of missions, by the algorithm's label.
    """
    names = [f'{label} {it}' for label in samples for it in range(len(samples[label].value))]
    values = np.concatenate([it.value for it in samples.values()])
    counts = np.isfinite(values).any(axis=1)
    known = np.isfinite(values[counts]).all(axis=0)
    means = np.full(len(values), np.inf)
    means[counts] = values[counts][:, known].mean(axis=1) if known.any() else np.nan
    n_less = (means[:, None] > means).sum(axis=1)
    n_equal = (means[:, None] == means).sum(axis=1)
    places = n_less + (n_equal - 1) / 2
    return Samples(value=places[:, None], trainings=tuple(names))


def is_above(what: str, unit: str, high: Samples, low: Samples) -> Evidence:
    """Whether one is larger than another; the margin is in per cent of the larger one."""
    return is_positive(what, unit, lambda first, second: first - second, high, low)


def is_positive(
    what: str, unit: str, statistic: _Statistic, *samples: Samples, one: float | None = None
) -> Evidence:
    """Whether a statistic is larger than zero.

    Args:
        statistic: of the summaries of the samples, in their order.
        one: what counts as 100 % for the margin and for a tie; None: the largest summary.
    """
    known = _known(samples)
    whole = max(abs(it.summary) if it.value.size else 0.0 for it in known) if one is None else one
    alike = whole * ALIKE_PERCENT / 100.0

    def rule(low: float, high: float) -> ClaimStatus:
        if low > 0:
            return ClaimStatus.HOLDS
        if high < 0:
            return ClaimStatus.FAILS
        return ClaimStatus.TIE if -alike <= low and high <= alike else ClaimStatus.OPEN

    def margin_percent(mean: float) -> float:
        return 100.0 * mean / whole if whole else 0.0

    def settled(*summaries: Floats) -> Floats:
        # Sums of the same data in another order differ by rounding, which must not decide.
        found = statistic(*summaries)
        return np.where(np.abs(found) <= _ROUNDING * whole, 0.0, found)

    return _judged(what, unit, settled, known, rule, margin_percent, lambda mean: -mean)


def is_within(
    what: str,
    unit: str,
    statistic: _Statistic,
    *samples: Samples,
    low: float = -np.inf,
    high: float = np.inf,
) -> Evidence:
    """Whether a statistic in per cent lies between two values, or on one side of one.

    Args:
        statistic: of the summaries of the samples, in their order.
        low: nothing, where the statement turns at the other end alone: a share is never above
            100 %, but for the rounding of its mean.
        high: likewise.
    """

    def rule(lowest: float, highest: float) -> ClaimStatus:
        if low <= lowest and highest <= high:
            return ClaimStatus.HOLDS
        if highest < low or lowest > high:
            return ClaimStatus.FAILS
        return ClaimStatus.OPEN

    def margin_percent(mean: float) -> float:
        return min(mean - low, high - mean)

    span = f'from {low:g} to {high:g}'
    if np.isinf(high):
        span = f'at least {low:g}'
    elif np.isinf(low):
        span = f'at most {high:g}'
    return _judged(
        f'{what} ({span})', unit, statistic, samples, rule, margin_percent,
        lambda mean: max(low - mean, mean - high),
    )  # fmt: skip


def mean_of(mean: Floats) -> Floats:
    """The statistic of one sample that is its mean."""
    return mean


def change_percent(after: Floats, before: Floats) -> Floats:
    """The statistic of two samples by how much the second becomes the first, in per cent."""
    return 100.0 * (ratio(after, before) - 1.0)


def ratio(first: Floats, second: Floats) -> Floats:
    """The statistic of two samples how many times the second the first is; nan where it is 0."""
    known = np.where(second == 0.0, np.nan, second)
    return np.asarray(first / known)


def combined_status(evidence: Sequence[Evidence]) -> ClaimStatus:
    """The status of a statement: it holds if each part does, and fails if one does.

    One of many fails by chance: it counts only as far as that is unlikely among them all
    (Bonferroni), and else leaves the statement open. What stands beside itself says nothing.
    """
    statuses = {it.status for it in evidence}
    if not statuses:
        return ClaimStatus.NOT_RUN
    if ClaimStatus.FAILS in statuses:
        beside = (it for it in evidence if it.status is ClaimStatus.FAILS)
        is_sure = any(it.is_beside_among(len(evidence)) for it in beside)
        return ClaimStatus.FAILS if is_sure else ClaimStatus.OPEN
    for status in (ClaimStatus.OPEN, ClaimStatus.TIE, ClaimStatus.HOLDS):
        if status in statuses:
            return status
    return ClaimStatus.SAME


def deciding(evidence: Sequence[Evidence]) -> Evidence | None:
    """Of the numbers that decide, the one with the least margin."""
    status = combined_status(evidence)
    decide = {status, ClaimStatus.FAILS} if status is ClaimStatus.OPEN else {status}
    known = [it for it in evidence if it.status in decide and it.estimate is not None]
    return min(known, key=lambda it: it.margin_percent, default=None)


def _judged(
    what: str,
    unit: str,
    statistic: _Statistic,
    samples: Sequence[Samples],
    rule: _Rule,
    margin_percent: Callable[[float], float],
    beside: Callable[[float], float],  # how far a number lies beside what is said
) -> Evidence:
    known = _known(samples)
    numbers = [len(it.trainings) for it in samples if it.trainings]
    n_missions = max((it.value.shape[1] for it in known if it.is_of_missions), default=0)
    evidence = Evidence(
        what=what, unit=unit, n_missions=n_missions, n_trainings=min(numbers, default=0),
        estimate=None, margin_percent=0.0, status=ClaimStatus.OPEN,
    )  # fmt: skip
    sources = [it.source for it in samples]
    if len(samples) > 1 and sources[0] and len(set(sources)) == 1:
        return replace(evidence, status=ClaimStatus.SAME)
    if not all(it.value.size for it in known):
        return evidence
    mean = float(statistic(*(it.summary for it in known)))
    resampled = np.array([it.resampled() for it in known])
    # Who is alone in a draw lies near nobody: such a draw says nothing.
    draws = statistic(*resampled[:, np.isfinite(resampled).all(axis=0)])
    n_least = min([*numbers, n_missions] if n_missions else numbers)
    if not np.isfinite(mean) or not np.isfinite(draws).all():
        return evidence
    low, high = expanded_interval(draws, n_least).tolist() if n_least > 1 else (mean, mean)
    estimate = Estimate(mean=mean, low=min(low, mean), high=max(high, mean), median=mean)
    status = rule(estimate.low, estimate.high)
    if n_least < 2 or min(numbers, default=MIN_TRAININGS) < MIN_TRAININGS:
        status = ClaimStatus.OPEN
    # The bootstrap of n finds the error of n - 1.
    error = float(draws.std()) * math.sqrt(n_least / max(1, n_least - 1))
    distance = beside(mean)
    return replace(
        evidence,
        estimate=estimate,
        margin_percent=margin_percent(mean),
        status=status,
        n_least=n_least,
        errors_beside=distance / error if error > 0.0 else math.copysign(math.inf, distance),
    )


def _known(samples: Sequence[Samples]) -> list[Samples]:
    """Samples without the missions that one of them has no number for."""
    of_missions = [it for it in samples if it.is_of_missions]
    if not of_missions:
        return [*samples]
    n_missions = {it.value.shape[1] for it in of_missions}
    if len(n_missions) > 1 or len(of_missions) < len(samples):
        raise ValueError(f'samples of {sorted(n_missions)} missions cannot be paired')
    known = np.all([np.isfinite(it.value).all(axis=0) for it in samples], axis=0)
    return [replace(it, value=it.value[:, known]) for it in samples]

"""Evidence for what the paper says of its tests: by mission, each policy in the same missions."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.claims.judging import (
    change_percent,
    Evidence,
    is_above,
    is_positive,
    is_within,
    mean_of,
    ranked,
    ratio,
    Samples,
    StudyResults,
)
from uav_collect.studies.claims.words import (
    ABOUT_POINTS,
    ALIKE_PERCENT,
    ALL_PERCENT,
    MARGINAL_PERCENT,
    ROBUST_PERCENT,
    ROUGHLY_PERCENT,
)
from uav_collect.studies.study import (
    AIQL,
    AQMIX,
    COLLECTED,
    COLLECTING,
    COMPLETION,
    EFFICIENCY,
    ENERGY,
    HERT,
    LEARNED,
    MissionSet,
    PanelMeasure,
    QMIX,
)

_LEAST_KJ, _ENOUGH_KJ, _LONG_KJ = 100.0, 150.0, 400.0  # as the paper has them
_OPTIMAL, _EQUAL = f'{AQMIX}, optimal bandwidth', f'{AQMIX}, equal bandwidth'

_FLAT = 1e-12  # a product of deviations that is none but for rounding

_Place = tuple[str, int]  # the label of a line, and the index of a value that it runs over


class _Tests:
    """Compares the lines of a study of tests."""

    def __init__(self, results: StudyResults, name: str) -> None:
        self._results, self._study = results, results.lines(name)
        self.values = self._study.values
        self.names = self._study.names or tuple(f'{value:g}' for value in self.values)

    def samples(self, place: _Place, measure: PanelMeasure) -> Samples:
        """The values of a measure at a place, mission by mission."""
        return self._results.missions(self.tested(place), measure)

    def tested(self, place: _Place) -> MissionSet:
        """The missions at a place."""
        label, index = place
        return self._study.line(label).tests[index]

    def above(self, what: str, measure: PanelMeasure, high: _Place, low: _Place) -> Evidence:
        """Whether a measure is larger at one place than at another."""
        first, second = self.samples(high, measure), self.samples(low, measure)
        unit = 'percentage points' if measure.unit == '%' else measure.unit
        return is_above(what, unit, first, second)

    def change(
        self, what: str, measure: PanelMeasure, label: str, indices: tuple[int, int],
        low: float = -ALIKE_PERCENT, high: float = ALIKE_PERCENT,
    ) -> Evidence:  # fmt: skip
        """Whether a measure of a line changes by so much from one value to another."""
        before, after = (self.samples((label, index), measure) for index in indices)
        title = f'change of the {measure.title} of {what}'
        return is_within(title, '%', change_percent, after, before, low=low, high=high)

    def collected(
        self, label: str, budget_kj: float, low: float = -np.inf, high: float = np.inf
    ) -> Evidence:
        """Whether a policy collects so much with a budget, or the nearest one that was tested."""
        index = self.nearest(budget_kj)
        what = f'data collected by {label} with {self.names[index]} kJ'
        samples = self.samples((label, index), COLLECTED)
        return is_within(what, COLLECTED.unit, mean_of, samples, low=low, high=high)

    def ranks(self, index: int, measure: PanelMeasure) -> Samples:
        """The ranks of all trainings' policies by a measure."""
        return ranked({label: self.samples((label, index), measure) for label in LEARNED})

    def one_and_two(self) -> tuple[int, int] | None:
        """Where the fleets of one UAV and of two stand, if both were tested."""
        try:
            return self.values.index(1.0), self.values.index(2.0)
        except ValueError:
            return None

    def nearest(self, value: float) -> int:
        """Index of the value next to one."""
        return int(np.argmin(np.abs(np.array(self.values) - value)))

    def at(self, index: int) -> str:
        """A value, for people."""
        return f'{self._study.over.split(" [")[0]} {self.names[index]}'

    def ahead(self, rival: str, index: int) -> Iterator[Evidence]:
        """Time that AQMIX saves and efficiency that it adds at a value."""
        ours, theirs, at = (AQMIX, index), (rival, index), self.at(index)
        yield self.above(f'{at}: time, {rival} less AQMIX', COMPLETION, theirs, ours)
        yield self.above(f'{at}: efficiency, AQMIX less {rival}', EFFICIENCY, ours, theirs)

    def ahead_everywhere(self) -> Iterator[Evidence]:
        """The same at every value, of every rival."""
        for index in range(len(self.values)):
            for rival in (QMIX, AIQL, HERT):
                yield from self.ahead(rival, index)


def enough_energy(results: StudyResults) -> Iterator[Evidence]:
    """Data collected with the paper's budget."""
    tests = _Tests(results, 'energy')
    for label in (AQMIX, QMIX, HERT):
        yield tests.collected(label, _ENOUGH_KJ, low=ALL_PERCENT)


def aiql_needs_more_energy(results: StudyResults) -> Iterator[Evidence]:
    """Data left behind with the paper's largest budget."""
    yield _Tests(results, 'energy').collected(AIQL, _LONG_KJ, high=ALL_PERCENT)


def more_energy_changes_nothing(results: StudyResults) -> Iterator[Evidence]:
    """The largest budget against the one that is enough."""
    tests = _Tests(results, 'energy')
    enough = tests.nearest(_ENOUGH_KJ)
    for label in (AQMIX, QMIX, AIQL, HERT):
        span = f'{label} from {tests.names[enough]} to {tests.names[-1]} kJ'
        for measure in (COMPLETION, EFFICIENCY):
            yield tests.change(span, measure, label, (enough, -1))


def aqmix_best_over_budgets(results: StudyResults) -> Iterator[Evidence]:
    """With the largest budget, where all have what they need; data with the paper's least."""
    tests = _Tests(results, 'energy')
    least = tests.nearest(_LEAST_KJ)
    for rival in (QMIX, AIQL, HERT):
        yield from tests.ahead(rival, len(tests.values) - 1)
        what = f'{tests.at(least)}: data collected, AQMIX less {rival}'
        yield tests.above(what, COLLECTED, (AQMIX, least), (rival, least))


def aqmix_uses_least_energy(results: StudyResults) -> Iterator[Evidence]:
    """Energy with the largest budget: less is also used by who leaves data behind."""
    tests = _Tests(results, 'energy')
    last = len(tests.values) - 1
    for rival in (QMIX, AIQL, HERT):
        what = f'{tests.at(last)}: energy, {rival} less AQMIX'
        yield tests.above(what, ENERGY, (rival, last), (AQMIX, last))


def efficiency_brings_the_rest(results: StudyResults) -> Iterator[Evidence]:
    """Over the policies of all trainings, of whichever algorithm: do the orders agree?

    With time at the largest budget, where everybody has collected what there is, and with data
    at the smallest.
    """
    tests = _Tests(results, 'energy')
    for index, measure, sign in ((-1, COMPLETION, -1.0), (0, COLLECTED, 1.0)):
        ranks = [tests.ranks(index, it) for it in (EFFICIENCY, measure)]
        ranks[1] = replace(ranks[1], value=sign * ranks[1].value)
        order = 'falls' if sign < 0 else 'rises'
        what = f'{tests.at(index)}: rank correlation, {measure.title} {order} with efficiency'
        yield is_positive(what, '1', _correlation, *_moments(*ranks), one=1.0)


def rising_with_density(results: StudyResults) -> Iterator[Evidence]:
    """AQMIX at each density against the one before."""
    tests = _Tests(results, 'density')
    for measure in (COMPLETION, EFFICIENCY):
        for index in range(1, len(tests.values)):
            names = f'density {tests.names[index]} less {tests.names[index - 1]}'
            what = f'{measure.title} of AQMIX, {names}'
            yield tests.above(what, measure, (AQMIX, index), (AQMIX, index - 1))


def aqmix_best_over_densities(results: StudyResults) -> Iterator[Evidence]:
    """AQMIX against every rival at every density."""
    return _Tests(results, 'density').ahead_everywhere()


def complete_at_every_density(results: StudyResults) -> Iterator[Evidence]:
    """Data collected by policies of AQMIX, which learned at one density."""
    tests = _Tests(results, 'density')
    for index in range(len(tests.values)):
        what = f'{tests.at(index)}: data collected by {AQMIX}'
        collected = tests.samples((AQMIX, index), COLLECTED)
        yield is_within(what, COLLECTED.unit, mean_of, collected, low=ALL_PERCENT)


def faster_but_less_efficient(results: StudyResults) -> Iterator[Evidence]:
    """Each fleet against the next larger one."""
    tests = _Tests(results, 'uavs')
    for label in (AQMIX, QMIX):
        for measure in (COMPLETION, EFFICIENCY):
            for few, many in pairwise(range(len(tests.values))):
                fleets = f'{tests.names[few]} less {tests.names[many]} UAVs'
                what = f'{measure.title} of {label}, {fleets}'
                yield tests.above(what, measure, (label, few), (label, many))


def second_uav_of_aqmix(results: StudyResults) -> Iterator[Evidence]:
    """The one UAV is the scenario's first, of 5 m/s: a fair split over two saves 67 %."""
    yield from _second_uav(results, AQMIX, COMPLETION, *_about(-75.0))
    yield from _second_uav(results, AQMIX, EFFICIENCY, -10.0, 0.0)


def second_uav_of_qmix(results: StudyResults) -> Iterator[Evidence]:
    """The same of QMIX."""
    yield from _second_uav(results, QMIX, COMPLETION, *_about(-50.0))
    yield from _second_uav(results, QMIX, EFFICIENCY, *_about(-30.0))


def better_trade_than_qmix(results: StudyResults) -> Iterator[Evidence]:
    """What of its efficiency each loses, and for the time that it saves, from one UAV to two.

    It is a trade only if something is given and something got.
    """
    tests = _Tests(results, 'uavs')
    pair = tests.one_and_two()
    if pair is not None:
        for label in (AQMIX, QMIX):
            for measure in (EFFICIENCY, COMPLETION):
                what = f'{measure.title} of {label}, 1 UAV less 2 UAVs'
                yield tests.above(what, measure, (label, pair[0]), (label, pair[1]))
        samples = [
            tests.samples((label, index), measure)
            for label in (QMIX, AQMIX)
            for measure in (EFFICIENCY, COMPLETION)
            for index in pair
        ]
        what = 'efficiency lost for each per cent of time saved, QMIX less AQMIX'
        yield is_positive(what, '% per %', _dearer, *samples, one=1.0)


def overlap_costs_efficiency(results: StudyResults) -> Iterator[Evidence]:
    """From the second fewest UAVs to the most: efficiency, overlap, and whether both go along."""
    tests = _Tests(results, 'uavs')
    few, many = 1, len(tests.values) - 1
    for label in (AQMIX, QMIX):
        overlaps = [results.overlap_percent(tests.tested((label, it))) for it in (many, few)]
        fleets = f'{tests.names[few]} less {tests.names[many]} UAVs'
        what = f'{EFFICIENCY.title} of {label}, {fleets}'
        yield tests.above(what, EFFICIENCY, (label, few), (label, many))
        span = f'{tests.names[many]} UAVs less {tests.names[few]}'
        yield is_above(f'cells of several UAVs, {label}, {span}', 'percentage points', *overlaps)
        efficiencies = [tests.samples((label, it), EFFICIENCY) for it in (many, few)]
        if overlaps[0].source != overlaps[1].source:
            growth, loss = _difference(*overlaps), _difference(*efficiencies[::-1])
            what = (
                f'correlation of the growth of overlap with the efficiency lost, {label}, {span}'
            )
            yield is_positive(what, '1', _correlation, *_moments(growth, loss), one=1.0)


def hert_in_proportion(results: StudyResults) -> Iterator[Evidence]:
    """Time times the number of UAVs, and efficiency, stay as they were."""
    tests = _Tests(results, 'uavs')
    for index in range(1, len(tests.values)):
        share = tests.values[index] / tests.values[0]
        times = [tests.samples((HERT, it), COMPLETION) for it in (index, 0)]
        worked = replace(times[0], value=times[0].value * share)
        what = f'from {tests.names[0]} to {tests.names[index]} UAVs'
        yield is_within(
            f'change of time x number of UAVs {what}', '%', change_percent, worked, times[1],
            low=-ROUGHLY_PERCENT, high=ROUGHLY_PERCENT,
        )  # fmt: skip
        yield tests.change(
            f'{HERT} {what}', EFFICIENCY, HERT, (0, index), -ROUGHLY_PERCENT, ROUGHLY_PERCENT
        )


def aiql_poor_with_many(results: StudyResults) -> Iterator[Evidence]:
    """AIQL against HERT, the paper's weakest, wherever there are more than two UAVs."""
    tests = _Tests(results, 'uavs')
    for index, n_uavs in enumerate(tests.values):
        if n_uavs > 2:
            what = f'{tests.at(index)}: efficiency, HERT less AIQL'
            yield tests.above(what, EFFICIENCY, (HERT, index), (AIQL, index))


def aqmix_best_over_fleets(results: StudyResults) -> Iterator[Evidence]:
    """AQMIX against every rival with every fleet."""
    return _Tests(results, 'uavs').ahead_everywhere()


def hert_without_radio(results: StudyResults) -> Iterator[Evidence]:
    """HERT with the largest range against none."""
    tests = _Tests(results, 'range')
    for measure in (COMPLETION, EFFICIENCY):
        yield tests.change(f'{HERT}, {_ranges(tests)}', measure, HERT, (0, -1))


def better_with_range(results: StudyResults) -> Iterator[Evidence]:
    """AQMIX and QMIX with the largest range against none."""
    tests = _Tests(results, 'range')
    for label in (AQMIX, QMIX):
        none, full, span = (label, 0), (label, -1), f'{label}, {_ranges(tests)}'
        yield tests.above(f'time that {span} saves', COMPLETION, none, full)
        yield tests.above(f'efficiency that {span} adds', EFFICIENCY, full, none)


def aiql_without_gain(results: StudyResults) -> Iterator[Evidence]:
    """The largest range against none: no better by more than what counts as alike."""
    tests = _Tests(results, 'range')
    yield tests.change(f'{AIQL}, {_ranges(tests)}', EFFICIENCY, AIQL, (0, -1), low=-np.inf)


def aqmix_best_over_ranges(results: StudyResults) -> Iterator[Evidence]:
    """AQMIX against every rival at every range."""
    return _Tests(results, 'range').ahead_everywhere()


def optimal_better(results: StudyResults) -> Iterator[Evidence]:
    """Both ways to share bandwidth at every channel error."""
    tests = _Tests(results, 'csi')
    for index, name in enumerate(tests.names):
        optimal, equal = (_OPTIMAL, index), (_EQUAL, index)
        yield tests.above(f'error {name}: time saved in collecting', COLLECTING, equal, optimal)
        yield tests.above(f'error {name}: efficiency gained', EFFICIENCY, optimal, equal)


def robust_to_errors(results: StudyResults) -> Iterator[Evidence]:
    """The largest channel error against none."""
    tests = _Tests(results, 'csi')
    what = f'{AQMIX} from error {tests.names[0]} to {tests.names[-1]}'
    yield tests.change(what, EFFICIENCY, _OPTIMAL, (0, -1), -ROBUST_PERCENT, np.inf)


def marginal_gain_when_sparse(results: StudyResults) -> Iterator[Evidence]:
    """What the optimal bandwidth gains at the smallest density."""
    tests = _Tests(results, 'bandwidth')
    both = (tests.samples((label, 0), EFFICIENCY) for label in (_OPTIMAL, _EQUAL))
    what = f'gain of efficiency at density {tests.names[0]}'
    yield is_within(what, '%', change_percent, *both, low=-MARGINAL_PERCENT, high=MARGINAL_PERCENT)


def gain_grows_with_density(results: StudyResults) -> Iterator[Evidence]:
    """What the optimal bandwidth gains at the largest density, and against the smallest."""
    tests = _Tests(results, 'bandwidth')
    samples = [
        tests.samples((label, index), EFFICIENCY)
        for index in (-1, 0)
        for label in (_OPTIMAL, _EQUAL)
    ]
    what = f'gain of efficiency, density {tests.names[-1]} less {tests.names[0]}'
    yield is_positive(what, 'percentage points', _larger_gain, *samples, one=100.0)
    what = f'gain of efficiency at density {tests.names[-1]}'
    yield is_within(what, '%', change_percent, *samples[:2], low=MARGINAL_PERCENT)


def less_overlap(results: StudyResults) -> Iterator[Evidence]:
    """Cells that several UAVs flew to, as a share of all that were flown to, in all missions."""
    tests = results.trajectories('trajectories').tests
    overlap = {label: results.overlap_percent(tested) for label, tested in tests.items()}
    for rival in (QMIX, AIQL):
        what = f'cells of several UAVs, {rival} less AQMIX'
        yield is_above(what, 'percentage points', overlap[rival], overlap[AQMIX])


def _second_uav(
    results: StudyResults, label: str, measure: PanelMeasure, low: float, high: float
) -> Iterator[Evidence]:
    tests = _Tests(results, 'uavs')
    pair = tests.one_and_two()
    if pair is not None:
        yield tests.change(f'{label} from 1 to 2 UAVs', measure, label, pair, low, high)


def _about(percent: float) -> tuple[float, float]:
    return percent - ABOUT_POINTS, percent + ABOUT_POINTS


def _dearer(*means: Floats) -> Floats:
    """Efficiency lost over time saved, of the first policy less of the second.

    Args:
        means: of each policy, efficiency with one UAV and two, then time with one and two.
    """
    first, second = (
        ratio(change_percent(two_kbit, one_kbit), change_percent(two_s, one_s))
        for one_kbit, two_kbit, one_s, two_s in (means[:4], means[4:])
    )
    return np.asarray(first - second)


def _larger_gain(*means: Floats) -> Floats:
    """Gain of efficiency in per cent at one density less that at another."""
    dense, dense_equal, sparse, sparse_equal = means
    return change_percent(dense, dense_equal) - change_percent(sparse, sparse_equal)


def _difference(first: Samples, second: Samples) -> Samples:
    """The first less the second by mission, of trainings one beside another."""
    n_trainings = min(len(first.value), len(second.value))
    pairs = zip(first.trainings, second.trainings, strict=False)
    return Samples(
        value=first.value[:n_trainings] - second.value[:n_trainings],
        trainings=tuple(f'{one} {other}' for one, other in pairs),
    )


def _moments(first: Samples, second: Samples) -> tuple[Samples, ...]:
    """What the correlation of two measures of the same things is made of."""
    one, other = first.value, second.value
    values = (one, other, one * one, other * other, one * other)
    return tuple(replace(first, value=value, source=()) for value in values)


def _correlation(*means: Floats) -> Floats:
    """Pearson's correlation, by the means of both, of both squared, and of the product."""
    one, other, one_squared, other_squared, product = means
    variances = (one_squared - one * one) * (other_squared - other * other)
    spread = np.sqrt(np.maximum(variances, 0.0))
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.asarray((product - one * other) / np.where(spread > _FLAT, spread, np.nan))


def _ranges(tests: _Tests) -> str:
    return f'{tests.names[0]} to {tests.names[-1]}'

"""Evidence for what the paper says of its tests: by mission, each policy in the same missions."""

from collections.abc import Iterator

import numpy as np
from uav_collect.studies.claims.judging import (
    changed_percent,
    Evidence,
    is_above,
    is_within,
    Samples,
    StudyResults,
)
from uav_collect.studies.study import (
    AIQL,
    AQMIX,
    COLLECTED,
    COLLECTING,
    COMPLETION,
    EFFICIENCY,
    HERT,
    PanelMeasure,
    QMIX,
)

_ENOUGH_KJ, _LONG_KJ = 150.0, 400.0  # as the paper has them
_ALL_PERCENT = 99.9  # of the data: all of it
_ALIKE_PERCENT = 2.0
_MARGINAL_PERCENT = 2.0
_ROBUST_PERCENT = 5.0
_OPTIMAL, _EQUAL = f'{AQMIX}, optimal bandwidth', f'{AQMIX}, equal bandwidth'

_Place = tuple[str, int]  # the label of a line, and the index of a value that it runs over


class _Tests:
    """Compares the lines of a study of tests."""

    def __init__(self, results: StudyResults, name: str) -> None:
        self._results, self._study = results, results.lines(name)
        self.values = self._study.values
        self.names = self._study.names or tuple(f'{value:g}' for value in self.values)

    def samples(self, place: _Place, measure: PanelMeasure) -> Samples:
        """The values of a measure at a place, mission by mission."""
        label, index = place
        return self._results.missions(self._study.line(label).tests[index], measure)

    def above(self, what: str, measure: PanelMeasure, high: _Place, low: _Place) -> Evidence:
        """Whether a measure is larger at one place than at another."""
        first, second = self.samples(high, measure), self.samples(low, measure)
        return is_above(what, measure.unit, first, second)

    def changed_percent(self, measure: PanelMeasure, after: _Place, before: _Place) -> Samples:
        """By how much a measure changes between two places."""
        return changed_percent(self.samples(after, measure), self.samples(before, measure))

    def change(
        self, what: str, measure: PanelMeasure, label: str, indices: tuple[int, int],
        low: float = -_ALIKE_PERCENT, high: float = _ALIKE_PERCENT,
    ) -> Evidence:  # fmt: skip
        """Whether a measure of a line changes by so much from one value to another."""
        before, after = ((label, index) for index in indices)
        changed = self.changed_percent(measure, after, before)
        return is_within(f'change of the {measure.title} of {what}', '%', changed, low, high)

    def collected(self, label: str, budget_kj: float, low: float, high: float) -> Evidence:
        """Whether a policy collects so much with a budget, or the nearest one that was tested."""
        index = self.nearest(budget_kj)
        what = f'data collected by {label} with {self.names[index]} kJ'
        samples = self.samples((label, index), COLLECTED)
        return is_within(what, COLLECTED.unit, samples, low, high)

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
        yield tests.collected(label, _ENOUGH_KJ, _ALL_PERCENT, 100.0)


def aiql_needs_more_energy(results: StudyResults) -> Iterator[Evidence]:
    """Data left behind with the paper's largest budget."""
    yield _Tests(results, 'energy').collected(AIQL, _LONG_KJ, 0.0, _ALL_PERCENT)


def more_energy_changes_nothing(results: StudyResults) -> Iterator[Evidence]:
    """The largest budget against the one that is enough."""
    tests = _Tests(results, 'energy')
    enough = tests.nearest(_ENOUGH_KJ)
    span = f'{AQMIX} from {tests.names[enough]} to {tests.names[-1]} kJ'
    for measure in (COMPLETION, EFFICIENCY):
        yield tests.change(span, measure, AQMIX, (enough, -1))


def aqmix_best_over_budgets(results: StudyResults) -> Iterator[Evidence]:
    """With the largest budget, where every policy has what it needs; data with the smallest."""
    tests = _Tests(results, 'energy')
    for rival in (QMIX, AIQL, HERT):
        yield from tests.ahead(rival, len(tests.values) - 1)
        what = f'{tests.at(0)}: data collected, AQMIX less {rival}'
        yield tests.above(what, COLLECTED, (AQMIX, 0), (rival, 0))


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


def faster_but_less_efficient(results: StudyResults) -> Iterator[Evidence]:
    """The smallest fleet against the largest."""
    tests = _Tests(results, 'uavs')
    fleets = f'{tests.names[0]} UAV less {tests.names[-1]} UAVs'
    for label in (AQMIX, QMIX):
        for measure in (COMPLETION, EFFICIENCY):
            what = f'{measure.title} of {label}, {fleets}'
            yield tests.above(what, measure, (label, 0), (label, -1))


def second_uav_of_aqmix(results: StudyResults) -> Iterator[Evidence]:
    """About 75 % is read as 70 to 80 %; the one UAV is the scenario's first, of 5 m/s."""
    yield from _second_uav(results, AQMIX, COMPLETION, -80.0, -70.0)
    yield from _second_uav(results, AQMIX, EFFICIENCY, -10.0, 0.0)


def second_uav_of_qmix(results: StudyResults) -> Iterator[Evidence]:
    """50 % is read as 45 to 55 %, 30 % as 25 to 35 %."""
    yield from _second_uav(results, QMIX, COMPLETION, -55.0, -45.0)
    yield from _second_uav(results, QMIX, EFFICIENCY, -35.0, -25.0)


def hert_in_proportion(results: StudyResults) -> Iterator[Evidence]:
    """Time times the number of UAVs, and efficiency, stay within a tenth."""
    tests = _Tests(results, 'uavs')
    for index in range(1, len(tests.values)):
        share = tests.values[index] / tests.values[0]
        times = [tests.samples((HERT, it), COMPLETION) for it in (index, 0)]
        worked = Samples(value=times[0].value * share, noun='mission')
        what = f'from {tests.names[0]} to {tests.names[index]} UAVs'
        change = changed_percent(worked, times[1])
        yield is_within(f'change of time x number of UAVs {what}', '%', change, -10.0, 10.0)
        change = tests.changed_percent(EFFICIENCY, (HERT, index), (HERT, 0))
        yield is_within(f'change of efficiency {what}', '%', change, -10.0, 10.0)


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
    yield tests.change(f'{AIQL}, {_ranges(tests)}', EFFICIENCY, AIQL, (0, -1), low=-100.0)


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
    change = tests.changed_percent(EFFICIENCY, (_OPTIMAL, -1), (_OPTIMAL, 0))
    what = f'change of efficiency from error {tests.names[0]} to {tests.names[-1]}'
    yield is_within(what, '%', change, -_ROBUST_PERCENT, 100.0)


def marginal_gain_when_sparse(results: StudyResults) -> Iterator[Evidence]:
    """What the optimal bandwidth gains at the smallest density."""
    tests = _Tests(results, 'bandwidth')
    gain = tests.changed_percent(EFFICIENCY, (_OPTIMAL, 0), (_EQUAL, 0))
    what = f'gain of efficiency at density {tests.names[0]}'
    yield is_within(what, '%', gain, -_MARGINAL_PERCENT, _MARGINAL_PERCENT)


def gain_grows_with_density(results: StudyResults) -> Iterator[Evidence]:
    """What the optimal bandwidth gains at the largest density against the smallest."""
    tests = _Tests(results, 'bandwidth')
    dense, sparse = (
        tests.changed_percent(EFFICIENCY, (_OPTIMAL, index), (_EQUAL, index)) for index in (-1, 0)
    )
    what = f'gain of efficiency, density {tests.names[-1]} less {tests.names[0]}'
    yield is_above(what, 'percentage points', dense, sparse)


def less_overlap(results: StudyResults) -> Iterator[Evidence]:
    """Cells that several UAVs flew to, as a share of all that were flown to, in all missions."""
    overlap = {}
    for label, tested in results.trajectories('trajectories').tests.items():
        shared = results.findings.numbers(tested, 'shared_cells')
        visited = results.findings.numbers(tested, 'visited_cells')
        overlap[label] = Samples(value=100.0 * shared / np.maximum(visited, 1.0), noun='mission')
    for rival in (QMIX, AIQL):
        what = f'cells of several UAVs, {rival} less AQMIX'
        yield is_above(what, '% of cells', overlap[rival], overlap[AQMIX])


def _second_uav(
    results: StudyResults, label: str, measure: PanelMeasure, low: float, high: float
) -> Iterator[Evidence]:
    tests = _Tests(results, 'uavs')
    if {1.0, 2.0} <= set(tests.values):
        indices = tests.values.index(1.0), tests.values.index(2.0)
        yield tests.change(f'{label} from 1 to 2 UAVs', measure, label, indices, low, high)


def _ranges(tests: _Tests) -> str:
    return f'{tests.names[0]} to {tests.names[-1]}'

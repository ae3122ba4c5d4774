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
    LinesStudy,
    PanelMeasure,
    QMIX,
)

_ENOUGH_KJ, _LONG_KJ = 150.0, 400.0  # as the paper has them
_ALL_PERCENT = 99.9  # of the data: all of it
_ALIKE_PERCENT = 2.0
_MARGINAL_PERCENT = 2.0
_ROBUST_PERCENT = 5.0
_OPTIMAL, _EQUAL = f'{AQMIX}, optimal bandwidth', f'{AQMIX}, equal bandwidth'


def enough_energy(results: StudyResults) -> Iterator[Evidence]:
    """Data collected with the paper's budget, or the nearest one that was tested."""
    study = results.lines('energy')
    index = _nearest(study, _ENOUGH_KJ)
    for label in (AQMIX, QMIX, HERT):
        collected = results.tested(study, label, index, COLLECTED)
        what = f'data collected by {label} with {study.values[index]:g} kJ'
        yield is_within(what, COLLECTED.unit, collected, _ALL_PERCENT, 100.0)


def aiql_needs_more_energy(results: StudyResults) -> Iterator[Evidence]:
    """Data left behind with the paper's largest budget, or the nearest one that was tested."""
    study = results.lines('energy')
    index = _nearest(study, _LONG_KJ)
    collected = results.tested(study, AIQL, index, COLLECTED)
    what = f'data collected by AIQL with {study.values[index]:g} kJ'
    yield is_within(what, COLLECTED.unit, collected, 0.0, _ALL_PERCENT)


def more_energy_changes_nothing(results: StudyResults) -> Iterator[Evidence]:
    """The largest budget against the one that is enough."""
    study = results.lines('energy')
    enough = _nearest(study, _ENOUGH_KJ)
    for measure in (COMPLETION, EFFICIENCY):
        before, after = (results.tested(study, AQMIX, index, measure) for index in (enough, -1))
        yield is_within(
            f'change of the {measure.title} of AQMIX from {study.values[enough]:g} to '
            f'{study.values[-1]:g} kJ',
            '%',
            changed_percent(after, before),
            -_ALIKE_PERCENT,
            _ALIKE_PERCENT,
        )


def aqmix_best_over_budgets(results: StudyResults) -> Iterator[Evidence]:
    """With the largest budget, where every policy has what it needs; data with the smallest."""
    study = results.lines('energy')
    for rival in (QMIX, AIQL, HERT):
        yield from _ahead(results, study, rival, len(study.values) - 1)
        yield is_above(
            f'{_at(study, 0)}: data collected, AQMIX less {rival}',
            COLLECTED.unit,
            results.tested(study, AQMIX, 0, COLLECTED),
            results.tested(study, rival, 0, COLLECTED),
        )


def rising_with_density(results: StudyResults) -> Iterator[Evidence]:
    """AQMIX at each density against the one before."""
    study = results.lines('density')
    for measure in (COMPLETION, EFFICIENCY):
        for index in range(1, len(study.values)):
            yield is_above(
                f'{measure.title} of AQMIX, density {study.values[index]:g} less '
                f'{study.values[index - 1]:g}',
                measure.unit,
                results.tested(study, AQMIX, index, measure),
                results.tested(study, AQMIX, index - 1, measure),
            )


def aqmix_best_over_densities(results: StudyResults) -> Iterator[Evidence]:
    """Every density, every rival."""
    yield from _best_everywhere(results, results.lines('density'))


def faster_but_less_efficient(results: StudyResults) -> Iterator[Evidence]:
    """The smallest fleet against the largest."""
    study = results.lines('uavs')
    for label in (AQMIX, QMIX):
        for measure in (COMPLETION, EFFICIENCY):
            yield is_above(
                f'{measure.title} of {label}, {study.values[0]:g} UAV less '
                f'{study.values[-1]:g} UAVs',
                measure.unit,
                results.tested(study, label, 0, measure),
                results.tested(study, label, -1, measure),
            )


def second_uav_of_aqmix(results: StudyResults) -> Iterator[Evidence]:
    """About 75 % is read as 70 to 80 %; the one UAV is the scenario's first, of 5 m/s."""
    yield from _second_uav(results, AQMIX, COMPLETION, -80.0, -70.0)
    yield from _second_uav(results, AQMIX, EFFICIENCY, -10.0, 0.0)


def second_uav_of_qmix(results: StudyResults) -> Iterator[Evidence]:
    """Read as 45 to 55 % and 25 to 35 %."""
    yield from _second_uav(results, QMIX, COMPLETION, -55.0, -45.0)
    yield from _second_uav(results, QMIX, EFFICIENCY, -35.0, -25.0)


def hert_in_proportion(results: StudyResults) -> Iterator[Evidence]:
    """Time times the number of UAVs, and efficiency, stay within a tenth."""
    study = results.lines('uavs')
    first = study.values[0]
    for index in range(1, len(study.values)):
        share = study.values[index] / first
        times = [results.tested(study, HERT, it, COMPLETION) for it in (index, 0)]
        together = Samples(value=times[0].value * share, noun='mission')
        what = f'from {first:g} to {study.values[index]:g} UAVs'
        yield is_within(
            f'change of time x number of UAVs {what}', '%',
            changed_percent(together, times[1]), -10.0, 10.0,
        )  # fmt: skip
        efficiencies = [results.tested(study, HERT, it, EFFICIENCY) for it in (index, 0)]
        yield is_within(
            f'change of efficiency {what}', '%', changed_percent(*efficiencies), -10.0, 10.0
        )


def aiql_poor_with_many(results: StudyResults) -> Iterator[Evidence]:
    """AIQL against HERT, the paper's weakest, wherever there are more than two UAVs."""
    study = results.lines('uavs')
    for index, n_uavs in enumerate(study.values):
        if n_uavs > 2:
            yield is_above(
                f'{_at(study, index)}: efficiency, HERT less AIQL',
                EFFICIENCY.unit,
                results.tested(study, HERT, index, EFFICIENCY),
                results.tested(study, AIQL, index, EFFICIENCY),
            )


def aqmix_best_over_fleets(results: StudyResults) -> Iterator[Evidence]:
    """Every fleet, every rival."""
    yield from _best_everywhere(results, results.lines('uavs'))


def hert_without_radio(results: StudyResults) -> Iterator[Evidence]:
    """The largest range against none."""
    study = results.lines('range')
    for measure in (COMPLETION, EFFICIENCY):
        yield _over_range(results, study, HERT, measure, -_ALIKE_PERCENT, _ALIKE_PERCENT)


def better_with_range(results: StudyResults) -> Iterator[Evidence]:
    """The largest range against none."""
    study = results.lines('range')
    for label in (AQMIX, QMIX):
        none, full = (
            (results.tested(study, label, it, COMPLETION),
             results.tested(study, label, it, EFFICIENCY))
            for it in (0, -1)
        )  # fmt: skip
        span = f'{label}, {study.names[0]} to {study.names[-1]}'
        yield is_above(f'time that {span} saves', COMPLETION.unit, none[0], full[0])
        yield is_above(f'efficiency that {span} adds', EFFICIENCY.unit, full[1], none[1])


def aiql_without_gain(results: StudyResults) -> Iterator[Evidence]:
    """The largest range against none: no better by more than what counts as alike."""
    study = results.lines('range')
    yield _over_range(results, study, AIQL, EFFICIENCY, -100.0, _ALIKE_PERCENT)


def aqmix_best_over_ranges(results: StudyResults) -> Iterator[Evidence]:
    """Every range, every rival."""
    yield from _best_everywhere(results, results.lines('range'))


def optimal_better(results: StudyResults) -> Iterator[Evidence]:
    """Every channel error."""
    study = results.lines('csi')
    for index, error in enumerate(study.values):
        optimal, equal = (
            [results.tested(study, label, index, it) for it in (COLLECTING, EFFICIENCY)]
            for label in (_OPTIMAL, _EQUAL)
        )
        at = f'error {error:g}'
        yield is_above(f'{at}: time saved in collecting', 's', equal[0], optimal[0])
        yield is_above(f'{at}: efficiency gained', EFFICIENCY.unit, optimal[1], equal[1])


def robust_to_errors(results: StudyResults) -> Iterator[Evidence]:
    """The largest channel error against none."""
    study = results.lines('csi')
    without, with_error = (results.tested(study, _OPTIMAL, index, EFFICIENCY) for index in (0, -1))
    yield is_within(
        f'change of efficiency from error {study.values[0]:g} to {study.values[-1]:g}',
        '%',
        changed_percent(with_error, without),
        -_ROBUST_PERCENT,
        100.0,
    )


def marginal_gain_when_sparse(results: StudyResults) -> Iterator[Evidence]:
    """The smallest density."""
    study = results.lines('bandwidth')
    yield is_within(
        f'gain of efficiency at density {study.values[0]:g}',
        '%',
        _gain(results, study, 0),
        -_MARGINAL_PERCENT,
        _MARGINAL_PERCENT,
    )


def gain_grows_with_density(results: StudyResults) -> Iterator[Evidence]:
    """The largest density against the smallest."""
    study = results.lines('bandwidth')
    yield is_above(
        f'gain of efficiency, density {study.values[-1]:g} less {study.values[0]:g}',
        'percentage points',
        _gain(results, study, -1),
        _gain(results, study, 0),
    )


def less_overlap(results: StudyResults) -> Iterator[Evidence]:
    """Cells that several UAVs flew to, as a share of all that were flown to, in all missions."""
    study = results.trajectories('trajectories')
    overlap = {}
    for label, tested in study.tests.items():
        shared, visited = (
            results.findings.numbers(tested, key) for key in ('shared_cells', 'visited_cells')
        )
        overlap[label] = Samples(value=100.0 * shared / np.maximum(visited, 1.0), noun='mission')
    for rival in (QMIX, AIQL):
        yield is_above(
            f'cells of several UAVs, {rival} less AQMIX', '% of cells', overlap[rival],
            overlap[AQMIX],
        )  # fmt: skip


def _nearest(study: LinesStudy, value: float) -> int:
    return int(np.argmin(np.abs(np.array(study.values) - value)))


def _at(study: LinesStudy, index: int) -> str:
    shown = study.names[index] if study.names else f'{study.values[index]:g}'
    return f'{study.over.split(" [")[0]} {shown}'


def _ahead(results: StudyResults, study: LinesStudy, rival: str, index: int) -> Iterator[Evidence]:
    """Time that AQMIX saves and efficiency that it adds."""
    aqmix, other = (
        [results.tested(study, label, index, it) for it in (COMPLETION, EFFICIENCY)]
        for label in (AQMIX, rival)
    )
    at = _at(study, index)
    yield is_above(f'{at}: time, {rival} less AQMIX', COMPLETION.unit, other[0], aqmix[0])
    yield is_above(f'{at}: efficiency, AQMIX less {rival}', EFFICIENCY.unit, aqmix[1], other[1])


def _best_everywhere(results: StudyResults, study: LinesStudy) -> Iterator[Evidence]:
    for index in range(len(study.values)):
        for rival in (QMIX, AIQL, HERT):
            yield from _ahead(results, study, rival, index)


def _second_uav(
    results: StudyResults, label: str, measure: PanelMeasure, low: float, high: float
) -> Iterator[Evidence]:
    study = results.lines('uavs')
    if not {1.0, 2.0} <= set(study.values):
        return
    one, two = (
        results.tested(study, label, study.values.index(n_uavs), measure) for n_uavs in (1.0, 2.0)
    )
    what = f'change of the {measure.title} of {label} from 1 to 2 UAVs'
    yield is_within(what, '%', changed_percent(two, one), low, high)


def _over_range(
    results: StudyResults,
    study: LinesStudy,
    label: str,
    measure: PanelMeasure,
    low: float,
    high: float,
) -> Evidence:
    none, full = (results.tested(study, label, index, measure) for index in (0, -1))
    what = f'change of the {measure.title} of {label}, {study.names[0]} to {study.names[-1]}'
    return is_within(what, '%', changed_percent(full, none), low, high)


def _gain(results: StudyResults, study: LinesStudy, index: int) -> Samples:
    optimal, equal = (
        results.tested(study, label, index, EFFICIENCY) for label in (_OPTIMAL, _EQUAL)
    )
    return changed_percent(optimal, equal)

"""Evidence for what the paper says of learning: by training, at the end."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.claims.judging import (
    by_training,
    change_percent,
    Evidence,
    is_above,
    is_positive,
    is_within,
    ratio,
    Samples,
    StudyResults,
)
from uav_collect.studies.claims.words import ALIKE_PERCENT
from uav_collect.studies.study import (
    AIQL,
    AQMIX,
    CurvesPanel,
    EFFICIENCY,
    QMIX,
    REWARD,
    TrainedPolicies,
)

_REGION, _WHOLE = '3x3', '1x1'  # what a UAV sees; no pooling
_EFFICIENCY_IN_TRAINING = 'training_efficiency_kbit_per_j'


def aqmix_above_in_every_area(results: StudyResults) -> Iterator[Evidence]:
    """Reward of a mission in training, at the end, area by area."""
    for panel in results.panels('learning-areas'):
        yield from _ahead(results, panel)


def waiting_costs_energy(results: StudyResults) -> Iterator[Evidence]:
    """Efficiency of the training's own missions, in which UAVs of QMIX wait."""
    for panel in results.panels('learning-areas'):
        what = f'{panel.label}: efficiency while learning, AQMIX less QMIX'
        aqmix, qmix = (
            results.final_values(panel.curve(label), _EFFICIENCY_IN_TRAINING)
            for label in (AQMIX, QMIX)
        )
        yield is_above(what, EFFICIENCY.unit, aqmix, qmix)


def aiql_varies_more(results: StudyResults) -> Iterator[Evidence]:
    """How far the rewards of seeds lie apart."""
    for panel in results.panels('learning-areas'):
        spread = {
            label: replace(results.final_values(panel.curve(label), REWARD.key), is_spread=True)
            for label in (AIQL, AQMIX, QMIX)
        }
        for rival in (AQMIX, QMIX):
            what = f'{panel.label}: deviation of the reward over seeds, from {rival} to AIQL'
            yield is_positive(what, 'doublings', _doublings, spread[AIQL], spread[rival], one=1.0)


def alike_with_one_uav(results: StudyResults) -> Iterator[Evidence]:
    """Validated efficiency with the smallest fleet."""
    panel = results.panels('learning-uavs')[0]
    aqmix = results.final_values(panel.curve(AQMIX), EFFICIENCY.key)
    for rival in (QMIX, AIQL):
        other = results.final_values(panel.curve(rival), EFFICIENCY.key)
        what = f'{panel.label}: change of the validated efficiency from AQMIX to {rival}'
        yield is_within(
            what, '%', change_percent, other, aqmix, low=-ALIKE_PERCENT, high=ALIKE_PERCENT
        )


def gaps_grow_with_uavs(results: StudyResults) -> Iterator[Evidence]:
    """AQMIX ahead with several UAVs, and with each larger fleet by more reward."""
    panels = results.panels('learning-uavs')[1:]
    for panel in panels:
        yield from _ahead(results, panel)
    for few, many in pairwise(panels):
        for rival in (QMIX, AIQL):
            rewards = [
                results.final_values(panel.curve(label), REWARD.key)
                for panel in (many, few)
                for label in (AQMIX, rival)
            ]
            what = f'lead over {rival} in reward, {many.label} less {few.label}'
            yield is_positive(what, REWARD.unit, _larger_lead, *rewards)


def aiql_drops_with_uavs(results: StudyResults) -> Iterator[Evidence]:
    """How far AIQL is behind AQMIX with the largest fleet, and with the smallest.

    Rewards of different fleets do not compare.
    """
    panels = results.panels('learning-uavs')
    few, many = panels[0], panels[-1]
    values = [
        results.final_values(panel.curve(label), EFFICIENCY.key)
        for panel in (many, few)
        for label in (AIQL, AQMIX)
    ]
    what = f'lead over {AIQL} in validated efficiency, of AQMIX, {many.label} less {few.label}'
    yield is_positive(what, 'percentage points', _further_ahead, *values, one=100.0)


def middle_kernel_best(results: StudyResults) -> Iterator[Evidence]:
    """Reward in training of 3x3 against every other kernel."""
    [panel] = results.panels('kernel')
    middle = _kernel(panel, _REGION)
    if middle is None:
        return
    for other in (it for it in panel.curves if it is not middle):
        rewards = (results.final_values(curve, REWARD.key) for curve in (middle, other))
        yield is_above(f'reward, {_REGION} less {other.label}', REWARD.unit, *rewards)


def pooling_saves(results: StudyResults) -> Iterator[Evidence]:
    """What a kernel of 3x3 saves of the networks' size, and of the time of an update."""
    [panel] = results.panels('kernel')
    whole, middle = (_kernel(panel, label) for label in (_WHOLE, _REGION))
    if whole is None or middle is None:
        return
    sizes = [_sizes(results, curve) for curve in (whole, middle)]
    what = f'numbers that are learned, {_WHOLE} less {_REGION}'
    yield is_above(what, '1', *sizes)
    times = (
        by_training(curve, results.findings.update_ms(curve), 'update_ms')
        for curve in (whole, middle)
    )
    what = f'time of an update with its missions, {_WHOLE} less {_REGION}'
    yield is_above(what, 'ms', *times)


def _kernel(panel: CurvesPanel, label: str) -> TrainedPolicies | None:
    return next((it for it in panel.curves if it.label == label), None)


def _sizes(results: StudyResults, trained: TrainedPolicies) -> Samples:
    n_parameters = float(results.findings.n_parameters(trained))
    return by_training(trained, np.full(len(trained.digests), n_parameters), 'parameters')


def _ahead(results: StudyResults, panel: CurvesPanel) -> Iterator[Evidence]:
    for rival in (QMIX, AIQL):
        rewards = (
            results.final_values(panel.curve(label), REWARD.key) for label in (AQMIX, rival)
        )
        yield is_above(f'{panel.label}: reward, AQMIX less {rival}', REWARD.unit, *rewards)


def _larger_lead(*means: Floats) -> Floats:
    """By how much AQMIX is further ahead of a rival with many UAVs than with few."""
    many_aqmix, many_rival, few_aqmix, few_rival = means
    return np.asarray((many_aqmix - many_rival) - (few_aqmix - few_rival))


def _further_ahead(*means: Floats) -> Floats:
    """By how much AQMIX is further ahead with many UAVs than with few [% of AQMIX]."""
    many_rival, many_aqmix, few_rival, few_aqmix = means
    return np.asarray(
        change_percent(few_rival, few_aqmix) - change_percent(many_rival, many_aqmix)
    )


def _doublings(first: Floats, second: Floats) -> Floats:
    """How often the second is doubled to become the first.

    However far two deviations differ, their difference is only a few of its errors; this is not.
    """
    times = ratio(first, second)
    return np.log2(np.where(times > 0.0, times, np.nan))

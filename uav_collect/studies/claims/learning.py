"""Evidence for what the paper says of learning: by seed, at the end of trainings."""

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
from uav_collect.studies.study import AIQL, AQMIX, CurvesPanel, EFFICIENCY, QMIX, REWARD

_ALIKE_PERCENT = 5.0
_REGION = '3x3'  # what a UAV sees
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
    """How far each seed's reward is from the middle of all seeds."""
    for panel in results.panels('learning-areas'):
        spread = {
            label: _spread(results.final_values(panel.curve(label), REWARD.key))
            for label in (AIQL, AQMIX, QMIX)
        }
        for rival in (AQMIX, QMIX):
            what = f'{panel.label}: distance of a seed from the median, AIQL less {rival}'
            yield is_above(what, REWARD.unit, spread[AIQL], spread[rival])


def alike_with_one_uav(results: StudyResults) -> Iterator[Evidence]:
    """Validated efficiency with the smallest fleet."""
    panel = results.panels('learning-uavs')[0]
    aqmix = results.final_values(panel.curve(AQMIX), EFFICIENCY.key)
    for rival in (QMIX, AIQL):
        change = changed_percent(results.final_values(panel.curve(rival), EFFICIENCY.key), aqmix)
        what = f'{panel.label}: change of the validated efficiency from AQMIX to {rival}'
        yield is_within(what, '%', change, -_ALIKE_PERCENT, _ALIKE_PERCENT)


def gaps_grow_with_uavs(results: StudyResults) -> Iterator[Evidence]:
    """AQMIX ahead with several UAVs, and further with the most than with the second fewest."""
    panels = results.panels('learning-uavs')
    for panel in panels[1:]:
        yield from _ahead(results, panel)
    few, many = panels[1], panels[-1]
    for rival in (QMIX, AIQL):
        gaps = [_relative_gap(results, panel, rival) for panel in (few, many)]
        n_seeds = min(len(gap.value) for gap in gaps)
        early, late = (Samples(value=gap.value[:n_seeds], noun='seed') for gap in gaps)
        what = f'lead over {rival} in validated efficiency, {many.label} less {few.label}'
        yield is_above(what, '% of AQMIX', late, early)


def aiql_drops_with_uavs(results: StudyResults) -> Iterator[Evidence]:
    """Reward in training with the smallest fleet and with the largest."""
    panels = results.panels('learning-uavs')
    few, many = panels[0], panels[-1]
    curves = few.curve(AIQL), many.curve(AIQL)
    n_seeds = min(len(curve.digests) for curve in curves)
    rewards = (results.final_values(curve, REWARD.key, n_seeds) for curve in curves)
    yield is_above(f'reward of AIQL, {few.label} less {many.label}', REWARD.unit, *rewards)


def middle_kernel_best(results: StudyResults) -> Iterator[Evidence]:
    """Reward in training of 3x3 against the smallest and the largest kernel."""
    [panel] = results.panels('kernel')
    middle = next((it for it in panel.curves if it.label == _REGION), None)
    if middle is None:
        return
    for other in (panel.curves[0], panel.curves[-1]):
        rewards = (results.final_values(curve, REWARD.key) for curve in (middle, other))
        yield is_above(f'reward, {_REGION} less {other.label}', REWARD.unit, *rewards)


def _ahead(results: StudyResults, panel: CurvesPanel) -> Iterator[Evidence]:
    for rival in (QMIX, AIQL):
        rewards = (
            results.final_values(panel.curve(label), REWARD.key) for label in (AQMIX, rival)
        )
        yield is_above(f'{panel.label}: reward, AQMIX less {rival}', REWARD.unit, *rewards)


def _relative_gap(results: StudyResults, panel: CurvesPanel, rival: str) -> Samples:
    aqmix, other = (
        results.final_values(panel.curve(label), EFFICIENCY.key) for label in (AQMIX, rival)
    )
    first, second = aqmix.paired(other)
    return Samples(value=100.0 * (first - second) / first.mean(), noun='seed')


def _spread(samples: Samples) -> Samples:
    # Distances from the median compare like deviations, and can be paired and resampled.
    distance = np.abs(samples.value - np.nanmedian(samples.value))
    return Samples(value=distance, noun=samples.noun)

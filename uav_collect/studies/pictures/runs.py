"""Draws algorithms over many tasks: a mean of the middle half, profiles, and who is better."""

import numpy as np
from uav_collect import files
from uav_collect.analysis.plotting import Axes
from uav_collect.analysis.run_scores import (
    improvement_probability,
    interquartile_mean,
    performance_profile,
    stratified_estimate,
)
from uav_collect.analysis.statistics import CONFIDENCE_LEVEL, Estimate
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.findings import Findings
from uav_collect.studies.pictures.drawing import COLOUR, Drawing, label_axes, panels, STYLE
from uav_collect.studies.runs import marl_eval_json, suite_scores
from uav_collect.studies.study import AQMIX, LEARNED, RULES, RunsStudy, Suite

_SIZE_IN = (4.2, 3.6)
_THRESHOLDS = np.linspace(0.0, 1.0, 101)
_SHARE = 'efficiency, share of the thriftiest plan'
_Rows = list[list[object]]


def draw(study: RunsStudy, findings: Findings) -> Drawing:
    """Draw a study; with it comes a file for marl-eval.

    Raises:
        StoreError: a job of it is not done.
    """
    scores = {suite.key: suite_scores(suite, findings) for suite in study.suites}
    counts = '; '.join(_count(suite, scores[suite.key]) for suite in study.suites)
    note = (
        f'{study.about}; {counts}; {CONFIDENCE_LEVEL:.0%} intervals of a stratified bootstrap'
        ' over trainings, widened for few'
    )
    figure, grid = panels(len(study.suites), 3, study.title, note, size_in=_SIZE_IN)
    rows: _Rows = []
    for row, suite in zip(grid, study.suites, strict=True):
        of_suite = scores[suite.key]
        rows += _draw_means(row[0], suite, of_suite)
        rows += _draw_profiles(row[1], suite, of_suite)
        rows += _draw_improvements(row[2], suite, of_suite)
        for axes in row:
            axes.set_title(suite.label, fontsize=9)
            axes.legend(
                loc='upper center', bbox_to_anchor=(0.5, -0.18), frameon=False, fontsize=7.5,
                ncols=3,
            )  # fmt: skip
    header = ('suite', 'measure', 'line', 'threshold', 'n_trainings', 'n_tasks', 'mean', 'low',
              'high')  # fmt: skip
    table = files.csv_of([header, *rows])
    return Drawing(
        figure=figure, table=table, others={'marl_eval.json': marl_eval_json(study, findings)}
    )


def _count(suite: Suite, scores: dict[str, Floats]) -> str:
    n_runs, n_tasks = scores[AQMIX].shape
    return f'{suite.label}: n = {n_runs} trainings on each of {n_tasks} tasks'


def _draw_means(axes: Axes, suite: Suite, scores: dict[str, Floats]) -> _Rows:
    rows: _Rows = []
    labels = [*LEARNED, *RULES]
    for place, label in enumerate(labels):
        [estimate] = stratified_estimate(interquartile_mean, scores[label])
        _draw_interval(axes, place, estimate, label)
        rows.append(_row(suite, 'interquartile_mean', label, '', scores[label], estimate))
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    label_axes(axes, f'interquartile mean of {_SHARE}', 'policy', '1')
    return rows


def _draw_interval(axes: Axes, place: int, estimate: Estimate, label: str) -> None:
    around = [[estimate.mean - estimate.low], [estimate.high - estimate.mean]]
    axes.errorbar(
        [estimate.mean], [place], xerr=around, color=COLOUR[label], marker='o', markersize=5,
        capsize=3, linestyle='none', label=label,
    )  # fmt: skip


def _draw_profiles(axes: Axes, suite: Suite, scores: dict[str, Floats]) -> _Rows:
    rows: _Rows = []
    for label in (*LEARNED, *RULES):
        of_label = scores[label]
        points = stratified_estimate(lambda it: performance_profile(it, _THRESHOLDS), of_label)
        style = STYLE.get(label, '-')
        axes.step(
            _THRESHOLDS, [it.mean for it in points], where='post', color=COLOUR[label],
            linestyle=style, linewidth=1.6, label=label,
        )  # fmt: skip
        if label in LEARNED:
            axes.fill_between(
                _THRESHOLDS, [it.low for it in points], [it.high for it in points], step='post',
                color=COLOUR[label], alpha=0.15, linewidth=0,
            )  # fmt: skip
        rows += [
            _row(suite, 'performance_profile', label, float(threshold), of_label, point)
            for threshold, point in zip(_THRESHOLDS, points, strict=True)
        ]
    label_axes(axes, _SHARE, 'share of trainings above', '1')
    return rows


def _draw_improvements(axes: Axes, suite: Suite, scores: dict[str, Floats]) -> _Rows:
    rows: _Rows = []
    rivals = [label for label in (*LEARNED, *RULES) if label != AQMIX]
    for place, rival in enumerate(rivals):
        [estimate] = stratified_estimate(improvement_probability, scores[AQMIX], scores[rival])
        _draw_interval(axes, place, estimate, rival)
        rows.append(_row(suite, 'improvement_probability', rival, '', scores[AQMIX], estimate))
    axes.axvline(0.5, color='#888888', linewidth=0.8)
    axes.set_xlim(-0.03, 1.03)
    axes.set_yticks(range(len(rivals)), rivals)
    axes.invert_yaxis()
    label_axes(axes, f'probability that {AQMIX} is better', 'than', '1')
    return rows


def _row(
    suite: Suite, measure: str, label: str, threshold: object, scores: Floats, it: Estimate
) -> list[object]:
    return [suite.key, measure, label, threshold, *scores.shape, it.mean, it.low, it.high]

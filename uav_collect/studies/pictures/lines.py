"""Draws tests over what is varied: means with their intervals, a panel for each measure."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from uav_collect import files
from uav_collect.analysis.plotting import Axes
from uav_collect.analysis.statistics import CONFIDENCE_LEVEL, Estimate
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.findings import Column, estimate_column, Findings
from uav_collect.studies.pictures.drawing import (
    COLOUR,
    count_text,
    Drawing,
    label_axes,
    MARKER,
    panels,
    SOLID,
    STYLE,
    THIN,
)
from uav_collect.studies.study import Line, LinesStudy, PanelMeasure, PLAN

_SIZE_IN = (4.6, 4.6)
_PLAN_LABELS = {
    'shortest_completion_s': 'shortest plan',
    'thriftiest_efficiency_kbit_per_j': 'thriftiest plan',
}
_ASIDE = 0.009  # between two lines, as a share of the axis: what coincides is seen beside itself
_BEST = 'the best in validation'


@dataclass(frozen=True, kw_only=True)
class _Point:
    """What is known of a line at one value."""

    n_missions: int
    n_trainings: int
    estimate: Estimate
    best: tuple[int, Estimate] | None  # missions of the one policy that validation would choose


_Points = list[_Point | None]  # by value; None where nothing is known


def draw(study: LinesStudy, findings: Findings) -> Drawing:
    """Draw a study.

    Raises:
        StoreError: a job of it is not done.
    """
    drawn: list[tuple[PanelMeasure, Line, _Points]] = []
    for measure in study.measures:
        for line in study.lines:
            points = _points(line, measure, findings)
            if points is not None:
                drawn.append((measure, line, points))
    note = _note(study, [(line, points) for _, line, points in drawn])
    figure, [row] = panels(1, len(study.measures), study.title, note, size_in=_SIZE_IN)
    rows: list[list[object]] = []
    for axes, measure in zip(row, study.measures, strict=True):
        for shown, line, points in drawn:
            if shown is measure:
                _draw_line(axes, study, line, measure, points)
                rows += _rows(study, line, measure, points, findings)
        _finish(axes, study, measure)
    header = (
        'measure', 'line', 'policies', study.column, 'n_trainings', 'n_missions', 'first_seed',
        'last_seed', 'mean', 'low', 'high', 'unit',
    )  # fmt: skip
    return Drawing(figure=figure, table=files.csv_of([header, *rows]))


def _note(study: LinesStudy, drawn: list[tuple[Line, _Points]]) -> str:
    """The caption: what was done, and of how many the numbers are."""
    known = [(line, point) for line, points in drawn for point in points if point is not None]
    flown = [point.n_missions for line, point in known if line.policy != PLAN] or [0]
    planned = [point.n_missions for line, point in known if line.policy == PLAN]
    trainings = [point.n_trainings for _, point in known if point.n_trainings]
    paper = f'Fig. {study.figure} of the paper; ' if study.figure else ''
    parts = [
        f'{paper}{study.about}',
        f'n = {count_text(flown, "mission")}'
        + (f' by each policy of {count_text(trainings, "training")}' if trainings else ''),
        f'mean and {CONFIDENCE_LEVEL:.0%} interval'
        + (f' of both; stars: {_BEST}' if any(it > 1 for it in trainings) else ''),
        'lines stand a little aside of each other',
    ]
    if study.names:
        parts.append('the horizontal axis is not to scale')
    if planned and min(planned) < max(flown):
        missions = count_text(planned, 'mission')
        parts.insert(2, f'plans of {missions}, those for which there is energy')
    return '; '.join(parts)


def _points(line: Line, measure: PanelMeasure, findings: Findings) -> _Points | None:
    columns = [findings.column(tested, measure) for tested in line.tests]
    points: _Points = []
    for tested, column in zip(line.tests, columns, strict=True):
        if column is None:
            return None
        estimated, best = estimate_column(column), None
        if len(tested.trainings) > 1:
            row = findings.best_training(tested)
            best = estimate_column(Column(value=column.value[row : row + 1], trainings=()))
        points.append(
            None
            if estimated is None
            else _Point(
                n_missions=estimated[0],
                n_trainings=len(tested.trainings),
                estimate=estimated[1],
                best=best,
            )
        )
    return points


def _draw_line(
    axes: Axes, study: LinesStudy, line: Line, measure: PanelMeasure, points: _Points
) -> None:
    known = [
        (at, point)
        for at, point in zip(_places(study, line), points, strict=True)
        if point is not None
    ]
    if not known:
        return
    over, estimates = [at for at, _ in known], [point.estimate for _, point in known]
    mean = np.array([estimate.mean for estimate in estimates])
    below = mean - [estimate.low for estimate in estimates]
    above = [estimate.high for estimate in estimates] - mean
    axes.errorbar(
        over, mean, [below, above], color=COLOUR[line.policy], marker=MARKER[line.policy],
        markersize=4, linewidth=1.1 if line.is_thin else 1.7, capsize=2.5, elinewidth=0.9,
        linestyle=THIN if line.is_thin else STYLE.get(line.policy, SOLID),
        label=_PLAN_LABELS[measure.plan_key] if line.policy == PLAN else line.label,
    )  # fmt: skip
    stars = [(at, point.best[1].mean) for at, point in known if point.best is not None]
    axes.plot(
        *zip(*stars, strict=True) if stars else ([], []), color=COLOUR[line.policy],
        linestyle='none', marker='*', markersize=8, fillstyle='none', markeredgewidth=0.8,
    )  # fmt: skip


def _places(study: LinesStudy, line: Line) -> Floats:
    """Where the values of a line stand, each line a little aside of those before it."""
    places = np.arange(float(len(study.values))) if study.names else np.array(study.values)
    number = study.lines.index(line) - (len(study.lines) - 1) / 2.0
    return np.asarray(places + _ASIDE * number * (places[-1] - places[0]))


def _rows(
    study: LinesStudy, line: Line, measure: PanelMeasure, points: _Points, findings: Findings
) -> list[list[object]]:
    rows: list[list[object]] = []
    for value, tested, point in zip(study.values, line.tests, points, strict=True):
        seeds = findings.numbers(tested, 'mission_seed')[0]
        key = measure.key if not tested.is_planned else measure.plan_key
        span = (int(seeds[0]), int(seeds[-1]))
        for policies, n_trainings, n_missions, numbers in _numbers(point):
            about = (key, line.label, policies, value, n_trainings, n_missions)
            rows.append([*about, *span, *numbers, measure.unit])
    return rows


def _numbers(point: _Point | None) -> Iterator[tuple[str, int, int, tuple[object, ...]]]:
    """Of all trainings and of the best one: how many of both, and mean and interval."""
    if point is None:
        yield 'all', 0, 0, ('', '', '')
        return
    mean = point.estimate
    yield 'all', point.n_trainings, point.n_missions, (mean.mean, mean.low, mean.high)
    if point.best is not None:
        n_missions, best = point.best
        yield 'best', 1, n_missions, (best.mean, best.low, best.high)


def _finish(axes: Axes, study: LinesStudy, measure: PanelMeasure) -> None:
    label_axes(axes, study.over, measure.title, measure.unit)
    if study.names:
        axes.set_xticks(range(len(study.names)), study.names)
    else:
        axes.set_xticks(study.values)
    axes.set_ylim(bottom=0.0)
    axes.legend(
        loc='upper center', bbox_to_anchor=(0.5, -0.16), frameon=False, fontsize=7.5, ncols=1
    )

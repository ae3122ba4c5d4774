"""Draws tests over what is varied: means with their intervals, a panel for each measure."""

import numpy as np
from uav_collect import files
from uav_collect.analysis.plotting import Axes
from uav_collect.analysis.statistics import CONFIDENCE_LEVEL, Estimate
from uav_collect.studies.findings import estimate_column, Findings
from uav_collect.studies.pictures.drawing import (
    COLOUR,
    count_label,
    Drawing,
    label_axes,
    panels,
    SOLID,
    STYLE,
    THIN,
)
from uav_collect.studies.study import Line, LinesStudy, PanelMeasure, PLAN

_SIZE_IN = (4.6, 4.6)
_PLAN_LABELS = {
    'shortest_completion_s': 'shortest clairvoyant plan',
    'thriftiest_efficiency_kbit_per_j': 'thriftiest clairvoyant plan',
}

_Point = tuple[int, Estimate]  # of so many missions
_Points = list[_Point | None]  # by value; None where nothing is known


def draw(study: LinesStudy, findings: Findings) -> Drawing:
    """Draw a study.

    Raises:
        StoreError: a job of it is not done.
    """
    interval = f'mean and {CONFIDENCE_LEVEL:.0%} interval'
    paper = f'Fig. {study.figure} of the paper; ' if study.figure else ''
    note = f'{paper}{study.about}; {interval}'
    figure, [row] = panels(1, len(study.measures), study.title, note, size_in=_SIZE_IN)
    rows: list[list[object]] = []
    for axes, measure in zip(row, study.measures, strict=True):
        for line in study.lines:
            points = _points(line, measure, findings)
            if points is not None:
                _draw_line(axes, study, line, measure, points)
                rows += _rows(study, line, measure, points, findings)
        _finish(axes, study, measure)
    header = (
        'measure', 'line', study.column, 'n_missions', 'first_seed', 'last_seed', 'mean', 'low',
        'high', 'unit',
    )  # fmt: skip
    return Drawing(figure=figure, table=files.csv_of([header, *rows]))


def _points(line: Line, measure: PanelMeasure, findings: Findings) -> _Points | None:
    columns = [findings.column(tested, measure) for tested in line.tests]
    if any(column is None for column in columns):
        return None
    return [estimate_column(column) for column in columns if column is not None]


def _draw_line(
    axes: Axes, study: LinesStudy, line: Line, measure: PanelMeasure, points: _Points
) -> None:
    places = np.arange(len(study.values)) if study.names else np.array(study.values)
    known = [(at, *point) for at, point in zip(places, points, strict=True) if point is not None]
    if not known:
        return
    over, counts, estimates = (list(it) for it in zip(*known, strict=True))
    mean = np.array([estimate.mean for estimate in estimates])
    below = mean - [estimate.low for estimate in estimates]
    above = [estimate.high for estimate in estimates] - mean
    name = _PLAN_LABELS[measure.plan_key] if line.policy == PLAN else line.label
    axes.errorbar(
        over, mean, [below, above], color=COLOUR[line.policy], marker='o', markersize=3.5,
        linewidth=1.1 if line.is_thin else 1.7, capsize=2.5, elinewidth=0.9,
        linestyle=THIN if line.is_thin else STYLE.get(line.policy, SOLID),
        label=count_label(name, counts, 'mission'),
    )  # fmt: skip


def _rows(
    study: LinesStudy, line: Line, measure: PanelMeasure, points: _Points, findings: Findings
) -> list[list[object]]:
    rows: list[list[object]] = []
    for value, tested, point in zip(study.values, line.tests, points, strict=True):
        seeds = findings.numbers(tested, 'mission_seed')
        about = (measure.key if not tested.is_planned else measure.plan_key, line.label, value)
        span = (int(seeds[0]), int(seeds[-1]))
        if point is None:
            rows.append([*about, 0, *span, '', '', '', measure.unit])
            continue
        n_missions, estimate = point
        interval = (estimate.mean, estimate.low, estimate.high)
        rows.append([*about, n_missions, *span, *interval, measure.unit])
    return rows


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

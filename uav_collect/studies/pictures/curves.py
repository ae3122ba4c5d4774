"""Draws learning curves: reward in training above, energy efficiency in validation below."""

from uav_collect import files
from uav_collect.analysis.plotting import Axes, EngFormatter
from uav_collect.analysis.trajectories import COLOURS
from uav_collect.studies.findings import estimate_column, Findings
from uav_collect.studies.pictures.drawing import (
    COLOUR,
    count_text,
    Drawing,
    label_axes,
    panels,
    STYLE,
)
from uav_collect.studies.study import (
    CurvesPanel,
    CurvesStudy,
    EFFICIENCY,
    PanelMeasure,
    PLAN,
    REWARD,
)
from uav_collect.training.curves import draw_curve, LearningCurve

_SIZE_IN = (4.2, 3.9)
_MARKERS = ('o', 's', '^', 'D', 'v')
_WIDEST, _NARROWER = 3.0, 0.45  # lines, the first one and each after it
_OVER = 'decisions in training'


def draw(study: CurvesStudy, findings: Findings) -> Drawing:
    """Draw a study.

    Raises:
        StoreError: a job of it is not done.
    """
    trainings = [len(curve.digests) for panel in study.panels for curve in panel.curves]
    tested = [it for panel in study.panels for it in panel.references.values()]
    missions = [findings.numbers(it, 'mission_seed').shape[1] for it in tested]
    note = (
        f'Fig. {study.figure} of the paper; {study.about}; n = {count_text(trainings, "training")}'
        ' of each, mean and standard deviation; rules and plans:'
        f' {count_text(missions, "mission")}.'
        ' Above: missions that explore; below: validation, bandwidth shared equally'
    )
    measures = (REWARD, EFFICIENCY)
    figure, grid = panels(2, len(study.panels), study.title, note, size_in=_SIZE_IN)
    rows: list[list[object]] = []
    for axes_row, measure in zip(grid, measures, strict=True):
        for axes, panel in zip(axes_row, study.panels, strict=True):
            for index, trained in enumerate(panel.curves):
                curve = findings.curve(trained, measure.key)
                if curve is not None:
                    colour = COLOUR.get(curve.label, COLOURS[index])
                    # Wide below narrow, each with marks of its own: what coincides is seen.
                    draw_curve(
                        axes, curve, colour, label=curve.label,
                        linewidth=_WIDEST - _NARROWER * index,
                        marker=_MARKERS[index % len(_MARKERS)],
                        markers_at=(0.03 * index, 0.15),
                    )  # fmt: skip
                    rows += _rows(panel, curve, measure)
            if measure is EFFICIENCY:
                rows += _draw_references(axes, panel, findings)
            axes.set_title(panel.label, fontsize=9)
            label_axes(axes, _OVER, measure.title, measure.unit)
            axes.xaxis.set_major_formatter(EngFormatter(sep=''))  # 500k, 2M
            axes.set_xlim(left=0.0)
            axes.legend(
                loc='upper center', bbox_to_anchor=(0.5, -0.16), frameon=False, fontsize=7, ncols=2
            )
    header = ('panel', 'line', 'measure', 'unit', 'n_seeds', 'n_missions', 'n_decisions', 'mean',
              'deviation', 'low', 'high')  # fmt: skip
    return Drawing(figure=figure, table=files.csv_of([header, *rows]))


def _rows(panel: CurvesPanel, curve: LearningCurve, measure: PanelMeasure) -> list[list[object]]:
    n_seeds = len(curve.seeds)
    points = zip(curve.over.tolist(), curve.mean.tolist(), curve.deviation.tolist(), strict=True)
    about = (panel.key, curve.label, measure.key, measure.unit, n_seeds, '')
    return [
        [*about, over, mean, deviation if n_seeds > 1 else '', '', '']
        for over, mean, deviation in points
    ]


def _draw_references(axes: Axes, panel: CurvesPanel, findings: Findings) -> list[list[object]]:
    rows: list[list[object]] = []
    for label, tested in panel.references.items():
        column = findings.column(tested, EFFICIENCY)
        point = None if column is None else estimate_column(column)
        if point is None:
            continue
        n_missions, estimate = point
        axes.axhline(
            estimate.mean, color=COLOUR[label], linewidth=1.1, linestyle=STYLE[label],
            label='thriftiest plan' if label == PLAN else label,
        )  # fmt: skip
        about = (panel.key, label, EFFICIENCY.key, EFFICIENCY.unit, '', n_missions, '')
        rows.append([*about, estimate.mean, '', estimate.low, estimate.high])
    return rows

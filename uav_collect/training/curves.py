"""Learning curves: what policies achieved while they were learned, mean and deviation over seeds.

Runs that differ in nothing but their seed make one curve. They validate at moments of their own,
so each run's values are interpolated at all moments at which one of them validated, as far as all
of them reach.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import textwrap
from typing import BinaryIO

import numpy as np
from uav_collect import files
from uav_collect.analysis.area_picture import GRID
from uav_collect.analysis.plotting import Axes, EngFormatter, Figure, FigureCanvasAgg
from uav_collect.analysis.trajectories import COLOURS, DPI
from uav_collect.errors import TrainingRunError
from uav_collect.kernels.arrays import Floats
from uav_collect.training.run_record import (
    algorithm_text,
    CURVE_MEASURES,
    CurveAxis,
    CurveMeasure,
    PANEL_FILE,
    PROGRESS_FILE,
    read_columns,
    read_run,
    RunRecord,
)

REFERENCE_STYLES = ((0.0, (5.0, 2.0)), (0.0, (1.5, 1.5)), (0.0, (5.0, 1.5, 1.0, 1.5)))
_TITLE_WIDTH, _LABEL_WIDTH = 100, 85  # characters
_WIDTH_IN, _HEIGHT_IN = 7.2, 4.0  # of the picture, without what the curves are called
_LABEL_HEIGHT_IN = 0.18


@dataclass(frozen=True, kw_only=True)
class LearningCurve:
    """What runs that differ in their seed alone achieved."""

    label: str
    seeds: tuple[int, ...]
    over: Floats  # (K,) in the unit of the axis
    mean: Floats  # (K,) over the seeds
    deviation: Floats  # (K,) sample standard deviation over the seeds; nan where there is one


def learning_curves(
    folders: Sequence[Path], measure: CurveMeasure, axis: CurveAxis
) -> tuple[LearningCurve, ...]:
    """The curves of runs, in the order in which the runs are given.

    Raises:
        TrainingRunError: a folder is no run, has not been validated yet, is given twice or has the
            seed of another; or the runs of a curve have no stretch in common.
    """
    if len({os.path.realpath(folder) for folder in folders}) < len(folders):
        raise TrainingRunError(f'{" ".join(map(str, folders))}: names a run twice')
    groups: dict[tuple[object, ...], list[tuple[RunRecord, Path]]] = {}
    for folder in folders:
        record = read_run(folder)
        groups.setdefault(_common_settings(record), []).append((record, folder))
    labels = _labels([members[0][0] for members in groups.values()])
    return tuple(
        _curve(label, members, measure, axis)
        for label, members in zip(labels, groups.values(), strict=True)
    )


def _common_settings(record: RunRecord) -> tuple[object, ...]:
    """Everything in which runs of one curve are the same: all but the seed."""
    return (
        record.algorithm, record.scenario_text, record.scenario_fingerprint, record.courses,
        record.preset, record.overrides, record.training_fingerprint, record.initial,
        record.minutes, record.decisions,
    )  # fmt: skip


def _labels(records: Sequence[RunRecord]) -> list[str]:
    """The algorithm of each curve, and whatever else differs between the curves."""
    algorithms = [algorithm_text(record.algorithm) for record in records]
    scenarios = [record.scenario_text for record in records]
    settings = [' '.join((record.preset, *record.overrides)) for record in records]
    others = [
        _with_fingerprints(
            scenarios, [record.courses or record.scenario_fingerprint for record in records]
        ),
        _with_fingerprints(settings, [record.training_fingerprint for record in records]),
        [f'from {record.initial or "scratch"}' for record in records],
        [record.budget_text for record in records],
    ]
    differing = [names for names in others if len(set(names)) > 1]
    return [', '.join(parts) for parts in zip(algorithms, *differing, strict=True)]


def _with_fingerprints(names: Sequence[str], fingerprints: Sequence[str]) -> list[str]:
    """The names, with the fingerprint where the same name stands for several things."""
    meanings: dict[str, set[str]] = {}
    for name, fingerprint in zip(names, fingerprints, strict=True):
        meanings.setdefault(name, set()).add(fingerprint)
    return [
        f'{name} ({fingerprint})' if len(meanings[name]) > 1 else name
        for name, fingerprint in zip(names, fingerprints, strict=True)
    ]


def _curve(
    label: str, members: Sequence[tuple[RunRecord, Path]], measure: CurveMeasure, axis: CurveAxis
) -> LearningCurve:
    seeds = tuple(record.seed for record, _ in members)
    if len(set(seeds)) < len(seeds):
        again = next(seed for seed in seeds if seeds.count(seed) > 1)
        raise TrainingRunError(f'{label}: two runs have the seed {again}: give one of them')
    lines = [_run_line(folder, measure, axis) for _, folder in members]
    curve = mean_curve(label, seeds, lines)
    if curve is None:
        raise TrainingRunError(f'{label}: its runs have no {axis.key} in common')
    return curve


def mean_curve(
    label: str, seeds: Sequence[int], lines: Sequence[tuple[Floats, Floats]]
) -> LearningCurve | None:
    """The mean of several runs; None where they have no stretch in common.

    Args:
        lines: moments and values of each run, (K,) each; moments rise.
    """
    low = max(over[0] for over, _ in lines)
    high = min(over[-1] for over, _ in lines)
    if low > high:
        return None
    moments = np.unique(np.concatenate([over for over, _ in lines]))
    moments = moments[(moments >= low) & (moments <= high)]
    values = np.array([np.interp(moments, over, value) for over, value in lines])
    alone = len(lines) == 1
    deviation = np.full_like(moments, np.nan) if alone else values.std(axis=0, ddof=1)
    return LearningCurve(
        label=label,
        seeds=tuple(seeds),
        over=moments,
        mean=values.mean(axis=0),
        deviation=deviation,
    )


def _run_line(folder: Path, measure: CurveMeasure, axis: CurveAxis) -> tuple[Floats, Floats]:
    """Moments and values of one run, moments rising."""
    columns = read_columns(folder / measure.file, (axis.column, measure.key))
    over, values = columns[axis.column] * axis.scale, columns[measure.key]
    # A panel has a row for each condition at each moment.
    moments, values = (averaged if measure.file == PANEL_FILE else rising)(over, values)
    if not len(moments):
        others = _measured_so_far(folder)
        instead = f'; {PROGRESS_FILE} has what --measure {" or ".join(others)} shows'
        raise TrainingRunError(
            f'{folder / measure.file}: has no {measure.title} yet{instead if others else ""}'
        )
    return moments, values


def _measured_so_far(folder: Path) -> list[str]:
    """What a run has of itself before it is validated: keys of measures."""
    keys = tuple(it.key for it in CURVE_MEASURES if it.file == PROGRESS_FILE)
    try:
        columns = read_columns(folder / PROGRESS_FILE, keys)
    except TrainingRunError:  # the run is refused for what it lacks, not for this
        return []
    return [key for key in keys if np.isfinite(columns[key]).any()]


def rising(over: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Known values at rising moments; of several at one moment the last counts."""
    known = np.isfinite(values)
    moments, last_from_end = np.unique(over[known][::-1], return_index=True)
    return moments, values[known][::-1][last_from_end]


def averaged(over: Floats, values: Floats) -> tuple[Floats, Floats]:
    """The means of the values at each moment, moments rising."""
    moments, places = np.unique(over, return_inverse=True)
    return moments, np.bincount(places, values) / np.bincount(places)


def to_csv(curves: Sequence[LearningCurve], measure: CurveMeasure, axis: CurveAxis) -> bytes:
    """One row per curve and moment; the deviation of a single seed is left empty."""
    heading = ('curve', 'n_seeds', axis.key, f'mean_{measure.key}', f'deviation_{measure.key}')
    table: list[tuple[object, ...]] = [heading]
    for curve in curves:
        n_seeds = len(curve.seeds)
        rows = zip(curve.over.tolist(), curve.mean.tolist(), curve.deviation.tolist(), strict=True)
        for over, mean, deviation in rows:
            spread = deviation if n_seeds > 1 else ''
            table.append((curve.label, n_seeds, f'{over:.10g}', mean, spread))
    return files.csv_of(table)


def draw_curves(
    curves: Sequence[LearningCurve],
    measure: CurveMeasure,
    axis: CurveAxis,
    file: Path | BinaryIO,
    references: Mapping[str, float] | None = None,
    title: str = '',
) -> None:
    """Draw curves into a PNG file: means as lines, deviations shaded around them.

    Args:
        file: to be written; the same curves give the same bytes.
        references: what other policies achieve, by name, in the unit of the measure.
        title: above the picture.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN), facecolor='white', layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for index, curve in enumerate(curves):
        marker = 'o' if len(curve.over) == 1 else ''
        colour = COLOURS[index % len(COLOURS)]
        n_seeds = len(curve.seeds)
        label = f'{curve.label} ({n_seeds} seed{"s" if n_seeds > 1 else ""})'
        draw_curve(axes, curve, colour, label=label, linewidth=1.8, marker=marker)
    _draw_references(axes, references or {})
    unit = '' if measure.unit == '1' else f' [{measure.unit}]'
    axes.set_xlabel(axis.title)
    axes.set_ylabel(f'{measure.title}{unit}')
    axes.set_title(textwrap.fill(title, _TITLE_WIDTH), loc='left', fontsize=10, parse_math=False)
    axes.set_xlim(left=0.0)
    if axis.scale == 1.0:
        axes.xaxis.set_major_formatter(EngFormatter(sep=''))  # 500k, 2M
    axes.grid(color=GRID, linewidth=0.6)
    axes.spines[['top', 'right']].set_visible(False)
    _write_legend(axes, figure)
    # No software name in the file: the bytes are the curves'.
    figure.savefig(file, dpi=DPI, format='png', metadata={'Software': None})


def _write_legend(axes: Axes, figure: Figure) -> None:
    """Say below the curves, where it covers none of them, what each one is."""
    handles, labels = axes.get_legend_handles_labels()
    wrapped = [textwrap.fill(label, _LABEL_WIDTH) for label in labels]
    n_lines = sum(label.count('\n') + 1 for label in wrapped)
    figure.set_figheight(_HEIGHT_IN + _LABEL_HEIGHT_IN * n_lines)
    legend = axes.legend(
        handles,
        wrapped,
        loc='upper left',
        bbox_to_anchor=(0.0, -0.13),
        frameon=False,
        fontsize=8.5,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)


def draw_curve(
    axes: Axes,
    curve: LearningCurve,
    colour: str,
    *,
    label: str,
    linewidth: float,
    marker: str = '',
    markers_at: tuple[float, float] = (0.0, 1.0),
) -> None:
    """Draw the mean as a line, and the deviation over several seeds shaded around it.

    Args:
        markers_at: where on the line the first marker stands, and how far the next ones are from
            each other, as shares of the picture.
    """
    axes.plot(
        curve.over, curve.mean, color=colour, linewidth=linewidth, marker=marker, label=label,
        markersize=4, markevery=markers_at if len(curve.over) > 1 else None,
    )  # fmt: skip
    if len(curve.seeds) > 1:
        low, high = curve.mean - curve.deviation, curve.mean + curve.deviation
        axes.fill_between(curve.over, low, high, color=colour, alpha=0.2, linewidth=0)


def _draw_references(axes: Axes, references: Mapping[str, float]) -> None:
    for index, (name, value) in enumerate(references.items()):
        style = REFERENCE_STYLES[index % len(REFERENCE_STYLES)]
        label = f'{name}: {value:g}'
        axes.axhline(value, color='#555555', linewidth=1.2, linestyle=style, label=label)

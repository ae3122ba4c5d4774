"""Draws the learning curves of trainings: mean and deviation over the seeds of each kind."""

import argparse
import io
import math
from pathlib import Path
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options
from uav_collect.errors import TrainingRunError
from uav_collect.training.run_record import CURVE_AXES, CURVE_MEASURES, CurveAxis, CurveMeasure

if TYPE_CHECKING:  # loaded when drawing, so that --help answers at once
    from uav_collect.training.curves import LearningCurve

_DESCRIPTION = """
Reads the run folders of train or train-fleet and draws what their policies achieved in the
validation missions during training. Runs that differ only in their seed make one curve: the mean,
with the standard deviation shaded around it.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    parser.add_argument(
        'runs',
        nargs='*',
        type=Path,
        metavar='RUN',
        help='run folders of train or train-fleet (default: all of runs/train)',
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('learning_curves.png'),
        metavar='FILE',
        help='picture to draw (default: %(default)s)',
    )
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write the curves as a table')
    parser.add_argument(
        '--over',
        choices=[axis.key for axis in CURVE_AXES],
        default=CURVE_AXES[0].key,
        help='horizontal axis (default: %(default)s)',
    )
    parser.add_argument(
        '--measure',
        choices=[measure.key for measure in CURVE_MEASURES],
        default=CURVE_MEASURES[0].key,
        metavar='NAME',
        help=f'vertical axis: {", ".join(it.key for it in CURVE_MEASURES)} (default: %(default)s)',
    )
    parser.add_argument(
        '--reference',
        action='extend',
        nargs='+',
        default=[],
        type=_reference,
        metavar='NAME=VALUE',
        help='dashed lines, in the unit of the measure, as hert=0.79 sweep=1.19',
    )
    parser.add_argument('--title', default='', metavar='TEXT', help='above the picture')


def run(arguments: argparse.Namespace) -> int:
    """Draw the curves; returns the exit status."""
    from uav_collect.training.curves import learning_curves

    options.check_outputs(arguments.output, arguments.csv)
    measure = next(measure for measure in CURVE_MEASURES if measure.key == arguments.measure)
    axis = next(axis for axis in CURVE_AXES if axis.key == arguments.over)
    curves = learning_curves(arguments.runs or _all_runs(), measure, axis)
    write(
        curves, measure, axis, picture=arguments.output, table=arguments.csv,
        references=dict(arguments.reference), title=arguments.title,
    )  # fmt: skip
    _show(curves, measure)
    for path in filter(None, (arguments.output, arguments.csv)):
        print(path)
    return 0


def _all_runs() -> list[Path]:
    """The folders of runs/train.

    Raises:
        TrainingRunError: there are none.
    """
    from uav_collect.commands.train_fleet import RUNS as FLEET_RUNS
    from uav_collect.commands.training_plan import RUNS

    runs = sorted(it for it in RUNS.glob('*') if it.is_dir())
    if not runs:
        raise TrainingRunError(
            f'{RUNS}: has no runs of train: name run folders, as those in {FLEET_RUNS}'
        )
    return runs


def write(
    curves: 'tuple[LearningCurve, ...]',
    measure: CurveMeasure,
    axis: CurveAxis,
    *,
    picture: Path,
    table: Path | None = None,
    references: dict[str, float] | None = None,
    title: str = '',
) -> None:
    """Write curves as a picture and, if asked, as a table.

    Raises:
        OSError: naming the file.
    """
    from uav_collect.training.curves import draw_curves, to_csv

    drawn = io.BytesIO()
    draw_curves(curves, measure, axis, drawn, references, title)
    files.write_result(picture, drawn.getvalue())
    if table is not None:
        files.write_result(table, to_csv(curves, measure, axis))


def _show(curves: 'tuple[LearningCurve, ...]', measure: CurveMeasure) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text
    from uav_collect.analysis.console import plain_console

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column(Text(f'{measure.title} [{measure.unit}]'), overflow='fold')
    for heading in ('seeds', 'at the end', 'deviation'):
        table.add_column(heading, justify='right', no_wrap=True)
    for curve in curves:
        spread = f'{curve.deviation[-1]:.4f}' if len(curve.seeds) > 1 else '-'
        row = (str(len(curve.seeds)), f'{curve.mean[-1]:.4f}', spread)
        table.add_row(Text(curve.label), *row)
    plain_console().print(table)


def _reference(text: str) -> tuple[str, float]:
    name, _, value = text.partition('=')
    try:
        height = float(value)
    except ValueError:
        height = math.nan
    if not name or not math.isfinite(height):
        raise argparse.ArgumentTypeError(f'{text!r} must be NAME=NUMBER, as sweep=1.19')
    return name, height

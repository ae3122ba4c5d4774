"""Trains one run for each combination of settings, one after another, and says which did best."""

import argparse
from collections.abc import Sequence
import copy
from itertools import product
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options, train
from uav_collect.commands.terminal import say
from uav_collect.commands.training_plan import is_of_training, OWN_OPTIONS, plan_training
from uav_collect.errors import TrainingRunError
from uav_collect.limits import FAILED, is_name, NAME_ALLOWED
from uav_collect.training.folder import BEST_POLICY
from uav_collect.training.run_record import read_run, RUN_FILE

if TYPE_CHECKING:  # loaded when training, so that --help answers at once
    from uav_collect.uav.policy_header import Validation

_DESCRIPTION = """
Trains a policy with each combination of some values of a preset, each seed in a run folder of its
own, named after what was varied, and compares what they achieved in the validation missions.
The same command again continues where it was interrupted.
"""
_MINUTES = 10.0
_MAX_RUNS = 1000
_TABLE, _PICTURE = 'tune.csv', 'tune.png'
_COLUMNS = ('label', 'seed', 'efficiency_kbit_per_j', 'completion_s', 'complete_share')


class Variant(NamedTuple):
    """A combination of settings."""

    label: str
    overrides: tuple[str, ...]  # KEY=VALUE


class Achieved(NamedTuple):
    """What the policy that a run kept achieved in its validation."""

    label: str
    seed: int
    validation: 'Validation'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    options.add_scenarios_options(parser)
    train.add_learning_options(parser)
    options.add_budget_options(parser, _MINUTES, 'how long to train each run')
    train.add_checkpoint_option(parser)
    parser.description = _DESCRIPTION
    parser.add_argument(
        '--vary',
        required=True,
        nargs='+',
        type=varied,
        metavar='KEY=VALUE,VALUE,...',
        help='values of the preset to try, each with each of the others, as'
        ' target.trace=0.5,0.7 optimiser.learning_rate=1e-4,5e-4',
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('runs') / 'tune',
        metavar='FOLDER',
        help=f'a folder for the run folders, {_TABLE} and {_PICTURE} (default: %(default)s)',
    )


def varied(text: str) -> tuple[str, ...]:
    """A type for argparse: the assignments KEY=VALUE of KEY=VALUE,VALUE,..."""
    key, _, values = text.partition('=')
    tried = tuple(f'{key}={value}' for value in values.split(','))
    if not key or not all(values.split(',')) or len(set(tried)) < len(tried):
        raise argparse.ArgumentTypeError(
            f'{text!r} must be KEY=VALUE,VALUE,..., each value once, as target.trace=0.5,0.7'
        )
    return tried


def variants(tried: Sequence[Sequence[str]]) -> list[Variant]:
    """All combinations, labelled by the last words of the keys and the values.

    Args:
        tried: by key, its assignments KEY=VALUE.

    Raises:
        TrainingRunError: a key is varied twice, a label cannot name a folder, two are the same, or
            there are too many.
    """
    keys = [assignments[0].partition('=')[0] for assignments in tried]
    for number, key in enumerate(keys):
        if key in keys[:number]:
            raise TrainingRunError(f'--vary {key}: is given twice')
    found = [Variant('-'.join(map(_word, each)), each) for each in product(*tried)]
    if len(found) > _MAX_RUNS:
        raise TrainingRunError(f'--vary: makes {len(found)} combinations: at most {_MAX_RUNS}')
    labels = [variant.label for variant in found]
    for label in labels:
        if not is_name(label):
            raise TrainingRunError(f'--vary: {label!r} names a folder: must be {NAME_ALLOWED}')
        if labels.count(label) > 1:
            raise TrainingRunError(f'--vary: two combinations would both be called {label}')
    return found


def run(arguments: argparse.Namespace) -> int:
    """Train all runs that are not done yet; returns the exit status."""
    options.check_torch('tune')
    arguments.resume = arguments.courses = None
    if arguments.minutes is None and arguments.decisions is None:
        arguments.minutes = _MINUTES
    train.fill_in(arguments)
    folder: Path = arguments.output
    tried = variants(arguments.vary)
    folders = {
        (variant.label, seed): folder / f'{variant.label}_s{seed}'
        for variant, seed in product(tried, arguments.seed)
    }
    pending = [_one(arguments, it, seed, folders) for it, seed in product(tried, arguments.seed)]
    status = 0
    for one in filter(None, pending):
        status = max(status, train.run(one))
        if status > FAILED:  # it was interrupted; what failed is no reason not to try others
            return status
    _compare(folder, folders)
    return status


def _one(
    arguments: argparse.Namespace,
    variant: Variant,
    seed: int,
    folders: dict[tuple[str, int], Path],
) -> argparse.Namespace | None:
    """What `train` is asked for a run; None if it is done."""
    one, folder = copy.copy(arguments), folders[variant.label, seed]
    one.override = [*arguments.override, *variant.overrides]
    one.seed, one.output = [seed], folder
    if not (folder / RUN_FILE).is_file():
        plan_training(one)  # raises before anything is trained
        return one
    record = read_run(folder)
    if not is_of_training(record, one):
        raise TrainingRunError(
            f'{folder}: holds a run with other settings: choose another --output'
        )
    return None if record.is_done else _resumed(one, folder)


def _resumed(one: argparse.Namespace, folder: Path) -> argparse.Namespace:
    """What `train` is asked to go on with a run."""
    for name in OWN_OPTIONS:
        setattr(one, name, None)
    one.resume, one.minutes, one.decisions = folder, None, None
    one.set, one.override = [], []
    return one


def _compare(folder: Path, folders: dict[tuple[str, int], Path]) -> None:
    """Say what each variant achieved, best first, and keep it as a table and as curves."""
    from uav_collect.commands.training_session import draw_curve

    # One that diverged before its first validation has kept none.
    there = {it: path for it, path in folders.items() if (path / BEST_POLICY).is_file()}
    if not there:
        say('no run has kept a policy: there is nothing to compare')
        return
    achieved = [_achieved(*it, path) for it, path in there.items()]
    achieved.sort(key=lambda it: it.validation.rank, reverse=True)
    rows = [
        (each.label, each.seed, *(getattr(each.validation, name) for name in _COLUMNS[2:]))
        for each in achieved
    ]
    files.write_result(folder / _TABLE, files.csv_of([_COLUMNS, *rows]))
    _show(achieved)
    draw_curve([*there.values()], folder / _PICTURE, title='settings tried')
    print(f'{folder / _TABLE}\n{folder / _PICTURE}')


def _achieved(label: str, seed: int, folder: Path) -> Achieved:
    from uav_collect.uav.policy_file import load_policy

    return Achieved(label, seed, load_policy(folder / BEST_POLICY).header.validation)


def _show(achieved: Sequence[Achieved]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text
    from uav_collect.analysis.console import plain_console
    from uav_collect.analysis.metrics import percent

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column('best validation of', overflow='fold')
    for heading in ('seed', 'kbit/J', 'time [s]', 'complete'):
        table.add_column(heading, justify='right', no_wrap=True)
    for each in achieved:
        found = each.validation
        numbers = f'{found.efficiency_kbit_per_j:.3f}', f'{found.completion_s:.1f}'
        table.add_row(Text(each.label), str(each.seed), *numbers, percent(found.complete_share))
    plain_console().print(table)


def _word(assignment: str) -> str:
    """trace0.5 of target.trace=0.5."""
    key, _, value = assignment.partition('=')
    return f'{key.rpartition(".")[2]}{value}'

"""Measures how long learning takes from nothing until it flies as well as what needs no learning.

python bench/time_to_learn.py [--minutes M] [--seeds SEED ...] [--learners NAME ...]

Each learner in turn on paper_10x10, in one process on one thread: AQMIX by the preset strong, and
branches by field_anywhere. The heuristics fly the same validation missions, so that what is
learned is measured against them; what validation takes is not counted, as in `train`. Other
missions, which nothing was chosen by, tell how good the best policy is in the end. Ctrl-C ends a
learner with what was passed until then.
"""

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterator
from contextlib import suppress
import sys
import time
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
import torch
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.statistics import mission_seeds
from uav_collect.learning.learner import keep_freed_memory
from uav_collect.learning.trainer import Trainer
from uav_collect.missions.rollout import fly, fly_for_metrics
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import load_preset
from uav_collect.training.progress import Budget, ValidationResult
from uav_collect.training.seeds import VALIDATION_SEED
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy

MINUTES = 10.0
LEARNERS = {'aqmix': 'strong', 'branches': 'field_anywhere'}  # algorithm: preset
HEURISTICS = ('hert', 'sweep')
ROUND_MARKS_KBIT_PER_J = (1.0, 1.19)
VALIDATION = {'validation.missions': 100, 'validation.every_updates': 250}  # alike for all
N_HELD_OUT = 300


class Passed(NamedTuple):
    """A validation and what had been spent until then."""

    validation: ValidationResult
    n_missions: int
    cpu_s: float  # validations included


def marks_kbit_per_j(scenario: Scenario, n_missions: int) -> dict[str, float]:
    """What is to be passed, by name, the lowest first."""
    site, seeds = build_site(scenario), mission_seeds(VALIDATION_SEED, n_missions)
    marks = {f'{mark:.1f}': mark for mark in ROUND_MARKS_KBIT_PER_J}
    for name in HEURISTICS:
        flown = [mission_metrics(log) for log in fly(site, seeds, name, 'equal')]
        marks[name] = float(np.mean([mission.efficiency_kbit_per_j for mission in flown]))
    return dict(sorted(marks.items(), key=lambda mark: mark[1]))


def learn(trainer: Trainer, minutes: float, bar: Progress) -> Iterator[Passed]:
    """Train; every validation as it comes."""
    task = bar.add_task('learning', total=1.0, kbit_per_j=0.0)
    start_s = time.process_time()
    for progress in trainer.run(Budget(minutes=minutes)):
        bar.update(task, completed=progress.share_done)
        if progress.validation is not None:
            bar.update(task, kbit_per_j=progress.validation.efficiency_kbit_per_j)
            cpu_s = time.process_time() - start_s
            yield Passed(progress.validation, progress.n_missions, cpu_s)


def held_out_kbit_per_j(scenario: Scenario, policy: FrozenPolicy | None) -> str:
    """The mean efficiency in missions that no training saw, with its interval; equal bandwidth."""
    if policy is None:
        return 'no policy'
    flown = fly_for_metrics(
        build_site(scenario), range(N_HELD_OUT), lambda: LearnedPolicy('learned', policy), 'equal'
    )
    each = flown.efficiency_kbit_per_j
    return f'{each.mean():.3f} +- {1.96 * each.std() / len(each) ** 0.5:.3f}'


def row(name: str, mark: float, passed: Passed | None) -> tuple[str, ...]:
    """One mark of the table."""
    if passed is None:
        return name, f'{mark:.3f}', *('not passed', '', '', '', '')
    validation = passed.validation
    return (
        name,
        f'{mark:.3f}',
        f'{validation.wall_s:.0f}',
        f'{passed.cpu_s:.0f}',
        f'{validation.n_decisions:,}',
        f'{passed.n_missions:,}',
        f'{validation.n_updates:,}',
    )


def measured(arguments: Namespace, algorithm: str, seed: int) -> Table:
    """Train once; what was passed when."""
    scenario = load('paper_10x10')
    config = load_preset(LEARNERS[algorithm], VALIDATION)
    marks = marks_kbit_per_j(scenario, config.validation.missions)
    trainer = Trainer([scenario], config, algorithm, seed)
    trainer.warm_up()
    columns = TextColumn('{task.fields[kbit_per_j]:.3f} kbit/J'), BarColumn(), TimeElapsedColumn()
    passed: dict[str, Passed] = {}
    last: Passed | None = None
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    with bar, suppress(KeyboardInterrupt):
        for last in learn(trainer, arguments.minutes, bar):
            for name, mark in marks.items():
                if last.validation.efficiency_kbit_per_j >= mark:
                    passed.setdefault(name, last)
    table = Table(
        title=f'{algorithm} from nothing, {config.name}, paper_10x10, seed {seed}: '
        'until a validation passes',
        caption=f'{arguments.minutes:g} minutes, on one thread; '
        f'{config.validation.missions} validation missions, equal bandwidth, every '
        f'{config.validation.every_updates} updates; the best policy in {N_HELD_OUT} others: '
        f'{held_out_kbit_per_j(scenario, trainer.best_policy())} kbit/J',
    )
    table.add_column('mark')
    for heading in ('kbit/J', 'training s', 'CPU s', 'decisions', 'missions', 'updates'):
        table.add_column(heading, justify='right')
    for name, mark in marks.items():
        table.add_row(*row(name, mark, passed.get(name)))
    if last is not None:
        table.add_row(*row('the end', last.validation.efficiency_kbit_per_j, last))
    return table


def parse_arguments() -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--minutes', type=_minutes, default=MINUTES, help='each (%(default)s)')
    parser.add_argument('--seeds', type=int, nargs='+', default=[0], help='(0)')
    parser.add_argument(
        '--learners', choices=LEARNERS, nargs='+', default=[*LEARNERS], help='(all, in turn)'
    )
    return parser.parse_args()


def _minutes(text: str) -> float:
    with suppress(ValueError):
        if 0.0 < float(text) < float('inf'):
            return float(text)
    raise ArgumentTypeError(f'{text!r}: must be a number of minutes above 0')


def main() -> None:
    """Measure and print."""
    arguments = parse_arguments()
    torch.set_num_threads(1)
    keep_freed_memory()
    console = Console(width=None if sys.stdout.isatty() else 132)
    for seed in arguments.seeds:
        for algorithm in arguments.learners:
            console.print(measured(arguments, algorithm, seed))


if __name__ == '__main__':
    main()

"""Measures how long AQMIX learns from nothing until it flies as well as what needs no learning.

python bench/time_to_learn.py [MINUTES] [SEED]

With the preset strong on paper_10x10, in one process on one thread, ten minutes by default. The
heuristics fly the same validation missions, so that what is learned is measured against them; what
validation takes is not counted, as in `train`. Ctrl-C ends it with what was passed until then.
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
from uav_collect.missions.rollout import fly
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import load_preset
from uav_collect.training.progress import Budget, ValidationResult
from uav_collect.training.seeds import VALIDATION_SEED

MINUTES, SEED = 10.0, 0
HEURISTICS = ('hert', 'sweep')
ROUND_MARKS_KBIT_PER_J = (1.0, 1.2)


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


def parse_arguments() -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('minutes', type=_minutes, nargs='?', default=MINUTES, help='(%(default)s)')
    parser.add_argument('seed', type=int, nargs='?', default=SEED, help='(%(default)s)')
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
    scenario, config = load('paper_10x10'), load_preset('strong')
    marks = marks_kbit_per_j(scenario, config.validation.missions)
    trainer = Trainer([scenario], config, 'aqmix', arguments.seed)
    trainer.warm_up()
    columns = TextColumn('{task.fields[kbit_per_j]:.3f} kbit/J'), BarColumn(), TimeElapsedColumn()
    passed: dict[str, Passed] = {}
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    with bar, suppress(KeyboardInterrupt):
        for look in learn(trainer, arguments.minutes, bar):
            for name, mark in marks.items():
                if look.validation.efficiency_kbit_per_j >= mark:
                    passed.setdefault(name, look)
            if len(passed) == len(marks):
                break
    table = Table(
        title=f'AQMIX from nothing, strong, paper_10x10, seed {arguments.seed}: '
        'until a validation passes',
        caption=f'{arguments.minutes:g} minutes at most, on one thread; '
        f'{config.validation.missions} validation missions, equal bandwidth, every '
        f'{config.validation.every_updates} updates',
    )
    table.add_column('mark')
    for heading in ('kbit/J', 'training s', 'CPU s', 'decisions', 'missions', 'updates'):
        table.add_column(heading, justify='right')
    for name, mark in marks.items():
        table.add_row(*row(name, mark, passed.get(name)))
    Console(width=None if sys.stdout.isatty() else 132).print(table)


if __name__ == '__main__':
    main()

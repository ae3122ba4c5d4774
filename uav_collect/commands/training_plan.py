"""What a train command will do: the runs, one for each seed, their folders and settings."""

import argparse
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
import os
from pathlib import Path
import shlex
import sys
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options
from uav_collect.commands.terminal import say
from uav_collect.errors import TrainingRunError
from uav_collect.training.folder import is_free
from uav_collect.training.planned_run import new_record, PlannedRun, stored_run
from uav_collect.training.plug_ins import short_name
from uav_collect.training.run_record import read_run, RUN_FILE, RunRecord

if TYPE_CHECKING:  # loaded when training, so that --help answers at once
    from uav_collect.scenario.model import Scenario
    from uav_collect.training.config import TrainingConfig
    from uav_collect.training.courses import Courses
    from uav_collect.uav.policy_network import FrozenPolicy

RUNS = Path('runs') / 'train'
OWN_OPTIONS = (
    'scenario', 'set', 'uavs', 'courses', 'algorithm', 'preset', 'override', 'start_from', 'seed',
    'device', 'output',
)  # fmt: skip
_SHARED = (
    'seed', 'training', 'algorithm', 'scenario_fingerprint', 'training_fingerprint', 'initial',
    'seeds', 'courses',
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TrainingPlan:
    """The runs of a training that are still to be done, and all folders it has in the end."""

    runs: tuple[PlannedRun, ...]
    folders: tuple[Path, ...]


def plan_training(arguments: argparse.Namespace) -> TrainingPlan:
    """The training that the arguments describe, new or to be resumed.

    Raises:
        TrainingRunError: a folder is there already, or there is nothing to resume.
        ConfigError: scenario or preset are not valid.
    """
    return _new_training(arguments) if arguments.resume is None else _resumed_training(arguments)


def is_of_training(record: RunRecord, arguments: argparse.Namespace) -> bool:
    """Whether a run is what the arguments describe for its one seed, budget and all.

    Raises:
        TrainingRunError: scenarios are given with courses.
        ConfigError: scenario or preset are not valid.
    """
    wanted = _first_run(arguments).record
    names = *_SHARED, 'minutes', 'decisions'
    return all(getattr(record, name) == getattr(wanted, name) for name in names)


def _new_training(arguments: argparse.Namespace) -> TrainingPlan:
    first = _first_run(arguments)
    seeds = first.record.seeds
    is_alone = len(seeds) == 1 and arguments.output is not None
    runs = []
    for seed in seeds:
        own = _folder_of(first.record, arguments.output, seed)
        folder = arguments.output if is_alone else own
        _check_new(folder)
        runs.append(replace(first, folder=folder, record=replace(first.record, seed=seed)))
    return TrainingPlan(runs=tuple(runs), folders=tuple(run.folder for run in runs))


def _first_run(arguments: argparse.Namespace) -> PlannedRun:
    """The run of the first seed that the arguments describe, in the folder of that seed."""
    from uav_collect.training.config import load_preset
    from uav_collect.uav.policy import frozen_policy, outdated

    courses = _courses_of(arguments)
    scenarios = options.scenarios_of(arguments) if courses is None else ()
    config = load_preset(arguments.preset, options.overrides_of(arguments.override))
    initial = None if arguments.start_from is None else frozen_policy(arguments.start_from)
    if initial is not None and (line := outdated(arguments.start_from, initial)) is not None:
        say(line)
    record = _record(arguments, scenarios, config, initial, courses)
    return PlannedRun(
        folder=_folder_of(record, arguments.output, record.seed), record=record,
        scenarios=scenarios, config=config, initial=initial, courses=courses,
    )  # fmt: skip


def _courses_of(arguments: argparse.Namespace) -> 'Courses | None':
    """What courses are drawn from; None where scenarios are learned in.

    Raises:
        ConfigError: it is not there or not valid.
        TrainingRunError: scenarios are given besides.
    """
    from uav_collect.training.courses import load_courses

    if arguments.courses is None:
        return None
    for name in ('scenario', 'set', 'uavs'):
        if getattr(arguments, name) not in (None, []):
            raise TrainingRunError(f'--{name} cannot be given with --courses: they are drawn')
    return load_courses(arguments.courses)


def _folder_of(record: RunRecord, output: Path | None, seed: int) -> Path:
    parent = RUNS if output is None else output.parent
    return parent / f'{record.training}_s{seed}'


def _check_new(folder: Path) -> None:
    with suppress(FileNotFoundError):  # below a file, say, none can be made
        files.check_there(folder)
    if (folder / RUN_FILE).is_file():
        raise TrainingRunError(
            f'{folder}: holds a run: go on with it by --resume {folder},'
            ' or choose another --output'
        )
    if not is_free(folder):
        raise TrainingRunError(f'{folder}: is there already: choose another --output')


def _record(
    arguments: argparse.Namespace,
    scenarios: 'Sequence[Scenario]',
    config: 'TrainingConfig',
    initial: 'FrozenPolicy | None',
    courses: 'Courses | None',
) -> RunRecord:
    """The record of the first run, as the arguments describe it."""
    algorithm = short_name(arguments.algorithm)
    if courses is None:
        n_uavs = [scenario.n_uavs for scenario in scenarios]
        names = [*dict.fromkeys(scenario.name for scenario in scenarios)]
        default_name = _default_name(names, n_uavs, algorithm, config.name)
    else:
        default_name = f'{courses.distribution.name}_{algorithm}_{config.name}'
    return new_record(
        scenarios,
        config,
        initial,
        courses,
        training=default_name if arguments.output is None else arguments.output.name,
        algorithm=arguments.algorithm,
        overrides=tuple(arguments.override),
        seed=arguments.seed[0],
        minutes=arguments.minutes,
        decisions=arguments.decisions,
        device=arguments.device,
        seeds=tuple(arguments.seed),
    )


def _default_name(names: Sequence[str], n_uavs: Sequence[int], algorithm: str, preset: str) -> str:
    """paper_10x10_n2_aqmix_strong, or paper_8x8+2_n1-6_aqmix_strong for three scenarios."""
    field = names[0] if len(names) == 1 else f'{names[0]}+{len(names) - 1}'
    least, most = min(n_uavs), max(n_uavs)
    fleet = f'{least}-{most}' if least < most else f'{most}'
    return f'{field}_n{fleet}_{algorithm}_{preset}'


def _resumed_training(arguments: argparse.Namespace) -> TrainingPlan:
    """The named run, then the other runs of its training that are not done."""
    given = [name for name in OWN_OPTIONS if getattr(arguments, name) not in (None, [])]
    if given:
        option = f'--{given[0].replace("_", "-")}'
        what = f'{option} cannot be given with --resume: the run goes on as it was begun'
        raise TrainingRunError(what)
    folder: Path = arguments.resume
    record = _with_budget(read_run(folder), arguments)
    folders = _seed_folders(folder, record)
    runs = [stored_run(folder, record)]
    for seed, other in zip(record.seeds, folders, strict=False):
        if os.path.realpath(other) == os.path.realpath(folder):
            continue
        planned = replace(record, seed=seed, is_done=False)
        if (other / RUN_FILE).exists():
            found = _with_budget(read_run(other), arguments)
            _check_sibling(other, found, planned)
            runs.append(stored_run(other, found))
        else:
            _check_new(other)
            runs.append(replace(runs[0], folder=other, record=planned, is_begun=False))
    pending = [run for run in runs if not run.record.is_done]
    if not pending:
        raise TrainingRunError(
            f'{folder}: has had its {record.budget_text}: give it more by --minutes or --decisions'
        )
    return TrainingPlan(runs=tuple(pending), folders=folders)


def _check_sibling(folder: Path, found: RunRecord, planned: RunRecord) -> None:
    """Refuse a run that is not of the same training, by another seed of it."""
    for name in _SHARED:
        value, wanted = getattr(found, name), getattr(planned, name)
        if value != wanted:
            raise TrainingRunError(
                f'{folder / RUN_FILE}: {name} is {value!r}: must be {wanted!r}: it is no run of'
                f' {planned.training}'
            )


def _seed_folders(folder: Path, record: RunRecord) -> tuple[Path, ...]:
    """The folders of all runs of a training, found beside one of them."""
    here = folder if folder.name not in ('', '..') else folder.resolve()
    names = [f'{record.training}_s{seed}' for seed in record.seeds]
    if here.name not in names:  # it stands alone, or was renamed
        return (folder,)
    return tuple(here.parent / name for name in names)


def _with_budget(record: RunRecord, arguments: argparse.Namespace) -> RunRecord:
    """The record with the time that the arguments give it, if they give any."""
    if arguments.minutes is None and arguments.decisions is None:
        return record
    return replace(record, minutes=arguments.minutes, decisions=arguments.decisions, is_done=False)


def resume_command(folder: Path) -> str:
    """The command line that goes on with a run."""
    python, here = Path(sys.executable), Path.cwd()
    shown = python.relative_to(here) if python.is_relative_to(here) else python
    return shlex.join((str(shown), '-m', 'uav_collect', 'train', '--resume', str(folder)))

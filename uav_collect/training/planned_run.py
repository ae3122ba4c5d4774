"""A training run, new or read back from its folder: what is trained, and where it is kept."""

from collections.abc import Sequence
from dataclasses import dataclass
import datetime
from pathlib import Path
import shlex
import sys
from typing import Any, TYPE_CHECKING

from uav_collect.errors import TrainingRunError
from uav_collect.revision import git_revision, package_versions
from uav_collect.training.run_record import algorithm_text, RUN_FILE, RunRecord

if TYPE_CHECKING:  # loaded when training, so that --help answers at once
    from uav_collect.scenario.model import Scenario
    from uav_collect.training.config import TrainingConfig
    from uav_collect.training.courses import Courses
    from uav_collect.uav.policy_network import FrozenPolicy

CONFIG_FILE = 'training.yaml'  # of a run folder: the preset, resolved
COURSES_FILE = 'courses.yaml'  # of a run on courses: what they are drawn from
CONDITIONS_FILE = 'panel.yaml'  # and the conditions that validate
INITIAL_POLICY = 'initial.safetensors'


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """One run: what is trained, and where it is kept."""

    folder: Path
    record: RunRecord
    scenarios: 'tuple[Scenario, ...]'  # none where there are courses
    config: 'TrainingConfig'
    initial: 'FrozenPolicy | None'  # whose weights it starts from
    courses: 'Courses | None' = None  # what it learns on in place of scenarios
    is_begun: bool = False  # its folder holds it already: it goes on from its checkpoint

    @property
    def title(self) -> str:
        """What is trained, for people; all seeds have the same."""
        record = self.record
        settings = ' '.join((record.preset, *record.overrides))
        return f'{algorithm_text(record.algorithm)}, {record.scenario_text}, {settings}'

    @property
    def scenario_files(self) -> tuple[Path, ...]:
        """The files of its scenarios, in the folder."""
        return _scenario_files(self.folder, len(self.scenarios))


def new_record(
    scenarios: 'Sequence[Scenario]',
    config: 'TrainingConfig',
    initial: 'FrozenPolicy | None',
    courses: 'Courses | None' = None,
    **others: Any,  # noqa: ANN401 - the other fields of a RunRecord
) -> RunRecord:
    """The record of a run that starts now.

    Args:
        courses: in place of scenarios.
        others: the fields of a `RunRecord` that do not follow from these.
    """
    from uav_collect.scenario.load import fingerprint
    from uav_collect.training.config import code_of_training
    from uav_collect.training.teachers import teacher_labels

    names = ' '.join(dict.fromkeys(scenario.name for scenario in scenarios))
    return RunRecord(
        scenario=names if courses is None else courses.distribution.name,
        courses='' if courses is None else courses.fingerprints,
        n_uavs=tuple(scenario.n_uavs for scenario in scenarios),
        scenario_fingerprint=' '.join(map(fingerprint, scenarios)),
        preset=config.name,
        training_fingerprint=config.fingerprint,
        initial='' if initial is None else initial.header.version,
        code=code_of_training(config, others['algorithm']),
        teachers=teacher_labels(config, others['algorithm']),
        started=datetime.datetime.now().astimezone().isoformat(timespec='seconds'),
        git_revision=git_revision(),
        versions=package_versions(),
        command=shlex.join(sys.orig_argv),
        is_done=False,
        **others,
    )


def stored_run(folder: Path, record: RunRecord) -> PlannedRun:
    """Read a run back from its folder.

    Raises:
        TrainingRunError: a file of it is not the one that the record was written with.
        ConfigError: a file of it cannot be read.
        PolicyMismatchError: the policy that it started from cannot be read.
    """
    from uav_collect.scenario.load import fingerprint, from_file
    from uav_collect.training.config import code_of_training, load_preset
    from uav_collect.training.teachers import teacher_labels
    from uav_collect.uav.policy_file import load_policy

    run_file = folder / RUN_FILE
    scenarios = []
    for path, wanted in zip(
        _scenario_files(folder, len(record.n_uavs)), record.scenario_fingerprint.split(),
        strict=True,
    ):  # fmt: skip
        scenarios.append(from_file(path))
        _check_same(path, 'fingerprint', fingerprint(scenarios[-1]), wanted, run_file)
    courses = _stored_courses(folder, record, run_file)
    if courses is None:
        first = _scenario_files(folder, 1)[0]
        names = ' '.join(dict.fromkeys(scenario.name for scenario in scenarios))
        _check_same(first, 'name', names, record.scenario, run_file)
    config = load_preset(folder / CONFIG_FILE)
    code = code_of_training(config, record.algorithm)
    _check_same(folder / CONFIG_FILE, 'code', ' '.join(code), ' '.join(record.code), run_file)
    _check_same(
        folder / CONFIG_FILE, 'fingerprint', config.fingerprint, record.training_fingerprint,
        run_file,
    )  # fmt: skip
    if record.teachers:  # records of before do not tell
        teachers = teacher_labels(config, record.algorithm)
        _check_same(
            folder / CONFIG_FILE, 'teachers', ' '.join(teachers), ' '.join(record.teachers),
            run_file,
        )  # fmt: skip
    initial = load_policy(folder / INITIAL_POLICY) if record.initial else None
    if initial is not None:
        path = folder / INITIAL_POLICY
        _check_same(path, 'version', initial.header.version, record.initial, run_file)
    return PlannedRun(
        folder=folder,
        record=record,
        scenarios=tuple(scenarios),
        config=config,
        initial=initial,
        courses=courses,
        is_begun=True,
    )


def _stored_courses(folder: Path, record: RunRecord, run_file: Path) -> 'Courses | None':
    """What the courses of a run are drawn from, and its panel; None where it has none."""
    if not record.courses:
        return None
    from uav_collect.training.courses import Courses, load_distribution
    from uav_collect.training.panel import load_panel

    path = folder / COURSES_FILE
    courses = Courses(
        distribution=load_distribution(path), panel=load_panel(folder / CONDITIONS_FILE)
    )
    what = f'fingerprint, with that of {CONDITIONS_FILE},'
    _check_same(path, what, courses.fingerprints, record.courses, run_file)
    _check_same(path, 'name', courses.distribution.name, record.scenario, run_file)
    return courses


def _check_same(path: Path, name: str, value: str, wanted: str, run_file: Path) -> None:
    if value != wanted:
        raise TrainingRunError(
            f'{path}: its {name} is {value}: must be {wanted}, as {run_file} has it'
        )


def _scenario_files(folder: Path, n_scenarios: int) -> tuple[Path, ...]:
    """scenario.yaml, scenario_2.yaml, ..."""
    numbers = ['' if number == 1 else f'_{number}' for number in range(1, n_scenarios + 1)]
    return tuple(folder / f'scenario{number}.yaml' for number in numbers)

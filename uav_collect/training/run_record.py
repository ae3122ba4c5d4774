"""The record of a training run: what was trained, and the tables of how it went.

`run.json` says what was trained; `validation.csv` has a row for each validation, `progress.csv`
one for about each second. The last word of a column's name is its unit; what has none is a count,
a share or a pure number.
"""

from collections.abc import Mapping
import csv
from dataclasses import asdict, dataclass, fields
import json
from pathlib import Path
from typing import Any

import numpy as np
from uav_collect.errors import TrainingRunError
from uav_collect.kernels.arrays import Floats

RUN_FILE = 'run.json'
VALIDATION_FILE = 'validation.csv'
PROGRESS_FILE = 'progress.csv'
FORMAT = 'uav_collect.training/1'

# A row for each validation of the policy as it was then.
VALIDATION_COLUMNS = (
    'n_decisions', 'n_updates', 'wall_s', 'efficiency_kbit_per_j', 'completion_s', 'energy_kj',
    'collected_share', 'complete_share', 'safe_share', 'team_reward',
)  # fmt: skip
# A row about each second; efficiency and reward are those of the last missions, which explored.
PROGRESS_COLUMNS = (
    'n_decisions', 'n_updates', 'wall_s', 'n_missions', 'decisions_per_s', 'updates_per_s', 'loss',
    'epsilon', 'learning_rate', 'training_efficiency_kbit_per_j', 'training_reward',
    'replay_transitions', 'replay_bytes',
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CurveMeasure:
    """What the vertical axis of learning curves can show."""

    key: str  # the column; its unit is the last word
    file: str
    title: str
    unit: str


@dataclass(frozen=True, kw_only=True)
class CurveAxis:
    """What the horizontal axis of learning curves can show."""

    key: str  # in the CSV
    title: str
    column: str
    scale: float  # from the column to what is shown


CURVE_MEASURES = tuple(
    CurveMeasure(key=key, file=file, title=title, unit=unit)
    for file, key, title, unit in (
        (VALIDATION_FILE, 'efficiency_kbit_per_j', 'energy efficiency', 'kbit/J'),
        (VALIDATION_FILE, 'team_reward', 'reward of a mission', '1'),
        (VALIDATION_FILE, 'completion_s', 'completion time', 's'),
        (VALIDATION_FILE, 'energy_kj', 'energy', 'kJ'),
        (VALIDATION_FILE, 'collected_share', 'data collected', 'share'),
        (VALIDATION_FILE, 'complete_share', 'complete missions', 'share'),
        (VALIDATION_FILE, 'safe_share', 'safe returns', 'share'),
        (
            PROGRESS_FILE, 'training_efficiency_kbit_per_j', 'energy efficiency while exploring',
            'kbit/J',
        ),
        (PROGRESS_FILE, 'training_reward', 'reward of a mission while exploring', '1'),
    )
)  # fmt: skip
CURVE_AXES = (
    CurveAxis(key='decisions', title='decisions', column='n_decisions', scale=1.0),
    CurveAxis(key='minutes', title='time of training [min]', column='wall_s', scale=1.0 / 60.0),
    CurveAxis(key='updates', title='updates', column='n_updates', scale=1.0),
)


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """What was trained: everything in which one run differs from another."""

    training: str  # for people, and how the folders of its seeds begin
    algorithm: str  # aqmix, qmix or aiql
    scenario: str  # names of the scenarios, each once
    n_uavs: tuple[int, ...]  # of each scenario
    scenario_fingerprint: str  # of each scenario
    preset: str
    overrides: tuple[str, ...]  # of the preset, KEY=VALUE
    training_fingerprint: str  # of all settings of the training
    initial: str  # version of the policy whose weights it starts from; '' for drawn ones
    seed: int
    minutes: float | None  # how long to train; None where decisions are counted
    decisions: int | None
    device: str
    seeds: tuple[int, ...]  # of all runs of the training, this one among them
    started: str  # ISO 8601, local time
    git_revision: str
    versions: Mapping[str, str]  # of Python and packages
    command: str  # that began it
    is_done: bool  # it has had its time

    @property
    def scenario_text(self) -> str:
        """The scenarios and the sizes of their fleets, for people."""
        least, most = min(self.n_uavs), max(self.n_uavs)
        fleet = f'{least} to {most} UAVs' if least < most else f'{most} UAVs'
        return f'{self.scenario}, {fleet}'

    @property
    def budget_text(self) -> str:
        """How long it was to train, for people."""
        if self.decisions is not None:
            return f'{self.decisions:,} decisions'
        return f'{self.minutes:g} min'

    def to_json(self) -> bytes:
        """The record as the text of a run.json."""
        return (json.dumps({'format': FORMAT, **asdict(self)}, indent=2) + '\n').encode()


def read_run(folder: Path) -> RunRecord:
    """Read what was trained in a run folder.

    Raises:
        TrainingRunError: the folder holds no run, or one of another format.
    """
    path = folder / RUN_FILE
    if not path.is_file():
        what = f'holds no {RUN_FILE}' if folder.is_dir() else 'is no folder'
        raise TrainingRunError(f'{folder}: {what}: must be a run folder of the command train')
    try:
        return _record(json.loads(path.read_text(encoding='utf-8')))
    except (KeyError, TypeError, ValueError) as error:
        raise TrainingRunError(f'{path}: cannot be read: {error}') from error


def _record(values: Mapping[str, Any]) -> RunRecord:
    if values['format'] != FORMAT:
        raise ValueError(f'format is {values["format"]!r}: must be {FORMAT!r}')
    known = {field.name: values[field.name] for field in fields(RunRecord)}
    for name in ('n_uavs', 'overrides', 'seeds'):
        known[name] = tuple(known[name])
    return RunRecord(**known)


def read_columns(path: Path, columns: tuple[str, ...]) -> dict[str, Floats]:
    """Read some columns of a validation.csv or progress.csv, each (K,).

    A last line without its end, which a run that was killed may leave, does not count.

    Raises:
        TrainingRunError: there is no such file, a column is missing, or a cell is no number.
    """
    try:
        lines = path.read_text(encoding='utf-8').splitlines(keepends=True)
    except OSError as error:
        raise TrainingRunError(f'{path}: cannot be read: {error.strerror}') from error
    rows = list(csv.DictReader(line for line in lines if line.endswith('\n')))
    try:
        return {
            column: np.array([float(row[column]) for row in rows], dtype=np.float64)
            for column in columns
        }
    except (KeyError, TypeError, ValueError) as error:
        raise TrainingRunError(f'{path}: is no table with {", ".join(columns)}') from error

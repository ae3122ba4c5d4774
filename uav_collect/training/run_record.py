"""The record of a training run: what was trained, and the tables of how it went.

`run.json` says what was trained; `validation.csv` has a row for each validation, `panel.csv` of a
run on courses one for each of its conditions, `progress.csv` one for about each second. The last
word of a column's name is its unit; what has none is a count, a share or a pure number.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
import json
import math
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from uav_collect import files
from uav_collect.errors import TrainingRunError
from uav_collect.kernels.arrays import Floats
from uav_collect.limits import DEVICES, is_algorithm, is_code_name, MAX_SEED

RUN_FILE = 'run.json'
VALIDATION_FILE = 'validation.csv'
PROGRESS_FILE = 'progress.csv'
FORMAT = 'uav_collect.training/1'
PANEL_FILE = 'panel.csv'
_LATER = ('courses', 'code', 'teachers')  # fields that records of before do not have
_MAX_BYTES = 2**20  # of a record
_MAX_TABLE_BYTES = 2**30
_MAX_SHOWN = 60  # characters of a wrong value
_MAX_DIGITS = 19  # of a count

# A row for each validation of the policy as it was then.
VALIDATION_COLUMNS = (
    'n_decisions', 'n_updates', 'wall_s', 'efficiency_kbit_per_j', 'completion_s', 'energy_kj',
    'collected_share', 'complete_share', 'safe_share', 'team_reward',
)  # fmt: skip
# A row about each second; efficiency and reward are those of the last missions, which explored.
PROGRESS_COLUMNS = (
    'n_decisions', 'n_updates', 'wall_s', 'n_missions', 'decisions_per_s', 'updates_per_s', 'loss',
    'epsilon', 'learning_rate', 'training_efficiency_kbit_per_j', 'training_reward',
    'replay_transitions', 'replay_bytes', 'mean_value', 'gradient_norm',
)  # fmt: skip

# Of a run on courses, a row for each condition of the panel at each validation; conditions count
# from 1, in the order of panel.yaml.
PANEL_COLUMNS = (
    'n_decisions', 'n_updates', 'wall_s', 'condition', 'sweep_ratio', 'efficiency_kbit_per_j',
    'complete_share', 'safe_share', 'sweep_complete_share', 'sweep_safe_share',
)  # fmt: skip

TABLES = {
    VALIDATION_FILE: VALIDATION_COLUMNS,
    PROGRESS_FILE: PROGRESS_COLUMNS,
    PANEL_FILE: PANEL_COLUMNS,
}

_NEW_COLUMNS = ('mean_value', 'gradient_norm')  # at the end; tables of before lack them

# Columns that are nan before the first mission or update, or where a UAV has not landed.
_MAY_BE_UNKNOWN = (
    'completion_s', 'loss', 'training_efficiency_kbit_per_j', 'training_reward', *_NEW_COLUMNS,
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
        (PROGRESS_FILE, 'mean_value', 'mean action value learned', '1'),
        (PROGRESS_FILE, 'gradient_norm', 'norm of the gradient before the clip', '1'),
        (PANEL_FILE, 'sweep_ratio', "energy efficiency over the sweep's, in the panel", '1'),
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
    algorithm: str  # one of limits.ALGORITHMS, or module:Name
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
    # Fingerprints of what courses are drawn from and of the panel; '': it learns in scenarios.
    courses: str = ''
    code: tuple[str, ...] = ()  # what users wrote of it, each as module:name@version
    teachers: tuple[str, ...] = ()  # whom it imitates, each as name@version

    @property
    def scenario_text(self) -> str:
        """The scenarios and the sizes of their fleets, or the courses, for people."""
        if self.courses:
            return f'courses {self.scenario}'
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
        values = asdict(self)
        for name in _LATER:  # as in records of before there were such
            if not values[name]:
                del values[name]
        return (json.dumps({'format': FORMAT, **values}, indent=2) + '\n').encode()


def algorithm_text(name: str) -> str:
    """An algorithm, for people."""
    return name if is_code_name(name) else name.upper()


def read_run(folder: Path) -> RunRecord:
    """Read what was trained in a run folder.

    Raises:
        TrainingRunError: the folder holds no run, or one of another format.
    """
    path = folder / RUN_FILE
    try:
        files.check_there(folder)
        return _record(json.loads(files.read_bounded(path, _MAX_BYTES)))
    except (FileNotFoundError, NotADirectoryError) as error:
        what = f'holds no {RUN_FILE}' if folder.is_dir() else 'is no folder'
        wanted = f'{what}: must be a run folder of the command train'
        raise TrainingRunError(f'{folder}: {wanted}') from error
    except OSError as error:
        raise TrainingRunError(f'{error.filename}: cannot be read: {error.strerror}') from error
    except (RecursionError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise TrainingRunError(f'{path}: is not JSON') from error
    except ValueError as error:
        raise TrainingRunError(f'{path}: {error}') from error


def _record(values: object) -> RunRecord:
    """The record that a run.json holds; raises ValueError, naming the field that is wrong."""
    if not isinstance(values, dict) or values.get('format') != FORMAT:
        found = values.get('format') if isinstance(values, dict) else values
        raise ValueError(f'format is {_shown(found)}: must be {FORMAT!r}')
    read = {}
    for name, annotation in get_type_hints(RunRecord).items():
        if name in values:
            read[name] = _field(name, annotation, values[name])
        elif name not in _LATER:
            raise ValueError(f'{name} is missing')
    record = RunRecord(**read)
    n_uavs, n_fingerprints = len(record.n_uavs), len(record.scenario_fingerprint.split())
    for is_right, what in (
        (is_algorithm(record.algorithm), f'algorithm is {_shown(record.algorithm)}'),
        (record.device in DEVICES, f'device is {_shown(record.device)}'),
        (record.seed in record.seeds, f'seeds are {_shown(record.seeds)}: lack {record.seed}'),
        (
            n_uavs == n_fingerprints and (n_uavs > 0) != bool(record.courses),
            f'n_uavs has {n_uavs} entries: needs {n_fingerprints}',
        ),
        (
            (record.minutes is None) != (record.decisions is None),
            'must have either minutes or decisions',
        ),
        (record.minutes is None or 0 < record.minutes < math.inf, f'minutes is {record.minutes}'),
    ):
        if not is_right:
            raise ValueError(what)
    return record


def _field(name: str, annotation: object, value: object) -> Any:  # noqa: ANN401 - of that type
    """A field's value, if it is of its type; numbers are counts, seeds or minutes, never < 0."""
    kinds = get_args(annotation) or (annotation,)
    if get_origin(annotation) is tuple:
        if isinstance(value, list):
            return tuple(_field(name, kinds[0], each) for each in value)
    elif get_origin(annotation) is Mapping:
        if isinstance(value, dict) and all(isinstance(each, str) for each in value.values()):
            return value
    elif type(value) in kinds or (float in kinds and type(value) is int):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or 0 <= value <= MAX_SEED:  # type: ignore[operator]
            return value
    raise ValueError(f'{name} is {_shown(value)}')


def _shown(value: object) -> str:
    return _shown_text(repr(value))


def _shown_text(text: str) -> str:
    return text if len(text) <= _MAX_SHOWN else f'{text[: _MAX_SHOWN - 3]}...'


def read_columns(path: Path, columns: tuple[str, ...]) -> dict[str, Floats]:
    """Read some columns of one of the tables, each (K,).

    Raises:
        TrainingRunError: there is no such file, or it is not as a run writes it.
    """
    header = TABLES[path.name]
    try:
        rows = read_rows(path, header)
    except OSError as error:
        raise TrainingRunError(f'{path}: cannot be read: {error.strerror}') from error
    places = [header.index(column) for column in columns]
    table = np.array([[float(row[place]) for place in places] for row in rows]).reshape(
        -1, len(places)
    )
    return {column: table[:, index] for index, column in enumerate(columns)}


def read_rows(path: Path, columns: tuple[str, ...]) -> list[list[str]]:
    """The rows of a table of a run, as text; whole ones of numbers.

    A last line without its end, which a run that was killed may leave, does not count.

    Raises:
        OSError: there is no such file, or it cannot be read.
        TrainingRunError: naming the line that is damaged.
    """
    content = files.read_bounded(path, _MAX_TABLE_BYTES)
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        raise TrainingRunError(f'{path}: is no text: delete it to go on without') from error
    lines = text.split('\n')[:-1]
    header = tuple(lines[0].split(',')) if lines else columns
    missing = columns[len(header) :]
    if header + missing != columns or not set(missing) <= set(_NEW_COLUMNS):
        raise TrainingRunError(f'{path}:1: is no table with {", ".join(columns)}')
    rows = [line.split(',') + ['nan'] * len(missing) for line in lines[1:]]
    for number, row in enumerate(rows, 2):
        problem = _row_problem(row, columns)
        if problem is not None:
            raise TrainingRunError(
                f'{path}:{number}: {problem}: mend it, or delete the file to go on without its'
                ' rows'
            )
    return rows


def _row_problem(row: list[str], columns: tuple[str, ...]) -> str | None:
    """What is wrong with a row; None if nothing is."""
    if len(row) != len(columns) or not _are_numbers(row):
        return f'is no row of {len(columns)} numbers'
    for column, text in zip(columns, row, strict=True):
        value = float(text)
        if math.isinf(value) or (math.isnan(value) and column not in _MAY_BE_UNKNOWN):
            return f'{column} is {_shown_text(text)}: must be a finite number'
    return None


def _are_numbers(row: list[str]) -> bool:
    """Whether all are, the first one a count."""
    with suppress(ValueError):
        return (
            row[0].isdecimal()
            and row[0].isascii()
            and len(row[0]) < _MAX_DIGITS
            and all(isinstance(float(each), float) for each in row)
        )
    return False

"""The one log of a mission: a header, then one record per event, or fault, as JSON lines.

The bytes depend on the scenario, the mission seed and the policies alone: no wall-clock value
enters, and floats are written with the fewest digits that read back to the same number. A mission
over ROS and the same mission in one process leave the same file.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect import files
from uav_collect.errors import MissionLogError
from uav_collect.limits import GUARD_AFTER
from uav_collect.recording.log_model import (
    area_keys,
    code_of,
    EVENT_DTYPE,
    EVENT_NAMES,
    EventModel,
    fault_problem,
    fleet_problem,
    header_problem,
    keys_problem,
    object_of,
    words_of,
)
from uav_collect.uav.action_codes import ACTION_NAMES, HOME, REASON_NAMES

FORMAT = 'uav_collect mission log'
FORMAT_VERSION = 1
MOST_LOG_BYTE = 1 << 28  # some 700,000 events

Events = NDArray[np.void]  # of EVENT_DTYPE


@dataclass(frozen=True, kw_only=True)
class UavHeader:
    """One UAV as it started: what it may spend, and who decides for it."""

    id: int  # from 1
    speed_mps: float
    energy_budget_j: float
    energy_margin_j: float  # to be left when home
    policy: str
    allocator: str  # how it shares its bandwidth: exact, equal or cvxpy
    # Decisions without news after which the policy's guard decides; the line has no other value
    # than this one, nor has it any for what has no guard.
    guard_after: int = GUARD_AFTER


@dataclass(frozen=True, kw_only=True)
class FaultRecord:
    """A fault that has befallen a UAV."""

    event: int  # the first event with it
    time_s: float  # when it began
    uav: int  # id, from 1
    fault: str  # its kind


@dataclass(frozen=True, kw_only=True)
class MissionHeader:
    """What a mission was: enough to fly it again and to judge its log."""

    scenario: str
    scenario_fingerprint: str
    mission_seed: int
    n_rows: int
    n_columns: int
    cell_size_m: float
    total_bit: float  # data waiting at the start
    uavs: tuple[UavHeader, ...]

    def event_model(self) -> EventModel:
        """What its events may say."""
        return EventModel(
            n_uavs=len(self.uavs),
            n_rows=self.n_rows,
            n_columns=self.n_columns,
            cell_size_m=self.cell_size_m,
        )


_FAULT_NAMES, _UAV_NAMES, _HEADER_FIELDS = (
    tuple(field.name for field in fields(record))
    for record in (FaultRecord, UavHeader, MissionHeader)
)
_EVENT_TYPES = tuple(float if EVENT_DTYPE[name].kind == 'f' else int for name in EVENT_NAMES)


@dataclass(frozen=True, kw_only=True)
class MissionLog:
    """A mission as it was flown, to its end or so far."""

    header: MissionHeader
    events: Events  # EVENT_DTYPE, one per event, in order
    faults: tuple[FaultRecord, ...] = ()  # in the order of their events

    @property
    def is_over(self) -> bool:
        """Whether every UAV has turned home in it."""
        return int((self.events['action'] == HOME).sum()) == len(self.header.uavs)

    @property
    def lacks_events(self) -> bool:
        """Whether events before its latest one are missing: a recording may have missed them."""
        return int(self.events['event'].max(initial=-1)) != len(self.events) - 1

    def to_jsonl(self) -> bytes:
        """The log as JSON lines: the header, then one line per event, faults before theirs."""
        lines = [header_line(self.header), *record_lines(self.events, self.faults)]
        return ('\n'.join(lines) + '\n').encode()


class LogWriter:
    """Writes a log as the mission flies; what was appended survives the writer's death."""

    def __init__(self, path: Path, header: MissionHeader) -> None:
        """Create the file and write the header.

        Raises:
            OSError: the file is there already, or cannot be written.
        """
        self._file = path.open('x', encoding='utf-8')
        try:
            self._file.write(header_line(header) + '\n')
            self._file.flush()
        except OSError:
            with suppress(OSError):  # closing writes what is left
                self._file.close()
            raise

    def append(self, events: Events, faults: Sequence[FaultRecord] = ()) -> None:
        """Add events whose intervals are known, and the faults that they were the first with.

        Raises:
            OSError: the disk is full, say.
        """
        for line in record_lines(events, faults):
            self._file.write(line + '\n')
        self._file.flush()

    def close(self) -> None:
        """Close the file; nothing can be appended any more."""
        self._file.close()


def header_line(header: MissionHeader) -> str:
    """The header as one line of JSON."""
    fields: dict[str, Any] = {'format': FORMAT, 'version': FORMAT_VERSION}
    fields |= _header_values(header)
    for uav in fields['uavs']:
        if uav['guard_after'] == GUARD_AFTER:
            del uav['guard_after']
    return json.dumps(fields, separators=(', ', ': '))


def _header_values(header: MissionHeader) -> dict[str, Any]:
    """The header's values by the keys of its line, in their order."""
    size = {'cells_per_side': header.n_rows}
    if header.n_rows != header.n_columns:
        size = {'rows': header.n_rows, 'columns': header.n_columns}
    values: dict[str, Any] = {}
    for name, value in asdict(header).items():
        if name == 'n_rows':
            values |= size
        elif name != 'n_columns':
            values[name] = value
    return values


def record_lines(events: Events, faults: Sequence[FaultRecord]) -> Iterator[str]:
    """Events as lines of JSON, each after the faults that it is the first with."""
    waiting = deque(faults)
    for event in events:
        while waiting and waiting[0].event <= event['event']:
            yield json.dumps(asdict(waiting.popleft()), separators=(', ', ': '))
        yield event_line(event)


def event_line(event: np.void) -> str:
    """One event as one line of JSON."""
    fields = dict(zip(EVENT_NAMES, event.item(), strict=True))
    fields['action'] = ACTION_NAMES[fields['action']]
    fields['reason'] = REASON_NAMES[fields['reason']]
    heard = fields['heard']
    fields['heard'] = [bit + 1 for bit in range(heard.bit_length()) if heard >> bit & 1]
    return json.dumps(fields, separators=(', ', ': '))


def header_from_line(line: str) -> MissionHeader:
    """Read a header line.

    Raises:
        MissionLogError: it is none of this format and version, or a value of it cannot be.
    """
    try:
        return _header_of(object_of(line))
    except ValueError as error:
        raise MissionLogError(f'line 1: no header of a mission log: {error}') from error


def fault_from(values: Mapping[str, Any], n_uavs: int) -> FaultRecord:
    """The fault that the values of a line tell of.

    Raises:
        ValueError: they are not those of a fault.
    """
    problem = keys_problem(values, _FAULT_NAMES) or fault_problem(values, n_uavs)
    if problem is not None:
        raise ValueError(problem)
    return FaultRecord(**{**values, 'time_s': float(values['time_s'])})


def from_jsonl(text: bytes) -> MissionLog:
    """Read a log back; the inverse of `MissionLog.to_jsonl`.

    Raises:
        MissionLogError: naming the line that is not of this format, and what of it.
    """
    first, *rest = _lines(text)
    header = header_from_line(first)
    model = header.event_model()
    rows: list[tuple[Any, ...]] = []
    numbers: list[int] = []  # of the events' lines
    faults: list[FaultRecord] = []
    for number, line in enumerate(rest, start=2):
        try:
            values = object_of(line)
            if 'fault' in values:
                faults.append(fault_from(values, model.n_uavs))
            else:
                numbers.append(number)
                rows.append(_row_of(values, model))
            _check_order(values['event'], len(rows) - ('fault' not in values))
        except ValueError as error:
            raise MissionLogError(f'line {number}: no event of a mission log: {error}') from error
    return MissionLog(
        header=header, events=_checked_events(rows, numbers, model), faults=tuple(faults)
    )


def read(path: Path) -> MissionLog:
    """The mission of a log file.

    Raises:
        MissionLogError: naming the file and the line.
    """
    return _read(path, is_whole=True)


def read_so_far(path: Path) -> MissionLog:
    """The mission of a log file that may have been cut off, in the middle of a line even.

    Raises:
        MissionLogError: naming the file and the line.
    """
    return _read(path, is_whole=False)


def _read(path: Path, *, is_whole: bool) -> MissionLog:
    try:
        text = files.read_bounded(path, MOST_LOG_BYTE)
    except OSError as error:
        raise MissionLogError(f'{path}: {error.strerror or error}') from error
    if not is_whole:
        before, end, _ = text.rpartition(b'\n')
        text = before + end
    try:
        return from_jsonl(text)
    except MissionLogError as error:
        raise MissionLogError(f'{path}: {error}') from error


def _lines(text: bytes) -> list[str]:
    try:
        lines = text.decode().split('\n')
    except UnicodeDecodeError as error:
        number = text.count(b'\n', 0, error.start) + 1
        raise MissionLogError(f'line {number}: is not UTF-8 text') from error
    return lines if lines[-1] or len(lines) == 1 else lines[:-1]


def _header_of(values: dict[str, Any]) -> MissionHeader:
    version = values.pop('version', None)
    is_version = type(version) is int and version == FORMAT_VERSION  # true equals 1, too
    if values.pop('format', None) != FORMAT or not is_version:
        raise ValueError(f'must be of format {FORMAT}, version {FORMAT_VERSION}')
    uavs = values.get('uavs')
    area, wanted = area_keys(values), [*_HEADER_FIELDS]
    wanted[wanted.index('n_rows') : wanted.index('n_columns') + 1] = area
    problem = keys_problem(values, wanted) or header_problem(values)
    if problem is None and not (
        isinstance(uavs, list) and all(isinstance(it, dict) for it in uavs)
    ):
        problem = 'uavs must be a list of objects'
    if problem is not None:
        raise ValueError(problem)
    fleet = [{'guard_after': GUARD_AFTER, **uav} for uav in values.pop('uavs')]
    for number, uav in enumerate(fleet, start=1):
        if (problem := keys_problem(uav, _UAV_NAMES)) is not None:
            raise ValueError(f'UAV {number}: {problem}')
    if (problem := fleet_problem(fleet)) is not None:
        raise ValueError(problem)
    size = [values.pop(name) for name in area]
    return MissionHeader(
        n_rows=size[0],
        n_columns=size[-1],
        uavs=tuple(UavHeader(**uav) for uav in fleet),
        **values,
    )


def _row_of(values: dict[str, Any], model: EventModel) -> tuple[Any, ...]:
    """The values of an event, types checked; ranges are later checked for all events at once."""
    if tuple(values) != EVENT_NAMES:
        if (problem := keys_problem(values, EVENT_NAMES)) is not None:
            raise ValueError(problem)
        values = {name: values[name] for name in EVENT_NAMES}
    values['action'] = code_of('action', values['action'], ACTION_NAMES)
    values['reason'] = code_of('reason', values['reason'], REASON_NAMES)
    values['heard'] = model.heard_bits(values['heard'])
    row = tuple(values.values())
    if tuple(map(type, row)) != _EVENT_TYPES and (problem := model.problem(row)) is not None:
        raise ValueError(problem)
    return row


def _checked_events(
    rows: Sequence[tuple[Any, ...]], numbers: Sequence[int], model: EventModel
) -> Events:
    try:
        events = np.array(rows, dtype=EVENT_DTYPE)
        wrong = model.first_wrong(events)
    except OverflowError:  # a whole number beyond all
        wrong = next(place for place, row in enumerate(rows) if model.problem(row) is not None)
    if wrong is not None:
        problem = model.problem(rows[wrong])
        raise MissionLogError(f'line {numbers[wrong]}: no event of a mission log: {problem}')
    return events


def _check_order(event: object, number: int) -> None:
    if event != number:
        raise ValueError(f'event is {words_of(event)}: must be {number}, they follow each other')

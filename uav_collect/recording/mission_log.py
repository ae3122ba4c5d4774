"""The one log of a mission: a header, then one record per event, or fault, as JSON lines.

The bytes depend on the scenario, the mission seed and the policies alone: no wall-clock value
enters, and floats are written with the fewest digits that read back to the same number. A mission
over ROS and the same mission in one process leave the same file.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.errors import MissionLogError
from uav_collect.limits import GUARD_AFTER
from uav_collect.uav.action_codes import ACTION_NAMES, HOME, REASON_NAMES

FORMAT = 'uav_collect mission log'
FORMAT_VERSION = 1
NO_AGENT = 'none'  # stands for the policy of a UAV that had no agent as the mission began

EVENT_DTYPE = np.dtype(
    [
        ('event', np.int64),  # running number over the fleet, from 0
        ('time_s', np.float64),  # when the deciding UAV decided
        ('uav', np.int64),  # id of the deciding UAV, from 1
        ('decision', np.int64),  # running number of the UAV's own decisions, from 0
        ('x_m', np.float64),  # where it decided, east
        ('y_m', np.float64),  # and north
        ('action', np.int64),  # see action_codes
        ('reason', np.int64),  # the same
        ('duration_s', np.float64),  # of the action
        ('energy_left_j', np.float64),  # before the action
        ('energy_j', np.float64),  # the action's cost
        ('collected_bit', np.float64),  # data claimed by the action, 0 unless it hovers
        ('n_sensors', np.int64),  # sensors served by the action
        ('heard', np.uint64),  # UAVs that it heard, bit i for the id i + 1
        ('known_complete', np.int64),  # completed cells in its map, after hearing the others
        ('interval_s', np.float64),  # until the next event, or the end
        ('reward', np.float64),  # of that interval, discounted to its start
    ]
)

Events = NDArray[np.void]


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
    cells_per_side: int
    cell_size_m: float
    total_bit: float  # data waiting at the start
    uavs: tuple[UavHeader, ...]


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

    def to_jsonl(self) -> bytes:
        """The log as JSON lines: the header, then one line per event, faults before theirs."""
        lines = [header_line(self.header), *record_lines(self.events, self.faults)]
        return ('\n'.join(lines) + '\n').encode()


class LogWriter:
    """Writes a log as the mission flies; what was appended survives the writer's death."""

    def __init__(self, path: Path, header: MissionHeader) -> None:
        """Create the file, or empty it, and write the header.

        Raises:
            OSError: the file cannot be written.
        """
        self._file = path.open('w', encoding='utf-8')
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
    fields = {'format': FORMAT, 'version': FORMAT_VERSION, **asdict(header)}
    for uav in fields['uavs']:
        if uav['guard_after'] == GUARD_AFTER:
            del uav['guard_after']
    return json.dumps(fields, separators=(', ', ': '))


def record_lines(events: Events, faults: Sequence[FaultRecord]) -> Iterator[str]:
    """Events as lines of JSON, each after the faults that it is the first with."""
    waiting = deque(faults)
    for event in events:
        while waiting and waiting[0].event <= event['event']:
            yield json.dumps(asdict(waiting.popleft()), separators=(', ', ': '))
        yield event_line(event)


def event_line(event: np.void) -> str:
    """One event as one line of JSON."""
    fields = dict(zip(EVENT_DTYPE.names or (), event.item(), strict=True))
    fields['action'] = ACTION_NAMES[fields['action']]
    fields['reason'] = REASON_NAMES[fields['reason']]
    heard = fields['heard']
    fields['heard'] = [bit + 1 for bit in range(heard.bit_length()) if heard >> bit & 1]
    return json.dumps(fields, separators=(', ', ': '))


def header_from_line(line: str) -> MissionHeader:
    """Read a header line.

    Raises:
        MissionLogError: the line is no header of this format and version.
    """
    try:
        fields = json.loads(line)
        if fields.pop('format') != FORMAT or fields.pop('version') != FORMAT_VERSION:
            raise MissionLogError(f'line 1: not a {FORMAT} of version {FORMAT_VERSION}')
        uavs = tuple(UavHeader(**uav) for uav in fields.pop('uavs'))
        return MissionHeader(uavs=uavs, **fields)
    except (json.JSONDecodeError, RecursionError, AttributeError, KeyError, TypeError) as error:
        raise MissionLogError(f'line 1: no header of a mission log ({error})') from error


def fault_from(values: dict[str, Any]) -> FaultRecord:
    """The fault that the values of a line tell of.

    Raises:
        TypeError: they are not those of a fault, by name or type.
    """
    fault = FaultRecord(**values)
    for each in fields(fault):
        if type(values[each.name]) is not each.type:
            raise TypeError(f'{each.name} is {values[each.name]!r}')
    return fault


def from_jsonl(text: bytes) -> MissionLog:
    """Read a log back; the inverse of `MissionLog.to_jsonl`.

    Raises:
        MissionLogError: a line is not of this format.
    """
    first, *rest = text.decode().splitlines() or ['']
    events = np.zeros(len(rest), dtype=EVENT_DTYPE)
    faults: list[FaultRecord] = []
    for number, line in enumerate(rest, start=2):
        try:
            fields = json.loads(line)
            if 'fault' in fields:
                faults.append(fault_from(fields))
            else:
                events[number - 2 - len(faults)] = _event_from(fields)
        except (json.JSONDecodeError, RecursionError, KeyError, TypeError, ValueError) as error:
            raise MissionLogError(f'line {number}: no event of a mission log ({error})') from error
    header = header_from_line(first)
    return MissionLog(
        header=header, events=events[: len(rest) - len(faults)], faults=tuple(faults)
    )


def read(path: Path) -> MissionLog:
    """The mission of a log file.

    Raises:
        MissionLogError: naming the file and the line.
    """
    try:
        return from_jsonl(path.read_bytes())
    except (OSError, UnicodeDecodeError, MissionLogError) as error:
        raise MissionLogError(f'{path}: {error}') from error


def read_so_far(path: Path) -> MissionLog:
    """The mission of a log file that may have been cut off, in the middle of a line even.

    Raises:
        MissionLogError: naming the file and the line.
    """
    try:
        whole, end, _ = path.read_bytes().rpartition(b'\n')
        return from_jsonl(whole + end)
    except (OSError, UnicodeDecodeError, MissionLogError) as error:
        raise MissionLogError(f'{path}: {error}') from error


def _event_from(fields: dict[str, Any]) -> tuple[float, ...]:
    fields['action'] = ACTION_NAMES.index(fields['action'])
    fields['reason'] = REASON_NAMES.index(fields['reason'])
    fields['heard'] = sum(1 << (uav - 1) for uav in fields['heard'])
    return tuple(fields[name] for name in EVENT_DTYPE.names or ())

"""What the records of a mission log may say: one model for log files, for bags and for proofs.

A record is checked by itself and against the mission's header. How records follow from each other,
energies and places that add up, is `analysis.metrics.check_log`.
"""

from collections.abc import Iterable, Mapping, Sequence
import json
import math
import re
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from uav_collect.config.yaml_text import shown
from uav_collect.limits import MAX_CELLS_PER_SIDE, MAX_GUARD_AFTER, MAX_UAVS
from uav_collect.scenario.model import FAULT_KINDS
from uav_collect.uav.action_codes import ACTION_NAMES, REASON_NAMES

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
EVENT_NAMES: tuple[str, ...] = EVENT_DTYPE.names or ()

_MOST = 1e18  # of what is measured: beyond all that is flown, and sums of it stay finite
_MOST_COUNT = 2**53
_LONGEST = 1_000  # characters of a name
_MOST_DIGITS = 4_300  # of a whole number: Python reads no more
_LONG_NUMBER = re.compile(f'[0-9]{{{_MOST_DIGITS + 1}}}')
_BYTE_ORDER_MARK = '\ufeff'
_MOST_SEED = 2**63 - 1


class Field(NamedTuple):
    """What a number of a record must be."""

    name: str
    kind: type  # int, or float: which a whole number is, too
    low: float
    high: float

    def problem(self, value: object) -> str | None:
        """What is wrong with a value, and what is allowed; None if nothing is."""
        kind = type(value)
        if kind is not self.kind and not (kind is int and self.kind is float):
            word = 'a whole number' if self.kind is int else 'a number'
            return f'{self.name} is {words_of(value)}: must be {word}'
        if not self.low <= value <= self.high:  # type: ignore[operator]
            spec = '' if self.kind is int else '.10g'
            span = f'{self.low:{spec}}'
            if self.high > self.low:
                span += f' to {self.high:{spec}}'
            return f'{self.name} is {words_of(value)}: must be {span}'
        return None


class EventModel:
    """What the events of a mission may say."""

    def __init__(self, *, n_uavs: int, n_rows: int, n_columns: int, cell_size_m: float) -> None:
        """Know the mission.

        Args:
            n_uavs: of the fleet.
            n_rows: of the area's cells.
            n_columns: the same.
            cell_size_m: the same.
        """
        self._all_heard = 2**n_uavs - 1
        self.n_uavs = n_uavs
        ranges: dict[str, tuple[float, float]] = {
            'event': (0, _MOST_COUNT),
            'time_s': (0.0, _MOST),
            'uav': (1, n_uavs),
            'decision': (0, _MOST_COUNT),
            'x_m': (0.0, n_columns * cell_size_m),
            'y_m': (0.0, n_rows * cell_size_m),
            'action': (0, len(ACTION_NAMES) - 1),
            'reason': (0, len(REASON_NAMES) - 1),
            'duration_s': (0.0, _MOST),
            'energy_left_j': (-_MOST, _MOST),
            'energy_j': (0.0, _MOST),
            'collected_bit': (0.0, _MOST),
            'n_sensors': (0, _MOST_COUNT),
            'heard': (0, self._all_heard),
            'known_complete': (0, n_rows * n_columns),
            'interval_s': (0.0, _MOST),
            'reward': (-_MOST, _MOST),
        }
        self._fields = tuple(
            Field(name, float if EVENT_DTYPE[name].kind == 'f' else int, *ranges[name])
            for name in EVENT_NAMES
        )

    def first_wrong(self, events: NDArray[np.void]) -> int | None:
        """The place of the first event with a value out of its range; None without any."""
        is_wrong = np.zeros(len(events), dtype=np.bool_)
        for name, kind, low, high in self._fields:
            column, number = events[name], EVENT_DTYPE[name].type
            # A nan is neither. Bounds of the same kind: 2^64 - 1 is no float.
            most = number(high) if kind is int else high
            is_wrong |= ~((column >= number(low)) & (column <= most))
        wrong = np.flatnonzero(is_wrong)
        return int(wrong[0]) if len(wrong) else None

    def problem(self, values: Iterable[object]) -> str | None:
        """What is wrong with the values of an event, in EVENT_DTYPE's order; None if nothing is.

        The UAVs that were heard are bits.
        """
        for field, value in zip(self._fields, values, strict=True):
            if field.name == 'heard' and isinstance(value, int):
                continue  # by their ids, see `heard_bits`
            if (problem := field.problem(value)) is not None:
                return problem
        return None

    def heard_bits(self, ids: object) -> int:
        """The UAVs that were heard as bits, bit i for the id i + 1.

        Raises:
            ValueError: saying what is wrong with the ids.
        """
        bits = 0
        allowed = f'a list of ids from 1 to {self.n_uavs}, each once, ascending'
        if not isinstance(ids, list):
            raise ValueError(f'heard is {words_of(ids)}: must be {allowed}')
        for uav in ids:
            if type(uav) is not int or not 1 <= uav <= self.n_uavs or bits >> (uav - 1):
                raise ValueError(f'heard has {words_of(uav)}: must be {allowed}')
            bits |= 1 << (uav - 1)
        return bits


def area_keys(values: Mapping[str, Any]) -> tuple[str, ...]:
    """By which keys a header says, or has to say, how many cells the area has."""
    is_square = 'rows' not in values and 'columns' not in values
    return ('cells_per_side',) if is_square else ('rows', 'columns')


def header_problem(values: Mapping[str, Any]) -> str | None:
    """What is wrong with the values of a header, UAVs aside; None if nothing is."""
    for name in ('scenario', 'scenario_fingerprint'):
        if (problem := text_problem(name, values[name])) is not None:
            return problem
    numbers = (
        Field('mission_seed', int, 0, _MOST_SEED),
        *(Field(name, int, 1, MAX_CELLS_PER_SIDE) for name in area_keys(values)),
        Field('cell_size_m', float, math.ulp(0.0), _MOST),
        Field('total_bit', float, 0.0, _MOST),
    )
    return _first(field.problem(values[field.name]) for field in numbers)


def fleet_problem(uavs: Sequence[Mapping[str, Any]]) -> str | None:
    """What is wrong with the UAVs of a header; None if nothing is."""
    if not 1 <= len(uavs) <= MAX_UAVS:
        return f'uavs has {len(uavs)} entries: must have 1 to {MAX_UAVS}'
    for number, uav in enumerate(uavs, start=1):
        fields = (
            Field('id', int, number, number),
            Field('speed_mps', float, math.ulp(0.0), _MOST),
            Field('energy_budget_j', float, 0.0, _MOST),
            Field('energy_margin_j', float, 0.0, _MOST),
            Field('guard_after', int, 0, MAX_GUARD_AFTER),
        )
        problems = [field.problem(uav[field.name]) for field in fields]
        problems += [text_problem(name, uav[name]) for name in ('policy', 'allocator')]
        if (problem := _first(problems)) is not None:
            return f'UAV {number}: {problem}'
    return None


def fault_problem(values: Mapping[str, Any], n_uavs: int) -> str | None:
    """What is wrong with the values of a fault; None if nothing is."""
    fields = (
        Field('event', int, 0, _MOST_COUNT),
        Field('time_s', float, 0.0, _MOST),
        Field('uav', int, 1, n_uavs),
    )
    kind = values['fault']
    if not (isinstance(kind, str) and kind in FAULT_KINDS):
        return f'fault is {words_of(kind)}: must be {_either(FAULT_KINDS)}'
    return _first(field.problem(values[field.name]) for field in fields)


def code_of(name: str, value: object, names: Sequence[str]) -> int:
    """The code that a name stands for.

    Raises:
        ValueError: there is none such.
    """
    if not (isinstance(value, str) and value in names):
        raise ValueError(f'{name} is {words_of(value)}: must be {_either(names)}')
    return names.index(value)


def keys_problem(
    values: Mapping[str, Any], names: Sequence[str], optional: Sequence[str] = ()
) -> str | None:
    """Which key of an object is missing, or should not be there; None if all is as it must be."""
    for name in names:
        if name not in values and name not in optional:
            return f'{name} is missing'
    for name in values:
        if name not in names:
            return f'{words_of(name)} is there: must be {", ".join(names)}'
    return None


def object_of(line: str) -> dict[str, Any]:
    """The JSON object of a line.

    Raises:
        ValueError: saying why it is none.
    """
    if line.startswith(_BYTE_ORDER_MARK):
        raise ValueError('it begins with a byte order mark: must be UTF-8 text without one')
    try:
        values = _DECODER.decode(line)
    except json.JSONDecodeError as error:
        raise ValueError(f'no JSON, {error.msg} at character {error.pos + 1}') from error
    except RecursionError:
        raise ValueError('no record, its values nest too deep') from None
    except ValueError:
        if _LONG_NUMBER.search(line):
            most = f'must have at most {_MOST_DIGITS}'
            raise ValueError(f'a number has more than {_MOST_DIGITS} digits: {most}') from None
        raise
    if not isinstance(values, dict):
        raise ValueError(f'no record but {words_of(values)}')
    return values


def text_problem(name: str, value: object) -> str | None:
    """What is wrong with a name; None if nothing is."""
    if not isinstance(value, str):
        return f'{name} is {words_of(value)}: must be text'
    if len(value) > _LONGEST or not value.isprintable():
        return (
            f'{name} is {words_of(value)}: must be printable text of at most {_LONGEST} characters'
        )
    return None


def words_of(value: object) -> str:
    """A wrong value, as short text on one line."""
    if isinstance(value, list):
        return 'a list'
    if isinstance(value, dict):
        return 'an object'
    return shown(value)


def _either(names: Sequence[str]) -> str:
    return f'{", ".join(names[:-1])} or {names[-1]}'


def _first(problems: Iterable[str | None]) -> str | None:
    return next((problem for problem in problems if problem is not None), None)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f'{words_of(twice)} stands twice')
    return values


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f'{name} is no number')


_DECODER = json.JSONDecoder(object_pairs_hook=_unique, parse_constant=_no_constant)

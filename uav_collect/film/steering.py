"""What a page may ask of the world that it shows."""

from dataclasses import dataclass
import json

from uav_collect.errors import in_one_line, RefusedError
from uav_collect.limits import MAX_SEED

COMMANDS = ('start', 'abort', 'pause', 'resume', 'step', 'pace')
MOST_BYTES = 1000  # of what is asked
MAX_PACE = 1000.0
_VALUES = {'start': 'seed', 'pace': 'pace'}  # what comes with a command


@dataclass(frozen=True, kw_only=True)
class Wish:
    """One thing that the world is to do."""

    command: str  # of COMMANDS
    seed: int = 0  # of start: the mission's
    pace: float = 0.0  # of pace: simulated over wall-clock time; 0: as fast as the fleet decides


def wish_of(text: str | bytes) -> Wish:
    """The wish that a page has sent as JSON.

    Raises:
        RefusedError: it is none; in one line.
    """
    try:
        values = json.loads(text) if len(text) <= MOST_BYTES else None
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, dict):
        raise RefusedError(f'this is no object of JSON within {MOST_BYTES} bytes')
    command = values.pop('command', None)
    if command not in COMMANDS:
        raise RefusedError(f'command is {_shown(command)}: must be {" or ".join(COMMANDS)}')
    wanted = _VALUES.get(command)
    for name in values:
        if name != wanted:
            raise RefusedError(f'{in_one_line(name, 80)} is there: {command} has none')
    match command:
        case 'start':
            return Wish(command=command, seed=_seed(values.get('seed')))
        case 'pace':
            return Wish(command=command, pace=_pace(values.get('pace')))
    return Wish(command=command)


def _seed(value: object) -> int:
    if type(value) is int and 0 <= value <= MAX_SEED:
        return value
    raise RefusedError(f'seed is {_shown(value)}: must be a whole number from 0 to {MAX_SEED}')


def _pace(value: object) -> float:
    if type(value) in (int, float) and isinstance(value, int | float) and 0 <= value <= MAX_PACE:
        return float(value)
    raise RefusedError(f'pace is {_shown(value)}: must be a number from 0 to {MAX_PACE:g}')


def _shown(value: object) -> str:
    return in_one_line(repr(value), 80)

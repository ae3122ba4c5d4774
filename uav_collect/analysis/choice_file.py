"""The files in which a run folder keeps who was chosen to fly, and why."""

from collections.abc import Mapping
from dataclasses import asdict, fields
import json
import math
from pathlib import Path
from typing import TypeVar

from uav_collect import files
from uav_collect.analysis.choice import Choice, Tried
from uav_collect.analysis.statistics import Estimate, MEASURES
from uav_collect.config.yaml_text import shown
from uav_collect.errors import in_one_line, StoreError

CHOICE_JSON, CHOICE_CSV = 'choice.json', 'choice.csv'
_MOST_BYTE = 1 << 20
_FORMAT = 'uav_collect choice of a policy'
_EFFICIENCY = MEASURES[0].key
_ALLOWED: Mapping[type, str] = {
    str: 'a printable text', int: 'a whole number', bool: 'true or false', float: 'a number',
    dict: 'a mapping', list: 'a list',
}  # fmt: skip
_Kind = TypeVar('_Kind')


def keep_choice(choice: Choice, folder: Path) -> None:
    """Leave a choice in a run folder, which is made where there is none.

    Raises:
        OSError: naming what cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    document = {'format': _FORMAT, 'policy': choice.policy, 'why': choice.why, **asdict(choice)}
    text = json.dumps(document, indent=2, allow_nan=False) + '\n'
    files.write_atomically(folder / CHOICE_JSON, text.encode())
    files.write_atomically(folder / CHOICE_CSV, files.csv_of(_rows(choice)))


def _rows(choice: Choice) -> list[list[object]]:
    keys = [measure.key for measure in MEASURES]
    bounds = [f'{_EFFICIENCY}_low', f'{_EFFICIENCY}_high']
    rows: list[list[object]] = [['policy', 'version', 'missions', 'is_best', *keys, *bounds]]
    for it in choice.tried:
        means = [it.estimates[key].mean for key in keys]
        span = it.estimates[_EFFICIENCY]
        is_best = int(it.policy == choice.policy)
        rows.append(
            [it.policy, it.version, choice.n_missions, is_best, *means, span.low, span.high]
        )
    return rows


def read_choice(folder: Path) -> Choice | None:
    """The choice that a run folder keeps; None where it keeps none.

    Raises:
        StoreError: what it keeps is no choice: one line that says why.
    """
    path = folder / CHOICE_JSON
    if not path.exists():
        return None
    try:
        return _choice_of(json.loads(files.read_bounded(path, _MOST_BYTE)))
    except OSError as error:
        why = f'cannot be read: {error.strerror or error}'
    except KeyError as error:
        why = f'{error.args[0]} is missing'
    except RecursionError:
        why = 'is nested too deeply'
    except (TypeError, ValueError) as error:
        why = str(error)
    raise StoreError(f'{path}: is no choice of a policy: {in_one_line(why)}')


def _choice_of(values: object) -> Choice:
    if not isinstance(values, dict) or values.get('format') != _FORMAT:
        raise ValueError(f'format must be {_FORMAT!r}')
    tried = tuple(map(_tried, _value(values, 'tried', list)))
    if not tried:
        raise ValueError('tried is empty')
    return Choice(
        scenario=_value(values, 'scenario', str),
        fingerprint=_value(values, 'fingerprint', str),
        bandwidth=_value(values, 'bandwidth', str),
        first_seed=_value(values, 'first_seed', int),
        n_missions=_value(values, 'n_missions', int),
        n_planned=_value(values, 'n_planned', int),
        is_compiled=_value(values, 'is_compiled', bool),
        tried=tried,
        lead=None if values['lead'] is None else _estimate(values['lead']),
    )


def _tried(values: object) -> Tried:
    policy, version = _value(values, 'policy', str), _value(values, 'version', str)
    estimates = _value(values, 'estimates', dict)
    is_counted = isinstance(values, dict) and values.get('computing_s') is not None
    return Tried(
        policy=policy,
        version=version,
        estimates={measure.key: _estimate(estimates[measure.key]) for measure in MEASURES},
        computing_s=_finite(values, 'computing_s') if is_counted else None,
    )


def _estimate(values: object) -> Estimate:
    return Estimate(**{field.name: _finite(values, field.name) for field in fields(Estimate)})


def _finite(values: object, name: str) -> float:
    number = _value(values, name, float)
    if not math.isfinite(number):
        raise ValueError(f'{name} is {number}: must be finite')
    return number


def _value(values: object, name: str, kind: type[_Kind]) -> _Kind:
    """A value that must be of a kind; texts are for a terminal, too.

    Raises:
        ValueError: there is none, or it is of another kind.
    """
    if not isinstance(values, dict) or name not in values:
        raise ValueError(f'{name} is missing')
    found = values[name]
    is_printable = not isinstance(found, str) or found.isprintable()
    if type(found) is not kind or not is_printable:
        raise ValueError(f'{name} is {shown(found)}: must be {_ALLOWED[kind]}')
    return found

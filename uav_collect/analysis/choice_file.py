"""The files in which a run folder keeps who was chosen to fly, and why."""

from collections.abc import Mapping
from dataclasses import asdict, fields
import json
from pathlib import Path
from typing import Any

from uav_collect import files
from uav_collect.analysis.choice import Choice, Tried
from uav_collect.analysis.statistics import Estimate, MEASURES

CHOICE_JSON, CHOICE_CSV = 'choice.json', 'choice.csv'
_MOST_BYTE = 1 << 20
_FORMAT = 'uav_collect choice of a policy'
_EFFICIENCY = MEASURES[0].key


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
    """The choice that a run folder keeps; None where it keeps none, or nothing of the kind."""
    try:
        values = json.loads(files.read_bounded(folder / CHOICE_JSON, _MOST_BYTE))
        return _choice_of(values) if values['format'] == _FORMAT else None
    except (OSError, KeyError, RecursionError, TypeError, ValueError):
        return None


def _choice_of(values: dict[str, Any]) -> Choice:
    own = {field.name: values[field.name] for field in fields(Choice)}
    tried = tuple(
        Tried(
            policy=str(it['policy']),
            version=str(it['version']),
            estimates={
                measure.key: _estimate(it['estimates'][measure.key]) for measure in MEASURES
            },
        )
        for it in own.pop('tried')
    )
    if not tried:
        raise ValueError('a choice has candidates')
    lead = own.pop('lead')
    return Choice(**own, tried=tried, lead=None if lead is None else _estimate(lead))


def _estimate(values: Mapping[str, Any]) -> Estimate:
    return Estimate(**{field.name: float(values[field.name]) for field in fields(Estimate)})

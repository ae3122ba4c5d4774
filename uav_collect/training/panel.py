"""The panel: the fixed conditions that a policy is validated in which is to fly anywhere.

config/training/panels/anywhere.yaml says what each key means. A panel that was read stands alone:
the scenarios of its conditions are part of it.
"""

from collections.abc import Mapping
from dataclasses import replace
import hashlib
from pathlib import Path
from typing import Annotated, Any

from uav_collect.config import layers, yaml_text
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import Document
from uav_collect.config.rules import Entries, name, Section, validated, whole
from uav_collect.config.yaml_text import Keys, shown
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_UAVS
from uav_collect.scenario.load import with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.training.resolved import resolved_scenario, with_value

_MOST_CONDITIONS = 200
_KEYS = ('name', 'scenario', 'set', 'uavs')  # of a condition in a file


class Condition(Section):
    """One condition: a scenario by a name."""

    name: Annotated[str, name()]
    scenario: Scenario


class Panel(Section):
    """The conditions, in the order in which tables number them."""

    name: Annotated[str, name()]
    conditions: Annotated[tuple[Condition, ...], Entries(1, _MOST_CONDITIONS)]

    @property
    def fingerprint(self) -> str:
        """16 hex digits that change with any condition."""
        return hashlib.sha256(self.to_yaml().encode()).hexdigest()[:16]

    def to_yaml(self) -> str:
        """The panel as a file that stands alone."""
        return yaml_text.dump(self.as_mapping())


def load_panel(name_or_path: str | Path) -> Panel:
    """Read a panel by its name among the shipped ones, or by the path of a YAML file.

    Raises:
        ConfigError: one line per problem: file and line, key, value, what is allowed.
    """
    document = layers.load(name_or_path, shared_folders('training/panels'), field='panel')
    conditions = document.at(('conditions',))
    if isinstance(conditions, list | tuple):
        for index in range(len(conditions)):
            document = _resolved(document, ('conditions', index))
    panel = validated(Panel, document)
    names = [condition.name for condition in panel.conditions]
    for index, each in enumerate(names):
        if each in names[:index]:
            keys: Keys = ('conditions', index, 'name')
            raise ConfigError(document.problem(keys, f'is {shown(each)}: must be unique'))
    return panel


def _resolved(document: Document, keys: Keys) -> Document:
    """A condition with the scenario that its keys `scenario`, `set` and `uavs` describe."""
    condition = document.at(keys)
    if not isinstance(condition, dict) or not isinstance(condition.get('scenario'), str):
        return document
    for key in condition:
        if key not in _KEYS:
            what = f'is an unknown key: must be one of {", ".join(_KEYS)}'
            raise ConfigError(document.problem((*keys, key), what))
    overrides = condition.get('set', {})
    if not isinstance(overrides, Mapping) or not all(isinstance(key, str) for key in overrides):
        what = f'is {shown(overrides)}: must be a mapping of keys as demand.cell_share'
        raise ConfigError(document.problem((*keys, 'set'), what))
    scenario = resolved_scenario(document, (*keys, 'scenario'), overrides)
    if 'uavs' in condition:
        scenario = with_uavs(scenario, _n_uavs(document, (*keys, 'uavs')))
    whole_condition: dict[Any, Any] = {
        key: it for key, it in condition.items() if key not in ('set', 'uavs')
    }
    whole_condition['scenario'] = scenario.as_mapping()
    return replace(document, values=with_value(document.values, keys, whole_condition))


def _n_uavs(document: Document, keys: Keys) -> int:
    rule = whole(1, MAX_UAVS)
    try:
        n_uavs: int = rule.parse(document.at(keys))
    except ValueError:
        what = f'is {shown(document.at(keys))}: must be {rule.allowed}'
        raise ConfigError(document.problem(keys, what)) from None
    return n_uavs

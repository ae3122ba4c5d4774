"""Scenarios that a file names, in the place of their names: so what was read stands alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uav_collect.config.layers import Document
from uav_collect.config.yaml_text import Keys, shown
from uav_collect.errors import ConfigError
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario


def resolved_scenario(
    document: Document, keys: Keys, overrides: Mapping[str, object] | None = None
) -> Scenario:
    """The scenario that stands at a path by its name, or by its file beside the document.

    Args:
        overrides: values by dotted path, which count more than the scenario's.

    Raises:
        ConfigError: one line per problem, the place of the name before it.
    """
    given = document.at(keys)
    path: str | Path = given
    if isinstance(given, str) and given.endswith(('.yaml', '.yml')):
        path = document.source(keys).folder / given
    try:
        return load(path, overrides)
    except ConfigError as error:
        where = document.problem(keys, f'is {shown(given)}')
        raise ConfigError(*(f'{where}: {line}' for line in error.lines)) from error


def with_value(values: Any, keys: Keys, value: object) -> Any:  # noqa: ANN401 - any YAML
    """Nested mappings and lists with another value at a path, which is there."""
    if not keys:
        return value
    first, *rest = keys
    below = with_value(values[first], tuple(rest), value)
    if isinstance(values, dict):
        return {**values, first: below}
    return [below if index == first else each for index, each in enumerate(values)]

"""YAML text: read strictly, written so that equal values give equal bytes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
import re
from typing import Any

from uav_collect.errors import ConfigError
import yaml

Keys = tuple[str | int, ...]  # the way to a value: mapping keys and list indices

_MAX_SHOWN = 60  # characters of a wrong value
_MAX_DEPTH = 50  # of values in values; the loader crashes the process beyond some ten thousand
_MAX_VALUES = 1_000_000  # of a text, those of its aliases written out

# YAML 1.1 reads 1e-3 and 1.5e6 as text; YAML 1.2, and everybody who writes them, as numbers.
_EXPONENT = re.compile(r'[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+')
_FLOAT_TAG = 'tag:yaml.org,2002:float'
_MERGE_TAG = 'tag:yaml.org,2002:merge'


class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """The safe loader; a key given twice is an error, not a silent overwrite."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            if key_node.tag == _MERGE_TAG or not isinstance(key_node, yaml.ScalarNode):
                continue
            if key_node.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f'the key {key_node.value!r} appears twice', key_node.start_mark
                )
            seen.add(key_node.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep=deep)
        return mapping


class _Dumper(yaml.SafeDumper):
    """Writes what `_Loader` reads; short lists on one line."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _represent_tuple(dumper: _Dumper, items: tuple[object, ...]) -> yaml.Node:
    is_short = all(isinstance(item, float | int) for item in items)
    return dumper.represent_sequence('tag:yaml.org,2002:seq', items, flow_style=is_short)


for _class in (_Loader, _Dumper):
    _class.add_implicit_resolver(
        _FLOAT_TAG, re.compile(f'^{_EXPONENT.pattern}$'), [*'-+.0123456789']
    )
_Dumper.add_representer(tuple, _represent_tuple)


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where values came from: to name it in errors, and to read what it refers to."""

    label: str  # a file's path, or what else to call it
    folder: Path  # relative files are looked for here
    text: str  # the YAML, '' if there is none


def shown(value: object) -> str:
    """A wrong value, as short text on one line."""
    if value is None:
        return 'empty'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return {'nan': '.nan', 'inf': '.inf', '-inf': '-.inf'}.get(str(value), str(value))
    text = repr([*value] if isinstance(value, tuple) else value)
    return text if len(text) <= _MAX_SHOWN else f'{text[: _MAX_SHOWN - 3]}...'


def dump(values: Mapping[str, object]) -> str:
    """YAML text that depends on the values alone."""
    text: str = yaml.dump(
        dict(values), Dumper=_Dumper, sort_keys=False, width=99, allow_unicode=True
    )
    return text


def read_value(source: Source) -> object:
    """The value that YAML text stands for; None for an empty text.

    Raises:
        ConfigError: naming the line where it stops being YAML.
    """
    try:
        _check_size(source)
        return yaml.load(source.text, Loader=_Loader)
    except ConfigError:
        raise
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        reason = ', '.join(filter(None, (error.context, error.problem)))
        raise ConfigError(f'{source.label}:{line}: is not valid YAML: {reason}') from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = ' '.join(str(error).split())
        raise ConfigError(f'{source.label}: is not valid YAML: {reason}') from error


def _check_size(source: Source) -> None:
    """Refuse texts that would exhaust the process that reads them.

    Raises:
        ConfigError: values nest too deep, or aliases make too many of them.
    """
    sizes: dict[str | None, int] = {}  # values below an anchor, aliases written out
    open_nodes: list[tuple[str | None, int]] = []  # anchor, and values before the node
    n_values = 0
    for event in yaml.parse(source.text, Loader=_Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            open_nodes.append((event.anchor, n_values))
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, n_before = open_nodes.pop()
            sizes[anchor] = n_values - n_before
        elif isinstance(event, yaml.NodeEvent):
            n_values += sizes.get(event.anchor, 1) if isinstance(event, yaml.AliasEvent) else 1
        if len(open_nodes) > _MAX_DEPTH or n_values > _MAX_VALUES:
            mark = event.start_mark
            where = f'{source.label}:{mark.line + 1 if mark else 1}'
            limits = f'{_MAX_DEPTH} levels and {_MAX_VALUES:,} values'
            raise ConfigError(f'{where}: is too large: must keep within {limits}')


def line_of(text: str, keys: Keys) -> int | None:
    """The line of a value, or of the last thing on the way to it that is there."""
    node = yaml.compose(text, Loader=_Loader) if text else None
    line = None
    for key in keys:
        if isinstance(node, yaml.MappingNode):
            pairs = {key_node.value: (key_node, value) for key_node, value in node.value}
            if str(key) not in pairs:
                return line
            key_node, node = pairs[str(key)]
            line = key_node.start_mark.line + 1
        elif (
            isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value)
        ):
            node = node.value[key]
            line = node.start_mark.line + 1
        else:
            return line
    return line

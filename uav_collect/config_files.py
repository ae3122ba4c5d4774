"""Layered YAML files: `extends`, overrides, and where each value came from.

Knows nothing of scenarios. Every error is one line: file and line, key path, value,
what is allowed.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
import os
from pathlib import Path
import re
from typing import Any

import yaml

Keys = tuple[str | int, ...]  # the way to a value: mapping keys and list indices

_MAX_LINES = 10  # of one error message
_MAX_SHOWN = 60  # characters of a wrong value
_SUFFIXES = ('.yaml', '.yml')

# YAML 1.1 reads 1e-3 and 1.5e6 as text; YAML 1.2, and everybody who writes them, as numbers.
_EXPONENT = re.compile(r'[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+')
_FLOAT_TAG = 'tag:yaml.org,2002:float'
_MERGE_TAG = 'tag:yaml.org,2002:merge'


class ConfigError(ValueError):
    """A configuration that cannot be used: one line per problem, ready to be shown."""

    def __init__(self, *problems: str) -> None:
        """Keep the problems; the message shows the first ten."""
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        """One line per problem."""
        left_out = len(self.problems) - _MAX_LINES
        more = [f'... and {left_out} more problems'] if left_out > 0 else []
        return '\n'.join([*self.problems[:_MAX_LINES], *more])


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
    """Where values came from."""

    label: str  # a file's path, or what else to call it
    folder: Path  # relative files are looked for here
    text: str  # the YAML, '' if there is none


_OVERRIDE = Source(label='override', folder=Path(), text='')


@dataclass(frozen=True, kw_only=True)
class Document:
    """The values of a stack of files and overrides, each with its source."""

    values: dict[Any, Any]
    origins: dict[Keys, Source]  # of the subtree at each path; the longest path counts
    aliases: dict[Keys, Keys]  # values that were written elsewhere: path here, path there
    top: Source

    def at(self, keys: Keys) -> Any:  # noqa: ANN401 - any YAML
        """The value at a path; None where there is none."""
        value: Any = self.values
        for key in keys:
            value = value[key] if _contains(value, key) else None
        return value

    def source(self, keys: Keys) -> Source:
        """Where the value at a path came from; the top file for one that is nowhere."""
        return next((self.origins[p] for p in _prefixes(keys) if p in self.origins), self.top)

    def problem(self, keys: Keys, what: str) -> str:
        """The line that reports a problem at a path."""
        written = next((path for path in _prefixes(keys) if path in self.aliases), ())
        if written:
            keys = self.aliases[written] + keys[len(written) :]
        source = self.source(keys)
        line = _line_of(source.text, keys)
        place = source.label if line is None else f'{source.label}:{line}'
        return f'{place}: {dotted(keys)} {what}'


def dotted(keys: Keys) -> str:
    """A path as the user writes it."""
    return '.'.join(str(key) for key in keys)


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


def parse(text: str, *, label: str, folder: Path) -> Document:
    """Read one YAML text that stands alone.

    Raises:
        ConfigError: it is not YAML, or not a mapping.
    """
    source = Source(label=label, folder=folder, text=text)
    values = _mapping_of(source)
    return Document(values=values, origins={}, aliases={}, top=source)


def parse_value(text: str) -> object:
    """Read a value from the command line, as YAML.

    Raises:
        ConfigError: it is not YAML.
    """
    return _yaml_of(Source(label='override', folder=Path(), text=text))


def read(path: Path, library: Iterable[Path]) -> Document:
    """Read a file and, below it, the files it extends.

    Args:
        path: the YAML file.
        library: folders with files that `extends` may call by name alone.

    Raises:
        ConfigError: a file is missing or unreadable, is not a YAML mapping, or extends itself.
    """
    library = tuple(library)
    chain: list[Source] = []
    layers: list[dict[Any, Any]] = []
    referrer = ''
    while True:
        if any(os.path.realpath(source.label) == os.path.realpath(path) for source in chain):
            way = ' -> '.join([*(source.label for source in chain), str(path)])
            raise ConfigError(f'{chain[0].label}: extends must not lead back to itself: {way}')
        source = Source(label=str(path), folder=path.parent, text=_text_of(path, referrer))
        values = _mapping_of(source)
        chain.append(source)
        layers.append({key: value for key, value in values.items() if key != 'extends'})
        if 'extends' not in values:
            break
        path, referrer = _extended(values['extends'], source, library), f'{source.label}: extends '
    merged: Any = {}
    origins: dict[Keys, Source] = {}
    for source, layer in zip(reversed(chain), reversed(layers), strict=True):
        merged = _merged(merged, layer, (), source, origins)
    return Document(values=merged, origins=origins, aliases={}, top=chain[0])


def find(name_or_path: str, folders: Iterable[Path], *, field: str) -> Path:
    """The file that a name or a path stands for.

    Raises:
        ConfigError: no such file; the message lists the names there are.
    """
    if name_or_path.endswith(_SUFFIXES) or os.sep in name_or_path:
        return Path(name_or_path)
    folders = tuple(folders)
    for folder in folders:
        if (folder / f'{name_or_path}.yaml').is_file():
            return folder / f'{name_or_path}.yaml'
    names = names_in(folders)
    raise ConfigError(
        f'{field} is {name_or_path!r}: must be a .yaml file or one of {", ".join(names) or "none"}'
    )


def names_in(folders: Iterable[Path]) -> tuple[str, ...]:
    """The names that `find` finds in some folders."""
    return tuple(sorted({file.stem for folder in folders for file in folder.glob('*.yaml')}))


def override(document: Document, overrides: Mapping[str, object]) -> Document:
    """Replace values by dotted path; list entries by their index (`fleet.uavs.0.speed_mps`).

    Raises:
        ConfigError: a path runs through something that has no such entry.
    """
    values: Any = document.values
    origins = dict(document.origins)
    for path, value in overrides.items():
        keys = tuple(int(key) if key.isdecimal() else key for key in path.split('.'))
        values = _replaced(values, keys, value, path)
        # A list of numbers is one value: with one of them replaced, it is no longer the file's.
        is_of_list = isinstance(keys[-1], int) and not isinstance(value, dict)
        written = keys[:-1] if is_of_list else keys
        _forget(origins, written)
        origins[written] = _OVERRIDE
    return replace(document, values=values, origins=origins)


def merged_mapping(base: Mapping[Any, Any], top: Mapping[Any, Any]) -> dict[Any, Any]:
    """The base with the entries of the top laid over it, level by level."""
    merged: dict[Any, Any] = _merged(dict(base), dict(top), (), _OVERRIDE, {})
    return merged


def _prefixes(keys: Keys) -> Iterator[Keys]:
    return (keys[:length] for length in range(len(keys), 0, -1))


def _merged(
    base: object, top: object, keys: Keys, source: Source, origins: dict[Keys, Source]
) -> Any:  # noqa: ANN401 - any YAML
    if isinstance(base, dict) and isinstance(top, dict) and not _is_one_value(keys, base, top):
        merged = dict(base)
        for key, value in top.items():
            merged[key] = _merged(base.get(key), value, (*keys, key), source, origins)
        return merged
    _forget(origins, keys)
    origins[keys] = source
    return top


def _is_one_value(keys: Keys, base: dict[Any, Any], top: dict[Any, Any]) -> bool:
    # A place or another kind of thing replaces what it stands over: half of each would be neither.
    return keys[-1:] in {('start',), ('home',)} or top.get('kind', base.get('kind')) != base.get(
        'kind'
    )


def _forget(origins: dict[Keys, Source], keys: Keys) -> None:
    for known in [known for known in origins if known[: len(keys)] == keys]:
        del origins[known]


def _replaced(values: Any, keys: Keys, value: object, path: str) -> Any:  # noqa: ANN401 - any YAML
    if not keys:
        return value
    first, *rest = keys
    if isinstance(values, dict):
        return {**values, first: _replaced(values.get(first, {}), tuple(rest), value, path)}
    if not _contains(values, first):
        raise ConfigError(f'override: {path} has no place: {first!r} is not in {shown(values)}')
    entries = list(values)
    entries[int(first)] = _replaced(values[first], tuple(rest), value, path)
    return entries


def _contains(value: object, key: str | int) -> bool:
    if isinstance(value, dict):
        return key in value
    return isinstance(value, list | tuple) and isinstance(key, int) and 0 <= key < len(value)


def _extended(name: object, source: Source, library: tuple[Path, ...]) -> Path:
    if not isinstance(name, str) or not name or not name.isprintable():
        raise ConfigError(
            f'{source.label}: extends is {shown(name)}: must be a .yaml file or a scenario name'
        )
    return source.folder / find(name, library, field=f'{source.label}: extends')


def _text_of(path: Path, referrer: str) -> str:
    try:
        return path.read_bytes().decode()
    except OSError as error:
        raise ConfigError(f'{referrer}{path}: cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b'\n') + 1
        raise ConfigError(
            f'{referrer}{path}:{line}: must be UTF-8 text: {error.reason}'
        ) from error


def _mapping_of(source: Source) -> dict[Any, Any]:
    values = _yaml_of(source)
    if not isinstance(values, dict):
        raise ConfigError(f'{source.label}: is {shown(values)}: must be a mapping of keys')
    return values


def _yaml_of(source: Source) -> object:
    try:
        return yaml.load(source.text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        reason = ', '.join(filter(None, (error.context, error.problem)))
        raise ConfigError(f'{source.label}:{line}: is not valid YAML: {reason}') from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = ' '.join(str(error).split())
        raise ConfigError(f'{source.label}: is not valid YAML: {reason}') from error


def _line_of(text: str, keys: Keys) -> int | None:
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

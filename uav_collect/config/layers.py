"""Layered YAML files: `extends`, overrides, and where each value came from.

Knows nothing of scenarios. Every error is one line: file and line, key path, value, what is
allowed.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import takewhile
import os
from pathlib import Path
import re
from typing import Any

from uav_collect.config.yaml_text import (
    dotted,
    Keys,
    MAX_BYTES,
    read_value,
    shown,
    shown_path,
    Source,
)
from uav_collect.errors import ConfigError
from uav_collect.files import read_bounded
from uav_collect.limits import is_name, NAME_ALLOWED

_SUFFIXES = ('.yaml', '.yml')
_MAX_EXTENDS = 1_000  # characters
_MAX_FILES = 20  # that extend each other
_MAX_KEYS = 50  # of a path
_MAX_DIGITS = 10  # of an index

_OVERRIDE = Source(label='override', folder=Path())

# Ways to say one thing, each by the keys that it takes.
Ways = tuple[frozenset[str], ...]


@dataclass(frozen=True)
class _Origin:
    """Where a value came from, and those of its parts that came from elsewhere."""

    source: Source
    below: dict[Any, '_Origin'] = field(default_factory=dict)  # by key or index


@dataclass(frozen=True, kw_only=True)
class Document:
    """The values of a stack of files and overrides, each with its source."""

    values: dict[Any, Any]
    top: Source
    origin: _Origin | None = None  # None: all came from the top
    aliases: dict[Keys, Keys] = field(default_factory=dict)  # by path, the path it was written at
    ways: tuple[Ways, ...] = ()  # to say one thing: the topmost layer's way counts

    def at(self, keys: Keys) -> Any:  # noqa: ANN401 - any YAML
        """The value at a path; None where there is none."""
        value: Any = self.values
        for key in keys:
            value = value[key] if _contains(value, key) else None
        return value

    def source(self, keys: Keys) -> Source:
        """Where the value at a path came from; the top file for one that is nowhere."""
        source, origin = self.top, self.origin
        for key in keys:
            origin = origin.below.get(key) if origin is not None else None
            if origin is None:
                break
            source = origin.source
        return source

    def problem(self, keys: Keys, what: str) -> str:
        """The line that reports a problem at a path."""
        written = next((path for path in _prefixes(keys) if path in self.aliases), ())
        if written:
            keys = self.aliases[written] + keys[len(written) :]
        source = self.source(keys)
        line = source.line_of(keys)
        place = source.label if line is None else f'{source.label}:{line}'
        return f'{place}: {dotted(keys)} {what}'


def parse(text: str, *, label: str, folder: Path) -> Document:
    """Read one YAML text that stands alone.

    Raises:
        ConfigError: it is not YAML, or not a mapping.
    """
    values, source = _mapping_of(text, label, folder)
    return Document(values=values, top=source)


def of_mapping(values: Mapping[str, Any], *, label: str) -> Document:
    """Values that stand in no file.

    Args:
        label: what to call them in errors.
    """
    return Document(values=dict(values), top=Source(label=label, folder=Path()))


def parse_value(text: str) -> object:
    """Read a value from the command line, as YAML.

    Raises:
        ConfigError: it is not YAML.
    """
    value, _ = read_value(text, _OVERRIDE.label)
    return value


def read(path: Path, library: Iterable[Path], ways: tuple[Ways, ...] = ()) -> Document:
    """Read a file and, below it, the files it extends.

    Args:
        path: the YAML file.
        library: folders with files that `extends` may call by name alone.
        ways: to say one thing; of a file and those below it, the topmost way that is used counts.

    Raises:
        ConfigError: a file is missing or unreadable, is not a YAML mapping, or extends itself.
    """
    layers = [*_layers(path, tuple(library))]
    merged: Any = {}
    origin = _Origin(layers[0][0])
    for source, values in reversed(layers):
        merged, origin = _merged(merged, origin, values, (), source, ways)
    return Document(values=merged, origin=origin, top=layers[0][0], ways=ways)


def _layers(path: Path, library: tuple[Path, ...]) -> Iterator[tuple[Source, dict[Any, Any]]]:
    """A file, what it extends, and so on; each with its own values."""
    way: list[Path] = []
    first = extended_by = ''
    while True:
        if any(os.path.realpath(above) == os.path.realpath(path) for above in way):
            circle = shown_path(' -> '.join(map(str, [*way, path])))
            raise ConfigError(f'{first} must not lead back to itself: {circle}')
        if len(way) == _MAX_FILES:
            raise ConfigError(
                f'{extended_by}{shown_path(path)}: must be one of at most {_MAX_FILES} files that '
                'extend each other'
            )
        text = read_text(path, extended_by)
        values, source = _mapping_of(text, shown_path(path), path.parent)
        yield source, {key: value for key, value in values.items() if key != 'extends'}
        if 'extends' not in values:
            return
        way.append(path)
        extends = f'{source.label}:{source.line_of(("extends",))}: extends'
        first, extended_by = first or extends, f'{extends} '
        path = source.folder / _extended(values['extends'], extends, library)


def is_path(name_or_path: str) -> bool:
    """Whether a text is the path of a file rather than a name that folders are searched for."""
    return name_or_path.endswith(_SUFFIXES) or os.sep in name_or_path


def find(name_or_path: str, folders: Iterable[Path], *, field: str) -> Path:
    """The file that a name or a path stands for.

    Raises:
        ConfigError: no such file; the message lists the names there are.
    """
    if is_path(name_or_path):
        return Path(name_or_path)
    folders = tuple(folders)
    for folder in folders:
        if is_file(folder / f'{name_or_path}.yaml'):
            return folder / f'{name_or_path}.yaml'
    names = ', '.join(names_in(folders)) or 'none'
    raise ConfigError(f'{field} is {shown(name_or_path)}: must be a .yaml file or one of {names}')


def load(
    name_or_path: str | Path,
    folders: tuple[Path, ...],
    *,
    field: str,
    overrides: Mapping[str, object] | None = None,
    ways: tuple[Ways, ...] = (),
) -> Document:
    """Read a file by its name in folders or by its path, with what it extends.

    Args:
        field: what is read, for messages.
        overrides: values by dotted path, which count more than the file's.
        ways: to say one thing, see `read`.

    Raises:
        ConfigError: there is no such file, or it cannot be used.
    """
    path = find(str(name_or_path), folders, field=field)
    document = read(path, folders, ways)
    # A name belongs to one file; what extends it is something else.
    has_name = 'name' in document.values and document.source(('name',)) is document.top
    if has_name or 'name' in (overrides or {}):
        return override(document, overrides or {})
    if not is_name(path.stem):
        what = f'must be {NAME_ALLOWED}, as the file name {shown(path.stem)} is not'
        raise ConfigError(f'{document.top.label}: name is missing: {what}')
    return override(document, {'name': path.stem, **(overrides or {})})


def names_in(folders: Iterable[Path]) -> tuple[str, ...]:
    """The names that `find` finds in some folders."""
    return tuple(sorted({file.stem for folder in folders for file in folder.glob('*.yaml')}))


def titles_in(folders: Iterable[Path]) -> dict[str, str]:
    """What each file of some folders is, by its name: how the comment that it begins with begins.

    A title ends with the first stop, colon, semicolon or bracket; a file without one has ''.
    """
    folders = tuple(folders)
    return {
        name: _title_of(read_text(find(name, folders, field=name))) for name in names_in(folders)
    }


def _title_of(text: str) -> str:
    lines = takewhile(lambda line: line.startswith('#'), text.splitlines())
    comment = ' '.join(line.lstrip('# ') for line in lines)
    return re.split(r'[.:;](?:\s|$)|\s\(', comment, maxsplit=1)[0]


def override(document: Document, overrides: Mapping[str, object]) -> Document:
    """Replace values by dotted path; list entries by their index (`fleet.uavs.0.speed_mps`).

    Raises:
        ConfigError: a path runs through something that has no such entry.
    """
    values: Any = document.values
    origin = document.origin or _Origin(document.top)
    for path, value in overrides.items():
        keys = _keys_of(path)
        values = _replaced(values, keys, value, path, document.ways)
        # A list of numbers is one value: with one of them replaced, it is no longer the file's.
        is_of_list = isinstance(keys[-1], int) and not isinstance(value, dict)
        origin = _with_override(origin, keys[:-1] if is_of_list else keys)
    return replace(document, values=values, origin=origin)


def _keys_of(path: str) -> Keys:
    keys = path.split('.')
    if len(keys) > _MAX_KEYS:
        raise ConfigError(
            f'override: {shown(path)} has {len(keys)} keys: must have at most {_MAX_KEYS}'
        )
    return tuple(int(key) if key.isdecimal() and len(key) < _MAX_DIGITS else key for key in keys)


def _with_override(origin: _Origin, keys: Keys) -> _Origin:
    if not keys:
        return _Origin(_OVERRIDE)
    first, *rest = keys
    below = origin.below.get(first, _Origin(origin.source))
    return replace(origin, below={**origin.below, first: _with_override(below, tuple(rest))})


def merged_mapping(
    base: Mapping[Any, Any], top: Mapping[Any, Any], ways: tuple[Ways, ...] = ()
) -> dict[Any, Any]:
    """The base with the entries of the top laid over it, level by level; ways as in `read`."""
    merged, _ = _merged(dict(base), _Origin(_OVERRIDE), dict(top), (), _OVERRIDE, ways)
    return dict(merged)


def without_other_ways(
    base: Mapping[Any, Any], said: Iterable[Any], ways: tuple[Ways, ...]
) -> dict[Any, Any]:
    """The base without what says in another way what some keys of a layer above say."""
    left, said = dict(base), {*said}
    for group in ways:
        of_group: frozenset[str] = frozenset().union(*group)
        if said & of_group:
            kept = frozenset().union(*(way for way in group if said & of_group <= way))
            left = {key: value for key, value in left.items() if key not in of_group - kept}
    return left


def is_file(path: Path) -> bool:
    """Whether there is such a file, or a pipe, or what else is no folder."""
    return os.path.exists(path) and not os.path.isdir(path)


def read_text(path: Path, referrer: str = '') -> str:
    """The text of a configuration file.

    Args:
        referrer: begins the line of an error: what named the file.

    Raises:
        ConfigError: it is missing, no ordinary file, too large, or no UTF-8.
    """
    label = f'{referrer}{shown_path(path)}'
    try:
        return read_bounded(path, MAX_BYTES).decode('utf-8-sig')
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b'\n') + 1
        raise ConfigError(f'{label}:{line}: must be UTF-8 text: {error.reason}') from error
    except OSError as error:
        raise ConfigError(f'{label}: cannot be read: {error.strerror}') from error


def _prefixes(keys: Keys) -> Iterator[Keys]:
    return (keys[:length] for length in range(len(keys), 0, -1))


def _merged(
    base: object,
    origin: _Origin,
    top: object,
    keys: Keys,
    source: Source,
    ways: tuple[Ways, ...],
) -> tuple[Any, _Origin]:
    """The base with the top laid over it, and where each came from."""
    if not (isinstance(base, dict) and isinstance(top, dict)) or _is_one_value(keys, base, top):
        return top, _Origin(source)
    merged, below = without_other_ways(base, top, ways), dict(origin.below)
    for key, value in top.items():
        origin_below = below.get(key, _Origin(origin.source))
        merged[key], below[key] = _merged(
            base.get(key), origin_below, value, (*keys, key), source, ways
        )
    return merged, replace(origin, below=below)


def _is_one_value(keys: Keys, base: dict[Any, Any], top: dict[Any, Any]) -> bool:
    # A place or another kind of thing replaces what it stands over: half of each would be neither.
    kind = base.get('kind')
    is_whole = keys[-1:] in {('start',), ('home',)} or 'like' in top
    return is_whole or (kind is not None and top.get('kind', kind) != kind)


def _replaced(
    values: Any,  # noqa: ANN401 - any YAML
    keys: Keys,
    value: object,
    path: str,
    ways: tuple[Ways, ...],
) -> Any:  # noqa: ANN401
    if not keys:
        return value
    first, *rest = keys
    if isinstance(values, dict):
        below = _replaced(values.get(first, {}), tuple(rest), value, path, ways)
        return {**without_other_ways(values, (first,), ways), first: below}
    if not _contains(values, first):
        what = f'has no place: {shown(first)} is not in {shown(values)}'
        raise ConfigError(f'override: {shown_path(path)} {what}')
    entries = list(values)
    entries[int(first)] = _replaced(values[first], tuple(rest), value, path, ways)
    return entries


def _contains(value: object, key: str | int) -> bool:
    if isinstance(value, dict):
        return key in value
    return isinstance(value, list | tuple) and isinstance(key, int) and 0 <= key < len(value)


def _extended(name: object, field: str, library: tuple[Path, ...]) -> Path:
    is_short = isinstance(name, str) and 1 <= len(name) <= _MAX_EXTENDS
    if not isinstance(name, str) or not is_short or not name.isprintable():
        raise ConfigError(f'{field} is {shown(name)}: must be a .yaml file or a scenario name')
    return find(name, library, field=field)


def _mapping_of(text: str, label: str, folder: Path) -> tuple[dict[Any, Any], Source]:
    values, place = read_value(text, label)
    if not isinstance(values, dict):
        raise ConfigError(f'{label}: is {shown(values)}: must be a mapping of keys')
    return values, Source(label=label, folder=folder, place=place)

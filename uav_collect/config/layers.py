"""Layered YAML files: `extends`, overrides, and where each value came from.

Knows nothing of scenarios. Every error is one line: file and line, key path, value, what is
allowed.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
import os
from pathlib import Path
from typing import Any

from uav_collect.config.yaml_text import Keys, line_of, read_value, shown, Source
from uav_collect.errors import ConfigError

_SUFFIXES = ('.yaml', '.yml')

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
        line = line_of(source.text, keys)
        place = source.label if line is None else f'{source.label}:{line}'
        return f'{place}: {dotted(keys)} {what}'


def dotted(keys: Keys) -> str:
    """A path as the user writes it."""
    return '.'.join(str(key) for key in keys)


def parse(text: str, *, label: str, folder: Path) -> Document:
    """Read one YAML text that stands alone.

    Raises:
        ConfigError: it is not YAML, or not a mapping.
    """
    source = Source(label=label, folder=folder, text=text)
    values = _mapping_of(source)
    return Document(values=values, origins={}, aliases={}, top=source)


def of_mapping(values: Mapping[str, Any], *, label: str) -> Document:
    """Values that stand in no file.

    Args:
        label: what to call them in errors.
    """
    source = Source(label=label, folder=Path(), text='')
    return Document(values=dict(values), origins={}, aliases={}, top=source)


def parse_value(text: str) -> object:
    """Read a value from the command line, as YAML.

    Raises:
        ConfigError: it is not YAML.
    """
    return read_value(Source(label='override', folder=Path(), text=text))


def read(path: Path, library: Iterable[Path]) -> Document:
    """Read a file and, below it, the files it extends.

    Args:
        path: the YAML file.
        library: folders with files that `extends` may call by name alone.

    Raises:
        ConfigError: a file is missing or unreadable, is not a YAML mapping, or extends itself.
    """
    layers = [*_layers(path, tuple(library))]
    merged: Any = {}
    origins: dict[Keys, Source] = {}
    for source, values in reversed(layers):
        merged = _merged(merged, values, (), source, origins)
    return Document(values=merged, origins=origins, aliases={}, top=layers[0][0])


def _layers(path: Path, library: tuple[Path, ...]) -> Iterator[tuple[Source, dict[Any, Any]]]:
    """A file, what it extends, and so on; each with its own values."""
    way: list[str] = []
    extended_by = ''
    while True:
        if any(os.path.realpath(above) == os.path.realpath(path) for above in way):
            circle = ' -> '.join([*way, str(path)])
            raise ConfigError(f'{way[0]}: extends must not lead back to itself: {circle}')
        source = Source(label=str(path), folder=path.parent, text=_text_of(path, extended_by))
        values = _mapping_of(source)
        yield source, {key: value for key, value in values.items() if key != 'extends'}
        if 'extends' not in values:
            return
        way.append(source.label)
        extended_by = f'{source.label}: extends '
        path = _extended(values['extends'], source, library)


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


def load(
    name_or_path: str | Path,
    folders: tuple[Path, ...],
    *,
    field: str,
    overrides: Mapping[str, object] | None = None,
) -> Document:
    """Read a file by its name in folders or by its path, with what it extends.

    Args:
        field: what is read, for messages.
        overrides: values by dotted path, which count more than the file's.

    Raises:
        ConfigError: there is no such file, or it cannot be used.
    """
    path = find(str(name_or_path), folders, field=field)
    document = read(path, folders)
    # A name belongs to one file; what extends it is something else.
    has_name = 'name' in document.values and document.source(('name',)) is document.top
    named = {} if has_name else {'name': path.stem}
    return override(document, {**named, **(overrides or {})})


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
    kind = base.get('kind')
    return keys[-1:] in {('start',), ('home',)} or top.get('kind', kind) != kind


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
        return path.read_bytes().decode('utf-8-sig')
    except OSError as error:
        raise ConfigError(f'{referrer}{path}: cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b'\n') + 1
        raise ConfigError(
            f'{referrer}{path}:{line}: must be UTF-8 text: {error.reason}'
        ) from error


def _mapping_of(source: Source) -> dict[Any, Any]:
    values = read_value(source)
    if not isinstance(values, dict):
        raise ConfigError(f'{source.label}: is {shown(values)}: must be a mapping of keys')
    return values

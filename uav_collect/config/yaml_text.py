"""YAML text: read strictly, written so that equal values give equal bytes.

What is read: mappings, lists, text, whole numbers and fractions in decimal digits, true and false,
and nothing. What else YAML has is refused, or text: tags, merge keys, 0x1f, 1:30, 2024-01-01.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
import re
from typing import Any, NamedTuple

from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_NO_FLY_CORNERS, MAX_SENSORS
import yaml

Keys = tuple[str | int, ...]  # the way to a value: mapping keys and list indices

MAX_BYTES = 16 * 2**20  # of a text: the largest scenario, its ids of no Latin letters, has 12 MB

_MAX_SHOWN = 60  # characters of a wrong value, or of a key
_MAX_PATH = 200  # characters of a path
_MAX_DEPTH = 50  # of values in values
# Of a text, keys among them, and those of its aliases written out. The largest scenario has 9 for
# each sensor, 3 for each corner of a no-fly zone, and fewer than 40,000 more.
_MAX_VALUES = 9 * MAX_SENSORS + 3 * MAX_NO_FLY_CORNERS + 40_000
_MAX_ALIASES = 1_000
_MAX_KEYS = 1_000  # of a mapping
_MAX_DIGITS = 1_000  # of a number

_Loader: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)

_UNPRINTABLE = re.compile('[^\t\n\r -~\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]')
_NOTHING = ('', '~', 'null', 'Null', 'NULL')
_TRUTHS = {
    spelled: word in {'yes', 'true', 'on'}
    for word in ('yes', 'no', 'true', 'false', 'on', 'off')
    for spelled in (word, word.capitalize(), word.upper())
}
_WHOLE = re.compile('[-+]?(?:0|[1-9][0-9]*)')
# YAML 1.1 reads 1e-3 and 1.5e6 as text; YAML 1.2, and everybody who writes them, as numbers.
_EXPONENT = re.compile(r'[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+')
_FRACTION = re.compile(rf'[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+)|{_EXPONENT.pattern}')
_NOT_FINITE = re.compile(r'[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)')
_MERGE_KEY = '<<'


class _Dumper(yaml.SafeDumper):
    """Writes what is read here; short lists on one line."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _represent_tuple(dumper: _Dumper, items: tuple[object, ...]) -> yaml.Node:
    is_short = all(isinstance(item, float | int) for item in items)
    return dumper.represent_sequence('tag:yaml.org,2002:seq', items, flow_style=is_short)


_Dumper.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(f'^(?:{_FRACTION.pattern})$'), [*'-+.0123456789']
)
_Dumper.add_representer(tuple, _represent_tuple)


class Written(NamedTuple):
    """Where a value stands: an entry of a list itself, one of a mapping by its key."""

    line: int
    below: dict[Any, 'Written']  # by key, or index


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where values came from: to name it in errors, and to read what it refers to."""

    label: str  # a file's path, or what else to call it
    folder: Path  # relative files are looked for here
    place: Written | None = None  # of what a text holds; None: they stand in none

    def line_of(self, keys: Keys) -> int | None:
        """The line of a value, or of the last thing on the way to it that is there."""
        line, place = None, self.place
        for key in keys:
            place = place.below.get(key) if place is not None else None
            if place is None:
                break
            line = place.line
        return line


def shown(value: object) -> str:
    """A wrong value, as short text on one line."""
    if value is None:
        return 'empty'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return {'nan': '.nan', 'inf': '.inf', '-inf': '-.inf'}.get(str(value), str(value))
    try:
        text = repr([*value] if isinstance(value, tuple) else value)
    except ValueError:  # Python writes no number of so many digits
        return 'a number of thousands of digits'
    return text if len(text) <= _MAX_SHOWN else f'{text[: _MAX_SHOWN - 3]}...'


def dotted(keys: Keys) -> str:
    """A path as the user writes it, its keys in short on one line."""
    return _in_short('.'.join(map(_shown_key, keys)))


def _shown_key(key: object) -> str:
    text = key if isinstance(key, str) else shown(key)
    return text if text.isprintable() and len(text) <= _MAX_SHOWN else shown(text)


def shown_path(path: Path | str) -> str:
    """A path as users write it; escaped and shortened where it would not be one short line."""
    text = str(path)
    if not text.isprintable():
        text = text.encode('unicode_escape', 'surrogatepass').decode('ascii')
    return _in_short(text)


def _in_short(text: str) -> str:
    half = (_MAX_PATH - 3) // 2
    return text if len(text) <= _MAX_PATH else f'{text[:half]}...{text[-half:]}'


def dump(values: Mapping[str, object]) -> str:
    """YAML text that depends on the values alone."""
    text: str = yaml.dump(
        dict(values), Dumper=_Dumper, sort_keys=False, width=99, allow_unicode=True
    )
    return text


def read_value(text: str, label: str) -> tuple[Any, Written]:
    """The value that YAML text stands for, None for an empty text, and where it stands.

    Args:
        label: what to call the text in errors.

    Raises:
        ConfigError: naming the line where it stops to be YAML that is read here.
    """
    if len(text) > MAX_BYTES:
        raise ConfigError(
            f'{label}: has {len(text):,} characters: must have at most {MAX_BYTES:,}'
        )
    wrong = _UNPRINTABLE.search(text)
    if wrong:
        line = text.count('\n', 0, wrong.start()) + 1
        character = f'the character U+{ord(wrong.group()):04X}'
        raise ConfigError(f'{label}:{line}: is not valid YAML: {character} is not allowed')
    try:
        builder = _Builder()
        for event in yaml.parse(text, Loader=_Loader):
            builder.take(event)
        return builder.value, builder.place
    except _RefusedError as error:
        raise ConfigError(f'{label}:{error.line}: {error.what}') from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        reason = ', '.join(filter(None, (error.context, error.problem)))
        raise ConfigError(f'{label}:{line}: is not valid YAML: {reason}') from error
    except yaml.YAMLError as error:
        reason = ' '.join(str(error).split())
        raise ConfigError(f'{label}: is not valid YAML: {reason}') from error


class _RefusedError(Exception):
    """Something that is not read: its line, its path, and why."""

    def __init__(self, event: yaml.Event, keys: Keys, what: str) -> None:
        super().__init__(what)
        self.line, self.what = _line(event), f'{dotted(keys)} {what}'.lstrip()


class _Anchored(NamedTuple):
    """What an anchor names."""

    value: object
    below: dict[Any, Written]
    n_values: int


@dataclass
class _Open:
    """A mapping or a list that is being read."""

    value: dict[Any, Any] | list[Any]
    place: Written
    anchor: str | None
    n_before: int  # values before it
    key: Any = None  # of a mapping: whose value comes next
    key_line: int = 0  # of that key; 0: a key comes next


class _Builder:
    """Makes one value of the events of a text, and keeps the line of each part."""

    def __init__(self) -> None:
        self.value: Any = None
        self.place = Written(1, {})
        self._open: list[_Open] = []
        self._anchored: dict[str, _Anchored] = {}
        self._n_values = 0
        self._n_aliases = 0
        self._n_documents = 0

    def take(self, event: yaml.Event) -> None:
        """Take the next event.

        Raises:
            _RefusedError: it is something that is not read, or too much.
        """
        if isinstance(event, yaml.ScalarEvent):
            self._check_new(event)
            if event.implicit[0] and len(event.value) > _MAX_DIGITS and _is_number(event.value):
                what = f'has {len(event.value):,} digits: must have at most {_MAX_DIGITS:,}'
                raise self._refusal(event, what)
            value = _scalar(event)
            if event.anchor:
                self._anchored[event.anchor] = _Anchored(value, {}, 1)
            self._put(event, value, {})
        elif isinstance(event, yaml.CollectionStartEvent):
            self._check_new(event)
            self._start(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._end()
        elif isinstance(event, yaml.AliasEvent):
            self._alias(event)
        elif isinstance(event, yaml.DocumentStartEvent):
            self._n_documents += 1
            if self._n_documents > 1:
                what = 'expected a single document in the stream, but found another document'
                raise self._refusal(event, f'is not valid YAML: {what}')

    def _refusal(self, event: yaml.Event, what: str) -> _RefusedError:
        way = [it.key if isinstance(it.value, dict) else len(it.value) - 1 for it in self._open]
        if self._open and isinstance(self._open[-1].value, list):
            way[-1] += 1  # what is refused comes behind the entries that are there
        elif self._open and _wants_key(self._open[-1]):
            way.pop()
        return _RefusedError(event, tuple(way), what)

    def _check_new(self, event: Any) -> None:  # noqa: ANN401 - a scalar, or a collection's start
        if event.tag is not None:
            tag = event.tag.replace('tag:yaml.org,2002:', '!!')
            raise self._refusal(
                event, f'has the tag {shown(tag)}: must be without tags, as !!int or !name'
            )
        self._count(event, 1)

    def _count(self, event: yaml.Event, n_values: int) -> None:
        self._n_values += n_values
        if self._n_values > _MAX_VALUES:
            raise self._refusal(event, f'is too large: must have at most {_MAX_VALUES:,} values')

    def _start(self, event: yaml.CollectionStartEvent) -> None:
        if len(self._open) == _MAX_DEPTH:
            raise self._refusal(event, f'is nested too deep: must be at most {_MAX_DEPTH} levels')
        if self._open and _wants_key(self._open[-1]):
            raise self._refusal(event, 'has a key that is a list or a mapping: must be text')
        value: dict[Any, Any] | list[Any] = {} if isinstance(event, yaml.MappingStartEvent) else []
        place = Written(_line(event), {})
        self._anchored.pop(event.anchor or '', None)
        below = self._put(event, value, place.below)
        self._open.append(
            _Open(value=value, place=below, anchor=event.anchor, n_before=self._n_values - 1)
        )

    def _end(self) -> None:
        ended = self._open.pop()
        if ended.anchor:
            n_values = self._n_values - ended.n_before
            self._anchored[ended.anchor] = _Anchored(ended.value, ended.place.below, n_values)

    def _alias(self, event: yaml.AliasEvent) -> None:
        self._n_aliases += 1
        if self._n_aliases > _MAX_ALIASES:
            raise self._refusal(event, f'is too large: must have at most {_MAX_ALIASES:,} aliases')
        anchored = self._anchored.get(event.anchor or '')
        if anchored is None:
            inside = any(event.anchor == above.anchor for above in self._open)
            what = 'stands for itself' if inside else 'has no anchor before it'
            raise self._refusal(
                event, f'is not valid YAML: the alias {shown(event.anchor)} {what}'
            )
        self._count(event, anchored.n_values)
        self._put(event, anchored.value, anchored.below)

    def _put(self, event: yaml.Event, value: Any, below: dict[Any, Written]) -> Written:  # noqa: ANN401
        """Put a value where the text has it; returns its place."""
        if not self._open:
            self.value, self.place = value, Written(_line(event), below)
            return self.place
        parent = self._open[-1]
        if _wants_key(parent):
            self._take_key(event, parent, value)
            return self.place
        if isinstance(parent.value, dict):
            key, line, parent.key_line = parent.key, parent.key_line, 0
            parent.value[key] = value
        else:
            key, line = len(parent.value), _line(event)
            parent.value.append(value)
        place = parent.place.below[key] = Written(line, below)
        return place

    def _take_key(self, event: yaml.Event, parent: _Open, key: Any) -> None:  # noqa: ANN401
        if isinstance(key, dict | list):
            raise self._refusal(event, 'has a key that is a list or a mapping: must be text')
        if key == _MERGE_KEY and getattr(event, 'implicit', [False])[0]:
            raise self._refusal(event, 'has the key <<: must be without merge keys')
        if key in parent.value:
            raise self._refusal(event, f'is not valid YAML: the key {shown(key)} appears twice')
        if len(parent.value) == _MAX_KEYS:
            raise self._refusal(event, f'is too large: must have at most {_MAX_KEYS:,} keys')
        parent.key, parent.key_line = key, _line(event)


def _wants_key(parent: _Open) -> bool:
    return isinstance(parent.value, dict) and not parent.key_line


def _line(event: Any) -> int:  # noqa: ANN401 - any event, all of which have marks
    return int(event.start_mark.line) + 1


def _scalar(event: yaml.ScalarEvent) -> Any:  # noqa: ANN401 - any plain value
    text = event.value
    if not event.implicit[0]:  # in quotes, or a block of text
        return text
    if text in _NOTHING:
        return None
    if text in _TRUTHS:
        return _TRUTHS[text]
    if _WHOLE.fullmatch(text):
        return int(text)
    if _FRACTION.fullmatch(text):
        return float(text)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace('.', ''))
    return text


def _is_number(text: str) -> bool:
    return bool(_WHOLE.fullmatch(text) or _FRACTION.fullmatch(text))

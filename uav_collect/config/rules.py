"""What a configuration value may be, and the one line that says it is not.

Sections are frozen dataclasses, and their annotations are the schema; leaves carry a rule that has
its own words. The standard library does it all, for distributions differ in their validators.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, MISSING
from itertools import pairwise
import math
from types import NoneType
from typing import (
    Annotated,
    Any,
    ClassVar,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
    Literal,
    TypeVar,
)

from uav_collect.config.layers import Document
from uav_collect.config.yaml_text import Keys, shown
from uav_collect.errors import ConfigError
from uav_collect.limits import is_code_name, is_name, NAME_ALLOWED


@dataclass_transform(frozen_default=True, kw_only_default=True)
@dataclass(frozen=True, kw_only=True)
class Section:
    """A mapping of the file: every key known, none missing but those with a default.

    A key is a leaf (`Annotated[float, number(0, 1)]`), a word (`Literal`), a section, one of some
    sections by its key `kind` (`A | B`; `A | None` may be left out), a list of these
    (`tuple[A, ...]`), or a mapping in which anything may stand (`dict[str, Any]`).
    """

    _annotations: ClassVar[Mapping[str, object]] = {}  # what each key must be

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        dataclass(frozen=True, kw_only=True)(cls)
        hints = get_type_hints(cls, include_extras=True)
        cls._annotations = {field.name: hints[field.name] for field in fields(cls)}

    def as_mapping(self) -> dict[str, Any]:
        """The keys and their values, sections as mappings; without the keys that are None."""
        return asdict(
            self, dict_factory=lambda items: {key: it for key, it in items if it is not None}
        )


_Section = TypeVar('_Section', bound=Section)


@dataclass(frozen=True)
class Rule:
    """What a value must be: in words, and as a function that returns it or raises ValueError."""

    allowed: str
    parse: Callable[[object], Any]


@dataclass(frozen=True)
class Entries:
    """How many entries a list must have."""

    at_least: int
    at_most: int | None = None  # None: as many as there are


def number(low: float, high: float, unit: str = '', *, word: str = '') -> Rule:
    """A number from low to high, which may be infinite, or else one word."""

    def parse(value: object) -> object:
        if word and value == word:
            return value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError
        number = float(value)
        if not low <= number <= high:
            raise ValueError
        return number

    span = f'>= {low:.10g}' if high == math.inf else f'from {low:.10g} to {high:.10g}'
    unit = f' {unit}' if unit else ''
    also = f', or {word}' if word else ', or .inf' if high == math.inf else ''
    return Rule(f'a number {span}{unit}{also}', parse)


def whole(low: int, high: int) -> Rule:
    """An integer from low to high."""

    def parse(value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ValueError
        return value

    return Rule(f'a whole number from {low} to {high}', parse)


def truth() -> Rule:
    """True or false, and no number or word that might mean it."""

    def parse(value: object) -> bool:
        if not isinstance(value, bool):
            raise ValueError
        return value

    return Rule('true or false', parse)


def span(rule: Rule, allowed: str) -> Rule:
    """A list of two values under one rule, of which the second is not the smaller one."""

    def parse(value: object) -> object:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise ValueError
        low, high = rule.parse(value[0]), rule.parse(value[1])
        if low > high:
            raise ValueError
        return low, high

    return Rule(f'a list [low, high], low <= high, of {allowed}', parse)


def number_span(low: float, high: float, unit: str = '') -> Rule:
    """Two numbers in a range, the smaller one first."""
    unit_text = f' {unit}' if unit else ''
    allowed = f'numbers from {low:.10g} to {high:.10g}{unit_text}'
    return span(number(low, high, unit), allowed)


def whole_span(low: int, high: int) -> Rule:
    """Two whole numbers in a range, the smaller one first."""
    return span(whole(low, high), f'whole numbers from {low} to {high}')


def text(max_length: int) -> Rule:
    """Printable text, not empty."""

    def parse(value: object) -> str:
        if (
            not isinstance(value, str)
            or not value.isprintable()
            or not 1 <= len(value) <= max_length
        ):
            raise ValueError
        return value

    return Rule(f'text of 1 to {max_length} printable characters', parse)


def name() -> Rule:
    """What may stand for a thing in lines, tables and names of files."""

    def parse(value: object) -> str:
        if not isinstance(value, str) or not is_name(value):
            raise ValueError
        return value

    return Rule(NAME_ALLOWED, parse)


def either(rule: Rule, word: str) -> Rule:
    """A value under a rule, or else one word."""
    return Rule(
        f'{rule.allowed}, or {word}', lambda value: value if value == word else rule.parse(value)
    )


def words(*allowed: str) -> Rule:
    """One of some words."""

    def parse(value: object) -> object:
        if value not in allowed:
            raise ValueError
        return value

    return Rule(' or '.join(allowed), parse)


def words_or_code(*allowed: str) -> Rule:
    """One of some words, or the name of code of a user's."""

    def parse(value: object) -> object:
        if value not in allowed and not (isinstance(value, str) and is_code_name(value)):
            raise ValueError
        return value

    return Rule(' or '.join((*map(repr, allowed), 'module:Name')), parse)


def polygon(low: float, high: float, most_corners: int) -> Rule:
    """A list of three points [x, y] or more that do not lie on one line, from low to high [m]."""

    def parse(value: object) -> object:
        if not isinstance(value, list | tuple) or not 3 <= len(value) <= most_corners:
            raise ValueError
        corner = pair(number(low, high), '')
        corners = tuple(corner.parse(each) for each in value)
        (x_m, y_m), *others = corners
        ways = [(east_m - x_m, north_m - y_m) for east_m, north_m in others]
        # Those along each other lie on one line with the first corner; so do all, by turns.
        if all(a[0] * b[1] == a[1] * b[0] for a, b in pairwise(way for way in ways if any(way))):
            raise ValueError
        return corners

    span = f'of numbers from {low:.10g} to {high:.10g} m'
    return Rule(f'a list of 3 to {most_corners} points [x, y] {span}, not all on one line', parse)


def or_zero(rule: Rule) -> Rule:
    """A number under a rule, or else 0."""

    def parse(value: object) -> object:
        is_zero = isinstance(value, int | float) and not isinstance(value, bool) and value == 0
        return 0.0 if is_zero else rule.parse(value)

    return Rule(f'{rule.allowed}, or 0', parse)


def one_or_span(rule: Rule, allowed: str) -> Rule:
    """One value under a rule, or a list of two of which the second is not the smaller one."""

    def parse(value: object) -> object:
        if not isinstance(value, list | tuple):
            return rule.parse(value)
        low, high = (rule.parse(each) for each in value)
        if low > high:
            raise ValueError
        return low, high

    return Rule(f'{allowed}, or a list [low, high] of two', parse)


def pair(rule: Rule, allowed: str, *, word: str = '', is_span: bool = False) -> Rule:
    """A list of two values under one rule, or else one word; a span runs up to more than 0."""

    def parse(value: object) -> object:
        if word and value == word:
            return value
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise ValueError
        first, second = rule.parse(value[0]), rule.parse(value[1])
        if is_span and not (first <= second and second > 0):
            raise ValueError
        return first, second

    return Rule(allowed, parse)


def validated(section: type[_Section], document: Document, keys: Keys = ()) -> _Section:
    """The part of a document at a path, as a section.

    Raises:
        ConfigError: one line for each thing that is wrong.
    """
    reader = _Reader(document)
    read: _Section = reader.read(section, keys, document.at(keys))
    if reader.problems:
        raise ConfigError(*dict.fromkeys(reader.problems))
    return read


class _Reader:
    """Reads values as their annotations say; keeps a line for each that it refuses."""

    def __init__(self, document: Document) -> None:
        self.problems: list[str] = []
        self._document = document

    def read(self, annotation: object, keys: Keys, value: object) -> Any:  # noqa: ANN401
        """The value at a path; None if it is refused."""
        kind, note = _kind_and_note(annotation)
        if isinstance(note, Rule):
            return self._leaf(note, keys, value)
        origin = get_origin(kind)
        if origin is Literal:
            return value if value in get_args(kind) else self._refuse(keys, value, _allowed(kind))
        if origin is tuple:
            return self._list(get_args(kind)[0], note, keys, value)
        if not isinstance(value, dict):
            return self._refuse(keys, value, 'a mapping of keys')
        return self._mapping(keys, value) if origin is dict else self._section(kind, keys, value)

    def _leaf(self, rule: Rule, keys: Keys, value: object) -> object:
        try:
            return rule.parse(value)
        except (ValueError, OverflowError):
            return self._refuse(keys, value, rule.allowed)

    def _list(self, kind: object, bounds: object, keys: Keys, value: object) -> object:
        if not isinstance(value, list | tuple):
            return self._refuse(keys, value, 'a list')
        if isinstance(bounds, Entries):
            if len(value) < bounds.at_least:
                self._note(keys, f'has {len(value)} entries: must have at least {bounds.at_least}')
            if bounds.at_most is not None and len(value) > bounds.at_most:
                self._note(keys, f'has {len(value)} entries: must have at most {bounds.at_most}')
        return tuple(self.read(kind, (*keys, index), each) for index, each in enumerate(value))

    def _mapping(self, keys: Keys, value: dict[Any, Any]) -> dict[Any, Any]:
        for key in value:
            if not isinstance(key, str):
                self._note((*keys, key), 'is a key that is not text')
        return value

    def _section(self, kind: object, keys: Keys, value: dict[Any, Any]) -> Section | None:
        section = self._chosen(_sections_in(kind), keys, value)
        if section is None:
            return None
        annotations, values = section._annotations, {}
        for field in fields(section):
            below, annotation = (*keys, field.name), annotations[field.name]
            if field.name in value and not (value[field.name] is None is field.default):
                values[field.name] = self.read(annotation, below, value[field.name])
            elif field.default is MISSING:
                self._note(below, f'is missing: must be {_allowed(annotation)}')
        for key in self._mapping(keys, value):
            if isinstance(key, str) and key not in annotations:
                known = ', '.join(annotations)
                self._note((*keys, key), f'is an unknown key: must be one of {known}')
        return None if self.problems else section(**values)

    def _chosen(
        self, sections: tuple[type[Section], ...], keys: Keys, value: dict[Any, Any]
    ) -> type[Section] | None:
        """Of several sections, that whose `kind` is the mapping's."""
        if len(sections) == 1:
            return sections[0]
        kinds = {kind: it for it in sections for kind in get_args(it._annotations['kind'])}
        if 'kind' not in value:
            self._note((*keys, 'kind'), 'is missing')
            return None
        kind = value['kind']
        if isinstance(kind, str) and kind in kinds:
            return kinds[kind]
        self._refuse((*keys, 'kind'), kind, f'one of {", ".join(map(repr, kinds))}')
        return None

    def _refuse(self, keys: Keys, value: object, allowed: str) -> Any:  # noqa: ANN401 - None
        self._note(keys, f'is {shown(value)}: must be {allowed}')

    def _note(self, keys: Keys, what: str) -> None:
        self.problems.append(self._document.problem(keys, what))


def _kind_and_note(annotation: object) -> tuple[object, object]:
    """A type, without the None of a key that may be missing, and what `Annotated` notes of it."""
    if get_origin(annotation) is not Annotated:
        return annotation, None
    kind, note = get_args(annotation)
    others = [it for it in get_args(kind) if it is not NoneType]
    return others[0] if NoneType in get_args(kind) else kind, note


def _sections_in(kind: object) -> tuple[type[Section], ...]:
    """A section itself, or each of a union; None stands for one that is left out."""
    union = (kind,) if isinstance(kind, type) else get_args(kind)
    return tuple(section for section in union if section is not NoneType)


def _allowed(annotation: object) -> str:
    kind, note = _kind_and_note(annotation)
    if isinstance(note, Rule):
        return note.allowed
    origin = get_origin(kind)
    if origin is Literal:
        return ' or '.join(map(repr, get_args(kind)))
    if origin is dict:
        return 'a mapping of keys'
    if origin is tuple:
        entry = _allowed(get_args(kind)[0])
        is_mapping = entry.startswith('a mapping')
        return f'a list of mappings{entry.removeprefix("a mapping")}' if is_mapping else 'a list'
    sections = _sections_in(kind)
    known = ', '.join(sections[0]._annotations) if len(sections) == 1 else 'kind'
    return f'a mapping with {known}'

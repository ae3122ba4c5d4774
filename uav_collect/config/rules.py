"""What a configuration value may be, and the one line that says it is not.

Built on pydantic: sections are frozen models, leaves carry a rule that knows its own words.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any, get_args, get_origin, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import core_schema, ErrorDetails, PydanticCustomError
from uav_collect.config.layers import Document
from uav_collect.config.yaml_text import Keys, shown
from uav_collect.errors import ConfigError

_Model = TypeVar('_Model', bound=BaseModel)


class Section(BaseModel):
    """A mapping of the file: every key known, none missing, never changed."""

    model_config = ConfigDict(frozen=True, extra='forbid')


@dataclass(frozen=True)
class Rule:
    """What a value must be: in words, and as a function that returns it or raises ValueError."""

    allowed: str
    parse: Callable[[object], Any]

    def __get_pydantic_core_schema__(
        self, source: object, handler: object
    ) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._checked)

    def _checked(self, value: object) -> object:
        try:
            return self.parse(value)
        except (ValueError, OverflowError) as error:
            raise PydanticCustomError(
                'rule', 'must be {allowed}', {'allowed': self.allowed}
            ) from error


def number(
    low: float, high: float, unit: str = '', *, above: bool = False, word: str = ''
) -> Rule:
    """A finite number from low (excluded if `above`) to high, or else one word."""

    def parse(value: object) -> object:
        if word and value == word:
            return value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError
        number = float(value)
        if not low <= number <= high or (above and number == low):
            raise ValueError
        return number

    span = f'> {low:.10g} and <= {high:.10g}' if above else f'from {low:.10g} to {high:.10g}'
    if high == math.inf:
        span = f'>= {low:.10g}'
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


def validated(model: type[_Model], document: Document, keys: Keys = ()) -> _Model:
    """The part of a document at a path, as a model.

    Raises:
        ConfigError: one line for each thing that is wrong.
    """
    try:
        return model.model_validate(document.at(keys))
    except ValidationError as error:
        problems = [
            _problem(document, keys, details, model)
            for details in error.errors(include_url=False)
            if not _follows_from_another(details)
        ]
        raise ConfigError(*dict.fromkeys(problems)) from None


def _follows_from_another(details: ErrorDetails) -> bool:
    # pydantic counts only the valid entries of a list: an invalid one also makes it too short.
    return details['type'] == 'too_short' and len(details['input']) >= details['ctx']['min_length']


def _problem(
    document: Document, above: Keys, details: ErrorDetails, model: type[BaseModel]
) -> str:
    below, section = _walked(model, details['loc'])
    keys = (*above, *below)
    value = shown(details['input'])
    match details['type']:
        case 'rule':
            return document.problem(keys, f'is {value}: {details["msg"]}')
        case 'missing':
            return document.problem(keys, f'is missing: must be {_allowed(section, below[-1])}')
        case 'extra_forbidden':
            known = ', '.join(section.model_fields)
            return document.problem(keys, f'is an unknown key: must be one of {known}')
        case 'model_type' | 'model_attributes_type':
            return document.problem(keys, f'is {value}: must be a mapping of keys')
        case 'tuple_type':
            return document.problem(keys, f'is {value}: must be a list')
        case 'too_short' | 'too_long':
            return document.problem(keys, _wrong_length(details['ctx']))
        case 'invalid_key':
            return document.problem(keys, 'is a key that is not text')
        case 'literal_error':
            return document.problem(keys, f'is {value}: must be {details["ctx"]["expected"]}')
        case 'union_tag_invalid':
            tag, tags = details['ctx']['tag'], details['ctx']['expected_tags']
            return document.problem((*keys, 'kind'), f'is {shown(tag)}: must be one of {tags}')
        case 'union_tag_not_found':
            return document.problem((*keys, 'kind'), 'is missing')
        case _:
            return document.problem(keys, f'is {value}: {details["msg"]}')


def _walked(model: type[BaseModel], location: Keys) -> tuple[Keys, type[BaseModel]]:
    """The keys of pydantic's location without the tags of unions, and the section of the last."""
    keys: list[str | int] = []
    section, inner = model, [model]
    for part in location:
        if len(inner) > 1:  # a union: the part is the tag that chose one of it
            inner = [
                kind for kind in inner if part in get_args(kind.model_fields['kind'].annotation)
            ]
            continue
        keys.append(part)
        if isinstance(part, str):
            section = inner[0]
            field = section.model_fields.get(part)
            inner = _models_in(field.annotation) if field else []
    return tuple(keys), section


def _models_in(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _allowed(section: type[BaseModel], key: str | int) -> str:
    field = section.model_fields[str(key)]
    rules = [rule.allowed for rule in field.metadata if isinstance(rule, Rule)]
    if rules:
        return rules[0]
    if get_origin(field.annotation) is Literal:
        return ' or '.join(repr(word) for word in get_args(field.annotation))
    sections = _models_in(field.annotation)
    is_list = get_origin(field.annotation) is tuple
    known = ', '.join(sections[0].model_fields) if len(sections) == 1 else 'kind'
    return f'a list of mappings with {known}' if is_list else f'a mapping with {known}'


def _wrong_length(context: dict[str, Any]) -> str:
    bound = f'at least {context["min_length"]}' if 'min_length' in context else ''
    bound = bound or f'at most {context["max_length"]}'
    return f'has {context["actual_length"]} entries: must have {bound}'

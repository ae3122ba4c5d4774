"""A frozen policy's file: safetensors, the weights as float32, the header's fields beside them."""

from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass, MISSING
import json
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from uav_collect import files
from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.learned_on import LearnedOn
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy_network import FrozenPolicy, PolicyHeader, Validation
from uav_collect.uav.tensor_file import read_tensor_file, tensor_file

FORMAT = 'uav_collect.policy/1'
SUFFIX = '.safetensors'
_MAX_DIGITS = 19  # of a number in a header: 63 bits

_Value = Layout | Validation | tuple[LearnedOn, ...] | int | str  # of a header's field


def policy_bytes(policy: FrozenPolicy) -> bytes:
    """What a policy's file holds; the inverse is `policy_from_bytes`."""
    return tensor_file(policy.weights, _metadata(policy))


def policy_from_bytes(content: bytes) -> FrozenPolicy:
    """The policy that a file holds.

    Raises:
        PolicyMismatchError: one line: the field, its value, what it must be.
    """
    weights, metadata = read_tensor_file(content)
    _check_field('format', _field(metadata, 'format'), FORMAT)
    policy = FrozenPolicy(_header(metadata), weights)
    _check_field('digest', _field(metadata, 'digest'), policy.digest)
    return policy


def save_policy(path: Path, policy: FrozenPolicy) -> None:
    """Write a policy's file: whole or not at all.

    Raises:
        OSError: naming the file.
    """
    files.write_atomically(path, policy_bytes(policy))


def load_policy(path: Path) -> FrozenPolicy:
    """Read a policy's file.

    Raises:
        PolicyMismatchError: one line: the file, the field, its value, what it must be.
    """
    try:
        return policy_from_bytes(path.read_bytes())
    except OSError as error:
        raise PolicyMismatchError(f'{path}: cannot be read: {error.strerror or error}') from error
    except PolicyMismatchError as error:
        raise PolicyMismatchError(f'{path}: {error}') from error


def _metadata(policy: FrozenPolicy) -> dict[str, str]:
    texts = {
        field.name: _text(getattr(policy.header, field.name)) for field in fields(PolicyHeader)
    }
    return {'format': FORMAT, **texts, 'digest': policy.digest}


def _text(value: _Value) -> str:
    if isinstance(value, Layout):
        return value.label
    if isinstance(value, tuple):
        return json.dumps([asdict(each) for each in value])
    return json.dumps(asdict(value)) if isinstance(value, Validation) else str(value)


def _header(metadata: Mapping[str, str]) -> PolicyHeader:
    values: dict[str, Any] = {
        field.name: _parsed(field.name, field.type, _field(metadata, field.name))
        for field in fields(PolicyHeader)
        if field.default is MISSING or field.name in metadata  # files of before say less
    }
    return PolicyHeader(**values)


def _parsed(name: str, kind: object, text: str) -> _Value:
    if kind is Layout:
        known = {layout.label: layout for layout in Layout}
        if text not in known:
            raise PolicyMismatchError(f'{name} is {text!r}: must be {" or ".join(known)}')
        return known[text]
    if kind is Validation:
        return _validation(name, text)
    if kind == tuple[LearnedOn, ...]:
        return _learned_on(name, text)
    if kind is int:
        if not (text.isascii() and text.isdecimal() and len(text) <= _MAX_DIGITS):
            raise PolicyMismatchError(f'{name} is {text!r}: must be a whole number')
        return int(text)
    return text


def _validation(name: str, text: str) -> Validation:
    try:
        validation: Validation = _of_kind(Validation, json.loads(text))
    except (ValueError, RecursionError) as error:
        raise _unreadable(name, text, 'a JSON object', Validation) from error
    return validation


def _learned_on(name: str, text: str) -> tuple[LearnedOn, ...]:
    try:
        known: tuple[LearnedOn, ...] = _of_kind(tuple[LearnedOn, ...], json.loads(text))
    except (ValueError, RecursionError) as error:
        raise _unreadable(name, text, 'a JSON list of objects', LearnedOn) from error
    return known


def _unreadable(name: str, text: str, what: str, of: type[Any]) -> PolicyMismatchError:
    names = ', '.join(field.name for field in fields(of))
    return PolicyMismatchError(f'{name} is {text!r}: must be {what} of {names}')


def _field(metadata: Mapping[str, str], name: str) -> str:
    if name not in metadata:
        raise PolicyMismatchError(f'{name} is missing: it is no policy of {FORMAT}')
    return metadata[name]


def _check_field(name: str, value: str, wanted: str) -> None:
    if value != wanted:
        raise PolicyMismatchError(f'{name} is {value!r}: must be {wanted!r}')


def _of_kind(kind: Any, value: object) -> Any:  # noqa: ANN401 - of that kind
    """What JSON holds of a record, a tuple, a number or a text; raises ValueError for another."""
    if isinstance(kind, type) and is_dataclass(kind):
        kinds = get_type_hints(kind)
        # Files of before say less.
        wanted = {field.name for field in fields(kind) if field.default is MISSING}
        if not isinstance(value, dict) or not wanted <= value.keys() <= kinds.keys():
            raise ValueError
        return kind(**{name: _of_kind(kinds[name], each) for name, each in value.items()})
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        if not isinstance(value, list):
            raise ValueError
        if parts[-1] is ...:
            parts = parts[:1] * len(value)
        return tuple(_of_kind(part, each) for part, each in zip(parts, value, strict=True))
    if isinstance(value, bool) or not isinstance(value, int | float if kind is float else kind):
        raise ValueError
    return kind(value)

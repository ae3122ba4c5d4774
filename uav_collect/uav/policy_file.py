"""A frozen policy's file: safetensors, the weights as float32, the header's fields beside them."""

from collections.abc import Mapping
from dataclasses import asdict, fields, MISSING
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from uav_collect import files
from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.learned_on import LearnedOn
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy_network import FrozenPolicy, PolicyHeader, Validation, Weights

FORMAT = 'uav_collect.policy/1'
SUFFIX = '.safetensors'
_MAX_DIGITS = 19  # of a number in a header: 63 bits
_LENGTH_BYTE = 8  # of the length that a safetensors file begins with

_Value = Layout | Validation | tuple[LearnedOn, ...] | int | str  # of a header's field


def policy_bytes(policy: FrozenPolicy) -> bytes:
    """What a policy's file holds; the inverse is `policy_from_bytes`."""
    from safetensors.numpy import save

    tensors = {
        name: np.ascontiguousarray(tensor, dtype='<f4') for name, tensor in policy.weights.items()
    }
    return _in_order(save(tensors, _metadata(policy)))


def _in_order(content: bytes) -> bytes:
    """The same file, its head sorted: safetensors writes it in another order each time."""
    end = _LENGTH_BYTE + int.from_bytes(content[:_LENGTH_BYTE], 'little')
    metadata = json.loads(content[_LENGTH_BYTE:end])
    head = json.dumps(metadata, sort_keys=True, separators=(',', ':'), ensure_ascii=False).encode()
    if len(head) > end - _LENGTH_BYTE:
        raise RuntimeError(f'a head of {len(head)} bytes has no room in {end - _LENGTH_BYTE}')
    return content[:_LENGTH_BYTE] + head.ljust(end - _LENGTH_BYTE) + content[end:]


def policy_from_bytes(content: bytes) -> FrozenPolicy:
    """The policy that a file holds.

    Raises:
        PolicyMismatchError: one line: the field, its value, what it must be.
    """
    metadata, weights = _read(content)
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


def _read(content: bytes) -> tuple[dict[str, str], Weights]:
    """The strings and the tensors of a file."""
    from safetensors import deserialize, SafetensorError

    try:
        tensors = deserialize(content)  # type: ignore[no-untyped-call]
    except SafetensorError as error:
        raise PolicyMismatchError(f'is not a whole safetensors file ({error})') from error
    # What deserialize has checked, but keeps to itself.
    end = _LENGTH_BYTE + int.from_bytes(content[:_LENGTH_BYTE], 'little')
    metadata: dict[str, str] = json.loads(content[_LENGTH_BYTE:end]).get('__metadata__') or {}
    _check_field('format', _field(metadata, 'format'), FORMAT)
    return metadata, {name: _tensor(name, tensor) for name, tensor in tensors}


def _tensor(name: str, tensor: Mapping[str, Any]) -> NDArray[np.float32]:
    kind = tensor['dtype']
    if kind != 'F32':  # numpy does not even know all that there are
        raise PolicyMismatchError(f'{name} is {kind}: must be F32')
    values = np.frombuffer(tensor['data'], dtype='<f4').reshape(tensor['shape'])
    return values.astype(np.float32)


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
        return TypeAdapter(Validation).validate_json(text)
    except ValidationError as error:
        raise _unreadable(name, text, 'a JSON object', Validation) from error


def _learned_on(name: str, text: str) -> tuple[LearnedOn, ...]:
    try:
        return TypeAdapter(tuple[LearnedOn, ...]).validate_json(text)
    except ValidationError as error:
        raise _unreadable(name, text, 'a JSON list of objects', LearnedOn) from error


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

"""Tensors in safetensors files: float32 alone, with texts beside them; numpy is all it takes.

Such a file is a head's length (8 bytes, little-endian), the head as JSON padded with spaces (a
tensor's type, shape and place by its name; the texts as `__metadata__`), then the tensors, one
right behind the other.
"""

from collections.abc import Iterator, Mapping
import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.errors import PolicyMismatchError

Tensors = dict[str, NDArray[np.float32]]

_LENGTH_BYTE = 8
_ALIGNED_BYTE = 8  # the tensors begin at a multiple
_TEXTS = '__metadata__'
_TYPE = 'F32'
_VALUE_BYTE = 4
_MAX_DIMENSIONS = 8


def tensor_file(tensors: Mapping[str, NDArray[np.float32]], texts: Mapping[str, str]) -> bytes:
    """The file that holds some tensors and texts; equal ones give equal bytes."""
    head: dict[str, object] = {_TEXTS: dict(texts)}
    place = 0
    for name, tensor in sorted(tensors.items()):
        end = place + tensor.size * _VALUE_BYTE
        head[name] = {'dtype': _TYPE, 'shape': tensor.shape, 'data_offsets': (place, end)}
        place = end
    text = json.dumps(head, sort_keys=True, separators=(',', ':'), ensure_ascii=False).encode()
    text += b' ' * (-len(text) % _ALIGNED_BYTE)
    data = [np.ascontiguousarray(it, dtype='<f4').tobytes() for _, it in sorted(tensors.items())]
    return b''.join((len(text).to_bytes(_LENGTH_BYTE, 'little'), text, *data))


def read_tensor_file(content: bytes) -> tuple[Tensors, dict[str, str]]:
    """The tensors and the texts of a file.

    Raises:
        PolicyMismatchError: it is not whole, or a tensor is of another type.
    """
    start = _LENGTH_BYTE + int.from_bytes(content[:_LENGTH_BYTE], 'little')
    if not _LENGTH_BYTE < start <= len(content):
        raise _broken('it ends within its head')
    try:
        head = json.loads(content[_LENGTH_BYTE:start])
    except (ValueError, RecursionError) as error:
        raise _broken('its head is not JSON') from error
    if not isinstance(head, dict):
        raise _broken('its head is not a JSON object')
    texts = head.pop(_TEXTS, {})
    if not isinstance(texts, dict) or not all(isinstance(text, str) for text in texts.values()):
        raise _broken(f'{_TEXTS} of its head are no texts')
    return dict(_tensors(head, content[start:])), texts


def _tensors(head: Mapping[str, Any], data: bytes) -> Iterator[tuple[str, NDArray[np.float32]]]:
    place = 0
    for (begin, end), name, shape in sorted(_entries(head)):
        if begin != place or end - begin != math.prod(shape) * _VALUE_BYTE or end > len(data):
            raise _broken(f'the place of {name!r} is not its own')
        values = np.frombuffer(data[begin:end], dtype='<f4').reshape(shape)
        yield name, values.astype(np.float32)
        place = end
    if place != len(data):
        raise _broken(f'{len(data) - place} bytes at its end belong to no tensor')


def _entries(head: Mapping[str, Any]) -> Iterator[tuple[tuple[int, int], str, tuple[int, ...]]]:
    for name, entry in head.items():
        match entry:
            case {'dtype': str(kind), 'shape': [*shape], 'data_offsets': [int(begin), int(end)]}:
                pass
            case _:
                raise _broken(f'its head does not place {name!r}')
        if not (name + kind).isprintable():
            raise _broken(f'it names {name!r} and {kind!r}')
        if kind != _TYPE:
            raise PolicyMismatchError(f'{name} is {kind}: must be {_TYPE}')
        is_shape = all(type(length) is int and length >= 0 for length in shape)
        if not is_shape or len(shape) > _MAX_DIMENSIONS:
            raise _broken(f'{name!r} has the shape {shape}')
        yield (begin, end), name, tuple(shape)


def _broken(reason: str) -> PolicyMismatchError:
    return PolicyMismatchError(f'is not a whole safetensors file ({reason})')

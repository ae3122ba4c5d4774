"""Tensors in safetensors files: float32 alone, with texts beside them; numpy is all it takes.

Such a file is a head's length (8 bytes, little-endian), the head as JSON padded with spaces (a
tensor's type, shape and place by its name; the texts as `__metadata__`), then the tensors, one
right behind the other.

Nothing of a file counts until it has been checked: head and tensors are bounded, and the head says
how long the file must be, so that a shape can be refused before a tensor takes any memory.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
import json
import math
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from uav_collect.config.yaml_text import shown
from uav_collect.errors import PolicyMismatchError

Tensors = dict[str, NDArray[np.float32]]
Shape = tuple[int, ...]

MAX_HEAD_BYTE = 1 << 20
MAX_TENSORS_BYTE = 1 << 29  # the widest network that learns has fewer
_LENGTH_BYTE = 8
_ALIGNED_BYTE = 8  # the tensors begin at a multiple
_TEXTS = '__metadata__'
_TYPE = 'F32'
_VALUE_BYTE = 4
_MAX_DIMENSIONS = 8


@dataclass(frozen=True, kw_only=True)
class TensorHead:
    """What a file says of its tensors."""

    content: bytes  # its bytes, its length included
    texts: Mapping[str, str]
    shapes: Mapping[str, Shape]  # by name, in the order in which the tensors follow

    @property
    def tensors_byte(self) -> int:
        """Bytes of all tensors, which are the rest of the file."""
        return sum(map(_size_byte, self.shapes.values()))


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


def read_head(file: BinaryIO, size_byte: int) -> TensorHead:
    """Read the head of a file, and leave it at the first tensor.

    Args:
        file: at its beginning.
        size_byte: of the whole file.

    Raises:
        PolicyMismatchError: it is no such file, it is not as long as its head says, or it has a
            tensor of another type or too many numbers.
    """
    length = file.read(_LENGTH_BYTE)
    text_byte = int.from_bytes(length, 'little')
    if not 0 < text_byte <= size_byte - _LENGTH_BYTE:
        raise _broken('it ends within its head')
    if text_byte > MAX_HEAD_BYTE:
        raise _broken(f'its head is {text_byte} bytes long: must be {MAX_HEAD_BYTE} or less')
    text = file.read(text_byte)
    head = _json_object(text)
    texts = head.pop(_TEXTS, {})
    if not isinstance(texts, dict) or not all(isinstance(text, str) for text in texts.values()):
        raise _broken(f'{_TEXTS} of its head are no texts')
    entries = [(place, name, shape) for name, place, shape in _entries(head)]
    found = TensorHead(
        content=length + text,
        texts=texts,
        shapes={name: shape for _, name, shape in sorted(entries)},
    )
    _check_places(sorted(entries), size_byte - len(found.content))
    if found.tensors_byte > MAX_TENSORS_BYTE:
        raise PolicyMismatchError(
            f'its tensors are {found.tensors_byte} bytes long: must be {MAX_TENSORS_BYTE} or less'
        )
    return found


def read_tensors(file: BinaryIO, head: TensorHead) -> tuple[Tensors, bytes]:
    """Read the tensors that follow a head, and their bytes as they stand in the file.

    Raises:
        PolicyMismatchError: the file has become shorter since its head was read.
    """
    data = file.read(head.tensors_byte)
    if len(data) != head.tensors_byte:
        raise _broken('it ends within its tensors')
    tensors, place = {}, 0
    for name, shape in head.shapes.items():
        end = place + _size_byte(shape)
        tensors[name] = np.frombuffer(data[place:end], '<f4').reshape(shape).astype(np.float32)
        place = end
    return tensors, data


def parsed_json(text: str | bytes) -> Any:  # noqa: ANN401 - whatever it holds
    """What JSON holds.

    Raises:
        ValueError: it is none, is nested too deeply, or names something twice.
    """
    try:
        return json.loads(text, object_pairs_hook=_without_doubles)
    except RecursionError as error:
        raise ValueError('nested too deeply') from error


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        [(double, _)] = Counter(name for name, _ in pairs).most_common(1)
        raise ValueError(f'names {shown(double)} twice')
    return values


def _json_object(text: bytes) -> dict[str, Any]:
    try:
        head = parsed_json(text)
    except ValueError as error:
        raise _broken(f'its head is not JSON: {error}') from error
    if not isinstance(head, dict):
        raise _broken('its head is not a JSON object')
    return head


def _check_places(entries: list[tuple[tuple[int, int], str, Shape]], tensors_byte: int) -> None:
    """Raise unless each tensor begins where the one before ends, up to the end of the file."""
    place = 0
    for (begin, end), name, shape in entries:
        if begin != place or end - begin != _size_byte(shape) or end > tensors_byte:
            raise _broken(f'data_offsets of {shown(name)} overlap or leave a gap')
        place = end
    if place != tensors_byte:
        raise _broken(f'{tensors_byte - place} bytes at its end belong to no tensor')


def _entries(head: Mapping[str, Any]) -> Iterator[tuple[str, tuple[int, int], Shape]]:
    for name, entry in head.items():
        match entry:
            case {'dtype': str(kind), 'shape': [*shape], 'data_offsets': [begin, end]}:
                pass
            case _:
                raise _broken(f'its head does not place {shown(name)}')
        if kind != _TYPE:
            raise PolicyMismatchError(f'{shown(name)} is {shown(kind)}: must be {_TYPE}')
        if not all(map(_is_count, (begin, end))):
            raise _broken(f'its head does not place {shown(name)}')
        if not all(map(_is_count, shape)) or len(shape) > _MAX_DIMENSIONS:
            raise _broken(f'{shown(name)} has the shape {shown(shape)}')
        yield name, (begin, end), tuple(shape)


def _is_count(value: object) -> bool:
    return type(value) is int and value >= 0


def _size_byte(shape: Shape) -> int:
    return math.prod(shape) * _VALUE_BYTE


def _broken(reason: str) -> PolicyMismatchError:
    return PolicyMismatchError(f'is not a whole safetensors file ({reason})')

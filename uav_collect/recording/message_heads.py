"""Reads a few fields of serialized messages, and no more: thousands in a second, broken ones too.

Whoever deserializes a message reads all of it, and gives room to whatever lengths it claims. Here
nothing is copied but the fields that are wanted.
"""

from collections.abc import Callable, Iterator, Sequence
import struct
from typing import Any, NamedTuple

from uav_collect.errors import UnreadableError

FieldKind = tuple[Any, Any]  # of rosbags: the form of a field, and what it is made of
FieldsOf = Callable[[str], Sequence[tuple[str, FieldKind]]]  # of a type, by its name

_LITTLE_ENDIAN = b'\x00\x01'  # plain CDR, as every middleware writes it here
_HEADER_BYTE = 4
_LENGTH = struct.Struct('<I')
_MOST_CHARACTERS = 1_000  # of a text that is wanted
_NUMBERS = {
    name: struct.Struct(f'<{code}')
    for name, code in {
        'bool': '?', 'byte': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h',
        'uint16': 'H', 'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f',
        'float64': 'd',
    }.items()
}  # fmt: skip


class _Step(NamedTuple):
    """One field on the way to those that are wanted."""

    name: str
    kind: str  # number, text, list, or count: of elements whose size is not known
    number: struct.Struct  # or that of an element
    n_fixed: int  # elements of a list that has no length of its own; 0: it has one
    is_wanted: bool


class HeadReader:
    """Reads the wanted fields of one type of message."""

    def __init__(self, type_name: str, wanted: Sequence[str], fields_of: FieldsOf) -> None:
        """Find the way to the wanted fields.

        Args:
            type_name: such as `uav_collect_msgs/msg/Epoch`.
            wanted: names of fields, in the order of the message: numbers, texts, lists of bytes.
                Of a list of messages, which must be the last one, only the length is read.
            fields_of: as rosbags has the fields of a type.

        Raises:
            ValueError: the type has no such fields, or one before them cannot be passed over.
        """
        self._type_name = type_name
        self._steps = _steps_to(type_name, wanted, fields_of)

    def read(self, content: bytes) -> tuple[Any, ...]:
        """The wanted fields of a serialized message.

        Raises:
            UnreadableError: it is no message of this type.
        """
        if content[:2] != _LITTLE_ENDIAN:
            raise UnreadableError(f'no {self._type_name}: not plain little-endian CDR')
        body = memoryview(content)[_HEADER_BYTE:]
        values: list[Any] = []
        place = 0
        step = self._steps[0]
        try:
            for step in self._steps:
                value, place = _READ[step.kind](step, body, place)
                if step.is_wanted:
                    values.append(value)
        except (struct.error, ValueError) as error:
            raise UnreadableError(f'no {self._type_name}: {step.name}: {error}') from error
        return tuple(values)


def _read_number(step: _Step, body: memoryview, place: int) -> tuple[Any, int]:
    size = step.number.size
    place = -(-place // size) * size
    return step.number.unpack_from(body, place)[0], place + size


def _read_text(step: _Step, body: memoryview, place: int) -> tuple[str, int]:
    place = -(-place // 4) * 4
    (n_byte,) = _LENGTH.unpack_from(body, place)
    place += 4
    if n_byte > len(body) - place:
        raise ValueError(f'a text of {n_byte} bytes in {len(body) - place}')
    if not step.is_wanted:
        return '', place + n_byte
    if n_byte > _MOST_CHARACTERS:
        raise ValueError(f'a text of {n_byte} bytes: must be at most {_MOST_CHARACTERS}')
    return bytes(body[place : place + n_byte]).rstrip(b'\0').decode(), place + n_byte


def _read_list(step: _Step, body: memoryview, place: int) -> tuple[bytes, int]:
    n_elements, size = step.n_fixed, step.number.size
    if not n_elements:
        place = -(-place // 4) * 4
        (n_elements,) = _LENGTH.unpack_from(body, place)
        place += 4
    if n_elements:
        place = -(-place // size) * size
    n_byte = n_elements * size
    if n_byte > len(body) - place:
        raise ValueError(f'a list of {n_byte} bytes in {len(body) - place}')
    return bytes(body[place : place + n_byte]) if step.is_wanted else b'', place + n_byte


def _read_count(step: _Step, body: memoryview, place: int) -> tuple[int, int]:
    place = -(-place // 4) * 4
    (n_elements,) = _LENGTH.unpack_from(body, place)
    return n_elements, place + 4


_READ: dict[str, Callable[[_Step, memoryview, int], tuple[Any, int]]] = {
    'number': _read_number,
    'text': _read_text,
    'list': _read_list,
    'count': _read_count,
}


def _steps_to(type_name: str, wanted: Sequence[str], fields_of: FieldsOf) -> tuple[_Step, ...]:
    steps: list[_Step] = []
    left = [*wanted]
    for name, kind in fields_of(type_name):
        is_wanted = bool(left) and name == left[0]
        steps += _steps_over(name, kind, fields_of, is_wanted=is_wanted)
        left = left[is_wanted:]
        if not left:
            return tuple(steps)
        if steps[-1].kind == 'count':
            break
    raise ValueError(f'{type_name}: has no {left[0]} that can be read')


def _steps_over(
    name: str, kind: FieldKind, fields_of: FieldsOf, *, is_wanted: bool
) -> Iterator[_Step]:  # fmt: skip
    form, what = kind
    if form.name == 'NAME':
        for inner, inner_kind in fields_of(what):
            yield from _steps_over(f'{name}.{inner}', inner_kind, fields_of, is_wanted=False)
    elif form.name == 'BASE':
        is_text = what[0] == 'string'
        number = _LENGTH if is_text else _NUMBERS[what[0]]
        yield _Step(name, 'text' if is_text else 'number', number, 0, is_wanted)
    else:
        (element, element_what), length = what
        is_plain = element.name == 'BASE' and element_what[0] in _NUMBERS
        number = _NUMBERS[element_what[0]] if is_plain else _LENGTH
        n_fixed = length if form.name == 'ARRAY' else 0
        yield _Step(name, 'list' if is_plain else 'count', number, n_fixed, is_wanted)

"""Tensors in files as the safetensors library has them, and files that are broken."""

from collections.abc import Mapping
from io import BytesIO
import json
from typing import Any

import numpy as np
import pytest
from safetensors import deserialize
from safetensors.numpy import load, save
from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.tensor_file import (
    MAX_HEAD_BYTE,
    read_head,
    read_tensors,
    tensor_file,
    Tensors,
)

RNG = np.random.default_rng(0)
TENSORS = {
    'head.weight': RNG.random((3, 5), dtype=np.float32),
    'head.bias': RNG.random(3, dtype=np.float32),
    'empty': np.zeros((0, 4), np.float32),
}
TEXTS = {'format': 'mine/1', 'name': 'Öresund "7"\n'}
PLACED = {'dtype': 'F32', 'shape': [2], 'data_offsets': [0, 8]}


def read(content: bytes) -> tuple[Tensors, Mapping[str, str]]:
    """Tensors and texts of a file."""
    file = BytesIO(content)
    head = read_head(file, len(content))
    return read_tensors(file, head)[0], head.texts


def assert_equal(
    found: Mapping[str, np.ndarray[Any, Any]], expected: Mapping[str, np.ndarray[Any, Any]]
) -> None:
    assert found.keys() == expected.keys()
    for name, tensor in expected.items():
        assert found[name].dtype == np.float32
        np.testing.assert_array_equal(found[name], tensor)


def with_head(head: object, data: bytes) -> bytes:
    text = head if isinstance(head, bytes) else json.dumps(head).encode()
    return len(text).to_bytes(8, 'little') + text + data


def test_what_is_written_the_library_reads() -> None:
    content = tensor_file(TENSORS, TEXTS)
    assert_equal(load(content), TENSORS)
    (length,) = {len(content) - sum(len(entry['data']) for _, entry in deserialize(content))}
    assert json.loads(content[8:length])['__metadata__'] == TEXTS
    assert length % 8 == 0


def test_what_the_library_writes_is_read() -> None:
    tensors, texts = read(save(TENSORS, TEXTS))
    assert_equal(tensors, TENSORS)
    assert texts == TEXTS


def test_equal_tensors_in_another_order_are_written_as_equal_bytes() -> None:
    turned = dict(reversed(TENSORS.items()))
    assert tensor_file(turned, dict(reversed(TEXTS.items()))) == tensor_file(TENSORS, TEXTS)


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (b'', 'ends within its head'),
        (b'\xff' * 8, 'ends within its head'),
        (with_head(b'{"a":', b''), 'not JSON'),
        (with_head(b'\xff\xff', b''), 'not JSON'),
        (with_head(b'[' * 100_000, b''), 'not JSON'),
        (with_head([1], b''), 'not a JSON object'),
        (with_head({'__metadata__': {'a': 1}}, b''), 'no texts'),
        (with_head({'__metadata__': [1]}, b''), 'no texts'),
        (with_head({'a': {**PLACED, 'dtype': 32}}, bytes(8)), 'does not place .a.'),
        (with_head({'a\n': {}}, bytes(8)), r"does not place 'a\\n'"),
        (with_head({'a' * 999: {}}, bytes(8)), 'does not place .a{50,60}[.]{3}'),
        (with_head({'a': {**PLACED, 'data_offsets': [0]}}, bytes(8)), 'does not place .a.'),
        (with_head(b'{"a": 1, "a": 2}', b''), "names 'a' twice"),
        (with_head(b' ' * (MAX_HEAD_BYTE + 1), b''), f'must be {MAX_HEAD_BYTE} or less'),
        (with_head({'a': {**PLACED, 'shape': [True, 2]}}, bytes(8)), 'has the shape'),
        (with_head({'a': {**PLACED, 'data_offsets': [False, 8]}}, bytes(8)), 'does not place .a.'),
        (with_head({'a': {**PLACED, 'data_offsets': [0.0, 8]}}, bytes(8)), 'does not place .a.'),
        (with_head({'a': {**PLACED, 'shape': [-2]}}, bytes(8)), 'has the shape'),
        (with_head({'a': {**PLACED, 'shape': ['2']}}, bytes(8)), 'has the shape'),
        (with_head({'a': {**PLACED, 'shape': [2, *[1] * 99]}}, bytes(8)), 'has the shape'),
        (with_head({'a': {**PLACED, 'shape': [10**30]}}, bytes(8)), 'data_offsets of .a.'),
        (with_head({'a': {**PLACED, 'data_offsets': [4, 12]}}, bytes(12)), 'data_offsets of .a.'),
        (with_head({'a': PLACED, 'b': PLACED}, bytes(8)), 'data_offsets of .b.'),
        (with_head({'a': PLACED}, bytes(7)), 'data_offsets of .a.'),
        (with_head({'a': PLACED}, bytes(9)), '1 bytes at its end'),
    ],
    ids=lambda value: value if isinstance(value, str) else '',
)
def test_a_broken_file_is_refused_with_its_reason(content: bytes, reason: str) -> None:
    with pytest.raises(PolicyMismatchError, match=f'is not a whole safetensors file .*{reason}'):
        read(content)


def test_a_tensor_of_another_type_is_refused() -> None:
    with pytest.raises(PolicyMismatchError, match="'a' is 'F16': must be F32"):
        read(save({'a': np.zeros(2, np.float16)}))


def test_a_file_that_became_shorter_while_it_was_read_is_refused() -> None:
    content = tensor_file(TENSORS, TEXTS)
    file = BytesIO(content[:-1])
    head = read_head(file, len(content))
    with pytest.raises(PolicyMismatchError, match='ends within its tensors'):
        read_tensors(file, head)


def test_no_flipped_bit_is_worse_than_a_refusal() -> None:
    whole = tensor_file(TENSORS, TEXTS)
    for place in range(len(whole)):
        for bit in (0x01, 0x20, 0x80):
            content = bytearray(whole)
            content[place] ^= bit
            try:
                read(bytes(content))
            except PolicyMismatchError as error:
                assert '\n' not in str(error)

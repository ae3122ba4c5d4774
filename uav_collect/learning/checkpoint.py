"""The checkpoint of a training: one file of plain values and arrays; reading it runs no code.

    format        24 bytes, `uav_collect.checkpoint/2`
    digest        32 bytes, SHA-256 of all that follows; checked before anything is interpreted
    sizes         2 x 8 bytes, little-endian: of the whole file, of the head
    head          JSON: `values`, null where an array was; `arrays`: path, type, shape of each
    arrays        their bytes, one right behind the other

It is written whole or not at all.
"""

from collections.abc import Iterator, Mapping, Sequence
import hashlib
import io
import json
import math
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from uav_collect import files
from uav_collect.errors import CheckpointError

STATE_FILE = 'state.pt'
_FORMAT = b'uav_collect.checkpoint/2'
_OLD_FORMAT = b'PK\x03\x04'  # a pickle in a zip, as torch writes them
_DIGEST_BYTES = 32
_SIZE_BYTES = 8
_FIRST_BYTES = len(_FORMAT) + _DIGEST_BYTES + 2 * _SIZE_BYTES
_MAX_HEAD_BYTES = 64 * 2**20
_PIECE_BYTES = 2**20
_MAX_DIMENSIONS = 8
_TYPES = ('|i1', '|u1', '<i4', '<i8', '<u8', '<f4', '<f8')

_Path = list[str | int]  # the way to an array: keys and indices


def write_checkpoint(folder: Path, state: Mapping[str, Any]) -> None:
    """Write a state in place of the last one.

    Args:
        state: nested mappings, lists, numbers, texts and arrays.

    Raises:
        OSError: it cannot be written; the last one is still there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files.write_parts_atomically(folder / STATE_FILE, _parts(state))


def checkpoint_bytes(state: Mapping[str, Any]) -> bytes:
    """What a checkpoint's file holds; the inverse is `checkpoint_from_bytes`."""
    return b''.join(_parts(state))


def read_checkpoint(folder: Path) -> dict[str, Any]:
    """Read the state that was written last.

    Raises:
        CheckpointError: one line: there is none, or it is not to the byte what was written.
    """
    path = folder / STATE_FILE
    try:
        with files.open_file(path) as (file, n_bytes):
            return _read(file, n_bytes)
    except FileNotFoundError as error:
        raise CheckpointError(
            f'{path}: is missing: cannot resume without it; start a new training'
        ) from error
    except OSError as error:
        raise CheckpointError(f'{path}: cannot be read: {error.strerror}') from error
    except CheckpointError as error:
        raise CheckpointError(f'{path}: {error}') from error


def checkpoint_from_bytes(content: bytes) -> dict[str, Any]:
    """The state that a checkpoint's file holds.

    Raises:
        CheckpointError: one line: it is not to the byte what was written.
    """
    return _read(io.BytesIO(content), len(content))


def _parts(state: Mapping[str, Any]) -> list[bytes | memoryview]:
    """The pieces of a file; those of arrays are not copied."""
    arrays: list[tuple[_Path, NDArray[Any]]] = []
    values = _without_arrays(state, [], arrays)
    places = [[path, array.dtype.str, array.shape] for path, array in arrays]
    head = json.dumps({'values': values, 'arrays': places}, separators=(',', ':')).encode()
    data = [array.reshape(-1).view(np.uint8).data for _, array in arrays]
    n_bytes = _FIRST_BYTES + len(head) + sum(map(len, data))
    sizes = b''.join(size.to_bytes(_SIZE_BYTES, 'little') for size in (n_bytes, len(head)))
    digest = hashlib.sha256(sizes + head)
    for part in data:
        digest.update(part)
    return [_FORMAT + digest.digest() + sizes, head, *data]


def _without_arrays(
    value: Any,  # noqa: ANN401 - whatever JSON knows
    path: _Path,
    arrays: list[tuple[_Path, NDArray[Any]]],
) -> Any:  # noqa: ANN401
    """The value with null in the place of each array, which is noted with its path."""
    if isinstance(value, np.ndarray):
        kind = value.dtype.newbyteorder('<')
        arrays.append((path, np.asarray(value, dtype=kind, order='C')))
        return None
    if isinstance(value, Mapping):
        return {key: _without_arrays(it, [*path, key], arrays) for key, it in value.items()}
    if isinstance(value, list | tuple):
        return [_without_arrays(it, [*path, index], arrays) for index, it in enumerate(value)]
    return value


def _read(file: BinaryIO, n_bytes: int) -> dict[str, Any]:
    first = file.read(_FIRST_BYTES)
    _check_format(first)
    digest = first[len(_FORMAT) : len(_FORMAT) + _DIGEST_BYTES]
    sizes = first[len(_FORMAT) + _DIGEST_BYTES :]
    stated, n_head = (int.from_bytes(it, 'little') for it in (sizes[:8], sizes[8:]))
    if stated != n_bytes:
        raise _broken(f'it has {n_bytes:,} bytes: must have {stated:,}')
    found = hashlib.sha256(sizes)
    while piece := file.read(_PIECE_BYTES):
        found.update(piece)
    if found.digest() != digest:
        raise _broken('checksum mismatch')
    # From here on it is what was written, unless somebody meant to deceive.
    if n_head > min(n_bytes - _FIRST_BYTES, _MAX_HEAD_BYTES):
        raise _broken(f'its head has {n_head:,} bytes')
    file.seek(_FIRST_BYTES)
    return _state(file.read(n_head), file, n_bytes - _FIRST_BYTES - n_head)


def _check_format(first: bytes) -> None:
    if first.startswith(_OLD_FORMAT):
        raise CheckpointError(
            'is a checkpoint of an older version, whose format could run code: go on with the'
            ' version that wrote it, or start a new training'
        )
    if len(first) < _FIRST_BYTES or not first.startswith(_FORMAT):
        raise _broken(f'it does not begin with {_FORMAT.decode()!r}')


def _state(head: bytes, file: BinaryIO, n_left: int) -> dict[str, Any]:
    try:
        parsed = json.loads(head)
    except (ValueError, RecursionError) as error:
        raise _broken('its head is not JSON') from error
    match parsed:
        case {'values': dict(values), 'arrays': [*places]}:
            pass
        case _:
            raise _broken('its head does not hold values and arrays')
    for path, kind, shape in _places(places):
        n_array = math.prod(shape) * kind.itemsize
        if n_array > n_left:
            raise _broken('it ends within its arrays')
        n_left -= n_array
        array = np.empty(shape, kind)
        _fill(array, file)
        _put(values, path, array)
    if n_left:
        raise _broken(f'{n_left:,} bytes at its end belong to no array')
    return values


def _fill(array: NDArray[Any], file: BinaryIO) -> None:
    """Read an array's bytes, in as many pieces as the file gives them."""
    left = array.reshape(-1).view(np.uint8).data
    while left:
        n_read = file.readinto(left)  # type: ignore[attr-defined]
        if not n_read:
            raise _broken('it ends within its arrays')
        left = left[n_read:]


def _places(places: Sequence[Any]) -> Iterator[tuple[_Path, np.dtype[Any], tuple[int, ...]]]:
    for place in places:
        match place:
            case [[*path], str(kind), [*shape]] if kind in _TYPES and path:
                pass
            case _:
                raise _broken('its head does not say what each array is')
        is_shape = all(type(length) is int and 0 <= length < 2**48 for length in shape)
        if not is_shape or len(shape) > _MAX_DIMENSIONS:
            raise _broken(f'an array has the shape {shape}'[:100])
        yield path, np.dtype(kind), tuple(shape)


def _put(values: Any, path: _Path, array: NDArray[Any]) -> None:  # noqa: ANN401 - of JSON
    """Put an array back where null stands for it."""
    holder = values
    try:
        for key in path[:-1]:
            holder = holder[key]
        if holder[path[-1]] is not None:
            raise KeyError
        holder[path[-1]] = array
    except (LookupError, TypeError) as error:
        raise _broken('its head places an array where there is none') from error


def _broken(reason: str) -> CheckpointError:
    return CheckpointError(f'is damaged: {reason}')

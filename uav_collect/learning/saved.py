"""What a checkpoint gives back: each value asked for by its name, and what it must be."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.errors import CheckpointError

_MAX_SHOWN = 40  # characters of a wrong value
_MOST = 2**63 - 1


class SavedPart:
    """A part of a state that was read back.

    Its methods raise CheckpointError, with the value's path, if it is missing or not as asked.
    """

    def __init__(self, values: Mapping[str, Any], where: str = '') -> None:
        """Wrap the part at a path, '' for the whole."""
        self._values, self._where = values, where

    def part(self, name: str) -> 'SavedPart':
        """A part of it by name."""
        return self._part_of(self._value(name), name)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its values."""
        return tuple(self._values)

    def parts(self, name: str, n_parts: int | None = None) -> list['SavedPart']:
        """So many parts in a list; None: however many they are."""
        parts = self._list(name)
        if n_parts is not None and len(parts) != n_parts:
            raise self.refusal(name, f'has {len(parts)} parts: must have {n_parts}')
        return [self._part_of(part, f'{name}/{index}') for index, part in enumerate(parts)]

    def optional(self, name: str) -> 'SavedPart | None':
        """A part that may not be there yet."""
        return None if self._value(name) is None else self.part(name)

    def whole(self, name: str, low: int = 0, high: int = _MOST) -> int:
        """An integer from low to high."""
        value = self._value(name)
        if type(value) is not int or not low <= value <= high:
            raise self._wrong(name, f'a whole number from {low} to {high}')
        return value

    def number(self, name: str, low: float = -math.inf) -> float:
        """A finite number, at least low."""
        value = self._value(name)
        if type(value) not in (int, float) or not math.isfinite(value) or value < low:
            floor = '' if low == -math.inf else f' >= {low:g}'
            raise self._wrong(name, f'a finite number{floor}')
        return float(value)

    def must_be(self, name: str, wanted: object) -> None:
        """Refuse a value that is another one."""
        value = self._value(name)
        if type(value) is not type(wanted) or value != wanted:
            raise self._wrong(name, f'{wanted!r}')

    def wholes(self, name: str) -> list[int]:
        """Integers in a list."""
        values = self._list(name)
        if not all(type(value) is int for value in values):
            raise self.refusal(name, 'is no list of whole numbers')
        return values

    def rows(self, name: str, n_columns: int) -> list[list[float]]:
        """Rows of a table, each a list of so many numbers."""
        rows = self._list(name)
        for index, row in enumerate(rows):
            is_row = isinstance(row, list) and len(row) == n_columns
            if not is_row or not all(type(each) in (int, float) for each in row):
                raise self.refusal(f'{name}/{index}', f'is no row of {n_columns} numbers')
        return rows

    def text(self, name: str) -> str:
        """A text."""
        value = self._value(name)
        if not isinstance(value, str):
            raise self._wrong(name, 'a text')
        return value

    def array(self, name: str, kind: object, shape: Sequence[int | None]) -> NDArray[Any]:
        """An array of a type and shape; None: of any length. Floats are finite.

        Args:
            kind: as numpy names it.
        """
        array, wanted = self._value(name), np.dtype(kind)  # type: ignore[call-overload]
        if not isinstance(array, np.ndarray):
            raise self.refusal(name, 'is no array')
        is_shaped = len(array.shape) == len(shape) and all(
            want is None or have == want for have, want in zip(array.shape, shape, strict=True)
        )
        if array.dtype != wanted or not is_shaped:
            asked = f'{wanted} {_shape_text(shape)}'
            raise self.refusal(
                name, f'is {array.dtype} {_shape_text(array.shape)}: must be {asked}'
            )
        if wanted.kind == 'f' and not np.isfinite(array).all():
            raise self.refusal(name, 'holds what is no finite number')
        return array

    def array_like(self, name: str, like: NDArray[Any]) -> NDArray[Any]:
        """An array of the type and shape of another one."""
        return self.array(name, like.dtype, like.shape)

    def refusal(self, name: str, what: str) -> CheckpointError:
        """The error that says what is wrong with the value of a name."""
        return CheckpointError(f'{self._path(name)} {what}')

    def _part_of(self, value: object, name: str) -> 'SavedPart':
        if not isinstance(value, dict):
            raise self.refusal(name, 'is no part with names')
        return SavedPart(value, self._path(name))

    def _list(self, name: str) -> list[Any]:
        value = self._value(name)
        if not isinstance(value, list):
            raise self.refusal(name, 'is no list')
        return value

    def _value(self, name: str) -> Any:  # noqa: ANN401 - whatever was saved
        if name not in self._values:
            raise self.refusal(name, 'is missing')
        return self._values[name]

    def _wrong(self, name: str, allowed: str) -> CheckpointError:
        value = self._values[name]
        shown = 'an array' if isinstance(value, np.ndarray) else repr(value)
        if len(shown) > _MAX_SHOWN:
            shown = f'{shown[: _MAX_SHOWN - 3]}...'
        return self.refusal(name, f'is {shown}: must be {allowed}')

    def _path(self, name: str) -> str:
        return f'{self._where}/{name}' if self._where else name


def _shape_text(shape: Sequence[int | None]) -> str:
    return f'({", ".join("any" if length is None else str(length) for length in shape)})'

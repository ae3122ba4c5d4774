"""Array types, the one check of a shape, and rows: what kernels index."""

from collections.abc import Iterator, Sequence
from typing import Any, cast, overload, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.compile import kernels_are_compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_Item = TypeVar('_Item')
_Number = TypeVar('_Number', float, int)


class Row(Protocol[_Item]):
    """What a kernel indexes: a 1-D array when compiled, a list when interpreted."""

    def __len__(self) -> int:
        """How many items there are."""

    def __iter__(self) -> Iterator[_Item]:
        """The items in order."""

    @overload
    def __getitem__(self, index: int, /) -> _Item: ...

    @overload
    def __getitem__(self, index: slice, /) -> Any: ...  # noqa: ANN401 - another kind of row

    def __setitem__(self, index: int, item: _Item, /) -> None:
        """Replace the item at a position."""


def check_shape(array: NDArray[np.generic], shape: tuple[int, ...], name: str) -> None:
    """Raise ValueError, naming the array and both shapes, unless the shape is as asked."""
    if array.shape != shape:
        raise ValueError(f'{name} must have shape {shape}, got {array.shape}')


def row_of(values: Sequence[_Number]) -> Row[_Number]:
    """The values as a row of this process; all floats or all ints."""
    if not kernels_are_compiled():
        return list(values)
    kind = np.float64 if all(isinstance(value, float) for value in values) else np.int64
    return np.array(values, dtype=kind)


def new_row(size: int, fill: _Number) -> Row[_Number]:
    """A row that has the same value everywhere."""
    if kernels_are_compiled():
        return np.full(size, fill)
    return [fill] * size


def filled_row(values: Sequence[_Number], zero: _Number) -> Row[_Number]:
    """The values as a row of the kind of `zero`, however few they are."""
    row = new_row(len(values), zero)
    for index, value in enumerate(values):
        row[index] = value
    return row


def new_table(n_rows: int, size: int, fill: _Number) -> Row[Row[_Number]]:
    """A table of rows, indexed row first: (n_rows, size)."""
    if kernels_are_compiled():
        return cast('Row[Row[_Number]]', np.full((n_rows, size), fill))
    return cast('Row[Row[_Number]]', [[fill] * size for _ in range(n_rows)])


def new_map_table(n_rows: int, size: int) -> Row[Row[int]]:
    """A table of zeros and ones, a byte each where kernels are compiled: (n_rows, size)."""
    if kernels_are_compiled():
        return cast(Row[Row[int]], np.zeros((n_rows, size), dtype=np.uint8))
    return cast(Row[Row[int]], [[0] * size for _ in range(n_rows)])


def grow_table(table: Row[Row[_Number]], n_rows: int, size: int) -> Row[Row[_Number]]:
    """The table with longer rows, its values kept."""
    if isinstance(table, np.ndarray):
        longer = np.zeros((n_rows, size), dtype=table.dtype)
        longer[:, : table.shape[1]] = table
        return cast('Row[Row[_Number]]', longer)
    for index in range(n_rows):
        row: list[_Number] = table[index]  # type: ignore[assignment]
        row.extend([type(row[0])(0)] * (size - len(row)))
    return table


def copied(rows: _Item) -> _Item:
    """Named tuples, rows and tables of numbers, with all rows of their own."""
    if isinstance(rows, np.ndarray):
        return cast(_Item, rows.copy())
    if isinstance(rows, list):
        is_table = bool(rows) and isinstance(rows[0], list)
        return cast(_Item, [row[:] for row in rows] if is_table else rows[:])
    if isinstance(rows, tuple):
        return cast(_Item, type(rows)(*map(copied, rows)))
    return rows

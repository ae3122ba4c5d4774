"""Rows: what kernels index. Arrays where they are compiled, lists where they are interpreted."""

from collections.abc import Sequence
from typing import cast, TypeVar

import numpy as np
from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernels_are_compiled

_Number = TypeVar('_Number', float, int)


def row_of(values: Sequence[_Number]) -> Row[_Number]:
    """The values as a row of this process; all floats or all ints."""
    if not kernels_are_compiled():
        return list(values)
    kind = np.float64 if all(isinstance(value, float) for value in values) else np.int64
    return np.array(values, dtype=kind)


def new_row(size: int, fill: _Number) -> Row[_Number]:
    """A row of one value."""
    if kernels_are_compiled():
        return np.full(size, fill)
    return [fill] * size


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

"""The first layer over observations of which only what is not zero is kept, compiled.

Four fifths of an observation are zeros: the layer's product with them, forward and for the slopes
by its weight, was the largest of an update. Tables are float32; a weight has one row for each
number of an observation.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.arrays import Ints
from uav_collect.kernels.compile import float_kernel

_AT_ONCE = 4  # numbers that one pass over a row of sums takes in

_Table = NDArray[np.float32]
_Row = Any  # a row of such a table

_ZERO = np.float32(0.0)


@float_kernel
def encode(
    column: NDArray[np.int32],
    value: _Table,
    start: Ints,
    stop: Ints,
    weight: _Table,
    bias: _Table,
    encoded: _Table,
) -> None:
    """A fully connected layer and ReLU.

    Args:
        column: which number of the observation each value is, shape (V,).
        value: those that are not zero, shape (V,).
        start: where the values of each row begin, (R,).
        stop: where they end, (R,).
        weight: shape (observation_size, H).
        bias: shape (H,).
        encoded: written, shape (R, H).
    """
    for row in range(len(encoded)):
        sums, first, last = encoded[row], start[row], stop[row]
        for unit in range(len(sums)):
            sums[unit] = bias[unit]
        end = first + (last - first) // _AT_ONCE * _AT_ONCE
        for at in range(first, end, _AT_ONCE):
            _add_four(column, value, at, weight, sums)
        for at in range(end, last):
            _add(weight[column[at]], value[at], sums)
        for unit in range(len(sums)):
            sums[unit] = _ZERO if sums[unit] < _ZERO else sums[unit]  # no number stays none


@float_kernel
def slopes_by_weight(
    column: NDArray[np.int32],
    value: _Table,
    start: Ints,
    stop: Ints,
    from_above: _Table,
    encoded: _Table,
    slope: _Table,
    by_weight: _Table,
    by_bias: NDArray[np.float64],
) -> None:
    """Compute the loss's slopes by the layer's weight and bias.

    Args:
        column: as `encode` takes it, as `value`, `start` and `stop`.
        from_above: slopes by what was encoded, shape (R, H).
        encoded: as `encode` wrote it.
        slope: room for a row, (H,).
        by_weight: zeros; written, shape (observation_size, H).
        by_bias: zeros; written, shape (H,).
    """
    for row in range(len(encoded)):
        above, output = from_above[row], encoded[row]
        for unit in range(len(slope)):
            slope[unit] = _ZERO if output[unit] <= _ZERO else above[unit]
        for unit in range(len(slope)):
            by_bias[unit] += slope[unit]
        first, last = start[row], stop[row]
        end = first + (last - first) // _AT_ONCE * _AT_ONCE
        for at in range(first, end, _AT_ONCE):
            _add_to_four(slope, column, value, at, by_weight)
        for at in range(end, last):
            _add(slope, value[at], by_weight[column[at]])


@float_kernel
def _add(weight: _Row, value: Any, sums: _Row) -> None:  # noqa: ANN401 - a number
    for unit in range(len(sums)):
        sums[unit] += value * weight[unit]


@float_kernel
def _add_four(
    column: NDArray[np.int32], value: _Table, at: int, weight: _Table, sums: _Row
) -> None:
    a, b, c, d = value[at], value[at + 1], value[at + 2], value[at + 3]
    of_a, of_b = weight[column[at]], weight[column[at + 1]]
    of_c, of_d = weight[column[at + 2]], weight[column[at + 3]]
    for unit in range(len(sums)):
        sums[unit] += a * of_a[unit] + b * of_b[unit] + c * of_c[unit] + d * of_d[unit]


@float_kernel
def _add_to_four(
    slope: _Row, column: NDArray[np.int32], value: _Table, at: int, by_weight: _Table
) -> None:
    a, b, c, d = value[at], value[at + 1], value[at + 2], value[at + 3]
    by_a, by_b = by_weight[column[at]], by_weight[column[at + 1]]
    by_c, by_d = by_weight[column[at + 2]], by_weight[column[at + 3]]
    for unit in range(len(slope)):
        of_unit = slope[unit]
        by_a[unit] += a * of_unit
        by_b[unit] += b * of_unit
        by_c[unit] += c * of_unit
        by_d[unit] += d * of_unit

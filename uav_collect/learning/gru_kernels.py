"""The steps of a GRU over packed sequences, and their way back, compiled.

At each step only a product with the hidden states of the step before is left to do, and few
sequences share it: as operations of torch, calls and passes over memory take longer than the
arithmetic. Here a step stays in the cache. All tables are float32; H is a multiple of `LANES`; the
gates come in the order reset, update, new.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.arrays import Ints
from uav_collect.kernels.compile import float_kernel

LANES = 16  # numbers that a vector register holds
_AT_ONCE = 4  # rows of a weight that one pass over the sums adds

_Table = NDArray[np.float32]
_Row = Any  # a row of such a table
_Number = Any  # of one

_HALF, _ONE = np.float32(0.5), np.float32(1.0)
# tanh x = x P(x^2) / Q(x^2), fitted to 2e-8 of its value where |x| is at most the bound.
_BOUND = np.float32(9.0)
_P0, _P1, _P2, _P3, _P4 = np.array(
    [0.999999979, 0.133810268, 3.49558948e-3, 2.06091033e-5, 1.33546873e-8], dtype=np.float32
)
_Q1, _Q2, _Q3, _Q4 = np.array(
    [0.467143424, 0.0258769874, 3.28563698e-4, 7.77656957e-7], dtype=np.float32
)


@float_kernel
def run_steps(
    gates: _Table,
    bias_before: _Table,
    weight: _Table,
    step_sizes: Ints,
    product: _Table,
    recurrent: _Table,
    hidden: _Table,
) -> None:
    """Compute the hidden states of all rows, step by step.

    Args:
        gates: what the inputs add to each gate, biases included; written, the gates' values,
            shape (R, 3 H).
        bias_before: what the new gate adds to its product with the hidden state before, (H,).
        weight: of the hidden states before, one row for each of their numbers, (H, 3 H).
        step_sizes: how many sequences reach each step, descending; they sum to R, (T,).
        product: room for a step, (step_sizes[0], 3 H).
        recurrent: written, the new gate's product with its bias, (R, H).
        hidden: written, (R, H).
    """
    size = hidden.shape[1]
    first = before = 0
    for step in range(len(step_sizes)):
        n_rows = step_sizes[step]
        product[:n_rows] = 0
        if step > 0:
            _add_products(product, hidden[before : before + n_rows], weight, n_rows)
        for index in range(n_rows):
            row = first + index
            _blend(
                gates[row, :size],
                gates[row, size : 2 * size],
                gates[row, 2 * size :],
                product[index],
                bias_before,
                recurrent[row],
                hidden[row],
            )
            if step > 0:
                _keep(gates[row, size : 2 * size], hidden[before + index], hidden[row])
        before = first
        first += n_rows


@float_kernel
def _blend(
    reset: _Row,
    update: _Row,
    new: _Row,
    product: _Row,
    bias_before: _Row,
    recurrent: _Row,
    hidden: _Row,
) -> None:
    """The gates of one row, and of its hidden state what the new gate gives, (H,) each."""
    size = len(hidden)
    for unit in range(size):
        reset[unit] = _sigmoid(reset[unit] + product[unit])
    for unit in range(size):
        update[unit] = _sigmoid(update[unit] + product[size + unit])
    for unit in range(size):
        recurrent[unit] = bias_before[unit] + product[2 * size + unit]
    for unit in range(size):
        new[unit] = _tanh(new[unit] + reset[unit] * recurrent[unit])
    for unit in range(size):
        hidden[unit] = new[unit] - update[unit] * new[unit]


@float_kernel
def _keep(update: _Row, before: _Row, hidden: _Row) -> None:
    for unit in range(len(hidden)):
        hidden[unit] += update[unit] * before[unit]


@float_kernel
def _sigmoid(value: _Number) -> _Number:
    return _HALF + _HALF * _tanh(_HALF * value)


@float_kernel
def _tanh(value: _Number) -> _Number:
    # What is no number stays none: a loss that has become so must be seen.
    bounded = -_BOUND if value < -_BOUND else value
    bounded = _BOUND if bounded > _BOUND else bounded
    square = bounded * bounded
    above = _P0 + square * (_P1 + square * (_P2 + square * (_P3 + square * _P4)))
    below = _ONE + square * (_Q1 + square * (_Q2 + square * (_Q3 + square * _Q4)))
    return bounded * above / below


@float_kernel
def run_back(
    from_above: _Table,
    gates: _Table,
    recurrent: _Table,
    hidden: _Table,
    weight: _Table,
    step_sizes: Ints,
    carried: _Table,
    slopes: _Table,
    before: _Table,
    bias_slopes: NDArray[np.float64],
) -> None:
    """Compute the loss's slopes by what the gates are made of, from the last step back.

    Args:
        from_above: the loss's slopes by the hidden states as outputs, (R, H).
        gates: as `run_steps` wrote them, as `recurrent` and `hidden`.
        weight: of the hidden states before, (3 H, H), in the order new, reset, update.
        step_sizes: as `run_steps` takes them.
        carried: zeros; room for a step, (step_sizes[0], H).
        slopes: written: by the new gate's product with the hidden state, by the reset and the
            update gate's sums, by the new gate's sum, (R, 4 H).
        before: written, the hidden state before each row, (R, H).
        bias_slopes: zeros; written, the sum of the slopes of all rows, (4 H,).
    """
    size = hidden.shape[1]
    first = len(hidden)
    before[: step_sizes[0]] = 0
    for step in range(len(step_sizes) - 1, -1, -1):
        n_rows = step_sizes[step]
        first -= n_rows
        for index in range(n_rows):
            row = first + index
            if step > 0:
                _copy(hidden[first - step_sizes[step - 1] + index], before[row])
            _unblend(
                from_above[row],
                gates[row],
                recurrent[row],
                before[row],
                carried[index],
                slopes[row],
            )
            for unit in range(4 * size):
                bias_slopes[unit] += slopes[row, unit]
        if step > 0:
            _add_products(carried, slopes[first : first + n_rows, : 3 * size], weight, n_rows)


@float_kernel
def _copy(source: _Row, target: _Row) -> None:
    for unit in range(len(target)):
        target[unit] = source[unit]


@float_kernel
def _unblend(
    from_above: _Row, gates: _Row, recurrent: _Row, before: _Row, carried: _Row, slopes: _Row
) -> None:
    """The slopes of one row; what is carried on to the step before, but for the product."""
    size = len(carried)
    for unit in range(size):
        reset, update, new = gates[unit], gates[size + unit], gates[2 * size + unit]
        total = from_above[unit] + carried[unit]
        kept = total * update
        by_new = (total - kept) * (_ONE - new * new)
        by_product = by_new * reset
        slopes[unit] = by_product
        slopes[size + unit] = by_product * recurrent[unit] * (_ONE - reset)
        slopes[2 * size + unit] = kept * (_ONE - update) * (before[unit] - new)
        slopes[3 * size + unit] = by_new
        carried[unit] = kept


@float_kernel
def _add_products(sums: _Table, values: _Table, weight: _Table, n_rows: int) -> None:
    """Add values (n, K) times weight (K, M) to sums (n, M)."""
    n_eights = n_rows // 8 * 8
    for row in range(0, n_eights, 8):
        for at in range(0, len(weight), _AT_ONCE):
            _add_to_eight(sums, values, row, weight, at)
    for row in range(n_eights, n_rows):
        for at in range(0, len(weight), _AT_ONCE):
            _add_to_one(sums[row], values[row], weight, at)


@float_kernel
def _add_to_eight(sums: _Table, values: _Table, row: int, weight: _Table, at: int) -> None:
    """Add what four values of each row contribute to eight rows: a weight is read once for all."""
    s0, s1, s2, s3 = sums[row], sums[row + 1], sums[row + 2], sums[row + 3]
    s4, s5, s6, s7 = sums[row + 4], sums[row + 5], sums[row + 6], sums[row + 7]
    a0, b0, c0, d0 = _four(values[row], at)
    a1, b1, c1, d1 = _four(values[row + 1], at)
    a2, b2, c2, d2 = _four(values[row + 2], at)
    a3, b3, c3, d3 = _four(values[row + 3], at)
    a4, b4, c4, d4 = _four(values[row + 4], at)
    a5, b5, c5, d5 = _four(values[row + 5], at)
    a6, b6, c6, d6 = _four(values[row + 6], at)
    a7, b7, c7, d7 = _four(values[row + 7], at)
    wa, wb, wc, wd = weight[at], weight[at + 1], weight[at + 2], weight[at + 3]
    for unit in range(len(s0)):
        a, b, c, d = wa[unit], wb[unit], wc[unit], wd[unit]
        s0[unit] += a0 * a + b0 * b + c0 * c + d0 * d
        s1[unit] += a1 * a + b1 * b + c1 * c + d1 * d
        s2[unit] += a2 * a + b2 * b + c2 * c + d2 * d
        s3[unit] += a3 * a + b3 * b + c3 * c + d3 * d
        s4[unit] += a4 * a + b4 * b + c4 * c + d4 * d
        s5[unit] += a5 * a + b5 * b + c5 * c + d5 * d
        s6[unit] += a6 * a + b6 * b + c6 * c + d6 * d
        s7[unit] += a7 * a + b7 * b + c7 * c + d7 * d


@float_kernel
def _add_to_one(sums: _Row, values: _Row, weight: _Table, at: int) -> None:
    a0, b0, c0, d0 = _four(values, at)
    wa, wb, wc, wd = weight[at], weight[at + 1], weight[at + 2], weight[at + 3]
    for unit in range(len(sums)):
        sums[unit] += a0 * wa[unit] + b0 * wb[unit] + c0 * wc[unit] + d0 * wd[unit]


@float_kernel
def _four(values: _Row, at: int) -> tuple[_Number, _Number, _Number, _Number]:
    return values[at], values[at + 1], values[at + 2], values[at + 3]

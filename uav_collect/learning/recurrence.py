"""A GRU over packed sequences: all its hidden states, and their way back."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import nn, Tensor
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.learning.gru_kernels import LANES, run_back, run_steps


def runs_compiled(hidden: Tensor) -> bool:
    """Whether kernels compute with such hidden states or weights, (..., H); torch does else.

    Torch knows other devices and precisions, needs no whole vectors, and is faster where kernels
    are interpreted.
    """
    is_single = hidden.dtype == torch.float32 and hidden.device.type == 'cpu'
    return is_single and hidden.shape[-1] % LANES == 0 and kernels_are_compiled()


def hidden_states(encoded: Tensor, gru: nn.GRUCell, step_sizes: Sequence[int]) -> Tensor:
    """The hidden states of many sequences, zero before their first step.

    Args:
        encoded: inputs, packed as `network.Drqn.forward` reads them, shape (R, H).
        gru: of H units.
        step_sizes: how many sequences reach each step, descending; they sum to R.

    Returns:
        Shape (R, H).
    """
    weights = gru.weight_ih, gru.weight_hh, gru.bias_ih, gru.bias_hh
    way = CompiledRecurrence if runs_compiled(encoded) else Recurrence
    with torch.autocast(encoded.device.type, enabled=False):
        hidden: Tensor = way.apply(encoded, *(it.to(encoded.dtype) for it in weights), step_sizes)
    return hidden


def compile_steps() -> None:
    """Let the kernels be compiled, which takes seconds once."""
    hidden_states(torch.zeros(1, LANES), nn.GRUCell(LANES, LANES), [1]).sum().backward()


class CompiledRecurrence(torch.autograd.Function):
    """The same as `Recurrence` in float32 on a CPU: its steps are `gru_kernels`."""

    @staticmethod
    def forward(
        context: Any,  # noqa: ANN401 - torch's own
        encoded: Tensor,
        weight_ih: Tensor,
        weight_hh: Tensor,
        bias_ih: Tensor,
        bias_hh: Tensor,
        step_sizes: Sequence[int],
    ) -> Tensor:
        """Hidden states (R, H) of inputs (R, H)."""
        size, sizes = weight_hh.shape[1], np.array(step_sizes, dtype=np.int64)
        bias, bias_before = bias_ih.clone(), bias_hh[2 * size :]
        bias[: 2 * size] += bias_hh[: 2 * size]
        gates = torch.addmm(bias, encoded, weight_ih.t())
        product = gates.new_empty(step_sizes[0], 3 * size)
        recurrent, hidden = gates.new_empty(2, len(gates), size).unbind()
        weight = weight_hh.t().contiguous()
        run_steps(
            gates.numpy(),
            bias_before.numpy(),
            weight.numpy(),
            sizes,
            product.numpy(),
            recurrent.numpy(),
            hidden.numpy(),
        )
        context.save_for_backward(encoded, weight_ih, weight_hh, gates, recurrent, hidden)
        context.step_sizes = sizes
        return hidden

    @staticmethod
    def backward(context: Any, from_above: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """Gradients of the inputs, the weights and the biases."""
        encoded, weight_ih, weight_hh, gates, recurrent, hidden = context.saved_tensors
        size = weight_hh.shape[1]
        weight = torch.cat((weight_hh[2 * size :], weight_hh[: 2 * size]))
        carried = hidden.new_zeros(int(context.step_sizes[0]), size)
        slopes = hidden.new_empty(len(hidden), 4 * size)
        before = torch.empty_like(hidden)
        bias_slopes = torch.zeros(4 * size, dtype=torch.float64)
        run_back(
            from_above.contiguous().numpy(),
            gates.numpy(),
            recurrent.numpy(),
            hidden.numpy(),
            weight.numpy(),
            context.step_sizes,
            carried.numpy(),
            slopes.numpy(),
            before.numpy(),
            bias_slopes.numpy(),
        )
        by_input, by_before = slopes[:, size:], slopes[:, : 3 * size]
        bias = bias_slopes.to(hidden.dtype)
        return (
            by_input @ weight_ih,
            by_input.t() @ encoded,
            (by_before.t() @ before).roll(-size, dims=0),
            bias[size:],
            bias[: 3 * size].roll(-size),
            None,
        )


class Recurrence(torch.autograd.Function):
    """A GRU over packed sequences by operations of torch, with its own way back.

    Step by step only what depends on the step before is computed, in place; all else, the weights'
    gradients above all, is one operation over all rows. The gates come in the order reset, update,
    new.
    """

    @staticmethod
    def forward(
        context: Any,  # noqa: ANN401 - torch's own
        encoded: Tensor,
        weight_ih: Tensor,
        weight_hh: Tensor,
        bias_ih: Tensor,
        bias_hh: Tensor,
        step_sizes: Sequence[int],
    ) -> Tensor:
        """Hidden states (R, H) of inputs (R, H)."""
        size, sizes = weight_hh.shape[1], list(step_sizes)
        parts = [2 * size, size]  # the two switches, which take the sum of both biases; the new
        into_switches, into_new = weight_ih.split(parts)
        back_switches, back_new = weight_hh.t().split(parts, dim=1)
        bias_switches, bias_new = (bias_ih + bias_hh)[: 2 * size], bias_ih[2 * size :]
        bias_before = bias_hh[2 * size :]
        switches = torch.addmm(bias_switches, encoded, into_switches.t())
        new = torch.addmm(bias_new, encoded, into_new.t())
        recurrent, hidden = torch.empty_like(new), torch.empty_like(new)
        before = new.new_zeros(sizes[0], size)
        # Views of all steps at once: a slice at each step would cost as much as its product.
        for switch, reset, update, from_before, candidate, after in zip(
            switches.split(sizes),
            switches[:, :size].split(sizes),
            switches[:, size:].split(sizes),
            recurrent.split(sizes),
            new.split(sizes),
            hidden.split(sizes),
            strict=True,
        ):
            before = before[: len(after)]
            torch.addmm(switch, before, back_switches, out=switch).sigmoid_()
            torch.addmm(bias_before, before, back_new, out=from_before)
            torch.addcmul(candidate, reset, from_before, out=candidate).tanh_()
            before = torch.lerp(candidate, before, update, out=after)
        context.save_for_backward(encoded, weight_ih, weight_hh, switches, new, recurrent, hidden)
        context.step_sizes = sizes
        return hidden

    @staticmethod
    def backward(context: Any, from_above: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """Gradients of the inputs, the weights and the biases."""
        encoded, weight_ih, weight_hh, switches, new, recurrent, hidden = context.saved_tensors
        sizes: list[int] = context.step_sizes
        size = weight_hh.shape[1]
        before = _shifted(hidden, sizes)
        reset, update = switches.split(size, dim=1)
        keep = 1.0 - update
        by_new = torch.addcmul(keep, keep * new, new, value=-1.0)
        slope = new.new_empty(len(new), 3, size)  # of what the weight's product adds to
        torch.mul(by_new, reset, out=slope[:, 2])
        by_reset = slope[:, 2] * recurrent
        torch.addcmul(by_reset, by_reset, reset, value=-1.0, out=slope[:, 0])
        torch.mul((before - new).mul_(update), keep, out=slope[:, 1])
        total = from_above.clone()
        back = torch.empty_like(slope)
        carried = from_above.new_zeros(0, size)
        rows = back.flatten(1)
        for gradient, of_gates, slopes, kept, into, flat in zip(
            reversed(total.split(sizes)),
            reversed(total.unsqueeze(1).split(sizes)),
            reversed(slope.split(sizes)),
            reversed(update.split(sizes)),
            reversed(back.split(sizes)),
            reversed(rows.split(sizes)),
            strict=True,
        ):
            gradient[: len(carried)].add_(carried)
            torch.mul(of_gates, slopes, out=into)
            carried = torch.addmm(gradient * kept, flat, weight_hh)
        of_hh = rows.t() @ before, rows.sum(dim=0)
        torch.mul(total, by_new, out=back[:, 2])  # the same for both switches
        of_ih = rows.t() @ encoded, rows.sum(dim=0)
        return rows @ weight_ih, of_ih[0], of_hh[0], of_ih[1], of_hh[1], None


def _shifted(hidden: Tensor, step_sizes: Sequence[int]) -> Tensor:
    """The hidden state before each row: that of the same sequence one step earlier, or zero."""
    n_first = step_sizes[0]
    pieces = [hidden.new_zeros(n_first, hidden.shape[1])]
    start = 0
    for n_here, n_next in pairwise(step_sizes):
        pieces.append(hidden[start : start + n_next])
        start += n_here
    return torch.cat(pieces)

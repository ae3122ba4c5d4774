"""The agent network: a deep recurrent Q-network whose parameters all UAVs share."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import torch
from torch import nn, Tensor
from uav_collect.actions import N_ACTIONS


class Drqn(nn.Module):
    """Fully connected layer, ReLU, GRU, fully connected layer (paper, section V-A)."""

    def __init__(self, observation_size: int, hidden_size: int) -> None:
        super().__init__()
        self.hidden_size = hidden_size
        self.encoder = nn.Linear(observation_size, hidden_size)
        self.gru = nn.GRUCell(hidden_size, hidden_size)
        self.head = nn.Linear(hidden_size, N_ACTIONS)

    def step(self, observation: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        """One decision of many UAVs.

        Args:
            observation: shape (N, observation_size).
            hidden: of each UAV's decision before, zero at the start of a mission, (N, H).

        Returns:
            Q values (N, N_ACTIONS) and the new hidden states (N, H).
        """
        hidden = self.gru(torch.relu(self.encoder(observation)), hidden)
        return self.head(hidden), hidden

    def forward(self, observation: Tensor, step_sizes: Sequence[int]) -> Tensor:
        """All decisions of many sequences, each the decisions of one UAV in one mission.

        Args:
            observation: rows step by step: the first decisions of all sequences, the second ones
                of those that have one, ...; longer sequences first, shape (R, observation_size).
            step_sizes: how many sequences reach each step, descending; they sum to R.

        Returns:
            Q values, shape (R, N_ACTIONS).
        """
        encoded = torch.relu(self.encoder(observation))
        from_input = nn.functional.linear(encoded, self.gru.weight_ih, self.gru.bias_ih)
        hidden = _Recurrence.apply(from_input, self.gru.weight_hh, self.gru.bias_hh, step_sizes)
        return self.head(hidden)


class _Recurrence(torch.autograd.Function):
    """A GRU's recurrence over packed sequences, with its own way back.

    Step by step only what depends on the step before is computed; all else, the weights' gradient
    above all, is one operation over all rows.
    """

    @staticmethod
    @torch.amp.custom_fwd(device_type='cpu', cast_inputs=torch.float32)
    def forward(
        context: Any,  # noqa: ANN401 - torch's own
        from_input: Tensor,
        weight: Tensor,
        bias: Tensor,
        step_sizes: Sequence[int],
    ) -> Tensor:
        """Hidden states (R, H) of gate inputs (R, 3 H) in the order reset, update, new."""
        size, sizes = weight.shape[1], list(step_sizes)
        hidden = from_input.new_empty(len(from_input), size)
        switches = from_input.new_empty(len(from_input), 2 * size)  # reset and update gate
        new = torch.empty_like(hidden)
        recurrent = torch.empty_like(from_input)
        turned = weight.t()
        before = from_input.new_zeros(sizes[0], size)
        # Views of all steps at once: a slice at each step would cost as much as its product.
        for rows in zip(
            from_input[:, : 2 * size].split(sizes),
            from_input[:, 2 * size :].split(sizes),
            recurrent.split(sizes),
            recurrent[:, : 2 * size].split(sizes),
            recurrent[:, 2 * size :].split(sizes),
            switches.split(sizes),
            switches[:, :size].split(sizes),
            switches[:, size:].split(sizes),
            new.split(sizes),
            hidden.split(sizes),
            strict=True,
        ):
            into_switch, into_new, back, back_switch, back_new, switch, reset, update = rows[:8]
            before = before[: len(into_new)]
            torch.addmm(bias, before, turned, out=back)
            torch.add(into_switch, back_switch, out=switch).sigmoid_()
            torch.addcmul(into_new, reset, back_new, out=rows[8]).tanh_()
            before = torch.lerp(rows[8], before, update, out=rows[9])
        context.save_for_backward(weight, hidden, switches, new, recurrent)
        context.step_sizes = sizes
        return hidden

    @staticmethod
    @torch.amp.custom_bwd(device_type='cpu')
    def backward(context: Any, from_above: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """Gradients of the gate inputs, the weight and the bias."""
        weight, hidden, switches, new, recurrent = context.saved_tensors
        sizes: list[int] = context.step_sizes
        size = weight.shape[1]
        before = _shifted(hidden, sizes)
        reset, update = switches.split(size, dim=1)
        by_new = (1.0 - update) * (1.0 - new * new)
        by_reset = by_new * recurrent[:, 2 * size :] * reset * (1.0 - reset)
        by_update = (before - new) * update * (1.0 - update)
        slope = torch.stack((by_reset, by_update, by_new * reset), dim=1)  # (R, 3, H)
        total = from_above.clone()
        back = torch.empty_like(slope)
        carried = from_above.new_zeros(0, size)
        for gradient, slopes, kept, into in zip(
            reversed(total.split(sizes)),
            reversed(slope.split(sizes)),
            reversed(update.split(sizes)),
            reversed(back.split(sizes)),
            strict=True,
        ):
            gradient[: len(carried)] += carried
            torch.mul(gradient.unsqueeze(1), slopes, out=into)
            carried = torch.addmm(gradient * kept, into.flatten(1), weight)
        rows = back.flatten(1)
        from_input = rows.clone()
        from_input[:, 2 * size :] = total * by_new
        return from_input, rows.t() @ before, rows.sum(dim=0), None


def _shifted(hidden: Tensor, step_sizes: Sequence[int]) -> Tensor:
    """The hidden state before each row: that of the same sequence one step earlier, or zero."""
    n_first = step_sizes[0]
    pieces = [hidden.new_zeros(n_first, hidden.shape[1])]
    start = 0
    for n_here, n_next in pairwise(step_sizes):
        pieces.append(hidden[start : start + n_next])
        start += n_here
    return torch.cat(pieces)

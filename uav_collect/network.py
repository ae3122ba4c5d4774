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
        size = weight.shape[1]
        hidden = from_input.new_empty(len(from_input), size)
        gates = torch.empty_like(from_input)  # reset and update gate, new state
        recurrent = torch.empty_like(from_input)
        turned = weight.t()
        before = from_input.new_zeros(step_sizes[0], size)
        start = 0
        for n_rows in step_sizes:
            stop = start + n_rows
            before = before[:n_rows]
            incoming, gate = from_input[start:stop], gates[start:stop]
            returned = torch.addmm(bias, before, turned, out=recurrent[start:stop])
            switch = torch.add(incoming[:, : 2 * size], returned[:, : 2 * size]).sigmoid_()
            gate[:, : 2 * size] = switch
            new = torch.addcmul(
                incoming[:, 2 * size :], switch[:, :size], returned[:, 2 * size :]
            ).tanh_()
            gate[:, 2 * size :] = new
            before = torch.lerp(new, before, switch[:, size:], out=hidden[start:stop])
            start = stop
        context.save_for_backward(weight, hidden, gates, recurrent)
        context.step_sizes = step_sizes
        return hidden

    @staticmethod
    @torch.amp.custom_bwd(device_type='cpu')
    def backward(context: Any, from_above: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """Gradients of the gate inputs, the weight and the bias."""
        weight, hidden, gates, recurrent = context.saved_tensors
        step_sizes: Sequence[int] = context.step_sizes
        size = weight.shape[1]
        before = _shifted(hidden, step_sizes)
        reset, update, new = gates.split(size, dim=1)
        by_new = (1.0 - update) * (1.0 - new * new)
        by_reset = by_new * recurrent[:, 2 * size :] * reset * (1.0 - reset)
        by_update = (before - new) * update * (1.0 - update)
        slope = torch.stack((by_reset, by_update, by_new * reset), dim=1)  # (R, 3, H)
        total = torch.empty_like(from_above)
        back = torch.empty_like(slope)
        carried = from_above.new_zeros(0, size)
        stop = len(from_above)
        for n_rows in reversed(step_sizes):
            start = stop - n_rows
            gradient = total[start:stop]
            gradient.copy_(from_above[start:stop])
            gradient[: len(carried)] += carried
            slopes = torch.mul(gradient.unsqueeze(1), slope[start:stop], out=back[start:stop])
            carried = torch.addmm(gradient * update[start:stop], slopes.flatten(1), weight)
            stop = start
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

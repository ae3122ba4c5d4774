"""The first layer of the agent network, over observations that are dense or sparse."""

from typing import Any

import numpy as np
import torch
from torch import nn, Tensor
from uav_collect.learning import encoder_kernels
from uav_collect.missions.experience import SparseRows


def encoded(layer: nn.Linear, observation: Tensor | SparseRows) -> Tensor:
    """A fully connected layer and ReLU.

    Args:
        observation: shape (R, observation_size); sparse where `runs_compiled` says that it may be.

    Returns:
        Shape (R, H).
    """
    if isinstance(observation, SparseRows):
        return SparseEncoding.apply(layer.weight, layer.bias, observation)
    return torch.relu_(layer(observation))


class SparseEncoding(torch.autograd.Function):
    """The layer over sparse observations, which get no gradient."""

    @staticmethod
    def forward(
        context: Any,  # noqa: ANN401 - torch's own
        weight: Tensor,
        bias: Tensor,
        rows: SparseRows,
    ) -> Tensor:
        """Shape (R, H)."""
        out = weight.new_empty(len(rows.start), len(weight))
        by_column = weight.t().contiguous()
        encoder_kernels.encode(*rows, by_column.numpy(), bias.numpy(), out.numpy())
        context.rows, context.observation_size = rows, weight.shape[1]
        context.save_for_backward(out)
        return out

    @staticmethod
    def backward(context: Any, from_above: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """Gradients of the weight and the bias."""
        [out] = context.saved_tensors
        size = out.shape[1]
        by_weight = out.new_zeros(context.observation_size, size)
        by_bias = torch.zeros(size, dtype=torch.float64)
        rows: SparseRows = context.rows
        encoder_kernels.slopes_by_weight(
            rows.column,
            rows.value,
            rows.start,
            rows.stop,
            from_above.contiguous().numpy(),
            out.numpy(),
            np.empty(size, dtype=np.float32),
            by_weight.numpy(),
            by_bias.numpy(),
        )
        return by_weight.t(), by_bias.to(out.dtype), None

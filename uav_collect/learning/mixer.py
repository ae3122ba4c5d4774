"""The mixing network: the team's action value out of the UAVs' own, monotonic in each of them."""

import math

import torch
from torch import nn, Tensor


class Mixer(nn.Module):
    """Two fully connected layers with ELU, weights by hypernetworks on the global state.

    The completion maps in the state are pooled first (paper, section V-B).
    """

    def __init__(
        self,
        *,
        n_uavs: int,
        n_uav_scalars: int,
        n_rows: int,
        n_columns: int,
        pool_side: int,
        pooling: str,
        embedding_size: int,
        hypernetwork_size: int,
    ) -> None:
        """Make the layers.

        Args:
            n_uav_scalars: numbers of the state for each UAV besides its map.
            pool_side: cells of a pooling window's side, the paper's M.
            pooling: 'sum' of a window's cells, or their 'mean', which keeps the state's numbers
                alike: with sums the state's part of the value drowns the UAVs' at first.
        """
        super().__init__()
        self._windows: Tensor
        self._embedding_size, self._n_uavs = embedding_size, n_uavs
        windows = pooling_windows(n_rows, n_columns, pool_side)
        if pooling == 'mean':
            windows /= pool_side * pool_side
        self.register_buffer('_windows', windows, persistent=False)
        state_size = n_uavs * n_uav_scalars + (n_uavs + 1) * windows.shape[1]
        sizes = state_size, hypernetwork_size
        self.inner_weight = _hypernetwork(*sizes, n_uavs * embedding_size)
        self.inner_bias = _hypernetwork(*sizes, embedding_size)
        self.outer_weight = _hypernetwork(*sizes, embedding_size)
        self.outer_bias = _hypernetwork(*sizes, 1)

    def state(self, fleet: Tensor, complete: Tensor) -> Tensor:
        """The global state, its maps pooled; all mixers of a fleet and area pool alike.

        Args:
            fleet: the state's numbers of each UAV, shape (N, U * n_uav_scalars).
            complete: completion maps of all UAVs and the true one, shape (N, U + 1, C).

        Returns:
            Shape (N, state size).
        """
        pooled = complete.to(fleet.dtype) @ self._windows
        return torch.cat((fleet, pooled.flatten(1)), dim=1)

    def forward(self, values: Tensor, state: Tensor) -> Tensor:
        """Mix the values of all UAVs into the team's.

        Args:
            values: of each UAV's action, shape (N, U).
            state: shape (N, state size).

        Returns:
            The team's action value, shape (N,).
        """
        inner = self.inner_weight(state).abs()
        inner = inner.view(-1, self._n_uavs, self._embedding_size)
        bias = self.inner_bias(state).unsqueeze(1)
        mixed = torch.baddbmm(bias, values.unsqueeze(1), inner).squeeze(1)
        outer = self.outer_weight(state).abs()
        total = (nn.functional.elu(mixed) * outer).sum(dim=1)
        return total + self.outer_bias(state).squeeze(1)


def _hypernetwork(state_size: int, hypernetwork_size: int, n_weights: int) -> nn.Module:
    return nn.Sequential(
        nn.Linear(state_size, hypernetwork_size),
        nn.ReLU(inplace=True),
        nn.Linear(hypernetwork_size, n_weights),
    )


def pooling_windows(n_rows: int, n_columns: int, pool_side: int) -> Tensor:
    """Which cells each pooling window sums; those at the far edges may reach outside.

    Returns:
        Zeros and ones, shape (C, windows).
    """
    high, wide = math.ceil(n_rows / pool_side), math.ceil(n_columns / pool_side)
    row, column = torch.arange(n_rows) // pool_side, torch.arange(n_columns) // pool_side
    window = (row[:, None] * wide + column[None, :]).flatten()
    return nn.functional.one_hot(window, high * wide).float()

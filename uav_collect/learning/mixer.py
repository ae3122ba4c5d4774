"""The mixing networks: the team's action value out of the UAVs' own, monotonic in each of them."""

from functools import lru_cache
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
        outer = self.outer_weight(state).abs()
        return _mixed(values, inner, self.inner_bias(state), outer, self.outer_bias(state))


class SetMixer(nn.Module):
    """A mixer of any number of UAVs over any area: which UAV is which changes nothing.

    Each UAV's part of the state is encoded alike beside what all share; the mean of these codes
    stands for the fleet. A UAV's weights come from its own code and the fleet's.
    """

    def __init__(self, *, n_uav_scalars: int, embedding_size: int, hypernetwork_size: int) -> None:
        """Make the layers.

        Args:
            n_uav_scalars: numbers of the state for each UAV besides its map.
        """
        super().__init__()
        self._n_uav_scalars = n_uav_scalars
        n_own, n_shared = n_uav_scalars + _N_BLOCKS, _N_BLOCKS + _N_FIELD_SCALARS
        size = hypernetwork_size
        self.own_code = nn.Linear(n_own, size)
        self.shared_code = nn.Linear(n_shared, size)
        self.fleet_code = nn.Linear(size + n_shared, size)
        self.inner_own = nn.Linear(size, embedding_size)
        self.inner_fleet = nn.Linear(size, embedding_size)
        self.inner_bias = nn.Linear(size, embedding_size)
        self.outer_weight = nn.Linear(size, embedding_size)
        self.outer_bias = nn.Sequential(
            nn.Linear(size, size), nn.ReLU(inplace=True), nn.Linear(size, 1)
        )

    def state(self, fleet: Tensor, complete: Tensor, area: tuple[int, int]) -> Tensor:
        """The global state: of each UAV its numbers and pooled map, then what all share.

        Args:
            fleet: the state's numbers of each UAV, shape (N, U * n_uav_scalars).
            complete: completion maps of all UAVs and the true one, shape (N, U + 1, C).
            area: rows and columns.

        Returns:
            Shape (N, U * (n_uav_scalars + 25) + 25 + 3).
        """
        n_states, n_maps, _ = complete.shape
        n_uavs = n_maps - 1
        rows, columns = (_blocks(side).to(fleet) for side in area)
        maps = complete.view(n_states, n_maps, *area).to(fleet.dtype)
        pooled = (rows @ (maps @ columns.T)).flatten(2)
        own = torch.cat((fleet.view(n_states, n_uavs, -1), pooled[:, :-1]), dim=2)
        sizes = n_uavs / _USUAL_UAVS, area[0] / _USUAL_SIDE, area[1] / _USUAL_SIDE
        field = fleet.new_tensor(sizes).expand(n_states, _N_FIELD_SCALARS)
        return torch.cat((own.flatten(1), pooled[:, -1], field), dim=1)

    def forward(self, values: Tensor, state: Tensor) -> Tensor:
        """Mix the values of all UAVs into the team's.

        Args:
            values: of each UAV's action, shape (N, U).
            state: shape (N, state size), of as many UAVs.

        Returns:
            The team's action value, shape (N,).
        """
        n_uavs = values.shape[1]
        n_shared = _N_BLOCKS + _N_FIELD_SCALARS
        own = state[:, :-n_shared].view(len(state), n_uavs, self._n_uav_scalars + _N_BLOCKS)
        shared = state[:, -n_shared:]
        codes = (self.own_code(own) + self.shared_code(shared).unsqueeze(1)).relu()
        fleet = self.fleet_code(torch.cat((codes.mean(dim=1), shared), dim=1)).relu()
        inner = (self.inner_own(codes) + self.inner_fleet(fleet).unsqueeze(1)).abs()
        outer = self.outer_weight(fleet).abs()
        return _mixed(values, inner, self.inner_bias(fleet), outer, self.outer_bias(fleet))


def _mixed(
    values: Tensor, inner: Tensor, inner_bias: Tensor, outer: Tensor, outer_bias: Tensor
) -> Tensor:
    """The UAVs' values (N, U) through two layers, their weights (N, U, E) and (N, E); (N,)."""
    # A sum over the UAVs: a product of two small matrices for each row takes twice as long.
    summed = (values.unsqueeze(2) * inner).sum(dim=1) + inner_bias
    return (nn.functional.elu(summed) * outer).sum(dim=1) + outer_bias.squeeze(1)


_BLOCKS_PER_SIDE = 5
_N_BLOCKS = _BLOCKS_PER_SIDE**2
_N_FIELD_SCALARS = 3  # number of UAVs, rows, columns
_USUAL_UAVS, _USUAL_SIDE = 8, 24  # that make these about 1


@lru_cache(maxsize=128)
def _blocks(side: int) -> Tensor:
    """The share that each cell of a side has in the mean of each block, shape (5, side).

    Blocks cover the side evenly; neighbours share a cell where it does not divide, as in torch's
    adaptive mean pooling.
    """
    shares = torch.zeros(_BLOCKS_PER_SIDE, side)
    for block in range(_BLOCKS_PER_SIDE):
        first = block * side // _BLOCKS_PER_SIDE
        last = -(-(block + 1) * side // _BLOCKS_PER_SIDE)
        shares[block, first:last] = 1.0 / (last - first)
    return shares


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

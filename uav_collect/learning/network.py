"""The agent network: a deep recurrent Q-network whose parameters all UAVs share."""

from collections.abc import Sequence

import torch
from torch import nn, Tensor
from uav_collect.learning.encoder import encoded
from uav_collect.learning.own_modules import PluggedNetwork
from uav_collect.learning.recurrence import hidden_states
from uav_collect.missions.experience import SparseRows
from uav_collect.uav.action_codes import N_ACTIONS


class Drqn(nn.Module):
    """Fully connected layer, ReLU, GRU, fully connected layer (paper, section V-A)."""

    def __init__(self, observation_size: int, hidden_size: int) -> None:
        super().__init__()
        self.hidden_size = hidden_size
        self.text = ''  # of a policy's header
        self.encoder = nn.Linear(observation_size, hidden_size)
        self.gru = nn.GRUCell(hidden_size, hidden_size)
        self.head = nn.Linear(hidden_size, N_ACTIONS)
        self.advice_bonus = 0.0  # on the value of what the adviser would do, when one is chosen

    @property
    def core(self) -> nn.Module:
        """The module whose weights a policy holds."""
        return self

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

    def forward(self, observation: Tensor | SparseRows, step_sizes: Sequence[int]) -> Tensor:
        """All decisions of many sequences, each the decisions of one UAV in one mission.

        Args:
            observation: rows step by step: the first decisions of all sequences, the second ones
                of those that have one, ...; longer sequences first, shape (R, observation_size);
                sparse only where the GRU `runs_compiled`.
            step_sizes: how many sequences reach each step, descending; they sum to R.

        Returns:
            Q values, shape (R, N_ACTIONS).
        """
        inputs = encoded(self.encoder, observation)
        return self.head(hidden_states(inputs, self.gru, step_sizes))


AgentNetwork = Drqn | PluggedNetwork

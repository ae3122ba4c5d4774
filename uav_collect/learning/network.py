"""What learns: the agent network, whose parameters all UAVs share, and the mixers of fleets."""

from collections.abc import Sequence
from functools import partial
from typing import cast

import torch
from torch import nn, Tensor
from uav_collect.learning.encoder import encoded
from uav_collect.learning.minibatch import Algorithm
from uav_collect.learning.mixer import Mixer, SetMixer
from uav_collect.learning.own_modules import PluggedMixer, PluggedNetwork
from uav_collect.learning.recurrence import hidden_states
from uav_collect.missions.experience import N_UAV_SCALARS, SparseRows
from uav_collect.training.config import TrainingConfig
from uav_collect.training.plug_ins import MixerSpace
from uav_collect.uav.action_codes import N_ACTIONS
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.observation import observation_size


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


class Networks(nn.Module):
    """The agent network, and where the algorithm has one a mixer.

    There is one for each fleet and area, or a single one for all of them.
    """

    def __init__(
        self, config: TrainingConfig, briefings: Sequence[Briefing], algorithm: Algorithm
    ) -> None:
        super().__init__()
        first = briefings[0]
        size = observation_size(config.layout, len(first.is_open), first.n_uavs)
        hidden_size, own = config.network.hidden_size, config.network.own
        self.agent: AgentNetwork = (
            PluggedNetwork(own, size, hidden_size) if own else Drqn(size, hidden_size)
        )
        self.mixers = nn.ModuleList()
        if not algorithm.mixes:
            return
        if config.mixer.is_of_sets:
            self.mixers.append(_set_mixer(config))
        else:
            make = _own_mixer if config.mixer.own else _mixer
            self.mixers.extend(make(config, briefing) for briefing in briefings)

    def mixer(self, task: int) -> Mixer | SetMixer | PluggedMixer | None:
        """The mixer of a task's fleet and area."""
        if not len(self.mixers):
            return None
        place = 0 if isinstance(self.mixers[0], SetMixer) else task
        return cast(Mixer | SetMixer | PluggedMixer, self.mixers[place])

    def state(self, task: int, fleet: Tensor, complete: Tensor, area: tuple[int, int]) -> Tensor:
        """What the mixer of a task sees; of no width where there is none, (E, ...).

        Args:
            fleet: numbers of each UAV, shape (E, U * N_UAV_SCALARS).
            complete: maps of all UAVs and the true one, shape (E, U + 1, C).
            area: rows and columns.
        """
        match self.mixer(task):
            case None:
                return fleet[:, :0]
            case SetMixer() as mixer:
                return mixer.state(fleet, complete, area)
            case mixer:
                return mixer.state(fleet, complete)


def _set_mixer(config: TrainingConfig) -> SetMixer:
    return SetMixer(
        n_uav_scalars=N_UAV_SCALARS,
        embedding_size=config.mixer.embedding_size,
        hypernetwork_size=config.mixer.hypernetwork_size,
    )


def _mixer(config: TrainingConfig, briefing: Briefing) -> Mixer:
    return Mixer(
        n_uavs=briefing.n_uavs,
        n_uav_scalars=N_UAV_SCALARS,
        n_rows=briefing.n_rows,
        n_columns=briefing.n_columns,
        pool_side=config.mixer.pool_side,
        pooling=config.mixer.pooling,
        embedding_size=config.mixer.embedding_size,
        hypernetwork_size=config.mixer.hypernetwork_size,
    )


def _own_mixer(config: TrainingConfig, briefing: Briefing) -> PluggedMixer:
    space = MixerSpace(
        n_uavs=briefing.n_uavs,
        n_uav_scalars=N_UAV_SCALARS,
        n_rows=briefing.n_rows,
        n_columns=briefing.n_columns,
        embedding_size=config.mixer.embedding_size,
        hypernetwork_size=config.mixer.hypernetwork_size,
        new_mixer=partial(_mixer, config, briefing),
    )
    return PluggedMixer(config.mixer.own, space)

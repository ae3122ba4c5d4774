"""What users write to learn otherwise: a network, a mixer, an algorithm, each a class.

`network.kind`, `mixer.kind` and `--algorithm` take `module:Name`. Shapes: R rows, each a decision
as one UAV saw it; E decisions in the order of missions; U UAVs, A actions, C cells, H numbers of
memory.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

from uav_collect.config.yaml_text import shown
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Floats
from uav_collect.limits import (
    ALGORITHMS,
    FLEET_ALGORITHMS,
    is_algorithm,
    is_code_name,
    MAX_LAYER_SIZE,
)
from uav_collect.uav.named_code import named_code, NamedCode
from uav_collect.uav.user_code import UserCodeError, value_text

Tensor = Any  # torch's, which this room does not load

_LIKE = ('aqmix', 'qmix', 'aiql')  # that an algorithm of a user's may be


class OwnNetwork(Protocol):
    """The agent network: a `torch.nn.Module`, made by `Name(observation_size, hidden_size)`.

    It has `layers`, from which a policy flies on board without torch and without the user's
    module: the names of its layers (linear, layer norm, one GRU cell) and of activations (relu,
    tanh) in their order, as `step` calls them; or else `fly`, and its policies need the module.
    """

    layers: Sequence[str]

    @staticmethod
    def memory_size(hidden_size: int) -> int:
        """H, how many numbers a UAV remembers from decision to decision; 0: no memory."""

    def step(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """One decision of many UAVs.

        Args:
            observation: shape (N, observation_size).
            memory: of each UAV's decision before, zeros at first, shape (N, H).

        Returns:
            Q values (N, A) and the new memories (N, H).
        """

    def forward(self, observation: Tensor, step_sizes: Sequence[int]) -> Tensor:
        """All decisions of many UAVs in many missions, to learn from.

        Args:
            observation: the first decisions of all, the second ones of those that have one, ...;
                who has more comes first, shape (R, observation_size).
            step_sizes: how many UAVs reach each step, descending; they sum to R.

        Returns:
            Q values, shape (R, A), as `step` gives them one after the other.
        """

    @staticmethod
    def fly(
        weights: Mapping[str, Floats], observation: Floats, memory: Floats
    ) -> tuple[Floats, Floats]:
        """What `step` computes for one decision, in numpy.

        Args:
            weights: by their name in the module's `state_dict`.
            observation: shape (observation_size,).
            memory: shape (H,).

        Returns:
            Q values (A,) and the new memory (H,).
        """


@dataclass(frozen=True, kw_only=True)
class MixerSpace:
    """What a mixer is made for: one fleet over one area."""

    n_uavs: int
    n_uav_scalars: int  # numbers of the state for each UAV: east, north, energy, still decides
    n_rows: int
    n_columns: int
    embedding_size: int  # of the settings
    hypernetwork_size: int
    new_mixer: Callable[[], Any]  # makes QMIX's, which has `state`, and takes values and state


class OwnMixer(Protocol):
    """The mixing network: a `torch.nn.Module`, made by `Name(space)` with a `MixerSpace`."""

    def state(self, fleet: Tensor, complete: Tensor) -> Tensor:
        """The global state as `forward` takes it.

        Args:
            fleet: numbers of each UAV, shape (E, U * n_uav_scalars).
            complete: completion maps of all UAVs and the true one, zeros and ones, (E, U + 1, C).

        Returns:
            Shape (E, any width).
        """

    def forward(self, values: Tensor, best: Tensor, state: Tensor) -> Tensor:
        """Mix the values of all UAVs into the team's.

        Where a UAV's value rises, the team's must not fall: UAVs choose by their own values.

        Args:
            values: of each UAV's latest action, 0 where it has none, shape (N, U).
            best: of the best legal action at the same decisions, shape (N, U).
            state: shape (N, width).

        Returns:
            The team's action value, shape (N,).
        """


class OwnAlgorithm(Protocol):
    """How it learns: a class that is called without arguments."""

    like: str  # aqmix, qmix or aiql: how missions are flown, who follows whom, and if it mixes

    def next_values(self, online: Tensor, target: Tensor, legal: Tensor) -> Tensor:
        """What a UAV's next decision is worth, for the targets.

        Args:
            online: Q values of the network that learns, shape (R, A).
            target: of the target network, shape (R, A).
            legal: which actions are, shape (R, A).

        Returns:
            Shape (R,).
        """

    def loss(self, team: Tensor, target: Tensor) -> Tensor:
        """What the optimiser makes less.

        Args:
            team: action values of L decisions, mixed unless `like` is aiql, shape (L,).
            target: their lambda-returns (`target.trace`), shape (L,).

        Returns:
            One number.
        """


@cache
def own_network(name: str) -> NamedCode:
    """A user's network.

    Raises:
        UserCodeError: there is none, or it lacks something.
    """
    code = named_code(name, ('memory_size', 'step', 'forward'))
    if not (hasattr(code.target, 'layers') or hasattr(code.target, 'fly')):
        raise UserCodeError('it lacks layers or fly: must have one of them to fly on board')
    return code


def memory_size(name: str, hidden_size: int) -> int:
    """How many numbers a UAV remembers with a user's network.

    Raises:
        UserCodeError: the class fails, or gives no such number.
    """
    code = own_network(name)
    size = code.call(code.target.memory_size, hidden_size)  # type: ignore[attr-defined]
    if type(size) is not int or not 0 <= size <= MAX_LAYER_SIZE:
        allowed = f'a whole number from 0 to {MAX_LAYER_SIZE}'
        raise UserCodeError(f'memory_size gives {value_text(size)}: must be {allowed}')
    return size


@cache
def own_mixer(name: str) -> NamedCode:
    """A user's mixer.

    Raises:
        UserCodeError: there is none, or it lacks something.
    """
    return named_code(name, ('state', 'forward'))


@cache
def own_algorithm(name: str) -> OwnAlgorithm:
    """A user's algorithm.

    Raises:
        UserCodeError: there is none, or it lacks something.
    """
    code = named_code(name, ('like', 'next_values', 'loss'))
    algorithm: OwnAlgorithm = code.call(code.target)
    like = code.call(getattr, algorithm, 'like')
    if type(like) is not str or like not in _LIKE:
        raise UserCodeError(f'like is {value_text(like)}: must be {" or ".join(_LIKE)}')
    return algorithm


def algorithm_like(name: str) -> str:
    """The one of our algorithms that a name stands for, or that a user's is like.

    Raises:
        ConfigError: there is none, or a user's lacks something.
    """
    if name in ALGORITHMS:
        return name
    if not is_code_name(name):
        known = f'{", ".join(ALGORITHMS)} or module:Name'
        raise ConfigError(f'algorithm is {shown(name)}: must be {known}')
    try:
        return own_algorithm(name).like
    except UserCodeError as error:
        raise ConfigError(f'algorithm is {name}: {error}') from error


def check_fleet_algorithm(name: str) -> None:
    """Refuse an algorithm by which UAVs wait for each other, as those of a fleet cannot.

    Raises:
        ConfigError: it is one, there is none of that name, or a user's lacks something.
    """
    known = ' or '.join(FLEET_ALGORITHMS)
    if not is_algorithm(name):
        raise ConfigError(f'algorithm is {shown(name)}: must be {known} or module:Name')
    like = algorithm_like(name)
    if like not in FLEET_ALGORITHMS:
        why = f'{like} lets all UAVs wait for each other'
        raise ConfigError(f'algorithm is {shown(name)}: must be {known}, or like one: {why}')


def short_name(algorithm: str) -> str:
    """What stands for an algorithm in the names of runs and files."""
    return algorithm.rpartition(':')[2]

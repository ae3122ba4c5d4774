"""What a user might write that cannot learn: each lacks something, or gives what it should not."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import nn, Tensor

NUMBER = 7


class Nothing:
    pass


class Blind:
    base = 'radar'
    size = 1

    def numbers(self, situation: object) -> Sequence[float]:
        return [0.0]


class Short(Blind):
    base = 'egocentric'

    def numbers(self, situation: object) -> Sequence[float]:
        return [0.0, 1.0]


class Listed(Blind):
    base = ('egocentric',)  # type: ignore[assignment]


class Shy(Blind):
    base = 'egocentric'

    @property
    def size(self) -> int:  # type: ignore[override]
        raise RuntimeError('none of your business')


class Learning(Blind):
    """Gives a tensor that torch does not hand to numpy."""

    base = 'egocentric'

    def numbers(self, situation: object) -> Any:  # noqa: ANN401
        return torch.zeros(1, requires_grad=True)


class Lazy(nn.Module):
    """A mixer that mixes nothing."""

    def __init__(self, space: object) -> None:
        super().__init__()

    def state(self, fleet: Tensor, complete: Tensor) -> Tensor:
        return fleet

    def forward(self, values: Tensor, best: Tensor, state: Tensor) -> Tensor:
        return values


class Broken(Lazy):
    def forward(self, values: Tensor, best: Tensor, state: Tensor) -> Tensor:
        raise RuntimeError('no mix today')


class Forgetful(nn.Module):
    """A network that tells less of its layers than it has."""

    layers: tuple[str, ...] = ('one', 'two')

    def __init__(self, observation_size: int, hidden_size: int) -> None:
        super().__init__()
        self.one = nn.Linear(observation_size, hidden_size)
        self.two = nn.Linear(hidden_size, 5)

    @staticmethod
    def memory_size(hidden_size: int) -> int:
        return 0

    def step(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        return self.forward(observation, []), memory

    def forward(self, observation: Tensor, step_sizes: Sequence[int]) -> Any:  # noqa: ANN401
        return self.two(torch.relu(self.one(observation)))


class Misnamed(Forgetful):
    layers = 'one', 'relu', 'three'


class Spelled(Forgetful):
    layers = 'one two'  # type: ignore[assignment]


class Nested(nn.Module):
    """A network whose modules are called as a list of names would be: it flies by `fly`."""

    def __init__(self, observation_size: int, hidden_size: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList([nn.Linear(observation_size, 5)])

    memory_size, step = Forgetful.memory_size, Forgetful.step

    def forward(self, observation: Tensor, step_sizes: Sequence[int]) -> Any:  # noqa: ANN401
        return self.layers[0](observation)

    @staticmethod
    def fly(weights: Any, observation: Any, memory: Any) -> tuple[Any, Any]:  # noqa: ANN401
        return weights['layers.0.weight'] @ observation + weights['layers.0.bias'], memory


class Wild:
    like = 'ddpg'
    next_values = loss = None


class Several(Wild):
    like = ('aqmix',)  # type: ignore[assignment]


def shouting(outcomes: object) -> str:
    return 'much'


def learning(outcomes: Any) -> Any:  # noqa: ANN401
    return torch.zeros(len(outcomes.time_s), requires_grad=True)

"""Networks and mixers that users wrote: made, tried out, and called; what fails is one line."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
import torch
from torch import nn, Tensor
from uav_collect.errors import ConfigError, PolicyMismatchError
from uav_collect.training.plug_ins import memory_size, MixerSpace, own_mixer, own_network
from uav_collect.uav.action_codes import N_ACTIONS
from uav_collect.uav.named_code import NamedCode
from uav_collect.uav.policy_header import check_network
from uav_collect.uav.policy_network import network_of
from uav_collect.uav.user_code import kind_text, UserCodeError, value_text

_TOLERANCE = 1e-3  # between torch's float32 and numpy's float64, relative to the largest value


class PluggedNetwork(nn.Module):
    """A user's agent network behind the interface of `network.Drqn`."""

    def __init__(self, name: str, observation_size: int, hidden_size: int) -> None:
        """Make the user's network and try it out.

        Raises:
            ConfigError: it fails, gives other shapes than it should, or flies otherwise on board.
        """
        super().__init__()
        self._code, self._what = own_network(name), f'network {name}'
        self.memory_size = memory_size(name, hidden_size)
        target = self._code.target
        self.inner: nn.Module = _made(
            self._what, self._code, target, observation_size, hidden_size
        )
        self.advice_bonus = 0.0  # on the value of what the adviser would do, when one is chosen
        self.text = self._listed_layers() or name  # of a policy's header
        self._try_out(observation_size)

    @property
    def core(self) -> nn.Module:
        """The module whose weights a policy holds."""
        return self.inner

    def step(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """One decision of many UAVs, see `plug_ins.OwnNetwork`."""
        stepped: tuple[Tensor, Tensor] = self._call(self.inner.step, observation, memory)
        return stepped

    def forward(self, observation: Tensor, step_sizes: Sequence[int]) -> Tensor:
        """All decisions of many sequences, see `plug_ins.OwnNetwork`."""
        values: Tensor = self._call(self.inner, observation, step_sizes)
        return values

    def _call(self, function: Any, *arguments: object) -> Any:  # noqa: ANN401 - the user's
        return _called(self._what, self._code, function, *arguments)

    def _listed_layers(self) -> str:
        """What a policy flies by without the user's module; '': it flies by the class's `fly`."""
        if not hasattr(self._code.target, 'layers'):  # of the object it may be a module of torch's
            return ''
        layers = self._call(getattr, self.inner, 'layers')
        is_list = isinstance(layers, list | tuple) and len(layers) > 0
        if not is_list or not all(type(it) is str for it in layers):
            what = f'layers is {value_text(layers)}: must be a list of names of layers'
            raise ConfigError(f'{self._what}: {what}')
        return ' '.join(layers)

    @torch.no_grad()
    def _try_out(self, observation_size: int) -> None:
        """Let it value three decisions of two UAVs in both ways, and two of them on board."""
        seen = torch.rand(3, observation_size)
        stepped = self._call(self.inner.step, seen[:2], torch.zeros(2, self.memory_size))
        if not (isinstance(stepped, tuple) and len(stepped) == 2):
            raise ConfigError(f'{self._what}: step gives a {kind_text(stepped)}: must be a pair')
        first, memory = stepped
        check_tensor(self._what, 'step', first, (2, N_ACTIONS))
        check_tensor(self._what, "step's memory", memory, (2, self.memory_size))
        third, _ = self.step(seen[2:], memory[:1])
        together = self.forward(seen, [2, 1])
        check_tensor(self._what, 'forward', together, (3, N_ACTIONS))
        one_by_one = torch.cat((first, third)).numpy()
        self._check_same('forward', together.numpy(), one_by_one)
        flown, memories = self._flown(seen[:2].double().numpy())
        self._check_same('on board it', flown, one_by_one[:2])
        self._check_same('on board its memory', memories, memory.numpy())

    def _flown(self, observation: Any) -> tuple[Any, Any]:  # noqa: ANN401 - arrays
        """What a policy would compute of first decisions."""
        weights, memory = frozen_weights(self), np.zeros((len(observation), self.memory_size))
        shapes = {name: tensor.shape for name, tensor in weights.items()}
        try:
            check_network(self.text, observation.shape[1], self.memory_size, shapes)
            return network_of(self.text, weights).step(observation, memory)
        except PolicyMismatchError as error:
            raise ConfigError(f'{self._what}, on board: {error}') from error

    def _check_same(self, way: str, values: Any, wanted: Any) -> None:  # noqa: ANN401 - arrays
        """Refuse a network that gives something else in another way."""
        if not wanted.size:
            return
        apart = float(np.abs(values - wanted).max())
        if not apart <= _TOLERANCE * max(1.0, float(np.abs(wanted).max())):
            raise ConfigError(f'{self._what}: {way} differs by {apart:.3g} from what step gives')


class PluggedMixer(nn.Module):
    """A user's mixer behind the interface of `mixer.Mixer`, with the best values besides."""

    def __init__(self, name: str, space: MixerSpace) -> None:
        """Make the user's mixer and try it out.

        Raises:
            ConfigError: it fails, or gives other shapes than it should.
        """
        super().__init__()
        self._code, self._what = own_mixer(name), f'mixer {name}'
        self.inner: nn.Module = _made(self._what, self._code, self._code.target, space)
        fleet = torch.rand(2, space.n_uavs * space.n_uav_scalars)
        maps = torch.zeros(2, space.n_uavs + 1, space.n_rows * space.n_columns, dtype=torch.uint8)
        values = torch.rand(2, space.n_uavs)
        with torch.no_grad():
            state = self.state(fleet, maps)
            if not (isinstance(state, Tensor) and state.ndim == 2 and len(state) == 2):
                check_tensor(self._what, 'state', state, (2, 'any width'))
            check_tensor(self._what, 'forward', self.forward(values, values, state), (2,))

    def state(self, fleet: Tensor, complete: Tensor) -> Tensor:
        """The global state, see `plug_ins.OwnMixer`."""
        inner: Any = self.inner
        state: Tensor = _called(self._what, self._code, inner.state, fleet, complete)
        return state

    def forward(self, values: Tensor, best: Tensor, state: Tensor) -> Tensor:
        """Mix the values of all UAVs into the team's, see `plug_ins.OwnMixer`."""
        total: Tensor = _called(self._what, self._code, self.inner, values, best, state)
        return total


def frozen_weights(agent: Any) -> dict[str, NDArray[np.float32]]:  # noqa: ANN401 - a network
    """The weights that a policy holds, copied."""
    state = agent.core.state_dict()
    return {name: np.array(tensor.detach().cpu().numpy()) for name, tensor in state.items()}


def check_tensor(what: str, name: str, tensor: object, shape: tuple[object, ...]) -> None:
    """Refuse what a user's code gave, unless it is a tensor of a shape.

    Raises:
        ConfigError: it is not.
    """
    found = tuple(tensor.shape) if isinstance(tensor, Tensor) else f'a {kind_text(tensor)}'
    if found != shape:
        raise ConfigError(f'{what}: {name} gives {found}: must be a tensor of {shape}')


def _made(what: str, code: NamedCode, make: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401
    made = _called(what, code, make, *arguments)
    if not isinstance(made, nn.Module):
        raise ConfigError(f'{what}: is a {kind_text(made)}: must be a torch.nn.Module')
    for name, tensor in made.state_dict().items():
        if tensor.dtype != torch.float32:
            raise ConfigError(f'{what}: {name} is {tensor.dtype}: must be torch.float32')
    return made


def _called(what: str, code: NamedCode, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401
    try:
        return code.call(function, *arguments)
    except UserCodeError as error:
        raise ConfigError(f'{what}: {error}') from error

"""A frozen policy: a network that learns no more, in numpy alone and in float64, and its header.

A batch of decisions gives each of them the very bits that it gets alone, so missions flown many at
once equal those flown by one agent per UAV. The header's `network` says which one it is:
- nothing: encoder, GRU cell, head, as `Recurrent` has them;
- names of layers and activations, separated by spaces: `Layers`, which the file alone describes;
- `module:Name`: a user's class, whose module must be there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
import hashlib
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Bools, Floats, Ints, Row
from uav_collect.limits import is_code_name
from uav_collect.uav.action_codes import HOME, N_ACTIONS, NONE
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.exploration import explore
from uav_collect.uav.frames import COMPASS_ACTIONS
from uav_collect.uav.heuristics import RulePolicy
from uav_collect.uav.named_code import named_code, NamedCode
from uav_collect.uav.observation import Observer
from uav_collect.uav.policy_header import ACTIVATIONS, by_network, check_shapes, PolicyHeader
from uav_collect.uav.user_code import UserCodeError, value_text
from uav_collect.uav.view import LocalView

Weights = Mapping[str, NDArray[np.float32]]

_NORM_EPSILON = 1e-5  # torch's own


class FrozenPolicy:
    """The network, ready to be asked."""

    def __init__(
        self, header: PolicyHeader, weights: Weights, *, is_header_covered: bool = True
    ) -> None:
        """Check the weights and lay them out as inference reads them.

        Args:
            weights: float32 by name, of the shapes that `policy_header.check_network` takes.
            is_header_covered: by the digest of the file that it was read from, if from any.

        Raises:
            PolicyMismatchError: a tensor is missing, unknown, misshapen or not finite.
        """
        check_shapes(header, {name: tensor.shape for name, tensor in weights.items()})
        _check_weights(weights)
        self.header = header
        self.is_header_covered = is_header_covered
        self.weights = dict(weights)
        self._parts = self._parts_of(weights)
        self._network = None if self._parts else network_of(header.network, weights)

    @property
    def networks(self) -> tuple['FrozenPolicy', ...]:
        """Its networks, each as a policy of its own; itself where it has one only."""
        return self._parts or (self,)

    @property
    def digest(self) -> str:
        """Hex digits that change with any weight."""
        return weights_digest(self.weights)

    def over(self, briefing: Briefing) -> 'FrozenPolicy':
        """The one network, of those that the policy has, that decides for a fleet over a field.

        Raises:
            ValueError: a rule does.
        """
        number = self.header.network_for(briefing)
        if number is None:
            raise ValueError('a rule flies there, no network')
        return self.networks[number - 1]

    def new_hidden(self, n_decisions: int) -> Floats:
        """The hidden states of UAVs that have not decided yet, (n_decisions, H)."""
        return np.zeros((n_decisions, self.header.hidden_size))

    def step(self, observation: Floats, hidden: Floats) -> tuple[Floats, Floats]:
        """Value the actions of decisions of different UAVs or missions.

        Args:
            observation: shape (N, observation_size).
            hidden: of each UAV after its decision before, shape (N, H).

        Returns:
            Q, shape (N, A), and the hidden states after this decision, shape (N, H).

        Raises:
            ValueError: the policy has several networks; `over` says which one decides.
        """
        if self._network is None:
            raise ValueError('one of several networks must be taken, by `over`')
        return self._network.step(observation, hidden)

    def actions(self, values: Floats, legal: Bools, frame: Ints, advice: Ints) -> Ints:
        """The legal action of the highest value in each row, the lowest of the frame's that tie.

        Args:
            values: of the actions in each UAV's frame, shape (N, A).
            legal: by the compass, shape (N, A); a row without any gives any action.
            frame: of the UAVs, shape (N,).
            advice: by the compass, shape (N,); NONE: there is none.

        Returns:
            Actions by the compass, shape (N,).
        """
        turned, bonus = COMPASS_ACTIONS[frame], self.header.advice_bonus
        if bonus > 0.0:
            values = np.where(turned == advice[:, None], values + bonus, values)
        best = best_actions(values, np.take_along_axis(legal, turned, axis=1))
        chosen: Ints = turned[np.arange(len(best)), best]
        return chosen

    def _parts_of(self, weights: Weights) -> tuple['FrozenPolicy', ...]:
        """As `networks`; none where there is one only."""
        n_networks = self.header.n_networks
        if n_networks == 1:
            return ()
        return tuple(
            FrozenPolicy(self.header.of_network(number), own)
            for number, own in enumerate(by_network(weights, n_networks), start=1)
        )


@dataclass
class LearnedPolicy:
    """A frozen policy behind the protocol `policy.Policy`, with the hidden state of its UAV.

    Those of a fleet share the frozen policy.
    """

    name: str
    frozen: FrozenPolicy
    _observer: Observer | None = field(default=None, init=False)
    _network: FrozenPolicy | None = field(default=None, init=False)  # that decides
    _hidden: Floats = field(default_factory=lambda: np.zeros((1, 0)), init=False)  # (1, H)
    _advice: int = field(default=NONE, init=False)
    _rule: RulePolicy | None = field(default=None, init=False)  # which flies instead

    @property
    def version(self) -> str:
        """Run, update and weights that it came from."""
        return self.frozen.header.version

    @property
    def observation(self) -> Row[float] | None:
        """What it chose from last, encoded, not to be written; None where a rule flies instead."""
        return None if self._observer is None else self._observer.observation

    @property
    def advice(self) -> int:
        """What its layout's adviser would have done last, by the compass; NONE: it has none."""
        return self._advice

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index.

        Raises:
            PolicyMismatchError: it did not learn to fly such a fleet, or such an area.
        """
        misfit = self.frozen.header.misfit(briefing)
        if misfit is not None:
            raise PolicyMismatchError(f'policy {self.name}: {misfit}')
        self._advice = NONE
        rule = self.frozen.header.rule_for(briefing)
        if rule is not None:
            self._observer, self._rule = None, RulePolicy(rule)
            self._rule.begin(briefing, uav)
            return
        self._observer = Observer(self.frozen.header.layout, briefing, uav)
        self._network = self.frozen.over(briefing)
        self._rule, self._hidden = None, self._network.new_hidden(1)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """The legal action of the highest value, or HOME where its adviser would fly home."""
        if self._rule is not None:
            self._advice = self._rule.choose(belief, view, legal)
            return self._advice
        observer, network = self._observer, self._network
        if observer is None or network is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        self._advice = observer.advice(belief, view, legal)
        if self._advice == HOME:
            return HOME
        observed = np.array([observer.encode(belief, view, legal, self._advice)], dtype=np.float64)
        values, self._hidden = network.step(observed, self._hidden)
        frame, advice = np.array([observer.frame]), np.array([self._advice])
        is_legal = np.array([legal]) == 1
        return int(network.actions(values, is_legal, frame, advice)[0])


@dataclass
class ExploringPolicy:
    """A learned policy whose UAV takes a random action now and then, by the key of the mission."""

    learned: LearnedPolicy
    epsilon: float  # probability to explore
    hover_share: float  # see `exploration.explore`
    mission_seed: int  # of the mission that is flown
    advice_share: float = 0.0  # see `exploration.explore`
    _uav: int = field(default=0, init=False)
    _n_decisions: int = field(default=0, init=False)

    @property
    def name(self) -> str:
        """That of the learned policy."""
        return self.learned.name

    @property
    def version(self) -> str:
        """Weights and how much it explores."""
        return flown_version(self.learned.version, self.epsilon)

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index.

        Raises:
            PolicyMismatchError: it did not learn to fly such a fleet, or such an area.
        """
        self.learned.begin(briefing, uav)
        self._uav = uav
        self._n_decisions = 0

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """The random action of this decision, or else what the learned policy chooses."""
        best = self.learned.choose(belief, view, legal)  # always: it remembers what it saw
        if best == HOME:
            return HOME
        key = self.mission_seed, self._uav, self._n_decisions
        self._n_decisions += 1
        explored = explore(
            *key, self.epsilon, self.hover_share, self.advice_share, self.learned.advice, legal
        )
        return best if explored == NONE else explored


def flown_version(version: str, epsilon: float) -> str:
    """How commands, logs and transitions name a learned policy that explores so much."""
    return f'{version} eps {epsilon:g}' if epsilon > 0.0 else version


def best_actions(values: Floats, legal: Bools) -> Ints:
    """The legal action of the highest value in each row, the lowest of those that tie.

    Args:
        values: shape (N, A).
        legal: shape (N, A); a row without any gives action 0.
    """
    best: Ints = np.argmax(np.where(legal, values, -np.inf), axis=1)
    return best


def weights_digest(weights: Weights) -> str:
    """64 hex digits that change with any weight: SHA-256 of their bytes in the names' order."""
    digest = hashlib.sha256()
    for name in sorted(weights):
        digest.update(np.ascontiguousarray(weights[name], dtype='<f4').tobytes())
    return digest.hexdigest()


class Network(Protocol):
    """What values the actions of decisions."""

    def step(self, observation: Floats, memory: Floats) -> tuple[Floats, Floats]:
        """Value the actions of decisions of different UAVs or missions.

        Args:
            observation: shape (N, observation_size).
            memory: of each UAV after its decision before, zeros at first, shape (N, H).

        Returns:
            Q, shape (N, A), and the memories after this decision, shape (N, H).
        """


def network_of(text: str, weights: Weights) -> Network:
    """The network that a header's text and its weights make.

    Raises:
        PolicyMismatchError: it is a user's class, and that is missing or lacks something.
    """
    match text:
        case '':
            return Recurrent(weights)
        case _ if is_code_name(text):
            return _OwnNetwork(text, weights)
        case _:
            return Layers(text, weights)


class Recurrent:
    """Encoder, GRU cell, head.

    h = GRU(relu(encoder(observation)), h of the UAV's decision before, zero at first)
    Q = head(h), one value per action
    """

    def __init__(self, weights: Weights) -> None:
        """Lay the weights out as inference reads them."""
        self._encoder = _Linear(weights, 'encoder')
        self._cell = _Gru(weights, 'gru')
        self._head = _Linear(weights, 'head')

    def step(self, observation: Floats, memory: Floats) -> tuple[Floats, Floats]:
        """Value the actions of decisions of different UAVs or missions, see `Network`."""
        encoded = np.maximum(self._encoder(observation), 0.0)
        following = self._cell(encoded, memory)
        return self._head(following), following


class Layers:
    """Layers and activations one after the other; one of them may be a GRU cell."""

    def __init__(self, text: str, weights: Weights) -> None:
        """Lay the weights out; their shapes are those that `check_network` takes."""
        self._layers = [
            name if name in ACTIVATIONS else _layer(weights, name) for name in text.split()
        ]

    def step(self, observation: Floats, memory: Floats) -> tuple[Floats, Floats]:
        """Value the actions of decisions of different UAVs or missions, see `Network`."""
        x = observation
        for layer in self._layers:
            match layer:
                case 'relu':
                    x = np.maximum(x, 0.0)
                case 'tanh':
                    x = np.tanh(x)
                case _Gru():
                    x = memory = layer(x, memory)
                case _Linear() | _Norm():
                    x = layer(x)
        return x, memory


class _OwnNetwork:
    """What a user's class computes on board by its `fly`."""

    def __init__(self, name: str, weights: Weights) -> None:
        self._name = name
        self._weights = {key: np.asarray(it, dtype=np.float64) for key, it in weights.items()}
        self._code = _code(name)

    def step(self, observation: Floats, memory: Floats) -> tuple[Floats, Floats]:
        """Value the actions of decisions of different UAVs or missions, see `Network`."""
        code, fly = self._code, getattr(self._code.target, 'fly', None)
        try:
            answers = [
                code.call(fly, self._weights, observation[row], memory[row])  # type: ignore[arg-type]
                for row in range(len(observation))  # one by one: a batch might round otherwise
            ]
        except UserCodeError as error:
            raise PolicyMismatchError(f'network {self._name}: {error}') from error
        try:
            values, memories = (code.call(_stacked, answers, part) for part in range(2))
        except UserCodeError:
            raise self._unlike(value_text(answers[0]), memory) from None
        is_shaped = (values.shape, memories.shape) == ((len(observation), N_ACTIONS), memory.shape)
        if not (is_shaped and np.isfinite(values).all() and np.isfinite(memories).all()):
            raise self._unlike(value_text(answers[0]), memory)
        return values, memories

    def _unlike(self, shown: str, memory: Floats) -> PolicyMismatchError:
        wanted = f'{N_ACTIONS} finite values and {memory.shape[1]} finite numbers of memory'
        return PolicyMismatchError(f'network {self._name}: fly gives {shown}: must be {wanted}')


def _stacked(answers: Sequence[Any], part: int) -> Floats:
    """A part of each answer, one below the other."""
    return np.array([answer[part] for answer in answers], dtype=np.float64)


@cache
def _code(name: str) -> NamedCode:
    try:
        return named_code(name, ('fly',))
    except UserCodeError as error:
        what = f'network {name}: {error}; the policy flies by its class alone'
        raise PolicyMismatchError(what) from error


def _layer(weights: Weights, name: str) -> '_Linear | _Gru | _Norm':
    if f'{name}.weight_ih' in weights:
        return _Gru(weights, name)
    return _Norm(weights, name) if weights[f'{name}.weight'].ndim == 1 else _Linear(weights, name)


class _Linear:
    def __init__(self, weights: Weights, name: str) -> None:
        self._weight = _transposed(weights[f'{name}.weight'])  # (in, out)
        self._bias = _wide(weights[f'{name}.bias'])

    def __call__(self, x: Floats) -> Floats:
        return _product(x, self._weight) + self._bias


class _Norm:
    """Layer normalisation over a row."""

    def __init__(self, weights: Weights, name: str) -> None:
        self._weight, self._bias = _wide(weights[f'{name}.weight']), _wide(weights[f'{name}.bias'])

    def __call__(self, x: Floats) -> Floats:
        centred = x - x.mean(axis=1, keepdims=True)
        spread = np.sqrt((centred * centred).mean(axis=1, keepdims=True) + _NORM_EPSILON)
        normed: Floats = centred / spread * self._weight + self._bias
        return normed


class _Gru:
    def __init__(self, weights: Weights, name: str) -> None:
        self._input = _transposed(weights[f'{name}.weight_ih'])  # (in, 3 H)
        self._input_bias = _wide(weights[f'{name}.bias_ih'])
        self._recurrent = _transposed(weights[f'{name}.weight_hh'])  # (H, 3 H)
        self._recurrent_bias = _wide(weights[f'{name}.bias_hh'])

    def __call__(self, x: Floats, memory: Floats) -> Floats:
        size = memory.shape[1]
        from_input = _product(x, self._input) + self._input_bias
        from_memory = _product(memory, self._recurrent) + self._recurrent_bias
        gates = _sigmoid(from_input[:, : 2 * size] + from_memory[:, : 2 * size])
        reset, update = gates[:, :size], gates[:, size:]
        new = np.tanh(from_input[:, 2 * size :] + reset * from_memory[:, 2 * size :])
        following: Floats = new + update * (memory - new)
        return following


def _wide(tensor: NDArray[np.float32]) -> Floats:
    return np.asarray(tensor, dtype=np.float64)


def _transposed(tensor: NDArray[np.float32]) -> Floats:
    # So that each product walks the memory in order.
    return np.ascontiguousarray(_wide(tensor).T)


def _product(rows: Floats, matrix: Floats) -> Floats:
    # Not `@`: BLAS rounds a row differently when others come with it, or on other threads.
    product: Floats = np.einsum('ni,io->no', rows, matrix)
    return product


def _sigmoid(x: Floats) -> Floats:
    return 0.5 * np.tanh(0.5 * x) + 0.5  # exp would overflow


def _check_weights(weights: Weights) -> None:
    for name, tensor in weights.items():
        if tensor.dtype != np.float32:
            raise PolicyMismatchError(f'{name} is {tensor.dtype}: must be float32')
        wrong = np.argwhere(~np.isfinite(tensor))
        if len(wrong):
            place = tuple(wrong[0].tolist())
            raise PolicyMismatchError(f'{name} is {tensor[place]} at {place}: must be finite')

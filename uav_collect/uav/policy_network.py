"""A frozen policy: the weights of a recurrent network that learns no more, and where it is from.

The network is encoder, GRU cell, head:

    h = GRU(relu(encoder(observation)), h of the UAV's decision before, zero at first)
    Q = head(h), one value per action

It runs on numpy alone, in float64. A batch of decisions gives each of them the very bits that it
gets alone, so missions flown many at once equal those flown by one agent per UAV.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
import hashlib
from itertools import product
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from uav_collect.config.rules import number, text, whole
from uav_collect.config.yaml_text import shown
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Bools, Floats, Ints, Row, row_of
from uav_collect.limits import MAX_CELLS_PER_SIDE, MAX_LAYER_SIZE, MAX_SEED
from uav_collect.uav.action_codes import HOME, N_ACTIONS, NONE
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.exploration import explore
from uav_collect.uav.frames import COMPASS_ACTIONS
from uav_collect.uav.learned_on import LearnedOn, LearnedWithin
from uav_collect.uav.observation import Layout, observation_size, Observer
from uav_collect.uav.view import LocalView

_ALMOST_ALL = 0.99  # of the missions: from there on efficiency alone decides

_MAX_BONUS = 1e12
_MAX_TEXT = 4096  # characters of a text in a header; one may name many scenarios

Weights = Mapping[str, NDArray[np.float32]]

_Share = Annotated[float, number(0, 1)]
_Amount = Annotated[float, number(0, 1e12)]


@dataclass(frozen=True, kw_only=True)
class Validation:
    """What a policy achieved on average in missions that it did not learn from."""

    efficiency_kbit_per_j: _Amount
    completion_s: _Amount
    energy_kj: _Amount
    collected_share: _Share
    complete_share: _Share  # of the missions: all data collected
    safe_share: _Share  # of the missions: every UAV landed with its margin
    missions: Annotated[int, whole(0, MAX_SEED)]
    bandwidth: Annotated[str, text(64)]  # how it was shared

    @property
    def rank(self) -> tuple[float, float]:
        """How good the policy is: of two, the one of greater rank is kept."""
        return policy_rank(self.complete_share, self.safe_share, self.efficiency_kbit_per_j)


def policy_rank(
    complete_share: float, safe_share: float, efficiency_kbit_per_j: float
) -> tuple[float, float]:
    """How good a policy is by its validation: of two, the one of greater rank is kept.

    A policy that leaves data or a UAV behind is no better for having saved energy.
    """
    return min(complete_share, safe_share, _ALMOST_ALL), efficiency_kbit_per_j


@dataclass(frozen=True, kw_only=True)
class PolicyHeader:
    """What a frozen policy sees, what it may fly, and how it was learned."""

    layout: Layout
    observation_size: int
    hidden_size: int
    cells_per_side_min: int
    cells_per_side_max: int
    n_uavs_min: int
    n_uavs_max: int
    scenario: str  # that it learned in
    fingerprint: str  # of that scenario
    preset: str  # of the training
    algorithm: str  # aqmix, qmix or aiql
    seed: int  # of the training
    decisions: int  # learned from
    updates: int  # of the weights
    version: str  # for people and for logs: run, update, digest of the weights
    git_revision: str
    validation: Validation
    learned_on: tuple[LearnedOn, ...] = ()  # by scenario; none where the file does not say
    advice_bonus: float = 0.0  # added to the value of what the layout's adviser would do
    learned_within: tuple[LearnedWithin, ...] = ()  # one of drawn scenarios; else none


class FrozenPolicy:
    """The network, ready to be asked."""

    def __init__(
        self, header: PolicyHeader, weights: Weights, *, is_header_covered: bool = True
    ) -> None:
        """Check the weights and lay them out as inference reads them.

        Args:
            weights: float32 by name, of the shapes that `weight_shapes` gives.
            is_header_covered: by the digest of the file that it was read from, if from any.

        Raises:
            PolicyMismatchError: a tensor is missing, unknown, misshapen or not finite.
        """
        check_shapes(header, {name: tensor.shape for name, tensor in weights.items()})
        _check_weights(weights)
        self.header = header
        self.is_header_covered = is_header_covered
        self.weights = dict(weights)
        # Upcast once; transposed, so that each product walks the memory in order.
        wide = {name: np.asarray(tensor, dtype=np.float64) for name, tensor in weights.items()}
        self._encoder = np.ascontiguousarray(wide['encoder.weight'].T)  # (O, H)
        self._encoder_bias = wide['encoder.bias']
        self._input = np.ascontiguousarray(wide['gru.weight_ih'].T)  # (H, 3 H)
        self._input_bias = wide['gru.bias_ih']
        self._recurrent = np.ascontiguousarray(wide['gru.weight_hh'].T)  # (H, 3 H)
        self._recurrent_bias = wide['gru.bias_hh']
        self._head = np.ascontiguousarray(wide['head.weight'].T)  # (H, A)
        self._head_bias = wide['head.bias']

    @property
    def digest(self) -> str:
        """Hex digits that change with any weight."""
        return weights_digest(self.weights)

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
        """
        size = self.header.hidden_size
        encoded = np.maximum(_product(observation, self._encoder) + self._encoder_bias, 0.0)
        from_input = _product(encoded, self._input) + self._input_bias
        from_hidden = _product(hidden, self._recurrent) + self._recurrent_bias
        gates = _sigmoid(from_input[:, : 2 * size] + from_hidden[:, : 2 * size])
        reset, update = gates[:, :size], gates[:, size:]
        new = np.tanh(from_input[:, 2 * size :] + reset * from_hidden[:, 2 * size :])
        following = new + update * (hidden - new)
        return _product(following, self._head) + self._head_bias, following

    def actions(self, values: Floats, legal: Bools, frame: Ints, advice: Ints) -> Ints:
        """The legal action of the highest value in each row, the lowest of the frame's that tie.

        Args:
            values: of the actions in each UAV's frame, shape (N, A).
            legal: by the compass, shape (N, A); a row without any gives any action.
            frame: of the UAVs, shape (N,).
            advice: by the compass, whose value is raised by the bonus, shape (N,); NONE: there is
                none.

        Returns:
            Actions by the compass, shape (N,).
        """
        turned = COMPASS_ACTIONS[frame]
        if self.header.advice_bonus > 0.0:
            values = values + self.header.advice_bonus * (turned == advice[:, None])
        best = best_actions(values, np.take_along_axis(legal, turned, axis=1))
        chosen: Ints = turned[np.arange(len(best)), best]
        return chosen

    def misfit(self, briefing: Briefing) -> str | None:
        """Why the policy cannot fly a fleet over an area; None if it can."""
        header = self.header
        area, n_uavs = (briefing.n_rows, briefing.n_columns), briefing.n_uavs
        least, most = header.cells_per_side_min, header.cells_per_side_max
        known = _areas_of_paper(header)
        if known and area not in known:
            allowed = ' or '.join(f'{rows} x {columns}' for rows, columns in sorted(known))
            return f'area is {area[0]} x {area[1]} cells: must be {allowed}'
        if not all(least <= side <= most for side in area):
            allowed = f'must have {_span(least, most)} rows and columns'
            return f'area is {area[0]} x {area[1]} cells: {allowed}'
        if not header.n_uavs_min <= n_uavs <= header.n_uavs_max:
            return f'n_uavs is {n_uavs}: must be {_span(header.n_uavs_min, header.n_uavs_max)}'
        return None


@dataclass
class LearnedPolicy:
    """A frozen policy behind the protocol `policy.Policy`, with the hidden state of its UAV.

    Those of a fleet share the frozen policy.
    """

    name: str
    frozen: FrozenPolicy
    _observer: Observer | None = field(default=None, init=False)
    _hidden: Floats = field(default_factory=lambda: np.zeros((1, 0)), init=False)  # (1, H)
    _advice: int = field(default=NONE, init=False)

    @property
    def version(self) -> str:
        """Run, update and weights that it came from."""
        return self.frozen.header.version

    @property
    def observation(self) -> Row[float]:
        """What it chose from last, encoded; not to be written."""
        return row_of([]) if self._observer is None else self._observer.observation

    @property
    def advice(self) -> int:
        """What its layout's adviser would have done last, by the compass; NONE: it has none."""
        return self._advice

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index.

        Raises:
            PolicyMismatchError: it did not learn to fly such a fleet, or such an area.
        """
        misfit = self.frozen.misfit(briefing)
        if misfit is not None:
            raise PolicyMismatchError(f'policy {self.name}: {misfit}')
        self._observer = Observer(self.frozen.header.layout, briefing, uav)
        self._hidden = self.frozen.new_hidden(1)
        self._advice = NONE

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """The legal action of the highest value, or HOME where its adviser would fly home."""
        observer = self._observer
        if observer is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        self._advice = observer.advice(belief, view, legal)
        if self._advice == HOME:
            return HOME
        observed = np.array([observer.encode(belief, view, self._advice)], dtype=np.float64)
        values, self._hidden = self.frozen.step(observed, self._hidden)
        frame, advice = np.array([observer.frame]), np.array([self._advice])
        return int(self.frozen.actions(values, np.array([legal]) == 1, frame, advice)[0])


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


def weight_shapes(observation_size: int, hidden_size: int) -> dict[str, tuple[int, ...]]:
    """The tensors of a policy by name; gates in the order reset, update, new."""
    return {
        'encoder.weight': (hidden_size, observation_size),
        'encoder.bias': (hidden_size,),
        'gru.weight_ih': (3 * hidden_size, hidden_size),
        'gru.weight_hh': (3 * hidden_size, hidden_size),
        'gru.bias_ih': (3 * hidden_size,),
        'gru.bias_hh': (3 * hidden_size,),
        'head.weight': (N_ACTIONS, hidden_size),
        'head.bias': (N_ACTIONS,),
    }


def weights_digest(weights: Weights) -> str:
    """64 hex digits that change with any weight: SHA-256 of their bytes in the names' order."""
    digest = hashlib.sha256()
    for name in sorted(weights):
        digest.update(np.ascontiguousarray(weights[name], dtype='<f4').tobytes())
    return digest.hexdigest()


def _product(rows: Floats, matrix: Floats) -> Floats:
    # Not `@`: BLAS rounds a row differently when others come with it, or on other threads.
    product: Floats = np.einsum('ni,io->no', rows, matrix)
    return product


def _sigmoid(x: Floats) -> Floats:
    return 0.5 * np.tanh(0.5 * x) + 0.5  # exp would overflow


def _span(low: int, high: int) -> str:
    return str(low) if low == high else f'{low} to {high}'


def check_shapes(header: PolicyHeader, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Refuse a header that contradicts itself, or tensors that are not of its shapes.

    Raises:
        PolicyMismatchError: one line: what, its value, what it must be.
    """
    _check_texts(header)
    _check_numbers(header)
    wanted = weight_shapes(header.observation_size, header.hidden_size)
    if unlike := sorted(wanted.keys() ^ shapes.keys()):
        what = 'is missing' if unlike[0] in wanted else 'is unknown'
        raise PolicyMismatchError(f'tensor {shown(unlike[0])} {what}: must be {", ".join(wanted)}')
    for name, shape in wanted.items():
        if shapes[name] != shape:
            raise PolicyMismatchError(
                f'{name} has shape {shown([*shapes[name]])}: must be {list(shape)}'
            )


def _areas_of_paper(header: PolicyHeader) -> set[tuple[int, int]]:
    """The areas, in rows and columns, that alone a policy can fly; none: not so, or squares."""
    if header.layout != Layout.PAPER or not any(it.rows for it in header.learned_on):
        return set()
    return {it.area for it in header.learned_on}


def _check_texts(header: PolicyHeader) -> None:
    for field_ in fields(header):
        value = getattr(header, field_.name)
        if isinstance(value, str) and not (value.isprintable() and len(value) <= _MAX_TEXT):
            allowed = f'{_MAX_TEXT} printable characters at most'
            raise PolicyMismatchError(f'{field_.name} is {shown(value)}: must be {allowed}')


def _check_numbers(header: PolicyHeader) -> None:
    most_uavs = header.layout.max_uavs
    largest = header.cells_per_side_max
    for name, value, low, high in (
        ('hidden_size', header.hidden_size, 1, MAX_LAYER_SIZE),
        ('cells_per_side_min', header.cells_per_side_min, 1, largest),
        ('cells_per_side_max', largest, header.cells_per_side_min, MAX_CELLS_PER_SIDE),
        ('n_uavs_min', header.n_uavs_min, 1, header.n_uavs_max),
        ('n_uavs_max', header.n_uavs_max, header.n_uavs_min, most_uavs),
    ):
        if not low <= value <= high:
            raise PolicyMismatchError(f'{name} is {value}: must be {_span(low, max(low, high))}')
    most_bonus = _MAX_BONUS if header.layout.adviser != NONE else 0.0
    if not 0.0 <= header.advice_bonus <= most_bonus:
        raise PolicyMismatchError(
            f'advice_bonus is {header.advice_bonus:g}: must be from 0 to {most_bonus:g} for '
            f'{header.layout.label}'
        )
    squares = {(side, side) for side in (header.cells_per_side_min, header.cells_per_side_max)}
    areas = sorted(_areas_of_paper(header) or squares)
    for (rows, columns), n_uavs in product(areas, (header.n_uavs_min, header.n_uavs_max)):
        size = observation_size(header.layout, rows * columns, n_uavs)
        if size != header.observation_size:
            words = f'{rows} cells per side' if rows == columns else f'{rows} x {columns} cells'
            raise PolicyMismatchError(
                f'observation_size is {header.observation_size}: must be {size} for '
                f'{header.layout.label}, {words} and {n_uavs} UAVs'
            )


def _check_weights(weights: Weights) -> None:
    for name, tensor in weights.items():
        if tensor.dtype != np.float32:
            raise PolicyMismatchError(f'{name} is {tensor.dtype}: must be float32')
        wrong = np.argwhere(~np.isfinite(tensor))
        if len(wrong):
            place = tuple(wrong[0].tolist())
            raise PolicyMismatchError(f'{name} is {tensor[place]} at {place}: must be finite')

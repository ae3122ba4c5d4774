"""The learner: networks, targets and updates of AQMIX, QMIX, AIQL and what users write."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
import torch
from torch import nn, Tensor
from uav_collect.errors import ConfigError
from uav_collect.learning.adam import Adam
from uav_collect.learning.minibatch import Algorithm, Minibatch
from uav_collect.learning.network import Drqn, Networks
from uav_collect.learning.own_modules import check_tensor, frozen_weights, PluggedMixer
from uav_collect.learning.recurrence import runs_compiled
from uav_collect.learning.saved import SavedPart
from uav_collect.missions.experience import SparseRows
from uav_collect.training.config import TrainingConfig
from uav_collect.training.plug_ins import own_algorithm
from uav_collect.training.progress import UpdateMetrics
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.user_code import run_user_code, UserCodeError

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # names of glibc's mallopt
_LARGEST_ARRAY_BYTES = 32 * 2**20  # no larger threshold is taken
_KEPT_BYTES = 2**31 - 1
# How much more an action is taken to be worth than the advised one. What is lost by leaving a cell
# behind is rare and large: cut off, it would be taken for a gain.
_LEAST_WORTH, _MOST_WORTH = -20.0, 4.0
_LEAST_VARIANCE = 0.1  # of that, where hardly anything differs
_LAST_LAYER = 'head'  # of Drqn


@dataclass(frozen=True, kw_only=True)
class _Tensors:
    """A minibatch on the device, see `Minibatch`."""

    task: int
    step_sizes: list[int]
    observation: Tensor | SparseRows
    legal: Tensor
    advice: Tensor
    worth: Tensor
    row: Tensor
    action: Tensor
    latest: Tensor
    decides: Tensor
    state: Tensor  # (E, ...) the mixer's; empty where there is none
    entry: Tensor
    next_entry: Tensor
    is_chained: Tensor
    reward: Tensor
    discount: Tensor


class Learner:
    """Updates the networks from minibatches, by any of the algorithms."""

    def __init__(
        self,
        config: TrainingConfig,
        briefings: Sequence[Briefing],
        algorithm: Algorithm,
        seed: int,
        device: str = 'cpu',
        own: str = '',
    ) -> None:
        """Make the networks, their weights drawn by the seed.

        Args:
            briefings: of each task: the fleets and areas that one agent network learns to fly;
                those of other tasks may follow where one mixer does for all.
            own: name of a user's algorithm that is like `algorithm`; '': there is none.

        Raises:
            ConfigError: a user's network or mixer fails.
        """
        self._config, self._algorithm = config, algorithm
        self._device = torch.device(device)
        self._own = own
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            networks = Networks(config, briefings, algorithm)
        is_of_odds = algorithm is Algorithm.IMITATION and isinstance(networks.agent, Drqn)
        # What the network says, times this, is the value of an action as policies hold it: where
        # it says the logarithms of odds, one of these is taken for a cell.
        self._value_of_odds = config.reward.scale if is_of_odds else 1.0
        networks.agent.advice_bonus = config.advice_bonus(0.0) / self._value_of_odds
        self.networks = networks.to(self._device)
        self.target = deepcopy(self.networks).requires_grad_(False)
        self.optimiser = Adam(self.networks.parameters(), config.optimiser.adam_epsilon)
        self.n_updates = 0

    @property
    def advice_bonus(self) -> float:
        """What is added to the value of the advice, as policies hold values; it can be set."""
        return self.networks.agent.advice_bonus * self._value_of_odds

    @advice_bonus.setter
    def advice_bonus(self, bonus: float) -> None:
        self.networks.agent.advice_bonus = bonus / self._value_of_odds

    def load_weights(self, weights: Mapping[str, NDArray[np.float32]]) -> None:
        """Take over an agent network's weights before the first update."""
        tensors = {
            name: torch.from_numpy(np.array(values))
            for name, values in _scaled(weights, 1.0 / self._value_of_odds).items()
        }
        self.networks.agent.core.load_state_dict(tensors)
        self.target.agent.core.load_state_dict(tensors)

    def update(
        self, minibatches: Sequence[tuple[Minibatch, int]], learning_rate: float
    ) -> UpdateMetrics:
        """Take one step of the optimiser, on the mean loss of minibatches of several tasks.

        Args:
            minibatches: each of missions of one task, and which one that is.

        Returns:
            The loss and the values before it, and the gradient of the step.
        """
        self.optimiser.forget_gradients()
        losses, means = [], []
        for minibatch, task in minibatches:
            loss, learned = self._loss(minibatch, task)
            (loss / len(minibatches) if len(minibatches) > 1 else loss).backward()
            losses.append(float(loss.detach()))
            means.append(float(learned.detach().mean()))
        clip_norm = self._config.optimiser.clip_norm
        norm = nn.utils.clip_grad_norm_(self.networks.parameters(), clip_norm)
        self.optimiser.step(learning_rate)
        self._move_target()
        self.n_updates += 1
        return UpdateMetrics(
            loss=sum(losses) / len(losses),
            mean_value=sum(means) / len(means),
            gradient_norm=float(norm),
        )

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """The agent network's weights, as a frozen policy holds them, copied.

        Who imitates learns of other courses at every update: the target network, a mean over the
        latest ones, knows more than any one of them (Polyak and Juditsky, 1992).
        """
        is_mean = self._algorithm is Algorithm.IMITATION
        networks = self.target if is_mean else self.networks
        return _scaled(frozen_weights(networks.agent), self._value_of_odds)

    def state(self) -> dict[str, Any]:
        """All that a learner needs to go on; the inverse is `restore`."""
        moments = {
            name: _arrays(self.optimiser.state[parameter])
            for name, parameter in self.networks.named_parameters()
            if parameter in self.optimiser.state  # a mixer that was not used yet has none
        }
        return {
            'networks': _arrays(self.networks.state_dict()),
            'target': _arrays(self.target.state_dict()),
            'moments': moments,
            'n_updates': self.n_updates,
        }

    def restore(self, saved: SavedPart) -> None:
        """Go on from where another learner of the same settings was.

        Raises:
            CheckpointError: something that was saved is not what one of these settings saves.
        """
        self.n_updates = saved.whole('n_updates')
        for networks, name in ((self.networks, 'networks'), (self.target, 'target')):
            weights = saved.part(name)
            for key, tensor in networks.state_dict().items():
                tensor.copy_(_tensor_of(weights, key, tensor))
        moments = saved.part('moments')
        for name, parameter in self.networks.named_parameters():
            if name in moments.names:
                self.optimiser.state[parameter] = self._moments(moments.part(name), parameter)

    def _moments(self, saved: SavedPart, parameter: Tensor) -> dict[str, Tensor]:
        """What Adam keeps of a parameter."""
        first, second = (
            _tensor_of(saved, name, parameter).to(self._device)
            for name in ('exp_avg', 'exp_avg_sq')
        )
        step = torch.from_numpy(saved.array('step', np.float32, ())).to(self._device)
        if step < 0 or (second < 0).any():
            raise saved.refusal('exp_avg_sq', 'or step is negative')
        return {'step': step, 'exp_avg': first, 'exp_avg_sq': second}

    def loss(self, minibatch: Minibatch, task: int = 0) -> Tensor:
        """Mean squared error of the entries' action values, or what a user's algorithm says."""
        return self._loss(minibatch, task)[0]

    def _loss(self, minibatch: Minibatch, task: int) -> tuple[Tensor, Tensor]:
        """The loss, and the values that it is of: (L,), by branches (R, N_ACTIONS)."""
        tensors = self._on_device(minibatch, task)
        values = self._values(self.networks, tensors)
        if self._algorithm is Algorithm.BRANCHES:
            return self._branch_loss(values, tensors), values
        if self._algorithm is Algorithm.IMITATION:
            return self._imitation_loss(values, tensors), values
        chosen = self._chosen_values(values, tensors)
        by_uav = self._by_uav(chosen, tensors)
        best = self._best_by_uav(self.networks, values, tensors)
        team = self._team_values(self.networks, chosen, by_uav, best, tensors, tensors.entry)
        with torch.no_grad():
            target = self._targets(values.detach(), tensors)
        if self._own:
            return self._asked('loss', (), team, target), team
        return nn.functional.mse_loss(team, target), team

    def _branch_loss(self, values: Tensor, tensors: _Tensors) -> Tensor:
        """How wrong it is what actions are worth more than the advised one, as branches tell.

        The mean squared error, in shares of how much that differs in the batch: fields on which
        any deviation changes all that follows tell little, and count as little.
        """
        advice = tensors.advice.argmax(dim=1, keepdim=True)
        worth = tensors.worth - tensors.worth.gather(1, advice)
        is_known = ~worth.isnan() & (tensors.advice == 0.0)
        if not is_known.any():
            return 0.0 * values.sum()
        wanted = worth[is_known].clamp(_LEAST_WORTH, _MOST_WORTH)
        found = (values - values.gather(1, advice))[is_known] / self._config.reward.scale
        return nn.functional.mse_loss(found, wanted) / (wanted.var(correction=0) + _LEAST_VARIANCE)

    def _imitation_loss(self, values: Tensor, tensors: _Tensors) -> Tensor:
        """How unlikely what the teacher would do is, values being the logarithms of odds.

        The mean cross-entropy over legal actions. Where no teacher was asked, it is the adviser.
        """
        is_known = ~tensors.worth.isnan().all(dim=1, keepdim=True)
        taught = torch.where(is_known, tensors.worth.nan_to_num(0.0), tensors.advice)
        raised = values + self.networks.agent.advice_bonus * tensors.advice
        odds = raised.masked_fill(~tensors.legal, -torch.inf)
        return nn.functional.cross_entropy(odds, taught.argmax(dim=1))

    def targets(self, minibatch: Minibatch, task: int = 0) -> Tensor:
        """What the entries' action values are to become, shape (L,)."""
        tensors = self._on_device(minibatch, task)
        with torch.no_grad():
            return self._targets(self._values(self.networks, tensors), tensors)

    def _targets(self, online: Tensor, tensors: _Tensors) -> Tensor:
        """lambda-returns over the chains of entries; one-step targets where lambda is 0.

        y = R + gamma^tau ((1 - lambda) max Q + lambda y'); Peng and Williams, 1996.
        """
        config = self._config.target
        values = self._values(self.target, tensors)
        next_value = self._next_values(online, values, tensors)[tensors.row]
        deciding = next_value[tensors.latest.clamp(min=0)]
        waiting = self._by_uav(self._chosen_values(values, tensors), tensors)
        by_uav = torch.where(tensors.decides, deciding, waiting)
        follows = tensors.next_entry.clamp(min=0)
        best = self._best_by_uav(self.target, values, tensors)
        future = self._team_values(self.target, next_value, by_uav, best, tensors, follows)
        discount = config.future_share(self.n_updates) * tensors.discount
        trace = torch.where(tensors.is_chained, config.trace, 0.0)
        fixed = tensors.reward + (1.0 - trace) * (discount * future)
        return reverse_scan(fixed, trace * discount)

    def _next_values(self, online: Tensor, target: Tensor, tensors: _Tensors) -> Tensor:
        """What the best action of each row is worth to the target network, shape (R,)."""
        if self._own:
            shape = (len(online),)
            return self._asked('next_values', shape, online, target, tensors.legal)
        selector = online if self._config.target.double_q else target
        bonus = self.networks.agent.advice_bonus
        if bonus > 0.0:  # it is chosen by in flight, too
            selector = selector + bonus * tensors.advice
        best = selector.masked_fill(~tensors.legal, -torch.inf).argmax(dim=1)
        return target.gather(1, best[:, None]).squeeze(1)

    def _asked(self, method: str, shape: tuple[int, ...], *tensors: Tensor) -> Tensor:
        """What a method of a user's algorithm gives.

        Raises:
            ConfigError: it fails, or gives a tensor of another shape.
        """
        what = f'algorithm {self._own}'
        try:
            answer = run_user_code(None, getattr(own_algorithm(self._own), method), *tensors)
        except UserCodeError as error:
            raise ConfigError(f'{what}: {error}') from error
        check_tensor(what, method, answer, shape)
        asked: Tensor = answer
        return asked

    def _values(self, networks: Networks, tensors: _Tensors) -> Tensor:
        """Q values of all rows, shape (R, N_ACTIONS)."""
        with self._autocast():
            values: Tensor = networks.agent(tensors.observation, tensors.step_sizes)
        return values.float()

    def _chosen_values(self, values: Tensor, tensors: _Tensors) -> Tensor:
        """The value of each decision's own action, shape (E,)."""
        return values[tensors.row].gather(1, tensors.action[:, None]).squeeze(1)

    def _by_uav(self, chosen: Tensor, tensors: _Tensors) -> Tensor:
        """The value of each UAV's latest action at each decision; 0 where it has none, (E, U)."""
        return torch.where(tensors.latest >= 0, chosen[tensors.latest.clamp(min=0)], 0.0)

    def _best_by_uav(self, networks: Networks, values: Tensor, tensors: _Tensors) -> Tensor | None:
        """The best value of each UAV's latest decision, (E, U); None where no mixer takes it."""
        if not isinstance(networks.mixer(tensors.task), PluggedMixer):
            return None
        best = values.masked_fill(~tensors.legal, -torch.inf).amax(dim=1)
        return self._by_uav(best[tensors.row], tensors)

    def _team_values(
        self,
        networks: Networks,
        own: Tensor,
        by_uav: Tensor,
        best: Tensor | None,
        tensors: _Tensors,
        at: Tensor,
    ) -> Tensor:
        """The UAVs' values mixed at some decisions; the deciding UAV's own without a mixer."""
        mixer = networks.mixer(tensors.task)
        if mixer is None:
            return own[at]
        mixed = (by_uav[at],) if best is None else (by_uav[at], best[at])
        with self._autocast():
            total: Tensor = mixer(*mixed, tensors.state[at])
        return total.float()

    def _autocast(self) -> torch.autocast:
        is_enabled = self._config.optimiser.bf16
        return torch.autocast(self._device.type, torch.bfloat16, enabled=is_enabled)

    @torch.no_grad()
    def _move_target(self) -> None:
        rate = self._config.target.update_rate
        targets: list[Tensor] = [*self.target.parameters()]
        sources: list[Tensor] = [*self.networks.parameters()]
        torch._foreach_lerp_(targets, sources, rate)
        # What a user's network counts is not learned, but flies with what is.
        for kept, counted in zip(self.target.buffers(), self.networks.buffers(), strict=True):
            kept.copy_(counted)

    def _on_device(self, minibatch: Minibatch, task: int) -> _Tensors:
        fleet, complete = self._tensor(minibatch.fleet), self._tensor(minibatch.complete)
        as_they_are = (
            *('legal', 'advice', 'worth', 'row', 'action', 'latest', 'decides'),
            *('entry', 'next_entry', 'is_chained'),
        )
        agent = self.networks.agent
        is_sparse = isinstance(agent, Drqn) and runs_compiled(agent.gru.weight_hh)
        is_sparse &= not self._config.optimiser.bf16
        return _Tensors(
            task=task,
            step_sizes=minibatch.step_sizes,
            state=self.networks.state(task, fleet, complete, minibatch.area),
            observation=minibatch.sparse if is_sparse else self._tensor(minibatch.observation),
            reward=self._tensor((self._config.reward.scale * minibatch.reward).astype(np.float32)),
            discount=self._tensor(minibatch.discount.astype(np.float32)),
            **{name: self._tensor(getattr(minibatch, name)) for name in as_they_are},
        )

    def _tensor(self, values: NDArray[Any]) -> Tensor:
        return torch.from_numpy(values).to(self._device)


def _scaled(
    weights: Mapping[str, NDArray[np.float32]], factor: float
) -> dict[str, NDArray[np.float32]]:
    """Weights of a network that says so many times as much."""
    if factor == 1.0:
        return dict(weights)
    return {
        name: np.float32(factor) * values if name.startswith(f'{_LAST_LAYER}.') else values
        for name, values in weights.items()
    }


def _arrays(tensors: Mapping[str, Tensor]) -> dict[str, NDArray[Any]]:
    return {name: tensor.detach().cpu().numpy() for name, tensor in tensors.items()}


def _tensor_of(saved: SavedPart, name: str, like: Tensor) -> Tensor:
    return torch.from_numpy(saved.array(name, np.float32, tuple(like.shape)))


def reverse_scan(values: Tensor, factors: Tensor) -> Tensor:
    """Solve y_i = value_i + factor_i y_{i+1} from the end, in log2(N) steps, shape (N,).

    Source: Hillis and Steele, Data parallel algorithms, 1986.
    """
    shift = 1
    while shift < len(values):
        later = torch.nn.functional.pad(values[shift:], (0, shift))
        values = values + factors * later
        factors = factors * torch.nn.functional.pad(factors[shift:], (0, shift))
        shift *= 2
    return values


def keep_freed_memory() -> None:
    """Use what arrays leave behind again instead of handing it back to the system.

    An update makes and drops arrays of many megabytes; fetched from the system page by page each
    time, they took a tenth of it. Where malloc is not glibc's, nothing changes.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, 'mallopt'):
        library.mallopt(_MMAP_THRESHOLD, _LARGEST_ARRAY_BYTES)
        library.mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)

"""Training in one process: fly, learn, validate, keep the best; and go on where it stopped."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
import os
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import torch
from uav_collect import frozen
from uav_collect.briefing import brief
from uav_collect.collector import Collector
from uav_collect.evaluation import mission_seeds
from uav_collect.frozen import FrozenPolicy, PolicyHeader, weights_digest
from uav_collect.learner import Learner
from uav_collect.metrics import figures
from uav_collect.minibatch import Algorithm, minibatch
from uav_collect.observation import observation_size
from uav_collect.policy import LearnedPolicy
from uav_collect.replay import Replay, replay_bytes
from uav_collect.revision import git_revision
from uav_collect.rollout import fly
from uav_collect.scenario import fingerprint, from_yaml, Scenario
from uav_collect.site import build_site
from uav_collect.training_config import TrainingConfig

_VALIDATION_SEED = 2**60  # of the first validation mission
_PROGRESS_EVERY_S = 1.0
_REPLAY_KEY = 1  # of the run's seed: which missions are learned from
_STATE_FILE = 'state.pt'


@dataclass(frozen=True, kw_only=True)
class Budget:
    """How long to train: one of the two."""

    minutes: float | None = None
    decisions: int | None = None


@dataclass(frozen=True, kw_only=True)
class Validation:
    """How the policy flew the validation missions."""

    wall_s: float
    n_decisions: int
    n_updates: int
    efficiency_kbit_per_j: float
    completion_s: float
    energy_kj: float
    collected_share: float
    complete_share: float
    safe_share: float
    team_reward: float  # the scenario's reward, summed over a mission


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How the training stands."""

    share_done: float
    wall_s: float
    n_decisions: int
    n_updates: int
    n_missions: int
    decisions_per_s: float
    updates_per_s: float
    loss: float
    epsilon: float
    learning_rate: float
    training_efficiency_kbit_per_j: float
    training_reward: float
    replay_transitions: int
    replay_bytes: int
    validation: Validation | None
    best: Validation | None


class CheckpointError(ValueError):
    """A checkpoint that cannot be gone on from: which, and why."""


class Trainer:
    """One training run."""

    def __init__(
        self,
        scenario: Scenario,
        config: TrainingConfig,
        algorithm: str,
        seed: int,
        device: str = 'cpu',
    ) -> None:
        """Get ready: first missions in the air, weights drawn.

        Args:
            algorithm: one of `minibatch.Algorithm`.
            seed: of weights, missions, exploration and what is replayed, 0..2^62.
            device: 'cpu' or 'cuda'.

        Raises:
            ConfigError: the fleet cannot start, or the observation has no room for it.
        """
        self.scenario, self.config, self.seed = scenario, config, seed
        self.algorithm = Algorithm(algorithm)
        self._device = device
        self._site = build_site(scenario)
        self._briefing = brief(scenario)
        learned = _rewarded(scenario, config)
        self._learner = Learner(config, self._briefing, self.algorithm, seed, device)
        self._collector = Collector(learned, self._site, config, self.algorithm, seed, device)
        self._replay = Replay(config.replay.decisions, self._briefing)
        self._rng = np.random.Generator(np.random.Philox(key=[seed, _REPLAY_KEY]))
        self._trained_s = 0.0
        self._validation: Validation | None = None
        self._best: Validation | None = None
        self._best_policy: FrozenPolicy | None = None

    @property
    def n_decisions(self) -> int:
        """Decisions flown so far."""
        return self._collector.n_decisions

    @property
    def replay_bytes(self) -> int:
        """Memory that the replay takes."""
        return replay_bytes(self.config.replay.decisions, self._briefing)

    def run(self, budget: Budget) -> Iterator[Progress]:
        """Train on until the budget is spent, resumed or not.

        Yields:
            How it stands, about once a second and after each validation. The weights change only
            between two of them: stop, save or look at any.
        """
        pace = _Pace(self)
        while (share_done := self._share_done(budget)) < 1.0:
            loss = self._advance(share_done, pace)
            is_due = self._learner.n_updates % self.config.validation.every_updates == 0
            is_due &= loss is not None
            if is_due:
                pace.pause()
                self._validate()
                pace.go_on()
            if is_due or pace.is_due():
                yield self._progress(budget, pace, self._validation if is_due else None)
        if self._validation is None or self._validation.n_updates < self._learner.n_updates:
            self._validate()
            yield self._progress(budget, pace, self._validation)

    def policy(self) -> FrozenPolicy:
        """The network as it is now, frozen."""
        validation = self._validation
        if validation is None or validation.n_updates < self._learner.n_updates:
            validation = self._validated()
        return self._frozen(validation)

    def best_policy(self) -> FrozenPolicy | None:
        """The network that flew the validation missions best; None before the first."""
        return self._best_policy

    def save(self, folder: Path) -> None:
        """Write all that the run needs to go on, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        best = self._best_policy
        state = {
            'scenario': self.scenario.to_yaml(),
            'config': self.config.model_dump(),
            'algorithm': self.algorithm.value,
            'seed': self.seed,
            'device': self._device,
            'learner': self._learner.state(),
            'collector': self._collector.state(),
            'replay': self._replay.state(),
            'rng': self._rng.bit_generator.state,
            'trained_s': self._trained_s,
            'validation': self._validation and asdict(self._validation),
            'best': self._best and asdict(self._best),
            'best_weights': best and dict(best.weights),
        }
        folder.mkdir(parents=True, exist_ok=True)
        partial = folder / f'{_STATE_FILE}.part'
        try:
            with partial.open('wb') as file:
                torch.save(state, file)
                file.flush()
                os.fsync(file.fileno())
            partial.replace(folder / _STATE_FILE)
        finally:
            partial.unlink(missing_ok=True)

    @classmethod
    def resume(cls, folder: Path) -> 'Trainer':
        """Go on from what `save` wrote.

        Raises:
            CheckpointError: there is nothing, or it is broken.
        """
        path = folder / _STATE_FILE
        try:
            state = torch.load(path, map_location='cpu', weights_only=False)
        except OSError as error:
            raise CheckpointError(f'{path}: cannot be read: {error.strerror}') from error
        except Exception as error:  # torch raises what its readers raise
            raise CheckpointError(f'{path}: is no whole checkpoint: {error}') from error
        scenario = from_yaml(state['scenario'])
        config = TrainingConfig.model_validate(state['config'])
        trainer = cls(scenario, config, state['algorithm'], state['seed'], state['device'])
        trainer._restore(state)
        return trainer

    def _restore(self, state: dict[str, Any]) -> None:
        self._learner.restore(state['learner'])
        self._collector.restore(state['collector'])
        self._replay.restore(state['replay'])
        self._rng.bit_generator.state = state['rng']
        self._trained_s = state['trained_s']
        if state['validation']:
            self._validation = Validation(**state['validation'])
        if state['best']:
            self._best = Validation(**state['best'])
            header = self._header(self._best, state['best_weights'])
            self._best_policy = FrozenPolicy(header, state['best_weights'])

    def _share_done(self, budget: Budget) -> float:
        if budget.decisions is not None:
            return min(1.0, self.n_decisions / budget.decisions)
        if budget.minutes is None:
            raise ValueError('a budget needs minutes or decisions')
        return min(1.0, self._trained_s / (60.0 * budget.minutes))

    def _advance(self, share_done: float, pace: '_Pace') -> float | None:
        """Fly a little, then learn once.

        Returns:
            The loss; None while too few missions have ended to learn from.
        """
        config = self.config
        agent = self._learner.networks.agent
        epsilon = config.epsilon(share_done)
        rollout, replay = config.rollout, self._replay
        for episode in self._collector.collect(agent, rollout.decisions_per_update, epsilon):
            replay.add(episode)
        loss = None
        if replay.n_missions >= config.replay.missions_per_batch:
            episodes = replay.sample(config.replay.missions_per_batch, self._rng)
            discount_per_s = config.reward.discount_per_s
            batch = minibatch(
                episodes, self._briefing, config.layout, self.algorithm, discount_per_s
            )
            loss = self._learner.update(batch, config.learning_rate(share_done))
            pace.note(loss)
        self._trained_s += pace.lap_s()
        return loss

    def _validate(self) -> None:
        self._validation = self._validated()
        best = self._best
        if best is None or _merit(self._validation) > _merit(best):
            self._best = self._validation
            self._best_policy = self._frozen(self._validation)

    def _validated(self) -> Validation:
        """Fly the validation missions, equal bandwidth, without exploration."""
        policy = self._frozen(None)
        seeds = mission_seeds(_VALIDATION_SEED, self.config.validation.missions)
        logs = fly(
            self.scenario, self._site, seeds, lambda: LearnedPolicy('validated', policy), 'equal'
        )
        flown = [figures(log) for log in logs]
        return Validation(
            wall_s=self._trained_s,
            n_decisions=self.n_decisions,
            n_updates=self._learner.n_updates,
            efficiency_kbit_per_j=_mean(it.efficiency_kbit_per_j for it in flown),
            completion_s=_mean(it.completion_s for it in flown),
            energy_kj=_mean(it.energy_j / 1e3 for it in flown),
            collected_share=_mean(it.collected_share for it in flown),
            complete_share=_mean(it.is_complete for it in flown),
            safe_share=_mean(it.is_safe for it in flown),
            team_reward=_mean(log.events['reward'].sum() for log in logs),
        )

    def _frozen(self, validation: Validation | None) -> FrozenPolicy:
        weights = self._learner.weights()
        return FrozenPolicy(self._header(validation, weights), weights)

    def _header(self, validation: Validation | None, weights: frozen.Weights) -> PolicyHeader:
        scenario, config = self.scenario, self.config
        side, n_uavs = scenario.area.cells_per_side, scenario.n_uavs
        n_updates = self._learner.n_updates if validation is None else validation.n_updates
        run = f'{scenario.name}_n{n_uavs}_{self.algorithm}_{config.name}_s{self.seed}'
        return PolicyHeader(
            layout=config.layout,
            observation_size=observation_size(config.layout, side, n_uavs),
            hidden_size=config.network.hidden_size,
            cells_per_side_min=side,
            cells_per_side_max=side,
            n_uavs_min=n_uavs,
            n_uavs_max=n_uavs,
            scenario=scenario.name,
            fingerprint=fingerprint(scenario),
            preset=config.name,
            algorithm=self.algorithm.value,
            seed=self.seed,
            decisions=self.n_decisions if validation is None else validation.n_decisions,
            updates=n_updates,
            version=f'{run}@{n_updates}-{weights_digest(weights)[:8]}',
            git_revision=git_revision(),
            validation=_told(validation, config.validation.missions),
        )

    def _progress(self, budget: Budget, pace: '_Pace', validation: Validation | None) -> Progress:
        share_done = self._share_done(budget)
        decisions_per_s, updates_per_s, loss = pace.read()
        return Progress(
            share_done=share_done,
            wall_s=self._trained_s,
            n_decisions=self.n_decisions,
            n_updates=self._learner.n_updates,
            n_missions=self._collector.n_missions,
            decisions_per_s=decisions_per_s,
            updates_per_s=updates_per_s,
            loss=loss,
            epsilon=self.config.epsilon(share_done),
            learning_rate=self.config.learning_rate(share_done),
            training_efficiency_kbit_per_j=self._collector.recent_efficiency_kbit_per_j,
            training_reward=self._collector.recent_reward,
            replay_transitions=self._replay.n_decisions,
            replay_bytes=self.replay_bytes,
            validation=validation,
            best=self._best,
        )

    @property
    def n_updates(self) -> int:
        """Updates so far."""
        return self._learner.n_updates


class _Pace:
    """How fast a training goes; reads the clock, which no result depends on."""

    def __init__(self, trainer: Trainer) -> None:
        self._trainer = trainer
        self._lap_from_s = self._read_s = monotonic()
        self._read_at = trainer.n_decisions, trainer.n_updates
        self._losses: list[float] = []
        self._loss = np.nan

    def note(self, loss: float) -> None:
        self._losses.append(loss)

    def lap_s(self) -> float:
        """Time since the last call."""
        now_s = monotonic()
        lap_s, self._lap_from_s = now_s - self._lap_from_s, now_s
        return lap_s

    def pause(self) -> None:
        """Validation does not count as training."""
        self._paused_s = monotonic()

    def go_on(self) -> None:
        paused_s = monotonic() - self._paused_s
        self._lap_from_s += paused_s
        self._read_s += paused_s

    def is_due(self) -> bool:
        return monotonic() - self._read_s >= _PROGRESS_EVERY_S

    def read(self) -> tuple[float, float, float]:
        """Decisions and updates per second, and the mean loss, since the last call."""
        now_s = monotonic()
        here = self._trainer.n_decisions, self._trainer.n_updates
        elapsed_s = max(now_s - self._read_s, 1e-9)
        speeds = [(new - old) / elapsed_s for new, old in zip(here, self._read_at, strict=True)]
        if self._losses:
            self._loss = float(np.mean(self._losses))
        self._losses.clear()
        self._read_s, self._read_at = now_s, here
        return speeds[0], speeds[1], self._loss


def _rewarded(scenario: Scenario, config: TrainingConfig) -> Scenario:
    """The scenario with the training's discount in the place of its own."""
    discount = {'discount_per_s': config.reward.discount_per_s}
    return scenario.model_copy(update={'reward': scenario.reward.model_copy(update=discount)})


def _merit(validation: Validation) -> tuple[float, float]:
    # A policy that leaves data or a UAV behind is no better for having saved energy.
    whole = min(validation.complete_share, validation.safe_share)
    return min(whole, 0.99), validation.efficiency_kbit_per_j


def _mean(values: Any) -> float:  # noqa: ANN401 - any iterable of numbers
    return float(np.mean(list(values)))


def _told(validation: Validation | None, n_missions: int) -> frozen.Validation:
    names = {field.name for field in fields(frozen.Validation)} - {'missions', 'bandwidth'}
    measured = {name: getattr(validation, name, 0.0) for name in names}
    return frozen.Validation(
        missions=n_missions if validation else 0, bandwidth='equal', **measured
    )

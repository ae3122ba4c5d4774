"""The trainer: collects experience, updates the networks, validates, and keeps the best policy."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
import math
from pathlib import Path
from typing import Any

import numpy as np
from uav_collect.errors import (
    CheckpointError,
    DivergedError,
    InterruptedRunError,
    PolicyMismatchError,
)
from uav_collect.kernels.patience import waiting_for
from uav_collect.kernels.stops import watchdog
from uav_collect.learning.checkpoint import read_checkpoint, STATE_FILE, write_checkpoint
from uav_collect.learning.course_tasks import CourseTasks
from uav_collect.learning.headers import (
    check_same_network,
    header_validation,
    learned_in_scenarios,
    learned_on_courses,
    network_to_start_from,
)
from uav_collect.learning.learner import Learner
from uav_collect.learning.minibatch import Algorithm
from uav_collect.learning.network import AgentNetwork
from uav_collect.learning.random_state import restore_rng, rng_state
from uav_collect.learning.recurrence import compile_steps
from uav_collect.learning.saved import SavedPart
from uav_collect.learning.task import (
    check_algorithm,
    EpisodeSource,
    FixedTasks,
    make_tasks,
    Task,
)
from uav_collect.learning.validation import (
    PanelValidator,
    ScenarioValidator,
    validation_of,
    validation_state,
    Validator,
)
from uav_collect.limits import is_code_name
from uav_collect.revision import git_revision, UNKNOWN
from uav_collect.scenario.model import Scenario
from uav_collect.training.config import code_of_training, TrainingConfig
from uav_collect.training.courses import Courses
from uav_collect.training.plug_ins import algorithm_like, short_name
from uav_collect.training.progress import (
    Budget,
    Progress,
    SpeedMeter,
    ValidationResult,
)
from uav_collect.uav.observation import observation_size
from uav_collect.uav.policy_header import PolicyHeader
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy, Weights, weights_digest

_REPLAY_KEY = 1  # of the run's seed: which missions are learned from


class Trainer:
    """One training run: flies, learns, validates, and can be saved and resumed."""

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        config: TrainingConfig,
        algorithm: str,
        seed: int,
        device: str = 'cpu',
        initial: FrozenPolicy | None = None,
        sources: Sequence[EpisodeSource] | None = None,
        courses: Courses | None = None,
    ) -> None:
        """Start the first missions and draw the weights.

        Args:
            scenarios: what one policy learns to fly, in turn; several need an observation whose
                size depends on none of them. None where there are courses.
            algorithm: one of `minibatch.Algorithm`, or the module:Name of a user's.
            seed: of weights, missions, exploration and what is replayed, 0..2^62.
            device: 'cpu' or 'cuda'.
            initial: whose weights the agent network starts from; drawn by the seed otherwise.
            sources: of each scenario's missions, which are flown in this process otherwise.
            courses: what it learns on in place of scenarios, drawn anew all the time.

        Raises:
            ConfigError: the settings do not do for these tasks, a fleet cannot start, or the
                observation has no room for it.
            PolicyMismatchError: the initial policy's network is another one.
        """
        self.scenarios, self.config, self.seed = tuple(scenarios), config, seed
        self._own = algorithm if is_code_name(algorithm) else ''
        self.algorithm = Algorithm(algorithm_like(algorithm))
        self._device = device
        self._courses = courses
        self._rota: FixedTasks | CourseTasks
        self._validator: Validator
        n_missions = config.validation.missions
        if courses is None:
            check_algorithm(self.algorithm, config)  # before teachers fly
            self._rota = make_tasks(scenarios, config, self.algorithm, seed, device, sources)
            self._validator = ScenarioValidator(self._rota.tasks, n_missions)
            self._learned = learned_in_scenarios(scenarios)
        else:
            distribution = courses.distribution
            self._learned = learned_on_courses(distribution)
            self._validator = PanelValidator(courses.panel, n_missions, self._learned)
            self._rota = CourseTasks(distribution, config, self.algorithm, seed, device)
        briefings = [task.briefing for task in self._tasks]
        self._learner = Learner(config, briefings, self.algorithm, seed, device, self._own)
        self._rng = np.random.Generator(np.random.Philox(key=[seed, _REPLAY_KEY]))
        self._trained_s = 0.0
        self._n_validated_missions = 0  # that had been learned from at the last validation
        self._validation: ValidationResult | None = None
        self._best: ValidationResult | None = None
        self._best_policy: FrozenPolicy | None = None
        if initial is not None:
            initial = network_to_start_from(initial, briefings)
            check_same_network(initial, self._header(None, initial.weights))
            self._learner.load_weights(initial.weights)

    @property
    def _agent(self) -> AgentNetwork:
        return self._learner.networks.agent

    @property
    def n_decisions(self) -> int:
        """How many decisions were collected so far."""
        return self._rota.n_decisions

    @property
    def _tasks(self) -> Sequence[Task]:
        """What is learned in at the moment."""
        return self._rota.tasks

    @property
    def n_parameters(self) -> int:
        """How many numbers the networks have that are learned."""
        return sum(it.numel() for it in self._learner.networks.parameters())

    @property
    def n_updates(self) -> int:
        """How many updates were made so far."""
        return self._learner.n_updates

    @property
    def replay_bytes(self) -> int:
        """Memory that the replays take [byte]."""
        return sum(task.replay.n_bytes for task in self._tasks)

    def warm_up(self) -> None:
        """Let the kernels of validation and updates be compiled, which takes minutes once."""
        compile_steps()
        self._validator.warm_up(LearnedPolicy('new', self._freeze(None)))

    def share_done(self, budget: Budget) -> float:
        """How much of a budget is spent, 0..1."""
        if budget.decisions is not None:
            return min(1.0, self.n_decisions / budget.decisions)
        if budget.minutes is None:
            raise ValueError('a budget needs minutes or decisions')
        return min(1.0, self._trained_s / (60.0 * budget.minutes))

    def run(
        self, budget: Budget, is_stopped: Callable[[], bool] = lambda: False
    ) -> Iterator[Progress]:
        """Train on until the budget is spent or experience is over, resumed or not.

        Args:
            is_stopped: whether somebody waits to save: then a validation is broken off, and made
                anew by who goes on.

        Yields:
            How it stands, about once a second, after each validation, and once experience is
            over; the last one is validated if there was an update, unless it was stopped. The
            weights change only between two of them: stop, save or look at any.

        Raises:
            DivergedError: loss, gradient or weights are no numbers any more; all that was yielded
                before can be gone on from.
        """
        speed = SpeedMeter(self.n_decisions, self.n_updates)
        is_over = False
        if self._owes_validation:
            yield self._validated_progress(budget, speed, is_stopped)
        while not is_over and (share_done := self.share_done(budget)) < 1.0:
            self._collect_and_update(share_done, speed)
            is_over = any(task.source.is_over for task in self._tasks)
            if self._owes_validation:
                yield self._validated_progress(budget, speed, is_stopped)
            elif is_over or speed.is_due():
                yield self._progress(budget, speed, None)
        if not self._is_validated:
            yield self._validated_progress(budget, speed, is_stopped)

    def snapshot(self) -> FrozenPolicy:
        """The network as it is now, frozen, whatever it is worth."""
        return self._freeze(None)

    def policy(self) -> FrozenPolicy:
        """The network as it is now, frozen and validated."""
        validation = self._validation
        if validation is None or validation.n_updates < self._learner.n_updates:
            validation = self._run_validation()
        return self._freeze(validation)

    def best_policy(self) -> FrozenPolicy | None:
        """The network that flew the validation missions best; None before the first."""
        return self._best_policy

    def save(self, folder: Path) -> None:
        """Write all that the run needs to go on, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        with watchdog.saving():
            write_checkpoint(folder, self.state())

    def load(self, folder: Path) -> None:
        """Go on from what a trainer of the same run wrote by `save`.

        Raises:
            CheckpointError: one line: there is nothing, it is broken, or of another run; this
                trainer is of no use then.
        """
        state = read_checkpoint(folder)
        try:
            self.restore(SavedPart(state))
        except CheckpointError as error:
            raise CheckpointError(f'{folder / STATE_FILE}: {error}') from error

    def state(self) -> dict[str, Any]:
        """All that the run needs to go on, see `checkpoint`; the inverse is `restore`."""
        best = self._best_policy
        return {
            **self._identity(),
            **self._missions_state(),
            'learner': self._learner.state(),
            **self._rota.state(),
            'rng': rng_state(self._rng),
            'trained_s': self._trained_s,
            'validation': validation_state(self._validation),
            'best': validation_state(self._best),
            'best_weights': best and dict(best.weights),
            'best_revision': best and best.header.git_revision,
            'best_advice_bonus': best and best.header.advice_bonus,
            'advice_bonus': self._agent.advice_bonus,
        }

    def restore(self, saved: SavedPart) -> None:
        """Go on from the state of another trainer of the same run.

        Raises:
            CheckpointError: one line: which of its values is not what such a trainer saves.
        """
        for name, value in self._identity().items():
            saved.must_be(name, value)
        self._learner.restore(saved.part('learner'))
        self._agent.advice_bonus = saved.number('advice_bonus', low=0.0)
        self._rota.restore(saved)
        restore_rng(self._rng, saved.part('rng'))
        self._trained_s = saved.number('trained_s', low=0.0)
        if self.config.validation.every_missions:
            self._n_validated_missions = saved.whole('n_validated_missions')
        has_panel = self._courses is not None
        self._validation = validation_of(saved.optional('validation'), has_panel=has_panel)
        self._best = validation_of(saved.optional('best'), has_panel=has_panel)
        weights = saved.optional('best_weights')
        if (self._best is None) != (weights is None):
            raise saved.refusal('best_weights', 'and best must both be there, or neither')
        if self._best is not None and weights is not None:
            arrays = {
                name: weights.array(name, np.float32, like.shape)
                for name, like in self._learner.weights().items()
            }
            header = replace(
                self._header(self._best, arrays),
                advice_bonus=saved.number('best_advice_bonus', low=0.0),
                # Checkpoints of 0.1.0 do not say which code found it.
                git_revision=saved.text('best_revision') if 'best_revision' in saved.names
                else UNKNOWN,
            )  # fmt: skip
            self._best_policy = FrozenPolicy(header, arrays)

    def _missions_state(self) -> dict[str, int]:
        """What a run that validates by missions saves beside all others."""
        is_by_missions = bool(self.config.validation.every_missions)
        return {'n_validated_missions': self._n_validated_missions} if is_by_missions else {}

    def _identity(self) -> dict[str, object]:
        """What only checkpoints of this run have in common."""
        panel = {} if self._courses is None else {'panel': self._courses.panel.fingerprint}
        return {
            'scenarios': self._learned.fingerprint,
            **panel,
            'settings': self.config.fingerprint,
            'algorithm': self._own or self.algorithm.value,
            'seed': self.seed,
            'device': self._device,
        }

    def _collect_and_update(self, share_done: float, speed: SpeedMeter) -> None:
        """Fly a little, then learn once, if enough missions have ended.

        Raises:
            DivergedError: the loss or the gradient is no number.
        """
        config, turns = self.config, self._rota.next_turn()
        self._learner.advice_bonus = config.advice_bonus(share_done)
        epsilon, n_missions = config.epsilon(share_done), config.missions_per_batch(share_done)
        n_decisions = -(-config.rollout.decisions_per_update // len(turns))
        batches, served = [], []
        for index in turns:
            task = self._tasks[index]
            for episode in task.source.collect(self._agent, n_decisions, epsilon):
                task.replay.add(episode)
            if not task.has_batch(n_missions, config) or task.source.is_over:
                continue
            if self._rota.teaches(index):
                batch = task.minibatch(n_missions, config, self.algorithm, self._rng)
                if not len(batch.entry):  # excerpts may hold no whole joint choice
                    continue
                batches.append((batch, index))
            served.append(index)
        if batches:
            rate = config.learning_rate(share_done)
            metrics = self._learner.update(batches, rate)
            for name, value in (('loss', metrics.loss), ('gradient', metrics.gradient_norm)):
                if not math.isfinite(value):
                    raise self._divergence(f'the {name} is {value}')
            speed.add_update(metrics)
        for index in served:
            self._rota.count_update(index)
        self._trained_s += speed.lap_s()

    def _divergence(self, what: str) -> DivergedError:
        return DivergedError(f'after {self.n_updates:,} updates: {what}')

    @property
    def _owes_validation(self) -> bool:
        """Whether so many updates, or missions, came that the network is to be validated now.

        It follows from what is saved alone: a run that goes on validates as if it never stopped.
        """
        if self._is_validated:
            return False
        if every := self.config.validation.every_missions:
            return self._rota.n_missions // every > self._n_validated_missions // every
        return self._learner.n_updates % self.config.validation.every_updates == 0

    @property
    def _is_validated(self) -> bool:
        """Whether the network is the one that was validated last, or the first one."""
        n_validated = 0 if self._validation is None else self._validation.n_updates
        return n_validated == self._learner.n_updates

    def _validated_progress(
        self, budget: Budget, speed: SpeedMeter, is_stopped: Callable[[], bool]
    ) -> Progress:
        """The progress with a validation, or without one where that was stopped."""

        def stop_if_asked() -> None:
            if is_stopped():
                raise InterruptedRunError('validation was stopped')

        speed.pause()
        try:
            self._validate(stop_if_asked)
        except InterruptedRunError:
            return self._progress(budget, speed, None)
        finally:
            speed.resume()
        return self._progress(budget, speed, self._validation)

    def _validate(self, between_decisions: Callable[[], None]) -> None:
        self._validation = validation = self._run_validation(between_decisions)
        self._n_validated_missions = self._rota.n_missions
        if self._best is None or self._is_better(validation, self._best):
            self._best = validation
            self._best_policy = self._freeze(validation)

    def _is_better(self, one: ValidationResult, other: ValidationResult) -> bool:
        if self.config.validation.best_by == 'efficiency':
            return one.efficiency_kbit_per_j > other.efficiency_kbit_per_j
        return one.rank > other.rank

    def _run_validation(
        self, between_decisions: Callable[[], None] | None = None
    ) -> ValidationResult:
        """Fly the validation missions, equal bandwidth, without exploration."""
        try:
            policy = LearnedPolicy('validated', self._freeze(None))
            with waiting_for('the validation missions'):
                measured = self._validator.measured(policy, between_decisions)
        except PolicyMismatchError as error:  # what are no numbers cannot fly
            raise self._divergence(str(error)) from error
        return ValidationResult(
            wall_s=self._trained_s,
            n_decisions=self.n_decisions,
            n_updates=self._learner.n_updates,
            **measured,
        )

    def _freeze(self, validation: ValidationResult | None) -> FrozenPolicy:
        weights = self._learner.weights()
        return FrozenPolicy(self._header(validation, weights), weights)

    def _header(self, validation: ValidationResult | None, weights: Weights) -> PolicyHeader:
        config, learned, first = self.config, self._learned, self._tasks[0].briefing
        n_updates = self._learner.n_updates if validation is None else validation.n_updates
        algorithm = self._own or self.algorithm.value
        run = f'{learned.run}_{short_name(algorithm)}_{config.name}_s{self.seed}'
        return PolicyHeader(
            layout=config.layout,
            observation_size=observation_size(config.layout, len(first.is_open), first.n_uavs),
            hidden_size=config.memory_size,
            preset=config.name,
            algorithm=algorithm,
            seed=self.seed,
            decisions=self.n_decisions if validation is None else validation.n_decisions,
            updates=n_updates,
            version=f'{run}@{n_updates}-{weights_digest(weights)[:8]}',
            git_revision=git_revision(),
            validation=header_validation(validation, self._validator.n_missions),
            advice_bonus=self._learner.advice_bonus,
            network=self._agent.text,
            code=' '.join(code_of_training(config, algorithm)),
            **learned.header_fields,
        )

    def _progress(
        self, budget: Budget, speed: SpeedMeter, validation: ValidationResult | None
    ) -> Progress:
        share_done = self.share_done(budget)
        recent = [task.source.recent for task in self._tasks]
        efficiency = _mean_of_known(it.efficiency_kbit_per_j for it in recent)
        decisions_per_s, updates_per_s, updates = speed.read(self.n_decisions, self.n_updates)
        return Progress(
            share_done=share_done,
            wall_s=self._trained_s,
            n_decisions=self.n_decisions,
            n_updates=self._learner.n_updates,
            n_missions=self._rota.n_missions,
            decisions_per_s=decisions_per_s,
            updates_per_s=updates_per_s,
            **updates._asdict(),
            epsilon=self.config.epsilon(share_done),
            learning_rate=self.config.learning_rate(share_done),
            training_efficiency_kbit_per_j=efficiency,
            training_reward=_mean_of_known(it.reward for it in recent),
            replay_transitions=sum(task.replay.n_decisions for task in self._tasks),
            replay_bytes=self.replay_bytes,
            validation=validation,
            best=self._best,
        )


def _mean_of_known(values: Iterable[float]) -> float:
    """The mean of what is not nan; nan where nothing is known."""
    known = [value for value in values if not math.isnan(value)]
    return float(np.mean(known)) if known else math.nan

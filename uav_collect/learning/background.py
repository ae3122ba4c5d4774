"""A training run in a thread of its own: it learns while the first thread receives missions."""

from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from threading import Thread

from uav_collect.errors import DivergedError, InterruptedRunError, TrainingRunError
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.learning.fleet_source import FleetSource
from uav_collect.learning.loop import open_trainer, opened_folder, train
from uav_collect.learning.trainer import Trainer
from uav_collect.training.folder import BEST_POLICY
from uav_collect.training.planned_run import PlannedRun
from uav_collect.training.progress import Budget, Progress
from uav_collect.uav.briefing import brief
from uav_collect.uav.policy_network import FrozenPolicy


@dataclass(frozen=True, kw_only=True)
class BehaviourPolicy:
    """What fleets fly to collect experience: a policy, and how often it explores."""

    policy: FrozenPolicy
    epsilon: float


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How a training in the background ended."""

    text: str  # for people
    has_failed: bool


class BackgroundTraining:
    """Trains one run on the missions of a `FleetSource`, in a thread of its own."""

    def __init__(
        self,
        run: PlannedRun,
        *,
        most_waiting: int,
        publish_every_updates: int,
        checkpoint_s: float,
    ) -> None:
        """Load the run as its last checkpoint has it.

        Args:
            most_waiting: decisions that may wait for the learner.

        Raises:
            TrainingRunError: the checkpoint cannot be read.
            ConfigError: the scenario cannot be trained with these settings.
            PolicyMismatchError: the network is not that of the policy to start from.
        """
        self.source = FleetSource(brief(run.scenarios[0]), most_waiting, self._publish_if_due)
        self.progress: Progress | None = None  # the latest
        self.ending: Ending | None = None  # once it has ended
        self._run, self._checkpoint_s = run, checkpoint_s
        self._every_updates = publish_every_updates
        self._trainer: Trainer = open_trainer(run, [self.source])
        self._publish_at = self._trainer.n_updates
        self._policies: SimpleQueue[BehaviourPolicy] = SimpleQueue()
        self._is_stopped = False
        self._thread = Thread(target=self._run_thread, name='learning', daemon=True)

    def start(self) -> None:
        """Compile what training needs, then start the thread."""
        if kernels_are_compiled():  # else the other thread would wait while one compiles
            self._trainer.warm_up()
        self._thread.start()

    def new_policy(self) -> BehaviourPolicy | None:
        """What fleets are to fly from now on; None where nothing changed since the last call."""
        latest = None
        with suppress(Empty):
            while True:
                latest = self._policies.get_nowait()
        return latest

    def stop(self) -> Ending:
        """Let it save and come to an end, and wait for that."""
        self._is_stopped = True
        self.source.close()
        self._thread.join()
        if self.ending is None:
            raise RuntimeError('learning ended without a word')
        return self.ending

    def _publish_if_due(self, epsilon: float) -> None:
        """Hand the network to the fleets, if there were enough updates since the last time."""
        if self._trainer.n_updates >= self._publish_at:
            self._publish_at = self._trainer.n_updates + self._every_updates
            self._policies.put(BehaviourPolicy(policy=self._trainer.snapshot(), epsilon=epsilon))

    def _run_thread(self) -> None:
        try:
            self.ending = Ending(text=self._train(), has_failed=False)
        except InterruptedRunError as error:
            self.ending = Ending(text=str(error), has_failed=False)
        except (DivergedError, TrainingRunError) as error:
            self.ending = Ending(text=str(error), has_failed=True)
        except OSError as error:
            why = f'{error.filename or self._run.folder}: {error.strerror or error}'
            text = f'{why}; start it again to go on from the last checkpoint'
            self.ending = Ending(text=text, has_failed=True)
        except BaseException as error:  # whatever it is, the other thread must see it
            self.ending = Ending(text=f'learning broke off: {error!r}', has_failed=True)
            raise

    def _train(self) -> str:
        """Train to the end of the budget; what came out, for people."""
        run, trainer = self._run, self._trainer
        budget = Budget(minutes=run.record.minutes, decisions=run.record.decisions)
        share_done = trainer.share_done(budget)
        with opened_folder(run, trainer) as folder:
            self._publish_if_due(trainer.config.epsilon(share_done))
            # Minutes count from the first mission on.
            if share_done < 1.0 and not self.source.wait():
                self._give_up()
            train(
                run,
                trainer,
                folder,
                checkpoint_s=self._checkpoint_s,
                is_stopped=lambda: self._is_stopped,
                show=self._show,
            )
        best = trainer.best_policy()
        if best is not None:
            self._policies.put(BehaviourPolicy(policy=best, epsilon=0.0))
        done = f'{trainer.n_decisions:,} decisions, {trainer.n_updates:,} updates'
        return f'done after {done}; its best policy is {run.folder / BEST_POLICY}'

    def _give_up(self) -> None:
        if self._is_stopped:
            raise InterruptedRunError('stopped before a mission was flown')
        raise TrainingRunError('there is no mission to learn from')

    def _show(self, progress: Progress) -> None:
        self.progress = progress

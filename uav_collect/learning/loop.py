"""The loop of one training run: trains, logs progress, saves policies and checkpoints."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from time import monotonic

from uav_collect.errors import DivergedError, InterruptedRunError, TrainingRunError
from uav_collect.learning.task import EpisodeSource
from uav_collect.learning.trainer import Trainer
from uav_collect.training.config import TrainingConfig
from uav_collect.training.folder import (
    BEST_POLICY,
    CHECKPOINT,
    LAST_POLICY,
    open_training_folder,
    TrainingFolder,
)
from uav_collect.training.planned_run import PlannedRun
from uav_collect.training.progress import Budget, Progress


def open_trainer(run: PlannedRun, sources: Sequence[EpisodeSource] | None = None) -> Trainer:
    """The trainer of a run: a new one, or as the last checkpoint of a run that is begun has it.

    Args:
        run: what is trained.
        sources: of each scenario's missions, which are flown in this process otherwise.

    Raises:
        CheckpointError: a run that is begun has no whole checkpoint of its own.
        ConfigError: the scenario cannot be trained with these settings.
        PolicyMismatchError: the network is not that of the policy to start from.
    """
    record = run.record
    trainer = Trainer(
        run.scenarios,
        run.config,
        record.algorithm,
        record.seed,
        device=record.device,
        initial=run.initial,
        sources=sources,
        courses=run.courses,
    )
    if run.is_begun:
        trainer.load(run.folder / CHECKPOINT)
    return trainer


def nothing_learned(trainer: Trainer, config: TrainingConfig) -> str:
    """That a training ended before its first update, and what that would have taken."""
    settings = config.replay
    n_missions = min(map(config.missions_per_batch, (0.0, 1.0)))
    if settings.excerpt_decisions:
        n_missions = 1
    least = max(config.rollout.decisions_per_update, settings.decisions_before_updates or 0)
    takes = f'{n_missions} mission{"" if n_missions == 1 else "s"} and {least:,} decisions'
    if settings.most_rows:
        takes += f', or {max(least, settings.most_rows):,} decisions of missions that ended'
    return (
        f'nothing was learned: {trainer.n_decisions:,} decisions came, too few for an update: it'
        f' takes {takes}'
    )


@contextmanager
def opened_folder(run: PlannedRun, trainer: Trainer) -> Iterator[TrainingFolder]:
    """The folder of a run, ready to be written as the trainer goes on.

    A run has its first checkpoint before its folder counts as one: whenever it is killed, it can
    be gone on with. Its best policy is then the checkpoint's.

    Raises:
        TrainingRunError: another process trains in the folder, or a table of it is damaged.
        OSError: naming what cannot be written.
    """
    checkpoint = run.folder / CHECKPOINT
    begin = partial(trainer.save, checkpoint)
    with open_training_folder(run, trainer.n_decisions, begin) as folder:
        folder.save(trainer.best_policy(), BEST_POLICY)
        yield folder


def train(
    run: PlannedRun,
    trainer: Trainer,
    folder: TrainingFolder,
    *,
    checkpoint_s: float,
    is_stopped: Callable[[], bool],
    show: Callable[[Progress], None],
) -> Progress | None:
    """Train until the time is up, from where the trainer is.

    Args:
        checkpoint_s: time between two checkpoints [s].
        is_stopped: asked about once a second.
        show: called with the progress about once a second.

    Returns:
        The last progress; None where the time was up before.

    Raises:
        InterruptedRunError: it was stopped; the run is saved.
        DivergedError: the loss is no number; the best policy is kept.
        TrainingRunError: no update was made of random weights; what came is saved.
        OSError: the folder cannot be written.
    """
    budget = Budget(minutes=run.record.minutes, decisions=run.record.decisions)
    saved_s = monotonic()
    best = trainer.best_policy()
    progress = None
    for progress in _progress_of(run, trainer, budget, is_stopped):
        folder.log(progress)
        show(progress)
        if trainer.best_policy() is not best:
            best = trainer.best_policy()
            folder.save(best, BEST_POLICY)
        is_interrupted = is_stopped()
        if is_interrupted or monotonic() - saved_s >= checkpoint_s:
            _save(trainer, folder)
            saved_s = monotonic()
        if is_interrupted:
            what = f'{progress.share_done:.0%} of {run.record.budget_text}'
            lacks = '' if best else ', no policy yet: none was validated'
            raise InterruptedRunError(f'interrupted after {what}; saved{lacks}')
    _save(trainer, folder)
    if trainer.n_updates == 0 and run.initial is None:  # random weights are no policy
        raise TrainingRunError(f'{run.folder}: {nothing_learned(trainer, run.config)}')
    folder.save(trainer.policy(), LAST_POLICY)
    folder.mark_done()
    return progress


def _progress_of(
    run: PlannedRun, trainer: Trainer, budget: Budget, is_stopped: Callable[[], bool]
) -> Iterator[Progress]:
    """The progress of a training.

    Raises:
        DivergedError: the loss or the weights are no numbers any more; it says what is kept.
    """
    try:
        yield from trainer.run(budget, is_stopped)
    except DivergedError as error:
        best = run.folder / BEST_POLICY
        has_policy = trainer.best_policy() is not None
        kept = f'its best policy: {best}' if has_policy else 'it has no policy yet'
        raise DivergedError(
            f'{run.folder}: diverged {error}; {kept}; a lower learning rate may help (--override)'
        ) from error


def _save(trainer: Trainer, folder: TrainingFolder) -> None:
    trainer.save(folder.checkpoint)
    folder.n_decisions_saved = trainer.n_decisions

"""One run of a training: follows the trainer, saves what it learns, and says what came out."""

from collections.abc import Iterator, Sequence
import math
from pathlib import Path
import sys
from time import monotonic

from uav_collect.checkpoint import CheckpointError
from uav_collect.commands import curves, files
from uav_collect.commands.interruption import Interruption
from uav_collect.commands.training_display import clock, showing
from uav_collect.commands.training_folder import (
    BEST_POLICY,
    CHECKPOINT,
    CURVE,
    LAST_POLICY,
    opened,
    RunFolder,
)
from uav_collect.commands.training_plan import PlannedRun, resume_command
from uav_collect.frozen import PolicyMismatchError
from uav_collect.learning_curves import learning_curves
from uav_collect.metrics import percent
from uav_collect.trainer import Trainer
from uav_collect.training_log import AXES, MEASURES, TrainingRunError
from uav_collect.training_progress import Budget, Progress


class DivergedError(RuntimeError):
    """The loss of a training is no number any more."""


class InterruptedRunError(RuntimeError):
    """A signal stopped a run, which was saved."""


def train(run: PlannedRun, checkpoint_s: float, interruption: Interruption) -> None:
    """Train one run to its end, from where its folder left it.

    Args:
        run: what to train, and where to keep it.
        checkpoint_s: time between two checkpoints [s].
        interruption: looked at about once a second.

    Raises:
        InterruptedRunError: a signal came; the run is saved.
        DivergedError: the loss is no number; the best policy is kept.
        TrainingRunError: another process trains in the folder.
        OSError: the folder cannot be written.
    """
    trainer = _trainer(run)
    with opened(run, trainer.n_decisions) as folder:
        _say(f'{run.title}, seed {run.record.seed}, {run.record.budget}: {run.folder}')
        try:
            last = _follow(run, trainer, folder, checkpoint_s, interruption)
            _save(trainer, folder.checkpoint)
            folder.keep(trainer.policy(), LAST_POLICY)
            folder.finish()
        except OSError:
            if _is_saved(folder.checkpoint):
                _say(f'to go on from the last checkpoint:\n  {resume_command(run.folder)}')
            raise
    if last is not None:
        _report(run, last)


def _trainer(run: PlannedRun) -> Trainer:
    """The trainer of a run, as its last checkpoint has it.

    Raises:
        TrainingRunError: the checkpoint cannot be read.
        ConfigError: the scenario cannot be trained with these settings.
        PolicyMismatchError: the network is not that of the policy to start from.
    """
    checkpoint = run.folder / CHECKPOINT
    if _is_saved(checkpoint):
        try:
            return Trainer.resume(checkpoint)
        except CheckpointError as error:
            raise TrainingRunError(str(error)) from error
    record = run.record
    return Trainer(
        run.scenarios,
        run.config,
        record.algorithm,
        record.seed,
        device=record.device,
        initial=run.initial,
    )


def _is_saved(checkpoint: Path) -> bool:
    return any(file.suffix != '.part' for file in checkpoint.glob('*'))


def _follow(
    run: PlannedRun,
    trainer: Trainer,
    folder: RunFolder,
    checkpoint_s: float,
    interruption: Interruption,
) -> Progress | None:
    """Train until the time is up; the last look at it, None where the time was up before."""
    budget = Budget(minutes=run.record.minutes, decisions=run.record.decisions)
    saved_s = monotonic()
    best = None
    progress = None
    with showing(run.folder.name) as show:
        for progress in _looks(run, trainer, budget):
            folder.note(progress)
            show(progress)
            if progress.best != best:
                best = progress.best
                folder.keep(trainer.best_policy(), BEST_POLICY)
            is_interrupted = interruption.signal_number is not None
            if is_interrupted or monotonic() - saved_s >= checkpoint_s:
                _save(trainer, folder.checkpoint)
                saved_s = monotonic()
            if is_interrupted:
                raise InterruptedRunError(_interruption(run, progress))
    return progress


def _looks(run: PlannedRun, trainer: Trainer, budget: Budget) -> Iterator[Progress]:
    """The looks at a training as long as its loss is a number.

    Raises:
        DivergedError: it is none any more.
    """
    try:
        for progress in trainer.run(budget):
            if progress.updates_per_s > 0 and not math.isfinite(progress.loss):
                raise DivergedError(_divergence(run, trainer, f'the loss is {progress.loss}'))
            yield progress
    except PolicyMismatchError as error:  # weights that are no numbers cannot be validated
        raise DivergedError(_divergence(run, trainer, str(error))) from error


def _divergence(run: PlannedRun, trainer: Trainer, what: str) -> str:
    best = run.folder / BEST_POLICY
    kept = 'it has no policy yet' if trainer.best_policy() is None else f'its best policy: {best}'
    return (
        f'{run.folder}: diverged after {trainer.n_updates:,} updates: {what}; {kept};'
        ' a lower learning rate may help (--override)'
    )


def _save(trainer: Trainer, checkpoint: Path) -> None:
    """Save a trainer.

    Raises:
        OSError: naming the checkpoint.
    """
    with files.naming(checkpoint):
        trainer.save(checkpoint)


def _interruption(run: PlannedRun, progress: Progress) -> str:
    return (
        f'interrupted after {progress.share_done:.0%} of {run.record.budget}; saved.'
        f' To go on:\n  {resume_command(run.folder)}'
    )


def draw_curve(
    folders: Sequence[Path], picture: Path, table: Path | None = None, title: str = ''
) -> None:
    """Draw the energy efficiency of runs over their decisions.

    Raises:
        OSError: naming the file.
    """
    measure, axis = MEASURES[0], AXES[0]
    lines = learning_curves(folders, measure, axis)
    curves.write(lines, measure, axis, picture=picture, table=table, title=title)


def _report(run: PlannedRun, last: Progress) -> None:
    """Print what a run came to, and draw its curve."""
    print(
        f'trained {clock(last.wall_s)}: {last.n_missions:,} missions,'
        f' {last.n_decisions:,} decisions, {last.n_updates:,} updates'
    )
    if last.best is None:
        return
    best = last.best
    print(
        f'best policy, after {best.n_decisions:,} decisions:'
        f' {best.efficiency_kbit_per_j:.3f} kbit/J, {best.completion_s:.1f} s,'
        f' {best.energy_kj:.1f} kJ, {percent(best.collected_share)} collected in validation'
    )
    print(f'policy: {run.folder / BEST_POLICY}')
    draw_curve((run.folder,), run.folder / CURVE, title=run.title)
    print(f'curve:  {run.folder / CURVE}')


def _say(text: str) -> None:
    sys.stderr.write(f'{text}\n')

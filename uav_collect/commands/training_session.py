"""One run of the command train: trains it, shows how it goes, and says what came out."""

from collections.abc import Sequence
from pathlib import Path

from uav_collect.analysis.metrics import percent
from uav_collect.commands import curves
from uav_collect.commands.terminal import Interruption, say
from uav_collect.commands.training_plan import resume_command
from uav_collect.errors import InterruptedRunError
from uav_collect.kernels.patience import waiting_for
from uav_collect.learning.loop import open_trainer, opened_folder, train
from uav_collect.training.curves import learning_curves
from uav_collect.training.display import progress_display
from uav_collect.training.folder import BEST_POLICY, CURVE
from uav_collect.training.planned_run import PlannedRun
from uav_collect.training.progress import Progress
from uav_collect.training.run_record import CURVE_AXES, CURVE_MEASURES, PANEL_FILE
from uav_collect.training.time_left import minutes_text


def train_with_display(run: PlannedRun, checkpoint_s: float, interruption: Interruption) -> None:
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
    with waiting_for('the replay and the first missions to begin'):
        trainer = open_trainer(run)
    with opened_folder(run, trainer) as folder:
        say(f'{run.title}, seed {run.record.seed}, {run.record.budget_text}: {run.folder}')
        try:
            with progress_display(run.folder.name) as show:
                last = train(
                    run,
                    trainer,
                    folder,
                    checkpoint_s=checkpoint_s,
                    is_stopped=interruption.acknowledge,
                    show=show,
                )
        except InterruptedRunError as stopped:
            raise InterruptedRunError(
                f'{stopped}. To go on:\n  {resume_command(run.folder)}'
            ) from stopped
        except OSError:
            n_lost = trainer.n_decisions - folder.n_decisions_saved
            say(
                f'{n_lost:,} of {trainer.n_decisions:,} decisions are lost, those after the last'
                f' checkpoint. To go on from there:\n  {resume_command(run.folder)}'
            )
            raise
    if last is not None:
        _report(run, last)


def draw_curve(
    folders: Sequence[Path], picture: Path, table: Path | None = None, title: str = ''
) -> None:
    """Draw the energy efficiency of runs over their decisions; of a panel, over the sweep's.

    Raises:
        OSError: naming the file.
    """
    is_of_panel = all((folder / PANEL_FILE).exists() for folder in folders)
    key = 'sweep_ratio' if is_of_panel else 'efficiency_kbit_per_j'
    [measure] = [each for each in CURVE_MEASURES if each.key == key]
    axis = CURVE_AXES[0]
    lines = learning_curves(folders, measure, axis)
    curves.write(lines, measure, axis, picture=picture, table=table, title=title)


def _report(run: PlannedRun, last: Progress) -> None:
    """Print what a run came to, and draw its curve."""
    print(
        f'trained {minutes_text(last.wall_s)}: {last.n_missions:,} missions,'
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
    if best.conditions:
        worst = best.worst
        print(
            f'in the panel: x{best.sweep_ratio:.3f} of the sweep on average,'
            f' x{worst.sweep_ratio:.2f} at worst, in {worst.name}'
        )
    print(f'policy: {run.folder / BEST_POLICY}')
    draw_curve((run.folder,), run.folder / CURVE, title=run.title)
    print(f'curve:  {run.folder / CURVE}')

"""A training that is interrupted or killed goes on as if nothing had happened."""

from collections.abc import Callable
from pathlib import Path
import shutil
import signal

import numpy as np
from processes import Processes, RunningProcess
import pytest
from train_command import (
    columns,
    COMPILING_S,
    copied,
    DECISIONS,
    ENVIRONMENT,
    events,
    Finished,
    learned,
    resume_command,
    said,
    Start,
)
from uav_collect.__main__ import main
from uav_collect.training.run_record import read_run

pytest.importorskip('torch', reason='training needs torch')
from uav_collect.learning.trainer import Trainer

pytestmark = pytest.mark.long

EFFICIENCY = 'efficiency_kbit_per_j'
N_TRIES = 5


def stopped_by(
    number: signal.Signals, start: Callable[[], RunningProcess], run: Path, n_validations: int = 1
) -> RunningProcess:
    """A training that a signal has ended amidst its first run, after so many validations.

    A training that was done before the signal came is begun anew, a few times.
    """
    for _ in range(N_TRIES):
        training = start()
        for _ in range(n_validations):
            training.wait_for('validated', COMPILING_S)
        training.send(number)
        training.wait_for_exit(COMPILING_S)
        if not read_run(run).is_done:
            return training
        for folder in run.parent.glob(f'{run.name.partition("_")[0]}*'):
            shutil.rmtree(folder) if folder.is_dir() else folder.unlink()
    raise AssertionError(f'each of {N_TRIES} trainings was done before the signal came')


def test_ctrl_c_saves_and_what_it_says_goes_on_as_if_nothing_had_happened(
    finished: Finished, settings: list[str], start: Start, processes: Processes, tmp_path: Path
) -> None:
    run = tmp_path / 'run'
    stopped = stopped_by(signal.SIGINT, lambda: start(*settings, '--output', 'run'), run)
    stopped.wait_for('interrupted after .* saved')
    command = resume_command(stopped)
    assert stopped.wait_for_exit() == 130
    assert int(columns(tmp_path / 'run' / 'progress.csv')['n_decisions'][-1]) < DECISIONS
    resumed = processes.run('resumed', *command, **ENVIRONMENT)
    assert resumed.wait_for_exit(COMPILING_S) == 0, resumed.output
    assert learned(tmp_path / 'run') == learned(finished[0])


@pytest.mark.nightly
def test_rows_that_a_killed_run_wrote_after_its_checkpoint_do_not_come_twice(
    finished: Finished,
    settings: list[str],
    start: Start,
    tmp_path: Path,
) -> None:
    # The first look at the training saves it, the later ones come too soon to.
    options = [*settings, '--output', 'run', '--checkpoint-minutes']
    run = tmp_path / 'run'
    stopped_by(signal.SIGKILL, lambda: start(*options, '0.001'), run, n_validations=2)
    with (run / 'validation.csv').open('a') as file:
        file.write('1160,29,9.9,9.9,9.9,9.9,9.9,9.9,9.9,9.9\n1180,30,9')
    assert start('--resume', 'run').wait_for_exit(COMPILING_S) == 0
    assert learned(run) == learned(finished[0])
    steps = [step for step, _ in events(run, 'validation/completion_s')]
    assert steps == [int(text) for text in columns(run / 'validation.csv')['n_decisions']]


def test_a_run_that_was_killed_before_its_first_look_goes_on_from_its_beginning(
    finished: Finished, settings: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*arguments: object) -> None:
        raise KeyboardInterrupt

    run = tmp_path / 'run'
    with monkeypatch.context() as patched:
        patched.setattr(Trainer, 'run', killed)
        assert main(['train', *settings, '--output', str(run)]) == 130
    assert main(['train', '--resume', str(run)]) == 0
    assert learned(run) == learned(finished[0])


def test_a_run_that_was_killed_before_its_first_checkpoint_begins_anew(
    settings: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Trainer.save
    first, second = tmp_path / 'pair_s3', tmp_path / 'pair_s4'

    def save_unless_killed(trainer: Trainer, folder: Path) -> None:
        if folder.parent == second:
            raise KeyboardInterrupt
        save(trainer, folder)

    few = [*settings, '--decisions', '200', '--output', str(tmp_path / 'pair')]
    with monkeypatch.context() as patched:
        patched.setattr(Trainer, 'save', save_unless_killed)
        assert main(['train', *few, '--seed', '3', '4']) == 130
    left = {path.name for path in second.iterdir()}
    assert left == {'.beginning', 'scenario.yaml', 'training.yaml'}
    assert main(['train', '--resume', str(first)]) == 0
    assert (read_run(second).seed, read_run(second).is_done) == (4, True)
    assert not (second / '.beginning').exists()


def test_a_folder_that_somebody_else_has_filled_is_no_beginning_of_a_run(
    settings: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'scenario.yaml').write_text('mine')
    assert main(['train', *settings, '--output', str(tmp_path)]) == 2
    assert said(capsys) == f'error: {tmp_path}: is there already: choose another --output'
    assert (tmp_path / 'scenario.yaml').read_text() == 'mine'


def test_a_run_that_was_killed_right_after_its_end_is_done(
    finished: Finished, tmp_path: Path
) -> None:
    run = copied(finished[0], tmp_path / 'run')
    (run / 'last.safetensors').unlink()
    assert main(['train', '--resume', str(run)]) == 0
    assert read_run(run).is_done
    assert learned(run) == learned(finished[0])


@pytest.mark.nightly
def test_several_seeds_that_are_terminated_go_on_together_and_end_in_one_curve(
    settings: list[str], start: Start, processes: Processes, tmp_path: Path
) -> None:
    first = tmp_path / 'runs' / 'pair_s3'
    both = [*settings, '--seed', '3', '4', '--output', 'runs/pair']
    stopped = stopped_by(signal.SIGTERM, lambda: start(*both), first)
    assert 'seed 3' in stopped.output
    command = resume_command(stopped)
    assert stopped.wait_for_exit() == 143
    assert not (tmp_path / 'runs' / 'pair_s4').exists()
    resumed = processes.run('resumed', *command, **ENVIRONMENT)
    resumed.wait_for('curve of 2 seeds: runs/pair.png, runs/pair.csv')
    assert resumed.wait_for_exit(COMPILING_S) == 0
    assert (tmp_path / 'runs' / 'pair.png').read_bytes().startswith(b'\x89PNG')
    curve = columns(tmp_path / 'runs' / 'pair.csv')
    last = [
        float(columns(tmp_path / 'runs' / f'pair_s{seed}' / 'validation.csv')[EFFICIENCY][-1])
        for seed in (3, 4)
    ]
    assert curve['n_seeds'][-1] == '2'
    assert float(curve[f'mean_{EFFICIENCY}'][-1]) == pytest.approx(np.mean(last))
    assert float(curve[f'deviation_{EFFICIENCY}'][-1]) == pytest.approx(np.std(last, ddof=1))


def test_a_run_that_is_done_goes_on_only_if_it_gets_more(
    finished: Finished, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / 'run'
    shutil.copytree(finished[0], run)
    assert main(['train', '--resume', str(run)]) == 2
    assert f'error: {run}: has had its 1,200 decisions: give it more' in said(capsys)
    assert main(['train', '--resume', str(run), '--decisions', '1600']) == 0
    assert columns(run / 'validation.csv')['n_decisions'][-1] == '1600'
    assert read_run(run).decisions == 1600

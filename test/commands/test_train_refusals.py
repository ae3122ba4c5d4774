"""What cannot be trained, or goes wrong while training, is said in one line."""

from collections.abc import Sequence
import fcntl
import os
from pathlib import Path
import shlex
import subprocess
import sys

from processes import Processes
import pytest
from train_command import COMPILING_S, copied, ENVIRONMENT, Finished, ROOT, said, TRAIN
from uav_collect.__main__ import main
from uav_collect.commands import train
from uav_collect.training.run_record import read_run
from uav_collect.uav.policy_file import load_policy

pytest.importorskip('torch', reason='training needs torch')
from uav_collect.learning.learner import Learner


def test_no_two_processes_train_in_one_folder(
    finished: Finished, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copied(finished[0], tmp_path / 'run')
    other = os.open(run, os.O_RDONLY)
    fcntl.flock(other, fcntl.LOCK_EX)
    status = main(['train', '--resume', str(run)])
    os.close(other)
    assert status == 2
    assert said(capsys) == f'error: {run}: another process trains in it'


@pytest.mark.usefixtures('finished')  # kernels are compiled by now, and need no room
def test_a_disk_that_fills_up_ends_the_run_with_one_line(
    settings: list[str], processes: Processes, tmp_path: Path
) -> None:
    # Files of more than 20 blocks of 512 or 1024 bytes are refused: the checkpoint.
    small = ['--override', 'network.hidden_size=1']  # the policy fits
    words = shlex.join([*TRAIN, *settings, *small, '--output', 'run'])
    limited = processes.run(
        'limited', 'sh', '-c', f'ulimit -f 20; exec {words}', PYTHONDONTWRITEBYTECODE='1',
        **ENVIRONMENT,
    )  # fmt: skip
    assert limited.wait_for_exit(COMPILING_S) == 2
    assert limited.output.endswith('error: run/checkpoint: File too large\n')
    assert 'Traceback' not in limited.output
    assert load_policy(tmp_path / 'run' / 'policy.safetensors')


def poisoned(monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    """Let the loss be no number after so many updates."""
    update = Learner.update

    def spoilt(self: Learner, *arguments: object) -> float:
        if self.n_updates == after:
            next(self.networks.parameters()).data.fill_(float('nan'))
        return update(self, *arguments)

    monkeypatch.setattr(Learner, 'update', spoilt)


@pytest.mark.parametrize('after', [12, 20])
def test_a_loss_that_is_no_number_ends_the_run_and_keeps_the_best_policy(
    after: int,
    settings: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    poisoned(monkeypatch, after)
    folder = tmp_path / 'run'
    assert main(['train', *settings, '--output', str(folder)]) == train.DIVERGED
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f'error: {folder}: diverged after ')
    assert f'its best policy: {folder}/policy.safetensors' in line
    assert load_policy(folder / 'policy.safetensors').header.updates <= after
    assert not read_run(folder).is_done


def test_a_run_is_not_overwritten(
    finished: Finished,
    settings: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    run, _ = finished
    assert main(['train', *settings, '--output', str(run)]) == 2
    assert f'--resume {run}' in said(capsys)


def test_of_several_seeds_none_is_trained_where_one_has_a_folder(
    settings: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'pair_s4').mkdir()
    (tmp_path / 'pair_s4' / 'notes.txt').touch()
    output = ['--output', str(tmp_path / 'pair')]
    assert main(['train', *settings, '--seed', '3', '4', *output]) == 2
    assert f'{tmp_path}/pair_s4: is there already' in said(capsys)
    assert not (tmp_path / 'pair_s3').exists()


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--scenario', 'atlantis'], ["'atlantis'", 'paper_10x10']),
        (['--preset', 'weak'], ["'weak'", 'paper', 'strong']),
        (['--override', 'target.trace=2'], ['target.trace is 2', 'from 0 to 1']),
        (['--override', 'target.trace'], ['target.trace', 'KEY=VALUE']),
        (['--override', 'goal.trace=1'], ['goal', 'unknown key']),
        (['--set', 'demand.cell_share=2'], ['demand.cell_share is 2']),
        (['--seed', '1', '2', '1'], ['--seed 1 2 1', 'twice']),
        (['--output', '/dev/null/run'], ['/dev/null/run', 'Not a directory']),
        (['--output', '/dev/null'], ['/dev/null', 'is there already']),
        (['--start-from', '/dev/null'], ['/dev/null']),
        (['--start-from', ''], ["called ''", 'paper_10x10_n2_aqmix']),
        (['--start-from', 'sweep'], ["'sweep'", 'paper_10x10_n2_aqmix']),
        (['--resume', '/dev'], ['/dev', 'holds no run.json']),
        (['--resume', '/dev', '--start-from', 'x'], ['--start-from cannot be given']),
        (['--resume', '/dev', '--seed', '1'], ['--seed cannot be given with --resume']),
        (['--resume', '/dev', '--set', 'a=1'], ['--set cannot be given with --resume']),
        (['--uavs', '7', '--output', '/nowhere/run'], ['7', '6']),
    ],
)
def test_what_cannot_be_trained_is_said_in_one_line(
    arguments: list[str], words: Sequence[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['train', '--decisions', '100', *arguments]) == 2
    line = said(capsys)
    assert line.startswith('error: ')
    assert all(word in line for word in words)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--minutes', '0'], ['--minutes', "'0'", 'above 0']),
        (['--minutes', 'inf'], ['--minutes', "'inf'"]),
        (['--minutes', '1', '--decisions', '1'], ['not allowed with']),
        (['--decisions', '1.5'], ['--decisions', 'whole number']),
        (['--algorithm', 'dqn'], ['--algorithm', 'aqmix', 'qmix', 'aiql']),
        (['--device', 'tpu'], ['--device', 'cpu', 'cuda']),
        (['--seed', '-1'], ['--seed', 'from 0 to']),
        (['--seed'], ['--seed']),
    ],
)
def test_a_wrong_argument_is_named_in_one_line(
    arguments: list[str], words: Sequence[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as raised:
        main(['train', *arguments])
    assert raised.value.code == 2
    shown = capsys.readouterr().err
    assert shown.count('\n') == 1
    assert all(word in shown for word in words)


def test_a_broken_checkpoint_is_named(
    finished: Finished,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ('run.json', 'scenario.yaml', 'training.yaml'):
        (tmp_path / name).write_bytes((finished[0] / name).read_bytes())
    (tmp_path / 'checkpoint').mkdir()
    (tmp_path / 'checkpoint' / 'state.pt').write_bytes(b'nothing')
    assert main(['train', '--resume', str(tmp_path), '--decisions', '2000']) == 2
    assert f'{tmp_path}/checkpoint/state.pt: is no whole checkpoint' in said(capsys)


def test_training_without_torch_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('importlib.util.find_spec', lambda name: None)
    assert main(['train']) == 2
    line = said(capsys)
    assert line.startswith('error: train needs torch and tensorboard: "make train" installs')


def test_a_gpu_that_is_not_there_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr('torch.cuda.is_available', lambda: False)
    assert main(['train', '--device', 'cuda', '--output', str(tmp_path / 'run')]) == 2
    assert 'finds no CUDA device' in said(capsys)
    assert not (tmp_path / 'run').exists()


@pytest.mark.parametrize('command', ['train', 'curves'])
def test_help_does_not_load_torch(command: str) -> None:
    program = (
        'import sys; from uav_collect.__main__ import main\n'
        f'try: main(["{command}", "--help"])\n'
        'except SystemExit: pass\n'
        'heavy = {"torch", "tensorboard", "numba", "matplotlib"} & set(sys.modules)\n'
        'assert not heavy, heavy'
    )
    done = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.startswith('usage: ')

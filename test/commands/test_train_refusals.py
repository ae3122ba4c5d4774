"""What cannot be trained, or goes wrong while training, is said in one line."""

from collections.abc import Callable, Sequence
import fcntl
import os
from pathlib import Path
import shutil
import sys

import pytest
from train_command import (
    copied,
    Finished,
    learned,
    ROOT,
    said,
)
from uav_collect.__main__ import main
from uav_collect.limits import FAILED
from uav_collect.training.run_record import read_run
from uav_collect.uav.policy_file import load_policy

pytest.importorskip('torch', reason='training needs torch')
from processes import completed
from trainer_states import poisoned


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
    assert main(['train', *settings, '--output', str(folder)]) == FAILED
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


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob('*'))
        if path.is_file()
    }


def edited(old: str, new: str) -> Callable[[Path], object]:
    """A change of a text in a file."""

    def edit(path: Path) -> None:
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return edit


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def as_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def as_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    ('name', 'tamper', 'words'),
    [
        ('checkpoint/state.pt', Path.unlink, 'is missing: cannot resume without it; start'),
        ('checkpoint/state.pt', flipped, 'is damaged: checksum mismatch'),
        ('checkpoint/state.pt', as_pipe, 'is a pipe'),
        ('checkpoint/state.pt', as_folder, 'is a folder'),
        ('scenario.yaml', Path.unlink, 'No such file'),
        ('scenario.yaml', as_folder, 'scenario.yaml'),
        ('scenario.yaml', edited('cells_per_side: 4', 'cells_per_side: 5'), 'its fingerprint is'),
        ('scenario.yaml', edited('name: field', 'name: meadow'), 'its name is meadow: must be'),
        ('scenario.yaml', edited('name: field', 'extends: field\nname: field'), 'unknown key'),
        ('training.yaml', Path.unlink, 'No such file'),
        ('training.yaml', edited('hidden_size: 8', 'hidden_size: 9'), 'its fingerprint is'),
        ('run.json', edited('"seed": 0', '"seed": 1'), 'seeds are (0,): lack 1'),
        ('run.json', edited('"aqmix"', '"qmix"'), "state.pt: algorithm is 'aqmix': must be"),
        ('run.json', edited('"cpu"', '"tpu"'), "device is 'tpu'"),
        ('run.json', edited('training/1', 'training/2'), "format is 'uav_collect.training/2'"),
        ('run.json', as_pipe, 'run.json'),
        ('progress.csv', edited('\n', '\nx'), 'progress.csv:2: is no row of 15 numbers'),
        ('progress.csv', edited('n_updates', 'n_update'), 'progress.csv:1: is no table'),
        ('validation.csv', as_pipe, 'validation.csv'),
        ('validation.csv', as_folder, 'validation.csv'),
    ],
)
def test_a_run_that_was_tampered_with_is_refused_by_the_file_and_stays_as_it_is(
    name: str,
    tamper: Callable[[Path], object],
    words: str,
    finished: Finished,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = copied(finished[0], tmp_path / 'run')
    tamper(run / name)
    before = contents(run)
    assert main(['train', '--resume', str(run)]) == 2
    line = said(capsys)
    assert line.startswith('error: ')
    assert Path(name).name in line or 'state.pt' in line
    assert words in line
    assert contents(run) == before


def test_a_run_is_not_gone_on_with_from_the_checkpoint_of_another(
    finished: Finished, settings: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, other = copied(finished[0], tmp_path / 'run'), tmp_path / 'other'
    assert main(['train', *settings, '--seed', '1', '--output', str(other)]) == 0
    capsys.readouterr()
    shutil.copyfile(other / 'checkpoint' / 'state.pt', run / 'checkpoint' / 'state.pt')
    before = contents(run)
    assert main(['train', '--resume', str(run)]) == 2
    assert said(capsys) == f'error: {run}/checkpoint/state.pt: seed is 1: must be 0'
    assert contents(run) == before


def test_what_a_checkpoint_holds_is_put_back_where_it_is_missing(
    finished: Finished, tmp_path: Path
) -> None:
    run = copied(finished[0], tmp_path / 'run')
    (run / 'policy.safetensors').write_bytes(b'damaged')
    (run / 'progress.csv').unlink()
    assert main(['train', '--resume', str(run)]) == 0
    assert learned(run) == learned(finished[0])
    assert (run / 'progress.csv').read_text().startswith('n_decisions,')


@pytest.mark.parametrize(
    ('command', 'target'), [('train', 'make train'), ('refine', 'make policy')]
)
def test_training_without_torch_says_how_to_get_it(
    command: str, target: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('uav_collect.commands.options.is_there', lambda name: False)
    assert main([command]) == 2
    line = said(capsys)
    assert line.startswith(f'error: {command} needs torch and tensorboard: "{target}" in a clone')


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
    done = completed(sys.executable, '-c', program, cwd=ROOT)
    assert done.stdout.startswith('usage: ')


def test_courses_and_scenarios_exclude_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / 'run'
    given = ['train', '--courses', 'anywhere', '--uavs', '2', '--output', str(run)]
    assert main(given) == 2
    assert said(capsys) == 'error: --uavs cannot be given with --courses: they are drawn'
    assert not run.exists()


def test_courses_are_not_learned_on_by_the_settings_of_scenarios(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / 'run'
    given = ['train', '--courses', 'anywhere', '--preset', 'strong', '--output', str(run)]
    assert main(given) == 2
    assert 'preset strong: courses is missing: must be there' in said(capsys)
    assert not run.exists()

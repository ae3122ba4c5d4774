"""The command train, in processes of its own: tiny trainings of a tiny world, in seconds."""

from collections.abc import Callable, Sequence
import csv
from dataclasses import replace
import fcntl
import os
from pathlib import Path
import shlex
import shutil
import signal
import subprocess
import sys

import numpy as np
from processes import Processes, RunningProcess
import pytest
from tiny_world import tiny
from uav_collect.__main__ import main
from uav_collect.commands import train
from uav_collect.scenario.load import fingerprint, from_yaml
from uav_collect.training.config import load_preset
from uav_collect.training.run_record import PROGRESS_COLUMNS, read_run, VALIDATION_COLUMNS
from uav_collect.uav.policy_file import load_policy

pytest.importorskip('torch', reason='training needs torch')
from uav_collect.learning.learner import Learner

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {'PYTHONPATH': str(ROOT)}
COMPILING_S = 400.0  # of a first process, on a busy machine
TRAIN = (sys.executable, '-m', 'uav_collect', 'train')
DECISIONS = 1200
EFFICIENCY = 'efficiency_kbit_per_j'
SCENARIOS = ('scenario.yaml', 'scenario_2.yaml')

Start = Callable[..., RunningProcess]
Finished = tuple[Path, subprocess.CompletedProcess[str]]

# Every 40 decisions an update, every 10 updates a validation.
PRESET = """extends: strong
network: {hidden_size: 8}
mixer: {embedding_size: 4, hypernetwork_size: 4}
rollout: {missions_at_once: 4, max_decisions_per_cell: 2.5, decisions_per_update: 40}
replay: {decisions: 2000, missions_per_batch: 4}
validation: {missions: 2, every_updates: 10}
"""


@pytest.fixture(scope='module')
def settings(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The options that make a training tiny."""
    folder = tmp_path_factory.mktemp('settings')
    (folder / 'field.yaml').write_text(tiny(name='field').to_yaml())
    (folder / 'quick.yaml').write_text(PRESET)
    files = ['--scenario', str(folder / 'field.yaml'), '--preset', str(folder / 'quick.yaml')]
    return [*files, '--decisions', str(DECISIONS)]


@pytest.fixture(scope='module')
def finished(settings: list[str], tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """A run that nothing interrupted, and what it said."""
    folder = tmp_path_factory.mktemp('finished') / 'run'
    done = subprocess.run(
        [*TRAIN, *settings, '--output', str(folder)], env={**os.environ, **ENVIRONMENT},
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder, done


@pytest.fixture
def start(processes: Processes) -> Start:
    """Starts a train command in the test's folder."""

    def begin(*arguments: str) -> RunningProcess:
        return processes.run('train', *TRAIN, *arguments, **ENVIRONMENT)

    return begin


def columns(path: Path) -> dict[str, list[str]]:
    with path.open(newline='') as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def learned(run: Path) -> dict[str, object]:
    """What a run learned, without what depends on the clock."""
    validations = columns(run / 'validation.csv')
    del validations['wall_s']
    policies = [load_policy(run / f'{name}.safetensors').digest for name in ('policy', 'last')]
    return {'validations': validations, 'policies': policies}


def said(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that it wrote."""
    shown = capsys.readouterr()
    [line] = [line for line in shown.err.splitlines() if 'compiling (once)' not in line]
    assert shown.out == ''
    return line


# What a run leaves.


def test_a_run_folder_says_what_was_trained(finished: Finished, settings: list[str]) -> None:
    run, _ = finished
    record = read_run(run)
    scenario = from_yaml((run / 'scenario.yaml').read_text())
    assert scenario == tiny(name='field')
    assert load_preset(run / 'training.yaml') == load_preset(settings[3])
    assert (record.scenario, record.n_uavs) == ('field', (2,))
    assert record.scenario_fingerprint == fingerprint(scenario)
    assert (record.algorithm, record.preset, record.seed) == ('aqmix', 'quick', 0)
    assert (record.decisions, record.minutes) == (DECISIONS, None)
    assert record.is_done
    assert set(record.versions) == {'uav_collect', 'python', 'numpy', 'numba', 'torch'}
    assert '-m uav_collect train --scenario' in record.command


def test_the_tables_have_units_and_end_with_the_budget(
    finished: Finished,
) -> None:
    run, _ = finished
    validations, progress = (columns(run / f'{name}.csv') for name in ('validation', 'progress'))
    assert tuple(validations) == VALIDATION_COLUMNS
    assert tuple(progress) == PROGRESS_COLUMNS
    assert int(validations['n_updates'][0]) == 10
    assert int(validations['n_decisions'][-1]) == int(progress['n_decisions'][-1]) == DECISIONS


def test_the_policy_is_the_best_of_the_validations(
    finished: Finished,
) -> None:
    run, done = finished
    header = load_policy(run / 'policy.safetensors').header
    validations = columns(run / 'validation.csv')
    row = validations['n_updates'].index(str(header.updates))
    told = header.validation
    assert told.efficiency_kbit_per_j == float(validations['efficiency_kbit_per_j'][row])
    assert told.completion_s == float(validations['completion_s'][row])
    assert f'{told.efficiency_kbit_per_j:.3f} kbit/J' in done.stdout


def test_the_last_policy_is_there_too(
    finished: Finished,
) -> None:
    run, _ = finished
    header = load_policy(run / 'last.safetensors').header
    assert header.decisions == DECISIONS


def test_a_run_draws_its_curve_and_says_where_all_is(
    finished: Finished,
) -> None:
    run, done = finished
    assert (run / 'curve.png').read_bytes().startswith(b'\x89PNG')
    assert f'policy: {run}/policy.safetensors' in done.stdout
    assert f'curve:  {run}/curve.png' in done.stdout


def test_the_progress_tells_speeds_loss_efficiency_and_the_time_left(
    finished: Finished,
) -> None:
    _, done = finished
    lines = done.stderr.splitlines()
    assert any('AQMIX, field, 2 UAVs, quick, seed 0, 1,200 decisions' in line for line in lines)
    words = ('decisions/s', 'updates/s', 'loss ', 'kbit/J exploring', 'validated', 'best', 'left')
    assert all(word in lines[-1] for word in words)


def events(run: Path, tag: str) -> list[tuple[int, float]]:
    """What TensorBoard would show."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    seen = EventAccumulator(str(run / 'tensorboard'))
    seen.Reload()
    return [(event.step, event.value) for event in seen.Scalars(tag)]


def test_tensorboard_shows_what_the_tables_have(
    finished: Finished,
) -> None:
    run, _ = finished
    validations = columns(run / 'validation.csv')
    shown = events(run, 'validation/completion_s')
    assert [step for step, _ in shown] == [int(text) for text in validations['n_decisions']]
    assert [value for _, value in shown] == pytest.approx(
        [float(text) for text in validations['completion_s']], rel=1e-6
    )


def test_another_seed_learns_something_else(
    finished: Finished, settings: list[str], tmp_path: Path
) -> None:
    assert main(['train', *settings, '--seed', '1', '--output', str(tmp_path / 'run')]) == 0
    assert learned(tmp_path / 'run') != learned(finished[0])


def test_a_run_starts_from_the_weights_of_a_policy(
    finished: Finished, settings: list[str], tmp_path: Path
) -> None:
    initial, folder = finished[0] / 'policy.safetensors', tmp_path / 'run'
    few = ['--decisions', '1', '--start-from', str(initial), '--output', str(folder)]
    assert main(['train', *settings[:4], *few]) == 0
    learned_from, kept = load_policy(initial), load_policy(folder / 'initial.safetensors')
    assert kept.digest == load_policy(folder / 'last.safetensors').digest == learned_from.digest
    assert read_run(folder).initial == learned_from.header.version


def test_one_policy_learns_to_fly_several_fleets(settings: list[str], tmp_path: Path) -> None:
    folder = tmp_path / 'run'
    assert main(['train', *settings, '--uavs', '1', '2', '--output', str(folder)]) == 0
    header = load_policy(folder / 'policy.safetensors').header
    assert (header.n_uavs_min, header.n_uavs_max) == (1, 2)
    assert read_run(folder).scenario_text == 'field, 1 to 2 UAVs'
    scenarios = [from_yaml((folder / name).read_text()) for name in SCENARIOS]
    assert [scenario.n_uavs for scenario in scenarios] == [1, 2]


# Interrupted, and resumed.


def resume_command(process: RunningProcess) -> list[str]:
    """The words that it said to go on with."""
    return shlex.split(process.wait_for(r'^  (.* train --resume .*)$')[1])


@pytest.mark.parametrize(('number', 'status'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_saves_and_what_it_says_goes_on_as_if_nothing_had_happened(
    number: signal.Signals,
    status: int,
    finished: Finished,
    settings: list[str],
    start: Start,
    processes: Processes,
    tmp_path: Path,
) -> None:
    stopped = start(*settings, '--output', 'run')
    stopped.wait_for('validated', COMPILING_S)
    stopped.send(number)
    stopped.wait_for('interrupted after .* saved')
    command = resume_command(stopped)
    assert stopped.wait_for_exit(COMPILING_S) == status
    assert int(columns(tmp_path / 'run' / 'progress.csv')['n_decisions'][-1]) < DECISIONS
    resumed = processes.run('resumed', *command, **ENVIRONMENT)
    assert resumed.wait_for_exit(COMPILING_S) == 0, resumed.output
    assert learned(tmp_path / 'run') == learned(finished[0])


def test_rows_that_a_killed_run_wrote_after_its_checkpoint_do_not_come_twice(
    finished: Finished,
    settings: list[str],
    start: Start,
    tmp_path: Path,
) -> None:
    # The first look at the training saves it, the later ones come too soon to.
    options = [*settings, '--output', 'run', '--checkpoint-minutes']
    killed = start(*options, '0.001')
    killed.wait_for('validated', COMPILING_S)
    killed.wait_for('validated', COMPILING_S)
    killed.kill()
    run = tmp_path / 'run'
    with (run / 'validation.csv').open('a') as file:
        file.write('1160,29,9.9,9.9,9.9,9.9,9.9,9.9,9.9,9.9\n1180,30,9')
    assert start('--resume', 'run').wait_for_exit(COMPILING_S) == 0
    assert learned(run) == learned(finished[0])
    steps = [step for step, _ in events(run, 'validation/completion_s')]
    assert steps == [int(text) for text in columns(run / 'validation.csv')['n_decisions']]


def copied(run: Path, folder: Path) -> Path:
    """The run as if it had not noted that it is done."""
    shutil.copytree(run, folder)
    record = replace(read_run(folder), is_done=False)
    (folder / 'run.json').write_bytes(record.to_json())
    return folder


def test_a_run_that_was_killed_before_its_first_checkpoint_begins_again(
    finished: Finished, tmp_path: Path
) -> None:
    run = copied(finished[0], tmp_path / 'run')
    shutil.rmtree(run / 'checkpoint')
    assert main(['train', '--resume', str(run)]) == 0
    assert learned(run) == learned(finished[0])


def test_a_run_that_was_killed_right_after_its_end_is_done(
    finished: Finished, tmp_path: Path
) -> None:
    run = copied(finished[0], tmp_path / 'run')
    (run / 'last.safetensors').unlink()
    assert main(['train', '--resume', str(run)]) == 0
    assert read_run(run).is_done
    assert learned(run) == learned(finished[0])


def test_several_seeds_go_on_together_and_end_in_one_curve(
    settings: list[str], start: Start, processes: Processes, tmp_path: Path
) -> None:
    stopped = start(*settings, '--seed', '3', '4', '--output', 'runs/pair')
    stopped.wait_for('seed 3')
    stopped.wait_for('validated', COMPILING_S)
    stopped.send(signal.SIGINT)
    command = resume_command(stopped)
    assert stopped.wait_for_exit(COMPILING_S) == 130
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


# What goes wrong is said in one line.


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

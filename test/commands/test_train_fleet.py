"""The command that lets a fleet learn over ROS: all its processes, from the start to the end."""

import os
from pathlib import Path
import re
import signal
import sys

from growing_bag import n_kept
from processes import DEADLINE_S, Processes, RunningProcess, wait_until
import pytest
from tiny_world import tiny, uav
from uav_collect.commands.ros_processes import ros_parameters
from uav_collect.recording.bag_reader import read_missions
from uav_collect.recording.bag_repair import repair
from uav_collect.training.run_record import read_run
from uav_collect.training.seeds import first_training_seed
from uav_collect.uav.policy_file import load_policy

pytestmark = pytest.mark.long

pytest.importorskip('torch', reason='training needs torch')

TRAINED_S = DEADLINE_S  # for what takes ten seconds where nothing else runs
PACE = 100  # simulated over wall-clock time: a trainer that starts meanwhile needs the processor
FLEET = uav(5.0), uav(10.0)

# Every 20 decisions an update; a mission of the tiny world has some 30.
PRESET = """extends: strong
network: {hidden_size: 8}
mixer: {embedding_size: 4, hypernetwork_size: 4}
rollout: {missions_at_once: 4, max_decisions_per_cell: 2.5, decisions_per_update: 20}
replay: {decisions: 2000, missions_per_batch: 4}
validation: {missions: 2, every_updates: 50}
"""


def started(
    processes: Processes, folder: Path, *arguments: str, n_uavs: int = 2
) -> RunningProcess:
    """A training of a tiny world in a folder `run`; a compiler would take minutes."""
    field, quick = folder / 'field.yaml', folder / 'quick.yaml'
    field.write_text(tiny(*FLEET[:n_uavs], name='field').to_yaml())
    quick.write_text(PRESET)
    words = ['--scenario', str(field), '--preset', str(quick), '--output', str(folder / 'run')]
    words += ['--real-time-factor', str(PACE), *arguments]
    command = [sys.executable, '-m', 'uav_collect', 'train-fleet', *words]
    return processes.run('train_fleet', *command, UAV_COLLECT_KERNELS='interpreted')


@pytest.mark.ros
def test_two_worlds_teach_one_trainer_until_its_time_is_up_and_all_ends(
    processes: Processes, tmp_path: Path
) -> None:
    # One fleet may fly hundreds of missions before the other one takes off.
    options, run = ['--worlds', '2', '--record'], tmp_path / 'run'
    command = started(processes, tmp_path, *options, '--minutes', '1000', n_uavs=1)
    said = run / 'processes'
    command.wait_for(r'loss \d', TRAINED_S)
    wait_until(lambda: all(n_ended(said / '1' / f'world_sim_{world}.log') > 2 for world in 'ab'))
    command.send(signal.SIGINT)
    assert command.wait_for_exit(TRAINED_S) == 130
    assert f'interrupted; the same command goes on with {run}' in command.output
    assert processes.survivors() == []
    before = n_decisions(run)
    assert before > 0
    more = ['--decisions', str(before + 100)]
    done = started(processes, tmp_path, *options, *more, n_uavs=1)
    assert done.wait_for_exit(TRAINED_S) == 0
    assert n_decisions(run) >= before + 100
    assert processes.survivors() == []
    assert read_run(run).is_done
    assert load_policy(run / 'policy.safetensors').header.decisions > 0
    assert re.search(rf'recorded \d+\.\d MB in {said}/2', done.output)
    said, seeds = said / '1', []
    for world in ('a', 'b'):
        missions = read_missions(said / f'bag_{world}')
        assert len(missions) > 2
        seeds += [mission.log.header.mission_seed for mission in missions]
        assert 'UAV 1 flies, policy topic' in (said / f'uav_1_{world}.log').read_text()
    assert len({*seeds}) == len(seeds)


def n_ended(log: Path) -> int:
    """How many missions of a world have ended, by what it says."""
    text = log.read_text() if log.exists() else ''
    return len(re.findall(r'mission \S+ (?:ended|was aborted)', text))


def n_decisions(run: Path) -> int:
    """Decisions that a run has learned from."""
    return int((run / 'progress.csv').read_text().splitlines()[-1].split(',')[0])


@pytest.mark.nightly
@pytest.mark.ros
def test_what_is_killed_is_started_again_costs_no_mission_and_none_is_flown_again(
    processes: Processes, tmp_path: Path
) -> None:
    command = started(processes, tmp_path, '--minutes', '1000', '--record')
    said = tmp_path / 'run' / 'processes' / '1'
    command.wait_for(r'loss \d', TRAINED_S)
    for name, words in (
        ('uav_1', ('uav_agent', '--id', '1')),
        ('recorder', ('recorder',)),
        ('world_sim', ('world_sim',)),
        ('trainer', ('trainer',)),
    ):
        [pid] = processes.running(*words)
        os.kill(pid, signal.SIGKILL)
        command.wait_for(f'{name} was killed and is started again')
    command.wait_for(r'loss \d', TRAINED_S)
    log, again = said / 'world_sim.log', first_training_seed(0, 0, 1)
    wait_until(lambda: f'-3 starts, seed {again + 3}\n' in log.read_text())
    second = said / 'bag_2'
    wait_until(lambda: second.is_dir() and n_kept(second)['/world/mission'] > 5)
    command.send(signal.SIGINT)
    assert command.wait_for_exit(TRAINED_S) == 130
    assert processes.survivors() == []
    seeds = re.findall(r' starts, seed (\d+)', log.read_text())
    assert len({*seeds}) == len(seeds)
    # The first bag is mended, the second as a recorder leaves it.
    assert repair(said / 'bag').n_messages > 0
    values = ros_parameters(
        scenario=tmp_path / 'field.yaml',
        preset=tmp_path / 'quick.yaml',
        output_dir=tmp_path / 'offline',
    )
    bags = [str(said / name) for name in ('bag', 'bag_2')]
    trainer = processes.start(
        'trainer', '--from-bag', *bags, *values, UAV_COLLECT_KERNELS='interpreted'
    )
    assert trainer.wait_for_exit(TRAINED_S) == 0
    n_joined = [
        int(number) for number in re.findall(r'found: (\d+) missions joined', trainer.output)
    ]
    assert len(n_joined) == len(bags)
    assert sum(n_joined) <= len(seeds)
    assert n_joined[-1] > 0


@pytest.mark.ros
def test_a_trainer_that_cannot_start_ends_all_with_its_reason(
    processes: Processes, tmp_path: Path
) -> None:
    (tmp_path / 'run').mkdir()
    (tmp_path / 'run' / 'run.json').write_text('{}')
    command = started(processes, tmp_path, '--decisions', '100')
    assert command.wait_for_exit(TRAINED_S) == 1
    assert 'run.json' in command.output
    assert 'Traceback' not in command.output
    assert processes.survivors() == []


def test_texts_stay_texts_as_ros_parameters() -> None:
    words = ros_parameters(folder=Path('2024'), names=["a'b", ''], minutes=2.0, seed=3)
    assert words == [
        '--ros-args', '-p', "folder:='2024'", '-p', "names:=['a''b', '']",
        '-p', 'minutes:=2.0', '-p', 'seed:=3',
    ]  # fmt: skip

"""Learning from recordings: each mission once, and what was in them is said."""

from pathlib import Path

from bag_damage import changed_byte
from bags import HandMadeBag
from episodes import single_threaded_torch
from fleets import parameters
from node_starts import refusal
from processes import Processes
import pytest

torch = single_threaded_torch()
pytest.importorskip('rclpy')
from rosbags.highlevel import AnyReader
from tiny_world import tiny
from trainings import fleet_of, NEVER, replayed, start_trainer, TRAINED_S
from uav_collect.missions.rollout import fly
from uav_collect.nodes import topics
from uav_collect.scenario.site import build_site

pytestmark = [pytest.mark.ros, pytest.mark.long]

N_MISSIONS = 16
PACE = 80.0  # simulated over wall-clock time


def recorded(processes: Processes, folder: Path, n_missions: int) -> tuple[Path, Path]:
    """Bags of two recorders, one after the other.

    The later one gets what the world has published before, so that both have missions in common.
    """
    fleet, second = fleet_of(processes, folder), folder / 'later_bag'
    recorder = fleet.start_recorder(stop_after_missions=n_missions // 2)
    agents = fleet.start_agents('random', 'equal', observation_layout='egocentric')
    # Slow enough that the later one finds even the first of them.
    world = fleet.start_world(missions=-1, real_time_factor=PACE)
    assert recorder.wait_for_exit() == 0
    flags = ['--output', str(second), *parameters(stop_after_missions=n_missions)]
    later = processes.start('recorder', *flags)
    assert later.wait_for_exit(TRAINED_S) == 0
    for process in (*agents, world):
        process.kill()
    return fleet.bag, second


@pytest.mark.nightly
def test_each_mission_of_two_bags_that_a_restart_parted_is_learned_from_once(
    processes: Processes, tmp_path: Path
) -> None:
    bags = [str(bag) for bag in recorded(processes, tmp_path, N_MISSIONS)]
    run = tmp_path / 'run'
    trainer = start_trainer(processes, run, '--from-bag', *bags, decisions=NEVER)
    first = trainer.wait_for(r'w_bag: (\d+) missions found: (\d+) missions joined')
    second = trainer.wait_for(
        r'later_bag: (\d+) missions found: (\d+) missions joined, (\d+) known'
    )
    assert trainer.wait_for_exit(TRAINED_S) == 0
    assert min(int(first[2]), int(second[2]), int(second[3])) > 5
    episodes, state = replayed(run)
    seeds = [one.mission_seed for one in episodes]
    assert state['sources'][0]['n_missions'] == int(first[2]) + int(second[2])
    assert sorted({*seeds}) == sorted(seeds)
    # A later run of the same trainer knows them all.
    policy = (run / 'policy.safetensors').read_bytes()
    again = start_trainer(processes, run, '--from-bag', *bags, decisions=NEVER)
    assert again.wait_for_exit(TRAINED_S) == 1
    assert 'later_bag: ' in again.output
    assert ': 0 missions joined' in again.output
    assert again.output.splitlines()[-1].endswith('there is no mission to learn from')
    assert (run / 'policy.safetensors').read_bytes() == policy


def test_a_bag_of_what_is_learned_from_is_enough_to_learn_from(
    processes: Processes, tmp_path: Path
) -> None:
    fleet, run = fleet_of(processes, tmp_path), tmp_path / 'run'
    recorder = fleet.start_recorder(stop_after_missions=20, topics='learning')
    fleet.start_agents('random', 'equal', observation_layout='egocentric')
    assert fleet.start_world(missions=20).wait_for_exit() == 0
    assert recorder.wait_for_exit() == 0
    own = {topic.name for uav in (1, 2) for topic in topics.topics_of_uav(uav)}
    with AnyReader([fleet.bag]) as reader:
        recorded = {connection.topic for connection in reader.connections}
    assert recorded & own == {'/uav_1/transition', '/uav_2/transition'}
    assert recorded - own == {
        '/world/scenario',
        '/world/mission',
        '/world/epoch',
        '/trainer/policy',
    }
    trainer = start_trainer(processes, run, '--from-bag', str(fleet.bag))
    assert trainer.wait_for_exit(TRAINED_S) == 0
    assert '20 missions found: 20 missions joined' in trainer.output


def test_a_recorder_of_what_nobody_knows_is_refused(
    ros_domain: int, capsys: pytest.CaptureFixture[str]
) -> None:
    *_, line = refusal('recorder', parameters(topics='some'), capsys)
    assert "topics is 'some': must be all or learning" in line


def test_a_bag_that_is_too_short_to_learn_from_leaves_no_policy(
    processes: Processes, tmp_path: Path
) -> None:
    fleet, run = fleet_of(processes, tmp_path), tmp_path / 'run'
    recorder = fleet.start_recorder(stop_after_missions=2)
    fleet.start_agents('random', 'equal', observation_layout='egocentric')
    assert fleet.start_world(missions=2).wait_for_exit() == 0
    assert recorder.wait_for_exit() == 0
    trainer = start_trainer(processes, run, '--from-bag', str(fleet.bag))
    assert trainer.wait_for_exit(TRAINED_S) == 1
    assert '2 missions found: 2 missions joined\n' in trainer.output
    assert 'nothing was learned' in trainer.output.splitlines()[-1]
    assert 'it takes 4 missions and 20 decisions' in trainer.output
    assert [*run.glob('*.safetensors')] == []


def test_a_bag_with_a_flipped_bit_teaches_nothing_and_is_mended(
    processes: Processes, tmp_path: Path
) -> None:
    site = build_site(tiny())
    [log] = fly(site, [0], 'sweep')
    bag = HandMadeBag(tmp_path / 'bag', chunk_byte=2_000)
    bag.add_scenario(site)
    bag.add_mission(log, 'world-0')
    bag.writer.close()
    changed_byte(tmp_path / 'bag' / 'bag.mcap', b'zstd', behind=True)  # the length of the first
    trainer = start_trainer(processes, tmp_path / 'run', '--from-bag', str(tmp_path / 'bag'))
    assert trainer.wait_for_exit(TRAINED_S) == 2
    assert f'{tmp_path}/bag: bag.mcap: chunk 1, bytes ' in trainer.output
    assert f'recorder --repair {tmp_path}/bag keeps what is whole' in trainer.output
    repair = processes.start('recorder', '--repair', str(tmp_path / 'bag'))
    assert repair.wait_for_exit() == 0
    repair.wait_for('left out: bag.mcap: chunk 1, bytes ')
    repair.wait_for(f'kept {tmp_path}/bag/bag.mcap.broken')
    again = processes.start('recorder', '--repair', str(tmp_path / 'bag'))
    assert again.wait_for_exit() == 0
    again.wait_for('nothing to repair')

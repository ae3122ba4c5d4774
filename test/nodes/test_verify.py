"""Missions that a fleet of processes has flown and recorded, proved by the command verify."""

from collections.abc import Callable, Iterator
from pathlib import Path
import shutil
from typing import Any

from bag_damage import changed_byte, copied_without_checksums
from fleets import Fleet, scenario_of
from growing_bag import n_kept
from policy_publisher import policy_publisher
from processes import DEADLINE_S, Processes, ros_environment, RunningProcess, wait_until
import pytest
from random_policies import header, random_policy
from ros_domains import own_domain
from steered_world import SteeredWorld
from uav_collect.__main__ import main

pytest.importorskip('rclpy')
pytest.importorskip('uav_collect_msgs')

from uav_collect.nodes import topics
from uav_collect.recording.mcap_file import read_mcap
from uav_collect.recording.mission_log import read
from uav_collect_msgs.msg import Mission

pytestmark = pytest.mark.ros

SEED = 3
EPSILON = 0.3
HARDLY = 0.001  # real-time factor: the next event would take hours


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The run folder of three missions by two published policies; in the last an agent dies."""
    folder = tmp_path_factory.mktemp('recorded')
    scenario = scenario_of(2, fleet__default__energy_budget_kj=20.0)  # some 40 events
    policies = [random_policy(header(version=f'run@{number}'), seed=number) for number in (1, 2)]
    with own_domain() as domain, pytest.MonkeyPatch.context() as patch:
        for name, value in ros_environment(domain, folder / 'ros_log').items():
            patch.setenv(name, value)
        processes = Processes(folder, {'ROS_DOMAIN_ID': str(domain)})
        fleet = Fleet(processes=processes, scenario=scenario, folder=folder / 'run')
        try:
            with policy_publisher(topics.MISSION) as (trainer, listening):
                missions = listening.heard[topics.MISSION.name]
                recorder = fleet.start_recorder(stop_after_missions=3)
                agents = fleet.start_agents('topic')
                world = fleet.start_world(missions=0, recorders=1)
                steered = SteeredWorld(listening.node, listening.wait_until)
                trainer.publish(policies[0], EPSILON)
                steered.start(SEED)
                listening.wait_until(lambda: _n_ended(missions) == 1)
                trainer.publish(policies[1])
                steered.start(SEED + 1)
                listening.wait_until(lambda: _n_ended(missions) == 2)
                steered.pause()
                steered.start(SEED + 2)
                steered.step(5)
                fleet.wait_for_events(SEED + 2, 5)
                _wait_until_recorded(fleet)
                _let_fly_home(world, steered, agents[1])
                assert recorder.wait_for_exit() == 0
        finally:
            processes.close()
    shutil.move(fleet.bag, fleet.folder / 'bag')
    yield fleet.folder


def _n_ended(missions: list[Any]) -> int:
    return sum(message.phase == Mission.ENDED for message in missions)


def _wait_until_recorded(fleet: Fleet) -> None:
    """Wait until the bag holds all that UAV 2 has said: what is latched is gone with its agent."""
    logs = [read(fleet.log_file(SEED + number)) for number in range(3)]
    n_decisions = sum(int((log.events['uav'] == 2).sum()) for log in logs)
    own = topics.uav_topics(2)
    least = {own.command.name: n_decisions + 1, own.radio_tx.name: n_decisions}  # it greeted

    def are_kept() -> bool:
        kept = n_kept(fleet.bag)
        return all(kept[topic] >= least[topic] for topic in least)

    wait_until(are_kept)


def _let_fly_home(world: RunningProcess, steered: SteeredWorld, agent: RunningProcess) -> None:
    """End the agent of UAV 2, which then does not answer; nobody else has to hurry."""
    agent.kill()
    steered.step_until('one event more, when UAV 2 has answered')
    steered.change('decision_timeout_s', 0.5)
    steered.change('real_time_factor', HARDLY)
    steered.resume()
    world.wait_for('UAV 2: no answer')
    steered.change('decision_timeout_s', DEADLINE_S)
    steered.change('real_time_factor', 0.0)


@pytest.fixture
def run_folder(recorded: Path, tmp_path: Path) -> Path:
    """A copy of it, to be changed."""
    return Path(shutil.copytree(recorded, tmp_path / 'run'))


def verified(
    path: Path, capsys: pytest.CaptureFixture[str], status: int, *options: str
) -> list[str]:
    """The lines that the command prints."""
    assert main(['verify', str(path), *options]) == status, capsys.readouterr()
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize('inside', ['', 'bag', 'bag/run_bag.mcap'])
def test_missions_by_published_policies_are_proved_with_their_exploration_and_failsafe(
    recorded: Path, inside: str, capsys: pytest.CaptureFixture[str]
) -> None:
    *missions, last = verified(recorded / inside, capsys, 0)
    assert last == '3 missions: 3 proved'
    assert all(f'seed {SEED + number}: proved, ' in line for number, line in enumerate(missions))
    assert ['1 failsafe taken as recorded' in line for line in missions] == [False, False, True]


def test_a_log_alone_does_not_tell_what_a_trainer_has_published(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, last = verified(recorded / f'mission_{SEED}.jsonl', capsys, 2)
    assert "policy 'run@1 eps 0.3' is not here" in first
    assert last == '1 mission: 1 cannot be proved'


def in_chunk(run: Path) -> None:
    bag = run / 'bag' / 'run_bag.mcap'
    chunk = max(read_mcap(bag).parts, key=lambda part: part.n_byte)
    content = bytearray(bag.read_bytes())
    content[chunk.begin + chunk.n_byte // 2] ^= 1
    bag.write_bytes(content)


def in_summary(run: Path) -> None:
    changed_byte(run / 'bag' / 'run_bag.mcap', b'offered_qos_profiles', last=True)


def in_metadata(run: Path) -> None:
    changed_byte(run / 'bag' / 'metadata.yaml', b'message_count')


def in_scenario(run: Path) -> None:
    changed_byte(run / 'scenario.yaml', b'cells_per_side')


def in_log(run: Path) -> None:
    changed_byte(run / f'mission_{SEED}.jsonl', b'"time_s": ', last=True, behind=True)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (in_chunk, 'bag: damaged: run_bag.mcap: chunk '),
        (in_summary, 'the summary is damaged: its checksum differs'),
        (in_metadata, 'metadata.yaml: '),
        (in_scenario, 'scenario.yaml: damaged: line '),
        (in_log, f'mission_{SEED}.jsonl: event '),
    ],
)
def test_one_changed_byte_is_named(
    run_folder: Path,
    change: Callable[[Path], None],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change(run_folder)
    lines = verified(run_folder, capsys, 1)
    assert any(words in line for line in lines), lines


def test_a_message_that_was_changed_is_named_though_the_bag_has_no_checksums(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = recorded / 'bag'
    copied_without_checksums(bag, tmp_path / 'same', lambda topic, message: None)
    *missions, last = verified(tmp_path / 'same', capsys, 0)
    assert last == '3 missions: 3 proved'
    assert all('it has no checksums' in line for line in missions)

    def share_otherwise(topic: str, message: Any) -> None:  # noqa: ANN401
        if topic.endswith('/command') and len(message.bandwidth_hz):
            message.bandwidth_hz = message.bandwidth_hz * (1.0 + 1e-12)

    copied_without_checksums(bag, tmp_path / 'other', share_otherwise)
    *missions, last = verified(tmp_path / 'other', capsys, 1)
    assert last.endswith(' differs')
    assert any(': bandwidth_hz is ' in line for line in missions), missions

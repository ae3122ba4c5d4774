"""The recorder as a process: it misses nothing, whenever it starts and however it ends."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count, pairwise
from pathlib import Path
import random
import re
import resource
import signal
import time
from types import SimpleNamespace
from typing import Any

from fleets import Fleet, scenario_of
from node_starts import refusal, said_at_start
from processes import DEADLINE_S, Processes, RunningProcess, wait_until
import pytest
from rosbags.highlevel import AnyReader
from steered_world import steered_world
from uav_collect.recording.bag_reader import read_missions

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from builtin_interfaces.msg import Time
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from uav_collect.errors import BagError
from uav_collect.nodes import topics
from uav_collect.nodes.identity import WorldIdentity
from uav_collect.nodes.middleware import use_quick_discovery
from uav_collect.nodes.recorder import node
from uav_collect_msgs.msg import Epoch, Mission, Scenario

pytestmark = [pytest.mark.ros, pytest.mark.long]

N_UAVS = 2
N_LATE = 16  # of a larger fleet
PACE = 200.0  # simulated over wall-clock time: a mission takes some seconds
use_quick_discovery()


def mission_of(world_instance: str, index: int = 0) -> str:
    """The id of a world's mission."""
    return WorldIdentity(started_s=0.0, instance=world_instance).mission_id(index)


class FakeFleet:
    """Publishes on every topic of a mission, and remembers what."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('fleet', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.mission_id = mission_of('w')
        self.topics = {topic.name: topic for topic in topics.fleet_topics(N_UAVS)}
        self.publishers = {
            name: topics.publisher(self.node, topic) for name, topic in self.topics.items()
        }
        self.sent: dict[str, list[Any]] = {name: [] for name in self.topics}
        self.send('/world/scenario', Scenario(world_instance='w', n_uavs=N_UAVS))

    def send(self, name: str, message: Any) -> None:  # noqa: ANN401
        self.sent[name].append(message)
        self.publishers[name].publish(message)

    def send_event(self, number: int, *, terminal: bool = False) -> None:
        """One message on each topic of a decision; the UAVs take turns."""
        decision, index = divmod(number, N_UAVS)
        uav = index + 1
        for name in (f'/uav_{uav}/observation', f'/uav_{uav}/command', f'/uav_{uav}/radio_tx'):
            message = self.topics[name].message()
            message.stamp.sec = number
            message.mission_id = self.mission_id
            setattr(message, 'sequence' if name.endswith('tx') else 'decision', decision)
            self.send(name, message)
        epoch = Epoch(
            event=number,
            mission_id=self.mission_id,
            uav=uav,
            decision=decision,
            uav_x_m=[1.0, 2.0],
            terminal=terminal,
        )
        epoch.stamp.sec = number
        self.send('/world/epoch', epoch)

    def send_phase(self, phase: int, n_events: int = 0) -> None:
        """A mission starts, or has ended after so many events."""
        mission = Mission(mission_id=self.mission_id, phase=phase, n_decisions=n_events)
        self.send('/world/mission', mission)

    def wait_until(self, condition: Callable[[], bool]) -> None:
        wait_until(condition, meanwhile=lambda: self.executor.spin_once(timeout_sec=0.02))

    def wait_for_recorder(self) -> None:
        self.wait_until(
            lambda: all(each.get_subscription_count() for each in self.publishers.values())
        )

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def fleet(ros_domain: int) -> Iterator[FakeFleet]:
    fleet = FakeFleet()
    yield fleet
    fleet.close()


def start(processes: Processes, bag: Path, *parameters: str) -> RunningProcess:
    assigned = [word for each in parameters for word in ('-p', each)]
    recorder = processes.start('recorder', '--output', str(bag), '--ros-args', *assigned)
    recorder.wait_for(f'recording 9 topics to {bag}')
    return recorder


def recorded(bag: Path) -> dict[str, list[Any]]:
    """The messages of each topic that has any."""
    types = {topic.name: topic.message for topic in topics.fleet_topics(N_UAVS)}
    found: dict[str, list[Any]] = {}
    with AnyReader([bag]) as reader:
        for connection, _, content in reader.messages():
            message = deserialize_message(content, types[connection.topic])
            found.setdefault(connection.topic, []).append(message)
    return found


def is_heard(recorder: node.RecorderNode, uav: int) -> bool:
    """Whether a recorder subscribes to all topics of a UAV."""
    heard = {each.topic_name for each in recorder.subscriptions}
    return heard.issuperset(topic.name for topic in topics.topics_of_uav(uav))


def sent_by(fleet: FakeFleet) -> dict[str, list[Any]]:
    return {name: sent for name, sent in fleet.sent.items() if sent}


def test_every_message_is_recorded_as_it_was_sent(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    recorder = start(processes, tmp_path / 'bag')
    fleet.wait_for_recorder()
    for name, topic in fleet.topics.items():
        fleet.send(name, topic.message())
    fleet.send_phase(Mission.STARTED)
    for number in range(200):
        fleet.send_event(number)
    fleet.wait_until(lambda: all(p.wait_for_all_acked() for p in fleet.publishers.values()))
    recorder.send(signal.SIGINT)
    assert recorder.wait_for_exit() == 0
    found = recorded(tmp_path / 'bag')
    assert {**found, '/clock': []} == {**sent_by(fleet), '/clock': []}


def test_types_are_recorded_with_the_hash_and_qos_of_the_running_system(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    recorder = start(processes, tmp_path / 'bag')
    fleet.wait_for_recorder()
    recorder.send(signal.SIGINT)
    assert recorder.wait_for_exit() == 0
    with AnyReader([tmp_path / 'bag']) as reader:
        connections = {connection.topic: connection for connection in reader.connections}
        assert set(connections) == set(fleet.topics)
        for name, connection in connections.items():
            (live,) = fleet.node.get_publishers_info_by_topic(name)
            assert connection.msgtype == live.topic_type
            assert connection.digest == str(live.topic_type_hash)
            (qos,) = connection.ext.offered_qos_profiles  # type: ignore[union-attr]
            assert qos.durability.name == live.qos_profile.durability.name
            assert qos.reliability.name == live.qos_profile.reliability.name


def test_a_recorder_that_starts_late_gets_what_was_said_before(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    fleet.send_phase(Mission.STARTED)
    for number in range(500):
        fleet.send_event(number, terminal=number == 499)
    fleet.send_phase(Mission.ENDED, 500)
    recorder = start(processes, tmp_path / 'bag', 'stop_after_missions:=1')
    assert recorder.wait_for_exit() == 0
    assert recorded(tmp_path / 'bag') == sent_by(fleet)


def test_a_recorder_stops_by_itself_when_the_missions_have_ended(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    recorder = start(processes, tmp_path / 'bag', 'stop_after_missions:=2')
    fleet.wait_for_recorder()
    fleet.send_phase(Mission.STARTED)
    fleet.send_event(0)
    fleet.send_phase(Mission.ABORTED)
    fleet.mission_id = mission_of('w', 1)
    fleet.send_phase(Mission.STARTED)
    fleet.send_event(0)
    assert recorder.is_running
    recorder.send(signal.SIGSTOP)  # it waits for the event no longer than a few seconds
    fleet.send_phase(Mission.ENDED, 2)
    fleet.send_event(1, terminal=True)  # topics are not ordered against each other
    recorder.send(signal.SIGCONT)
    assert recorder.wait_for_exit() == 0
    assert recorded(tmp_path / 'bag') == sent_by(fleet)


def test_what_is_missing_is_named_in_log_and_bag_and_the_exit_status_tells(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    bag = tmp_path / 'bag'
    recorder = start(processes, bag, 'stop_after_missions:=1')
    fleet.wait_for_recorder()
    fleet.send_phase(Mission.STARTED)
    for number in range(4):
        fleet.send_event(number)
    contact = Epoch(event=4, mission_id=fleet.mission_id, uav=1, decision=2, terminal=True)
    contact.heard, contact.heard_back = [2], True
    contact.stamp.sec = 4
    fleet.send('/world/epoch', contact)
    fleet.send_phase(Mission.ENDED, 5)
    assert recorder.wait_for_exit() == 1
    metadata = ' '.join((bag / 'metadata.yaml').read_text().split())  # its lines are broken
    for topic in ('uav_1/command', 'uav_1/observation', 'uav_1/radio_rx', 'uav_2/radio_rx'):
        line = f'/{topic} lacks 1 of mission {fleet.mission_id}'
        assert f'not recorded: {line}' in recorder.output
        assert line in metadata
    assert recorded(bag) == sent_by(fleet)


def test_bytes_that_are_no_message_are_left_out_and_counted(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    recorder = start(processes, tmp_path / 'bag')
    fleet.wait_for_recorder()
    fleet.send_phase(Mission.STARTED)
    draw, mine = random.Random(7), fleet.topics['/world/epoch']
    read = [fleet.topics[f'/world/{name}'] for name in ('scenario', 'mission', 'epoch')]
    own = topics.uav_topics(1)
    read += [own.observation, own.command, own.radio_tx, own.radio_rx, own.transition]
    for number in range(300):
        for topic in read:
            damaged = bytearray(serialize_message(topic.message()))
            for _ in range(draw.randrange(1, 6)):
                damaged[draw.randrange(len(damaged))] = draw.randrange(256)
            # The middleware never acknowledges an empty one.
            content = draw.randbytes(draw.randrange(4, 100)) if number % 2 else bytes(damaged)
            fleet.publishers[topic.name].publish(content)
    for number in range(20):
        fleet.send_event(number)
    fleet.wait_until(lambda: all(p.wait_for_all_acked() for p in fleet.publishers.values()))
    recorder.send(signal.SIGINT)
    assert recorder.wait_for_exit() in (0, 1)  # some may read like missions
    assert 'Traceback' not in recorder.output
    # Every other one was random, and is no message at all; short histories may lose some.
    for topic in read:
        (n_left_out,) = re.findall(rf'left out (\d+) messages of {topic.name}:', recorder.output)
        assert int(n_left_out) > min(150, topic.qos.depth // 3)
    assert len(recorder.output) < 100_000
    with AnyReader([tmp_path / 'bag']) as reader:
        epochs = [it for it in reader.connections if it.topic == mine.name]
        contents = [content for _, _, content in reader.messages(epochs)]
    kept = []
    for content in contents:
        with suppress(Exception):  # some are damaged where the recorder does not look
            kept.append(deserialize_message(content, Epoch))
    sent = fleet.sent[mine.name]
    assert [epoch for epoch in kept if epoch in sent] == sent


def test_a_fleet_is_listened_to_one_uav_after_the_other_with_other_work_in_between(
    fleet: FakeFleet, recorder_here: node.RecorderNode
) -> None:
    fleet.wait_until(lambda: is_heard(recorder_here, N_UAVS))
    fleet.send('/world/scenario', Scenario(world_instance='w', n_uavs=N_LATE))
    n_heard: list[int] = []

    def is_whole_fleet_heard() -> bool:
        n_heard.append(len([*recorder_here.subscriptions]))
        return is_heard(recorder_here, N_LATE)

    fleet.wait_until(is_whole_fleet_heard)
    recorder_here.on_stop()
    assert max(after - before for before, after in pairwise(n_heard)) <= len(
        topics.topics_of_uav(1)
    )


def test_a_mission_takes_off_when_its_recorder_hears_everything(
    processes: Processes, tmp_path: Path
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(), folder=tmp_path / 'run')
    recorder = processes.start('recorder', '--output', str(fleet.bag))
    recorder.send(signal.SIGSTOP)
    world = fleet.start_world(recorders=1, recorder_timeout_s=DEADLINE_S)
    fleet.start_agents()
    world.wait_for('waiting for a recorder that is not there yet')
    assert fleet.n_events(0) == 0
    recorder.send(signal.SIGCONT)
    assert world.wait_for_exit() == 0
    recorder.send(signal.SIGINT)
    assert recorder.wait_for_exit() == 0, recorder.output
    (mission,) = read_missions(fleet.bag)
    assert mission.is_complete
    assert mission.n_radio_messages > 0


def test_a_mission_waits_for_recorders_no_longer_than_was_said(
    processes: Processes, tmp_path: Path
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(), folder=tmp_path / 'run')
    world = fleet.start_world(recorders=1, recorder_timeout_s=0.5, missions=2)
    fleet.start_agents()
    assert world.wait_for_exit() == 0
    lines = re.findall('a mission starts after 0.5 s without a recorder', world.output)
    assert len(lines) == 1


def test_a_world_whose_recorder_was_killed_waits_for_another_one_that_records_the_next_mission(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(1, fleet__default__energy_budget_kj=40.0)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    killed = fleet.start_recorder()
    fleet.start_agents()
    world = fleet.start_world(recorders=1, missions=-1, real_time_factor=PACE)
    world.wait_for('starts, seed')
    killed.kill()
    # Until the recorder was silent for a while, missions start that it seems to record.
    world.wait_for('waiting for a recorder that is not there yet')
    late = start(processes, tmp_path / 'late')
    waited, seed = world.wait_for(r'mission (\S+) starts, seed (\d+)').groups()
    world.wait_for(f'mission {waited} ended')
    world.send(signal.SIGINT)
    assert world.wait_for_exit() == 0
    late.send(signal.SIGINT)
    assert late.wait_for_exit() == 0, late.output
    missions = {it.log.header.mission_seed: it for it in read_missions(tmp_path / 'late')}
    assert missions[int(seed)].is_complete
    assert missions[int(seed)].log.to_jsonl() == fleet.log(int(seed))


@pytest.fixture
def recorder_here(fleet: FakeFleet, tmp_path: Path) -> Iterator[node.RecorderNode]:
    """A recorder of one mission in this process."""
    rclpy.init(args=['--ros-args', '-p', 'stop_after_missions:=1'])
    recorder = node.RecorderNode(tmp_path / 'bag')
    fleet.executor.add_node(recorder)
    fleet.wait_for_recorder()
    yield recorder
    fleet.executor.remove_node(recorder)
    recorder.destroy_node()
    rclpy.try_shutdown()


def test_a_recorder_waits_for_the_scenario_of_what_it_has_recorded(
    fleet: FakeFleet, recorder_here: node.RecorderNode, tmp_path: Path
) -> None:
    for phase in (Mission.STARTED, Mission.ABORTED):
        mission = Mission(mission_id='m', phase=phase, scenario_fingerprint='late')
        fleet.send('/world/mission', mission)
    fleet.wait_until(lambda: recorder_here._missions_left == 0)
    for _ in range(round(2.0 * node._QUIET_S / node._LOOK_PERIOD_S)):
        recorder_here._look()
    assert recorder_here.end_status is None
    fleet.send('/world/scenario', Scenario(world_instance='w', fingerprint='late'))
    fleet.wait_until(lambda: recorder_here.end_status is not None)
    recorder_here.on_stop()
    assert recorder_here.end_status == 0
    assert recorded(tmp_path / 'bag') == sent_by(fleet)


def test_a_recording_without_the_scenario_of_its_mission_says_so(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    recorder = start(processes, tmp_path / 'bag', 'stop_after_missions:=1')
    fleet.wait_for_recorder()
    for phase in (Mission.STARTED, Mission.ABORTED):
        mission = Mission(mission_id='m', phase=phase, scenario_fingerprint='never')
        fleet.send('/world/mission', mission)
    assert recorder.wait_for_exit() == 1
    recorder.wait_for('not recorded: /world/scenario lacks 1 of mission m')


def test_only_worlds_that_have_presented_themselves_move_the_clock_of_a_recording(
    fleet: FakeFleet, recorder_here: node.RecorderNode, tmp_path: Path
) -> None:
    def sent(name: str, message: Any) -> None:  # noqa: ANN401
        fleet.send(name, message)
        n_sent = sum(map(len, fleet.sent.values()))
        fleet.wait_until(lambda: recorder_here._bag.n_messages == n_sent)

    fleet.wait_until(lambda: recorder_here._n_recorded == N_UAVS)
    sent('/world/epoch', Epoch(mission_id=fleet.mission_id, event=0, stamp=Time(sec=5)))
    sent('/clock', Clock(clock=Time(sec=10**9)))
    sent('/world/epoch', Epoch(mission_id='foreign-0', event=1, stamp=Time(sec=10**9)))
    sent('/world/scenario', Scenario(world_instance='next'))
    sent('/world/epoch', Epoch(mission_id=mission_of('next'), event=2, stamp=Time(sec=1)))
    sent('/world/epoch', Epoch(mission_id=fleet.mission_id, event=3, stamp=Time(sec=7)))
    recorder_here.on_stop()
    with AnyReader([tmp_path / 'bag']) as reader:
        logged_s = {
            deserialize_message(content, Epoch).event: log_ns // 10**9
            for connection, log_ns, content in reader.messages()
            if connection.topic == '/world/epoch'
        }
    assert logged_s == {0: 5, 1: 5, 2: 6, 3: 7}


def test_a_recorder_that_is_held_up_has_not_waited(
    fleet: FakeFleet,
    recorder_here: node.RecorderNode,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fleet.send_phase(Mission.STARTED)
    fleet.send_event(0)
    fleet.send_phase(Mission.ENDED, 2)
    fleet.wait_until(lambda: recorder_here._missions_left == 0)
    later = SimpleNamespace(monotonic=lambda: time.monotonic() + 60.0, sleep=time.sleep)
    monkeypatch.setattr(node, 'time', later)
    for _ in range(3):
        recorder_here._look()
    assert recorder_here.end_status is None
    fleet.send_event(1, terminal=True)
    fleet.wait_until(lambda: recorder_here.end_status is not None)
    recorder_here.on_stop()
    assert recorder_here.end_status == 0
    assert recorded(tmp_path / 'bag') == sent_by(fleet)


def test_a_recorder_whose_last_mission_was_aborted_awaits_no_event(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    recorder = start(processes, tmp_path / 'bag', 'stop_after_missions:=1')
    fleet.wait_for_recorder()
    fleet.send_phase(Mission.STARTED)
    fleet.send_phase(Mission.ABORTED)
    assert recorder.wait_for_exit() == 0
    assert recorded(tmp_path / 'bag') == sent_by(fleet)


@pytest.mark.parametrize(
    'signals', [[signal.SIGINT], [signal.SIGINT, signal.SIGINT], [signal.SIGTERM]]
)
def test_a_signal_closes_the_bag(
    processes: Processes, fleet: FakeFleet, tmp_path: Path, signals: list[signal.Signals]
) -> None:
    recorder = start(processes, tmp_path / 'bag')
    fleet.wait_for_recorder()
    fleet.send_phase(Mission.STARTED)
    for number in range(20):
        fleet.send_event(number)
    fleet.wait_until(lambda: all(p.wait_for_all_acked() for p in fleet.publishers.values()))
    for number in signals:
        recorder.send(number)
    assert recorder.wait_for_exit() == 0
    assert 'Traceback' not in recorder.output
    recorder.wait_for(f'recorded 82 messages to {tmp_path / "bag"}')
    assert recorded(tmp_path / 'bag') == sent_by(fleet)
    assert processes.survivors() == []


def test_a_killed_recorder_loses_only_what_it_had_not_flushed(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    bag = tmp_path / 'bag'
    recorder = start(processes, bag, 'flush_period_s:=0.05')
    fleet.wait_for_recorder()
    sizes_byte: set[int] = set()
    number = 0
    while len(sizes_byte) < 20:  # so many chunks, or parts of them, are in the file
        fleet.send_event(number)
        number += 1
        fleet.executor.spin_once(timeout_sec=0.001)
        sizes_byte.add((bag / 'bag.mcap').stat().st_size)
    recorder.kill()
    with pytest.raises(FileNotFoundError):
        recorded(bag)
    repair = processes.start('recorder', '--repair', str(bag))
    assert repair.wait_for_exit() == 0
    n_repaired = int(repair.wait_for(r'holds (\d+) messages up to [\d.]+ s of simulated time')[1])
    found = recorded(bag)
    assert sum(map(len, found.values())) == n_repaired
    assert 1 < len(found['/world/epoch']) <= number
    for name, contents in found.items():
        assert contents == fleet.sent[name][: len(contents)]
    again = processes.start('recorder', '--repair', str(bag))
    assert again.wait_for_exit() == 0
    again.wait_for('nothing to repair')
    assert recorded(bag) == found


@pytest.mark.nightly
def test_of_a_mission_a_killed_recorder_keeps_the_start_and_a_late_one_records_it_all(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(fleet__default__energy_budget_kj=100.0)  # some 250 events
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    killed = fleet.start_recorder(flush_period_s=0.05)
    world = fleet.start_world(recorders=1)
    with steered_world() as steered:
        steered.pause()
        agents = fleet.start_agents('random')
        steered.step(150)
        wait_until(lambda: fleet.bag.joinpath(f'{fleet.bag.name}.mcap').stat().st_size > 50_000)
        agents[0].kill()
        killed.kill()
        late = start(processes, tmp_path / 'late', 'stop_after_missions:=1')
        wait_until(lambda: (tmp_path / 'late' / 'late.mcap').stat().st_size > 50_000)
        fleet.start_agent(1, 'random')
        steered.resume()
    assert world.wait_for_exit() == 0
    assert late.wait_for_exit() == 1  # what the dead agent had said is gone with it
    late.wait_for('not recorded: /uav_1/command lacks')
    assert '/uav_2/' not in late.output.partition('not recorded')[2]
    with pytest.raises(BagError, match='recorder --repair'):
        read_missions(fleet.bag)
    assert processes.start('recorder', '--repair', str(fleet.bag)).wait_for_exit() == 0
    (start_of_it,) = read_missions(fleet.bag)
    assert not start_of_it.is_complete
    assert len(start_of_it.log.events) > 0
    assert fleet.log(0).startswith(start_of_it.log.to_jsonl())
    (whole,) = read_missions(tmp_path / 'late')
    assert whole.is_complete
    assert whole.log.to_jsonl() == fleet.log(0)


def test_a_full_disk_ends_the_recorder_alone_and_leaves_a_readable_bag(
    processes: Processes, fleet: FakeFleet, tmp_path: Path
) -> None:
    bag = tmp_path / 'bag'
    recorder = start(processes, bag, 'chunk_byte:=400000', 'flush_period_s:=60.0')
    fleet.wait_for_recorder()
    # No file may grow beyond this: two chunks of noise fit, of 0.4 MB each, and the index.
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (1_050_000, 1_050_000))
    draw, numbers = random.Random(1), count()

    def send() -> None:
        noise = draw.randbytes(2000)
        fleet.send('/world/epoch', Epoch(event=next(numbers), uav_complete=noise))
        fleet.executor.spin_once(timeout_sec=0.001)

    wait_until(lambda: not recorder.is_running, meanwhile=send)
    assert recorder.wait_for_exit() == 1
    assert recorder.output.count('ended early') == 1
    assert 'Traceback' not in recorder.output
    found = recorded(bag)
    assert sum(map(len, found.values())) > 100
    for name, contents in found.items():
        assert contents == fleet.sent[name][: len(contents)]


def test_a_folder_that_exists_is_refused(
    ros_domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'bag').mkdir()
    assert refusal('recorder', ['--output', str(tmp_path / 'bag')], capsys) == [
        f'error: output folder {tmp_path / "bag"} exists already'
    ]


def test_a_recorder_that_cannot_start_leaves_no_folder(
    ros_domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / 'bag'
    arguments = ['--output', str(bag), '--ros-args', '-p', 'world_instance:=x']
    [line] = refusal('recorder', arguments, capsys)
    assert "world_instance is 'x': must be a UUID" in line
    assert not bag.exists()


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (['--ros-args', '-p', 'chunk_byte:=10'], 'chunk_byte out of range. Min: 1000'),
        (['--ros-args', '-p', 'chunk_byte:=big'], "'chunk_byte' to 'big'"),
        (['--ros-args', '-p', 'chunk_byte'], "override rule: '-p chunk_byte'"),
        (['--output'], 'expected one argument'),
        (['--repair', 'nowhere'], 'nowhere: no such bag'),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(
    ros_domain: int, arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    *_, line = refusal('recorder', arguments, capsys)
    assert complaint in line


def test_a_bag_that_is_being_recorded_is_not_repaired(
    processes: Processes, tmp_path: Path
) -> None:
    recorder = start(processes, tmp_path / 'bag')
    repair = processes.start('recorder', '--repair', str(tmp_path / 'bag'))
    assert repair.wait_for_exit() == 2
    repair.wait_for('still being recorded')
    recorder.send(signal.SIGINT)
    assert recorder.wait_for_exit() == 0


def test_help_describes_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    said = said_at_start('recorder', ['--help'], capsys, status=0)
    for name in ('output_dir', 'stop_after_missions', 'flush_period_s', 'chunk_byte', '--repair'):
        assert name in said

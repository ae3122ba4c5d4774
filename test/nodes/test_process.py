"""How a node's process starts, hears, and ends; and that the events executor delivers it all."""

from collections.abc import Callable, Iterator
from pathlib import Path
import signal
import sys
from typing import Any
from xml.etree import ElementTree

from processes import complaints, Processes, RunningProcess, wait_until
import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

import rclpy
from rclpy import experimental
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32, String
from uav_collect.nodes import middleware, process
from uav_collect_msgs.srv import ControlMission

pytestmark = pytest.mark.ros

middleware.use_quick_discovery()
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

PROGRAM = """
import os, signal, sys
from std_msgs.msg import String
from uav_collect.errors import NodeError
from uav_collect.nodes.process import ProcessNode, run_node

class Speaker(ProcessNode):
    def __init__(self):
        super().__init__('speaker')
        self.declare_parameter('count', 3)
        self.words = self.create_publisher(String, 'words', 10)
        self.create_timer(0.01, self.tick)
        self.ticks = 0
        {at_start}
        self.get_logger().info('up')

    def tick(self):
        self.ticks += 1
        {at_tick}

    def on_stop(self):
        self.words.publish(String(data='bye'))
        self.get_logger().info('said bye')

sys.exit(run_node(Speaker, sys.argv[1:]))
"""


def speaker(
    processes: Processes, *arguments: str, at_start: str = 'pass', at_tick: str = 'pass'
) -> RunningProcess:
    program = PROGRAM.format(at_start=at_start, at_tick=at_tick)
    return processes.run('speaker', sys.executable, '-c', program, *arguments)


@pytest.mark.parametrize(
    'signals',
    [
        [signal.SIGINT],
        [signal.SIGINT, signal.SIGINT],
        [signal.SIGTERM],
        [signal.SIGTERM, signal.SIGINT, signal.SIGINT],
    ],
)
def test_signals_end_a_node_well(processes: Processes, signals: list[signal.Signals]) -> None:
    process = speaker(processes)
    process.wait_for('up')
    for number in signals:
        process.send(number)
    assert process.wait_for_exit() == 0
    assert process.output.count('said bye') == 1
    assert 'Traceback' not in process.output


def test_a_signal_before_the_node_is_up_is_not_lost(processes: Processes) -> None:
    process = speaker(processes, at_start='os.kill(os.getpid(), signal.SIGINT)')
    assert process.wait_for_exit() == 0
    assert 'said bye' in process.output


def test_a_node_ends_with_the_status_it_asks_for(processes: Processes) -> None:
    process = speaker(processes, at_tick='self.get_logger().error("no more"); self.end(3)')
    assert process.wait_for_exit() == 3
    assert process.output.count('no more') == 1
    assert 'said bye' in process.output


def test_a_node_that_cannot_start_says_why_in_one_line(processes: Processes) -> None:
    process = speaker(processes, at_start='raise NodeError("area.side: must be > 0")')
    assert process.wait_for_exit() == 2
    assert complaints(process.output) == ['error: area.side: must be > 0']


@pytest.mark.parametrize('rule', ['count:=many', 'count'])
def test_wrong_parameters_are_refused_without_a_traceback(processes: Processes, rule: str) -> None:
    process = speaker(processes, '--ros-args', '-p', rule)
    assert process.wait_for_exit() == 2
    assert 'Traceback' not in process.output
    assert 'count' in process.output.splitlines()[-1]


def test_a_bug_is_shown_and_fails(processes: Processes) -> None:
    process = speaker(processes, at_tick='raise KeyError("a bug")')
    assert process.wait_for_exit() == 1
    assert 'Traceback' in process.output


def test_a_node_that_does_not_come_to_obey_a_signal_ends_with_a_status_of_its_own(
    processes: Processes,
) -> None:
    endless = (
        'from uav_collect.kernels import stops; stops.DEAF_S = 0.1;'
        ' self.get_logger().info("deaf"); import hashlib;'
        ' hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)'
    )
    process = speaker(processes, at_tick=endless)
    process.wait_for('deaf')
    process.send(signal.SIGTERM)
    process.wait_for('stopped in a step .* what was saved before is whole')
    assert process.wait_for_exit() == 1


def test_a_node_that_ends_is_not_ended_by_force(processes: Processes) -> None:
    own_end = (
        'from uav_collect.kernels import stops; stops.watchdog.acknowledge ='
        ' lambda: print("acknowledged", flush=True); self.end(3)'
    )
    process = speaker(processes, at_tick=own_end)
    assert process.wait_for_exit() == 3
    assert process.output.index('acknowledged') < process.output.index('said bye')


class Spinner:
    """A node and the executor that nodes get, in this process."""

    def __init__(self) -> None:
        rclpy.init()
        self.executor = process.make_executor()
        self.node = Node('tested')
        self.executor.add_node(self.node)

    def spin_until(self, condition: Callable[[], object]) -> None:
        wait_until(condition, meanwhile=lambda: self.executor.spin_once(timeout_sec=0.05))

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def spinner(ros_domain: int) -> Iterator[Spinner]:
    spinner = Spinner()
    yield spinner
    spinner.close()


def test_last_words_reach_who_listens(processes: Processes, spinner: Spinner) -> None:
    heard: list[str] = []
    spinner.node.create_subscription(
        String, 'words', lambda message: heard.append(message.data), 10
    )
    process = speaker(processes, at_tick='self.words.get_subscription_count() and self.end()')
    spinner.spin_until(lambda: heard)
    assert heard == ['bye']
    assert process.wait_for_exit() == 0


@pytest.mark.parametrize('who', ['the reader goes on', 'a second signal'])
def test_a_stopped_node_waits_for_its_readers_until_a_second_signal(
    processes: Processes, who: str
) -> None:
    reader = speaker(
        processes, at_start='self.create_subscription(String, "words", lambda _: None, 10)'
    )
    process = speaker(
        processes,
        at_start='import uav_collect.nodes.process as own; own._FLUSH_S = 1e9',
        at_tick='self.words.get_subscription_count() and self.get_logger().info("is heard")',
    )
    process.wait_for('is heard')
    reader.send(signal.SIGSTOP)
    process.send(signal.SIGINT)
    process.wait_for('said bye')
    if who == 'a second signal':
        process.send(signal.SIGINT)
    else:
        reader.send(signal.SIGCONT)
    assert process.wait_for_exit() == 0
    reader.send(signal.SIGCONT)


def test_what_a_short_lived_node_said_reaches_who_listens(
    processes: Processes, spinner: Spinner
) -> None:
    heard: list[str] = []
    spinner.node.create_subscription(
        String, 'facts', lambda message: heard.append(message.data), LATCHED
    )
    latched = 'durability=DurabilityPolicy.TRANSIENT_LOCAL'
    said = (
        'from rclpy.qos import DurabilityPolicy, QoSProfile; '
        f'facts = self.create_publisher(String, "facts", QoSProfile(depth=9, {latched})); '
        '[facts.publish(String(data=fact)) for fact in "abc"]; self.end()'
    )
    for _ in range(20):  # who is held up as long as the node lives does not hear of it
        process = speaker(processes, at_start=said)
        spinner.spin_until(lambda process=process: len(heard) == 3 or not process.is_running)
        assert process.wait_for_exit() == 0
        if heard:
            break
    spinner.spin_until(lambda: len(heard) >= 3)
    assert heard == ['a', 'b', 'c']


def test_the_events_executor_is_used_here(spinner: Spinner) -> None:
    assert not isinstance(spinner.executor, SingleThreadedExecutor)


def test_timers_fire_until_cancelled(spinner: Spinner) -> None:
    fired: list[str] = []
    once = spinner.node.create_timer(0.001, lambda: (fired.append('once'), once.cancel()))
    spinner.node.create_timer(0.002, lambda: fired.append('often'))
    spinner.spin_until(lambda: fired.count('often') >= 10)
    assert fired.count('once') == 1


def test_timers_follow_simulated_time(spinner: Spinner) -> None:
    spinner.node.set_parameters([Parameter('use_sim_time', value=True)])
    fired: list[int] = []
    spinner.node.create_timer(
        5.0, lambda: fired.append(spinner.node.get_clock().now().nanoseconds // 10**9)
    )
    clock = spinner.node.create_publisher(Clock, '/clock', 1)
    now_s = iter(range(1, 10_000))

    def advance() -> bool:
        message = Clock()
        message.clock.sec = next(now_s)
        clock.publish(message)
        return len(fired) >= 3

    spinner.spin_until(advance)
    assert fired[0] >= 5


def test_raw_latched_messages_reach_a_subscription_made_in_a_callback(spinner: Spinner) -> None:
    publisher = spinner.node.create_publisher(Int32, 'numbers', LATCHED)
    for number in range(100):
        publisher.publish(Int32(data=number))
    heard: list[bytes] = []

    def subscribe() -> None:
        timer.cancel()
        spinner.node.create_subscription(Int32, 'numbers', heard.append, LATCHED, raw=True)

    timer = spinner.node.create_timer(0.001, subscribe)
    spinner.spin_until(lambda: len(heard) == 100)
    numbers = [deserialize_message(content, Int32).data for content in heard]
    assert numbers == list(range(100))


def test_a_service_answers_a_client_of_the_same_executor(spinner: Spinner) -> None:
    def answer(request: Any, response: Any) -> Any:  # noqa: ANN401
        response.message = f'seed {request.seed}'
        return response

    spinner.node.create_service(ControlMission, 'control', answer)
    client = spinner.node.create_client(ControlMission, 'control')
    answers: list[str] = []
    spinner.spin_until(client.service_is_ready)
    call = client.call_async(ControlMission.Request(seed=7))
    call.add_done_callback(lambda done: answers.append(done.result().message))
    spinner.spin_until(lambda: answers)
    assert answers == ['seed 7']


def test_who_comes_falls_silent_and_goes_is_noticed(spinner: Spinner) -> None:
    lease = QoSProfile(
        depth=1,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Duration(seconds=2.0),
    )
    alive: list[int] = []
    matched: list[int] = []
    spinner.node.create_subscription(
        Int32,
        'numbers',
        lambda _: None,
        lease,
        event_callbacks=SubscriptionEventCallbacks(
            liveliness=lambda event: alive.append(event.alive_count),
            matched=lambda event: matched.append(event.current_count),
        ),
    )
    publisher = spinner.node.create_publisher(Int32, 'numbers', lease)
    publisher.publish(Int32())
    spinner.spin_until(lambda: alive and matched)
    spinner.node.destroy_publisher(publisher)
    spinner.spin_until(lambda: alive[-1] == 0 and matched[-1] == 0)


def test_a_killed_process_is_noticed_by_its_liveliness(
    processes: Processes, spinner: Spinner
) -> None:
    alive: list[int] = []
    lease = 'liveliness_lease_duration=Duration(seconds=1.0)'
    made = f'QoSProfile(depth=1, {lease})'
    process = speaker(
        processes,
        at_start='from rclpy.duration import Duration; from rclpy.qos import QoSProfile; '
        f'self.numbers = self.create_publisher(String, "numbers", {made})',
        at_tick='self.numbers.publish(String())',
    )
    spinner.node.create_subscription(
        String,
        'numbers',
        lambda _: None,
        QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=1.0)),
        event_callbacks=SubscriptionEventCallbacks(
            liveliness=lambda event: alive.append(event.alive_count)
        ),
    )
    spinner.spin_until(lambda: alive)
    process.kill()
    spinner.spin_until(lambda: alive[-1] == 0)


class _DoesNothing:
    def create_task(self, callback: Callable[[], None]) -> None:
        pass

    def spin_once(self, timeout_sec: float) -> None:
        pass

    def shutdown(self) -> None:
        pass


def test_an_events_executor_that_does_nothing_is_not_used(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rclpy.init()
    monkeypatch.setattr(experimental, 'EventsExecutor', _DoesNothing)
    assert isinstance(process.make_executor(), SingleThreadedExecutor)
    rclpy.try_shutdown()


def test_a_release_without_the_events_executor_gets_the_usual_one(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rclpy.init()
    monkeypatch.setitem(sys.modules, 'rclpy.experimental', None)
    assert isinstance(process.make_executor(), SingleThreadedExecutor)
    rclpy.try_shutdown()


def test_profiles_of_the_user_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', '/etc/mine.xml')
    monkeypatch.delenv('FASTDDS_DEFAULT_PROFILES_FILE', raising=False)
    middleware.use_quick_discovery()
    assert middleware.os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] == '/etc/mine.xml'
    assert 'FASTDDS_DEFAULT_PROFILES_FILE' not in middleware.os.environ


def test_who_ends_by_itself_waits_for_readers_as_long_as_they_count_as_there() -> None:
    profiles = ElementTree.parse(Path(__file__).parents[2] / 'config' / 'fastdds.xml').getroot()
    (lease,) = (it for it in profiles.iter() if it.tag.endswith('leaseDuration'))
    assert float(lease[0].text or 'nan') <= process._HANDOVER_S


def test_nodes_announce_themselves_often_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'):
        monkeypatch.delenv(name, raising=False)
    middleware.use_quick_discovery()
    file = Path(middleware.os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'])
    assert 'leaseAnnouncement' in file.read_text()

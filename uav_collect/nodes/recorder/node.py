"""The recorder: every topic of a mission, as received, into one bag."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
import math
from pathlib import Path
import re
import sys
import time
from typing import Any

from ament_index_python.packages import get_package_share_directory
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from uav_collect.errors import BagError, NodeError, RecordingError
from uav_collect.nodes.parameters import add_world_option, declare, help_text, Parameter
from uav_collect.nodes.process import FAILED, MISUSED, parse_arguments, ProcessNode, run_node
from uav_collect.nodes.topics import Topic, topics_of_uav, world_of, world_topics
from uav_collect.recording.bag_writer import BagWriter, MessageTypes
from uav_collect_msgs.msg import Epoch, Mission

_DESCRIPTION = """
Records every topic of a mission, as received, into one bag (rosbag2 layout, MCAP). Start it in any
order with the other nodes; it adds the topics of each UAV that it sees. SIGINT, SIGTERM and SIGHUP
close the bag; after anything worse, --repair makes it readable up to the last flushed chunk.
"""
_READER_DEPTH = 10_000  # messages of a topic that wait while a chunk is written
_LOOK_PERIOD_S = 0.05  # between looks for new UAVs; latched histories bridge it
_QUIET_S = 0.3  # without any message, when the last mission has ended, it was the last
_WAIT_S = 5.0  # longest wait for that: DDS repeats lost packets every 3 s

PARAMETERS = (
    Parameter(
        name='output_dir',
        default='',
        description='folder to create for the bag; if empty, named by the time',
    ),
    Parameter(
        name='stop_after_missions',
        default=0,
        description='close the bag and exit when so many missions have ended; 0: never',
        low=0,
        high=1_000_000,
    ),
    Parameter(
        name='flush_period_s',
        default=1.0,
        description='longest time [s] of which messages are lost if the recorder is killed',
        low=0.05,
        high=60.0,
    ),
    Parameter(
        name='chunk_byte',
        default=1_000_000,
        description='size [byte] of messages that are written without waiting for that',
        low=1_000,
        high=1_000_000,
    ),
)


class RecorderNode(ProcessNode):
    """Subscribes to all topics and hands what comes to the bag, in chunks."""

    def __init__(self, output: Path | None, world: str = '') -> None:
        """Open the bag and subscribe.

        Args:
            output: folder to create; None for the parameter `output_dir`.
            world: name of the world to record; empty for that without a name.
        """
        super().__init__('recorder', namespace=world)
        self._world = world_topics(world_of(self.get_namespace()))
        self._uav_topic = re.compile(rf'{self._world.namespace}/uav_([1-9]\d?)/\w+')
        declare(self, PARAMETERS)
        self._bag = self._open(output)
        self._missions_left = self._value('stop_after_missions') or math.inf
        self._ended_s = math.inf  # when the last mission to record has ended
        self._unfinished = ''  # that mission, while its last event is not here
        self._last_epoch = b''
        self._heard_s = 0.0  # when the last message came that is not just the clock
        self._uavs: set[int] = set()
        fleet_wide = self._world.recorded()
        for topic in fleet_wide:
            self._record(topic)
        # Wall time, whatever the simulated clock does.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self._value('flush_period_s'), self._flush, clock=steady)
        self.create_timer(_LOOK_PERIOD_S, self._look_for_uavs, clock=steady)
        self.get_logger().info(f'recording {len(fleet_wide)} topics to {self._bag.folder}')

    def on_stop(self) -> None:
        """Close the bag."""
        self._write(self._bag.close)
        self.get_logger().info(f'recorded {self._bag.n_messages} messages to {self._bag.folder}')

    def _open(self, output: Path | None) -> BagWriter:
        named = self._value('output_dir') or time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S')
        types = MessageTypes(_definition_text)
        try:
            return BagWriter(output or Path(named), types, chunk_byte=self._value('chunk_byte'))
        except RecordingError as error:
            raise NodeError(str(error)) from error

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _record(self, topic: Topic) -> None:
        """Subscribe to a topic, and keep what comes in the bag."""
        stored = self._bag.add_topic(topic.name, topic.type_name, _rosbag_qos(topic.qos))
        world = self._world
        own = {
            world.clock.name: self._keep,
            world.mission.name: self._on_mission,
            world.epoch.name: self._on_epoch,
        }
        on_message = own.get(topic.name, self._on_message)
        self.create_subscription(
            topic.message,
            topic.name,
            partial(on_message, stored),
            _reader_qos(topic.qos),
            raw=True,
        )

    def _keep(self, stored: Connection, message: bytes) -> None:
        if self.end_status is None:
            self._write(partial(self._bag.write, stored, time.time_ns(), message))

    def _on_message(self, stored: Connection, message: bytes) -> None:
        self._heard_s = time.monotonic()
        self._keep(stored, message)

    def _on_epoch(self, stored: Connection, message: bytes) -> None:
        self._last_epoch = message
        self._on_message(stored, message)

    def _on_mission(self, stored: Connection, message: bytes) -> None:
        self._on_message(stored, message)
        mission = deserialize_message(message, Mission)
        if mission.phase != Mission.STARTED:
            self._missions_left -= 1
            if self._missions_left == 0:
                self._ended_s = time.monotonic()
                self._unfinished = mission.mission_id if mission.phase == Mission.ENDED else ''

    def _flush(self) -> None:
        self._write(self._bag.flush)

    def _look_for_uavs(self) -> None:
        """Record new UAVs; stop when the last mission has ended and its messages are here."""
        seen = (self._uav_topic.fullmatch(name) for name, _ in self.get_topic_names_and_types())
        for uav in sorted({int(match[1]) for match in seen if match} - self._uavs):
            self._uavs.add(uav)
            for topic in topics_of_uav(uav, self._world.namespace):
                self._record(topic)
            self.get_logger().info(f'recording UAV {uav}')
        if self._ended_s < math.inf:
            self._stop_when_quiet()

    def _stop_when_quiet(self) -> None:
        """The end of a mission may overtake its events; each topic by itself is in order."""
        if self._unfinished and self._last_epoch:
            epoch = deserialize_message(self._last_epoch, Epoch)
            if epoch.terminal and epoch.mission_id == self._unfinished:
                self._unfinished = ''
        now_s = time.monotonic()
        is_quiet = now_s - max(self._heard_s, self._ended_s) > _QUIET_S
        if (is_quiet and not self._unfinished) or now_s - self._ended_s > _WAIT_S:
            self.end()

    def _write(self, write: Callable[[], None]) -> None:
        """Write; end the process, but nothing else, when the disk does not take it."""
        try:
            write()
        except RecordingError as error:
            self.get_logger().error(str(error))
            self.end(FAILED)


def main(argv: Sequence[str]) -> int:
    """Record, or repair a bag; the exit status.

    Args:
        argv: what follows the program's name on the command line.
    """
    arguments = parse_arguments(_parser(), argv)
    if arguments.repair is not None:
        return _repair(arguments.repair)
    return run_node(lambda: RecorderNode(arguments.output, arguments.world), argv)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='recorder',
        description=_DESCRIPTION,
        epilog=help_text(PARAMETERS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--output', type=Path, metavar='DIR', help='folder to create for the bag')
    add_world_option(parser)
    parser.add_argument('--repair', type=Path, metavar='BAG', help='make a bag readable, and exit')
    return parser


def _repair(bag: Path) -> int:
    from uav_collect.recording.bag_repair import repair

    try:
        done = repair(bag)
    except BagError as error:
        sys.stderr.write(f'error: {error}\n')
        return MISUSED
    except OSError as error:
        sys.stderr.write(f'error: {bag}: cannot be repaired: {error}\n')
        return FAILED
    time_s = done.last_sim_time_s
    until = '' if time_s is None else f' up to {time_s:.3f} s of simulated time'
    sys.stdout.write(f'{bag}: holds {done.n_messages} messages{until}\n')
    if done.broken_file is None:
        sys.stdout.write('nothing to repair\n')
    else:
        sys.stdout.write(
            f'left out {done.n_cut_byte} bytes of a broken chunk; kept {done.broken_file}\n'
        )
    return 0


def _definition_text(type_name: str) -> str:
    package, _, name = type_name.split('/')
    return Path(get_package_share_directory(package), 'msg', f'{name}.msg').read_text()


def _reader_qos(offered: QoSProfile) -> QoSProfile:
    """Take everything that is offered, however long a chunk takes to write."""
    return QoSProfile(
        depth=max(offered.depth, _READER_DEPTH),
        reliability=offered.reliability,
        durability=offered.durability,
    )


def _rosbag_qos(offered: QoSProfile) -> Qos:
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=offered.depth,
        reliability=QosReliability[offered.reliability.name],
        durability=QosDurability[offered.durability.name],
        deadline=QosTime(0, 0),
        lifespan=QosTime(0, 0),
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=QosTime(
            *divmod(offered.liveliness_lease_duration.nanoseconds, 1_000_000_000)
        ),
        avoid_ros_namespace_conventions=False,
    )

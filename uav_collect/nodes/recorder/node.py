"""The recorder: every topic of a mission, as received, into one bag."""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
import math
from pathlib import Path
import time
from typing import Any

from ament_index_python.packages import get_package_share_directory
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from uav_collect.config.arguments import Parser
from uav_collect.errors import NodeError, RecordingError, UnreadableError
from uav_collect.ingest.from_messages import converter_for
from uav_collect.limits import FAILED, MAX_UAVS, RECORDED
from uav_collect.lockstep.seals import Checker
from uav_collect.nodes.identity import short_instance
from uav_collect.nodes.parameters import (
    add_world_option,
    declare,
    help_text,
    Parameter,
    WORLD_INSTANCE,
    world_instance_of,
    wrapped,
)
from uav_collect.nodes.process import parse_arguments, ProcessNode, run_node
from uav_collect.nodes.recorder.own_world import OwnWorld
from uav_collect.nodes.recorder.status import StatusPublisher
from uav_collect.nodes.sealing import warn_of
from uav_collect.nodes.topics import (
    checker,
    is_learned_from,
    patient_qos,
    Topic,
    topics_of_uav,
    world_of,
    world_topics,
)
from uav_collect.recording.bag_writer import BagWriter, MessageTypes
from uav_collect.recording.completeness import Completeness, Lack, Taken
from uav_collect.recording.log_times import LogTimes, StampReader
from uav_collect.recording.message_heads import HeadReader
from uav_collect.recording.origin import CHOICE_KEY, ORIGIN_KEY, origin_text

_DESCRIPTION = """
Records every topic of a mission, as received, into one bag (rosbag2 layout, MCAP), in simulated
time: messages are logged at their stamps, those without at what the clock shows, so that a mission
of any speed is replayed at any pace. Of the clock one message is kept for each event. Start it in
any order with the other nodes; it adds the topics of each UAV of the scenario. SIGINT, SIGTERM and
SIGHUP close the bag; after anything worse, --repair makes it readable up to its last whole chunk.
What events of missions tell of and the bag lacks is named at the end; the exit status is then 1.
With a key, what has no valid seal is left out.
"""
_READER_DEPTH = 10_000  # messages of a topic that wait while a chunk is written
_LOOK_PERIOD_S = 0.05  # between looks for publishers that are not heard yet
_DRAIN_LOOK_S = _LOOK_PERIOD_S / 10  # between looks for what is still to come
_MOST_WORLDS = 64  # that a status names: worlds that are gone, and bags played back, count, too
_SCENARIO_FIELDS = ('world_instance', 'fingerprint', 'n_uavs')
_MISSION_FIELDS = ('mission_id', 'scenario_fingerprint')
_MOST_SCENARIOS = 64  # that missions name and nobody has told
_DRAIN_S = 3.0  # longest wait, when it is stopped, for what was published before
_SILENT_S = 1.0  # the same without any message
_QUIET_S = 0.3  # without any message, when the last mission has ended, it was the last
_WAIT_S = 5.0  # longest wait for that; without any, nothing more will come: DDS repeats every 3 s
_MOST_WAIT_S = 30.0  # longest wait for what is missing while other messages come

Taker = Callable[[bytes], Taken | None]  # takes note of a message, and may refuse it

PARAMETERS = (
    Parameter(
        name='output_dir',
        default='',
        description='folder to create for the bag; if empty, named by the time',
    ),
    Parameter(
        name='topics',
        default=RECORDED[0],
        description='what to record: all topics, or those for learning, which trainer --from-bag'
        ' reads: missions, events, transitions, scenario and policies',
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
    Parameter(
        name='choice',
        default='',
        description='who flies and why, for the metadata of the bag; empty: nobody was chosen',
    ),
    WORLD_INSTANCE,
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
        self._names = names = world_topics(world_of(self.get_namespace()))
        declare(self, PARAMETERS)
        self._takes_all = self._checked_choice() == RECORDED[0]
        instance = world_instance_of(self)
        types = MessageTypes(_definition_text)
        self._bag = self._open(output, types)
        self._scenarios = HeadReader(names.scenario.type_name, _SCENARIO_FIELDS, types.fields)
        self._scenario_of = HeadReader(names.mission.type_name, _MISSION_FIELDS, types.fields)
        self._fingerprints: set[str] = set()  # of scenarios that are recorded
        self._unexplained: dict[str, str] = {}  # a mission of each that is not, by fingerprint
        self._completeness = Completeness(types.fields, names.namespace)
        self._types, self._log_times = types, LogTimes()
        self._missions_left = self._value('stop_after_missions') or math.inf
        # By looks, between which it takes what there is: one that is held up has not waited.
        self._now_s = 0.0
        self._ended_s = math.inf  # when the last mission to record has ended
        self._heard_s = 0.0  # when the last message came that is not just the clock
        self._worlds: dict[str, str] = {}  # scenario by world instance, the latest last
        self._n_uavs = 0  # to record
        self._n_recorded = 0  # that are listened to
        self._listeners: dict[str, Subscription] = {}  # by topic
        self._n_unreadable: Counter[str] = Counter()  # messages by topic
        self._n_unsealed: Counter[str] = Counter()  # the same
        self._n_foreign: Counter[str] = Counter()  # the same, of other worlds
        self._own = OwnWorld(instance, types.fields) if instance else None
        # Samples do not say whose they are: once the own world is there, it is the only one.
        for topic in [names.scenario] if instance else filter(self._is_wanted, names.recorded()):
            self._record(topic)
        self._status = StatusPublisher(self, names.recorder, self._bag.folder)
        # Wall time, whatever the simulated clock does.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self._value('flush_period_s'), self._flush, clock=steady)
        self.create_timer(_LOOK_PERIOD_S, self._look, clock=steady)
        self.get_logger().info(f'recording {len(self._listeners)} topics to {self._bag.folder}')

    def on_stop(self) -> None:
        """Take what has come already, say what is missing, and close the bag."""
        if not self.end_status:
            self._completeness.freeze()
            self._drain()
            self._name_gaps()
        self._write(self._bag.close)
        self.get_logger().info(f'recorded {self._bag.n_messages} messages to {self._bag.folder}')

    def _name_gaps(self) -> None:
        for topic, n_messages in self._n_unreadable.items():
            self._bag.remark(f'left out of {topic}', f'{n_messages} messages that are none')
            self.get_logger().warning(f'left out {n_messages} messages of {topic}: they are none')
        for topic, n_messages in self._n_foreign.items():
            self._bag.remark(f'left out as foreign of {topic}', f'{n_messages} of other worlds')
        for topic, n_messages in self._n_unsealed.items():
            self._bag.remark(f'refused on {topic}', f'{n_messages} messages without a valid seal')
        lacks = self._lacks()
        for lack in lacks:
            self._bag.remark(f'missing of {lack.topic}', str(lack))
            self.get_logger().error(f'not recorded: {lack}')
        if lacks:
            self.end_status = FAILED

    def _open(self, output: Path | None, types: MessageTypes) -> BagWriter:
        named = self._value('output_dir') or time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S')
        try:
            bag = BagWriter(output or Path(named), types, chunk_byte=self._value('chunk_byte'))
        except RecordingError as error:
            raise NodeError(str(error)) from error
        bag.remark(ORIGIN_KEY, origin_text())
        if choice := self._value('choice'):
            bag.remark(CHOICE_KEY, choice)
        return bag

    def _checked_choice(self) -> str:
        chosen: str = self._value('topics')
        if chosen not in RECORDED:
            raise NodeError(f'topics is {chosen!r}: must be {" or ".join(RECORDED)}')
        return chosen

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _is_wanted(self, topic: Topic) -> bool:
        return self._takes_all or is_learned_from(topic)

    def _lacks(self) -> list[Lack]:
        """What is missing of the topics that are recorded."""
        lacks = self._completeness.lacks()
        wanted = [it for it in lacks if self._takes_all or converter_for(it.topic) is not None]
        if self._unexplained:
            number, mission_id = len(self._unexplained), next(iter(self._unexplained.values()))
            wanted.append(Lack(self._names.scenario.name, number, number, mission_id))
        return wanted

    def _record(self, topic: Topic) -> None:
        """Subscribe to a topic, and keep what comes in the bag."""
        stored = self._bag.add_topic(topic.name, topic.type_name, _rosbag_qos(topic.qos))
        take: Taker | None = self._completeness.taker(topic.name)
        if topic == self._names.scenario:
            take = self._take_scenario
        if topic == self._names.mission:
            take = partial(self._take_mission, take)
        if self._own is not None:
            self._own.add_topic(topic)
        stamps = StampReader(topic.type_name, self._types.fields)
        on_message = partial(self._on_message, stored, stamps, take, checker(self, topic))
        if topic == self._names.clock:
            on_message = partial(self._on_clock, stored, stamps)
        self._listeners[topic.name] = self.create_subscription(
            topic.message,
            topic.name,
            on_message,
            patient_qos(topic.qos, _READER_DEPTH),
            raw=True,
        )

    def _on_clock(self, stored: Connection, stamps: StampReader, message: bytes) -> None:
        """Keep the clock, but no more of it than of events: there may be thousands between two."""
        log_ns = self._log_times.log_ns(stored.topic, stored.msgtype, stamps.read_ns(message))
        if self.end_status is None and self._log_times.keeps_clock():
            self._write(partial(self._bag.write, stored, log_ns, message))

    def _on_message(
        self,
        stored: Connection,
        stamps: StampReader,
        take: Taker | None,
        seals: Checker | None,
        message: bytes,
    ) -> None:
        """Keep a message; bytes that are none are left out, so that whoever reads the bag can."""
        self._heard_s = self._now_s
        why = None if seals is None else seals.refusal(message)
        if why is not None:
            self._n_unsealed[stored.topic] += 1
            warn_of(self, f'{stored.topic}: a message', why)
            return
        try:
            if self._own is not None and not self._own.has_sent(stored.topic, message):
                self._n_foreign[stored.topic] += 1
                self.warn('other world', f'{stored.topic}: left out what is of another world')
                return
            taken = None if take is None else take(message)
        except UnreadableError as error:
            self._n_unreadable[stored.topic] += 1
            self.warn('no message', f'{stored.topic}: {error}')
            return
        mission_id = '' if taken is None else taken.mission_id
        log_ns = self._log_times.log_ns(
            stored.topic, stored.msgtype, stamps.read_ns(message), mission_id
        )
        if self.end_status is None:
            self._write(partial(self._bag.write, stored, log_ns, message))
        if stored.topic in (self._names.epoch.name, self._names.mission.name):
            self._log_times.note_event()
        if taken is not None and taken.has_ended:
            self._missions_left -= 1
            if self._missions_left == 0:
                self._ended_s = self._now_s

    def _take_mission(self, take: Taker | None, message: bytes) -> Taken | None:
        """Note what a mission says, and that it cannot be read without its scenario."""
        mission_id, scenario_fingerprint = self._scenario_of.read(message)
        is_known = scenario_fingerprint in ('', *self._fingerprints)
        if not is_known and len(self._unexplained) < _MOST_SCENARIOS:
            self._unexplained.setdefault(scenario_fingerprint, mission_id)
        return None if take is None else take(message)

    def _take_scenario(self, message: bytes) -> None:
        """Record the fleet of a world."""
        world_instance, scenario_fingerprint, n_uavs = self._scenarios.read(message)
        self._fingerprints.add(scenario_fingerprint)
        self._unexplained.pop(scenario_fingerprint, None)
        self._log_times.begin_world(short_instance(world_instance))
        self._worlds.pop(world_instance, None)
        self._worlds[world_instance] = scenario_fingerprint
        if len(self._worlds) > _MOST_WORLDS:
            del self._worlds[next(iter(self._worlds))]
        for topic in filter(self._is_wanted, self._names.recorded()):
            if topic.name not in self._listeners:
                self._record(topic)
        if (n_uavs := min(n_uavs, MAX_UAVS)) > self._n_uavs:
            is_under_way = self._n_recorded < self._n_uavs
            self._n_uavs = n_uavs
            if not is_under_way:
                self._record_next_uav()

    def _record_next_uav(self) -> None:
        """Record one more UAV, and the next one after what else is due: that may be a signal."""
        self._n_recorded += 1
        own = topics_of_uav(self._n_recorded, self._names.namespace)
        for topic in filter(self._is_wanted, own):
            self._record(topic)
        self.get_logger().info(f'recording UAV {self._n_recorded}')
        if self._n_recorded < self._n_uavs and self.executor is not None:
            self.executor.create_task(self._record_next_uav)

    def _is_heard(self, topic: Topic) -> bool:
        listener = self._listeners.get(topic.name)
        return listener is not None and listener.get_publisher_count() > 0

    def _flush(self) -> None:
        self._write(self._bag.flush)

    def _look(self) -> None:
        """Say what is not heard; stop when the last mission has ended and all of it is here."""
        awaited = filter(self._is_wanted, self._names.awaited(range(1, self._n_uavs + 1)))
        if self._own is None or self._worlds:  # other worlds do not wait for it
            silent = [it.name for it in awaited if not self._is_heard(it)]
            self._status.publish(self._worlds, silent)
        self._now_s += _LOOK_PERIOD_S
        since_end_s, quiet_s = self._now_s - self._ended_s, self._now_s - self._heard_s
        if since_end_s < _QUIET_S or (quiet_s < _QUIET_S and since_end_s < _WAIT_S):
            return
        # The end of a mission may overtake its messages: topics are not ordered.
        is_hopeless = quiet_s > _WAIT_S or since_end_s > _MOST_WAIT_S
        if is_hopeless or not self._lacks():
            self.end()

    def _drain(self) -> None:
        """Take what the middleware has, and wait a moment for what it is still to get.

        A world that was stopped just now aborts its mission; of what is missing, more may come.
        """
        begun_s = self._now_s
        while self.end_status is None:
            for listener in [*self._listeners.values()]:  # a scenario brings the first UAV's
                self._take_some(listener)
            is_silent = self._now_s - max(begun_s, self._heard_s) > _SILENT_S
            patience_s = _DRAIN_S if self._lacks() else _QUIET_S
            if is_silent or self._now_s - begun_s > patience_s:
                return
            time.sleep(_DRAIN_LOOK_S)
            self._now_s += _DRAIN_LOOK_S

    @staticmethod
    def _take_some(listener: Subscription) -> None:
        with listener.handle:
            for _ in range(_READER_DEPTH):
                taken = listener.handle.take_message(listener.msg_type, listener.raw)
                if taken is None:
                    return
                listener.callback(taken[0])

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
        from uav_collect.nodes.recorder.repairing import repair_bag

        return repair_bag(arguments.repair)
    return run_node(lambda: RecorderNode(arguments.output, arguments.world), argv)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog='recorder',
        description=wrapped(_DESCRIPTION),
        epilog=help_text(PARAMETERS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--output', type=Path, metavar='DIR', help='folder to create for the bag')
    add_world_option(parser)
    parser.add_argument('--repair', type=Path, metavar='BAG', help='make a bag readable, and exit')
    return parser


def _definition_text(type_name: str) -> str:
    package, _, name = type_name.split('/')
    return Path(get_package_share_directory(package), 'msg', f'{name}.msg').read_text()


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

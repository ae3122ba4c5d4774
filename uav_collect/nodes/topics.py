"""Every topic and service of a mission: name, type and quality of service, in one table.

Lockstep must never lose a message, so all that a mission needs is reliable, with a history deeper
than any reader lags behind (keep-all would block the writer of a slow reader instead). The
history is latched too: no first message is lost to a reader that is matched a moment later, and
a recorder may start late. The price: whoever starts late also gets messages of the past, which
are known by their `mission_id` and `decision`.

A silent death is a liveliness event on `command` (of an agent), `scenario` (of the world) or
`policy` (of the trainer).

Worlds that share a ROS domain have a namespace each, which stands before all their names; the
trainer and diagnostics are common to them. The constants here are the names without a namespace.
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, NavSatFix
from tf2_msgs.msg import TFMessage
from uav_collect.lockstep.seals import Checker, Signer
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.sealing import has_seal, SealedPublisher, warn_of
from uav_collect_msgs.msg import (
    Command,
    Epoch,
    Mission,
    Observation,
    Policy,
    RadioMessage,
    RecorderStatus,
    Refusal,
    Scenario,
    Transition,
)
from visualization_msgs.msg import MarkerArray

JOIN_SERVICE = '/world/join'
CONTROL_SERVICE = '/world/control'
INJECT_SERVICE = '/world/inject'
FLY_MISSION_ACTION = '/world/fly_mission'

LIVELINESS_LEASE_S = 2.0  # how long a death goes unnoticed; shorter, load looks like death

_LATCHED = DurabilityPolicy.TRANSIENT_LOCAL
_NOTICED = {
    'liveliness': LivelinessPolicy.AUTOMATIC,
    'liveliness_lease_duration': Duration(seconds=LIVELINESS_LEASE_S),
}

# A reader keeps this many of all worlds together: with one, of two worlds it may miss the first.
_WORLD = QoSProfile(depth=10, durability=_LATCHED, **_NOTICED)
_MISSIONS = QoSProfile(depth=200, durability=_LATCHED)  # about as many as the histories below hold
_EVENTS = QoSProfile(depth=10_000, durability=_LATCHED)
_TO_UAV = QoSProfile(depth=3_000, durability=_LATCHED)
_FROM_UAV = QoSProfile(depth=3_000, durability=_LATCHED, **_NOTICED)
_LEARNED = QoSProfile(depth=4, durability=_LATCHED, **_NOTICED)
_LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_REPORTS = QoSProfile(depth=10)
# Of missions as fast as can be a recorder may lag behind by thousands of samples.
_SAMPLES = QoSProfile(depth=2_000, durability=_LATCHED)
_PICTURES = QoSProfile(depth=100, durability=_LATCHED)
_STATUS = QoSProfile(depth=10, durability=_LATCHED)

_MOST_BYTES = 64_000_000  # of a message; the largest, a policy, takes one or two millions


@dataclass(frozen=True, kw_only=True)
class Topic:
    """One topic: its full name, the class of its messages, and how they are delivered."""

    name: str
    message: Any
    qos: QoSProfile

    @property
    def type_name(self) -> str:
        """The type as ROS writes it, such as `uav_collect_msgs/msg/Epoch`."""
        package: str = self.message.__module__.partition('.')[0]
        return f'{package}/msg/{self.message.__name__}'

    def within(self, namespace: str) -> 'Topic':
        """The topic below a namespace, '' or such as '/a'."""
        return replace(self, name=f'{namespace}{self.name}')


@dataclass(frozen=True, kw_only=True)
class UavTopics:
    """The topics between one UAV's agent, the world and learners."""

    observation: Topic  # world -> agent
    command: Topic  # agent -> world
    radio_tx: Topic  # agent -> world
    radio_rx: Topic  # world -> agent
    refusal: Topic  # world -> agent
    transition: Topic  # agent -> learner
    odometry: Topic  # world -> viewers, these four
    path: Topic
    battery: Topic
    fix: Topic  # where the scenario knows latitude and longitude


CLOCK = Topic(name='/clock', message=Clock, qos=_LATEST)
SCENARIO = Topic(name='/world/scenario', message=Scenario, qos=_WORLD)
MISSION = Topic(name='/world/mission', message=Mission, qos=_MISSIONS)
EPOCH = Topic(name='/world/epoch', message=Epoch, qos=_EVENTS)
MARKERS = Topic(name='/world/markers', message=MarkerArray, qos=_PICTURES)
COMPLETED_CELLS = Topic(name='/world/completed_cells', message=OccupancyGrid, qos=_PICTURES)
TF = Topic(name='/tf', message=TFMessage, qos=_SAMPLES)
DIAGNOSTICS = Topic(name='/diagnostics', message=DiagnosticArray, qos=_REPORTS)

# Beside the latest word of each recorder, those before it matter to nobody.
RECORDER = Topic(name='/world/recorder', message=RecorderStatus, qos=_STATUS)
POLICY = Topic(name='/trainer/policy', message=Policy, qos=_LEARNED)


@dataclass(frozen=True, kw_only=True)
class WorldTopics:
    """The names of one world and its fleet."""

    namespace: str  # '', or such as '/a'
    clock: Topic
    scenario: Topic
    mission: Topic
    epoch: Topic
    markers: Topic
    completed_cells: Topic
    tf: Topic
    recorder: Topic  # recorders -> world
    join_service: str
    control_service: str
    inject_service: str
    fly_mission: str  # action
    vouch_prefix: str  # before a digest of a world's instance: each world has its own

    def uav(self, uav: int) -> UavTopics:
        """The topics of the UAV with an id, from 1."""
        return uav_topics(uav, self.namespace)

    def recorded(self) -> tuple[Topic, ...]:
        """All topics but those of UAVs, with those that worlds share."""
        own = (self.clock, self.scenario, self.mission, self.epoch)
        return (*own, self.markers, self.completed_cells, self.tf, DIAGNOSTICS, POLICY)

    def awaited(self, uavs: Iterable[int]) -> tuple[Topic, ...]:
        """The topics that somebody publishes in every mission of a fleet, by ids of its UAVs."""
        shared = [topic for topic in self.recorded() if topic != POLICY]
        own = [self.uav(uav) for uav in uavs]
        parts = [
            *((it.observation, it.radio_rx, it.refusal, it.command, it.radio_tx) for it in own),
            *((it.odometry, it.path, it.battery, it.fix) for it in own),
        ]
        return (*shared, *(topic for part in parts for topic in part))


def world_topics(namespace: str = '') -> WorldTopics:
    """The topics of the world in a namespace, '' or such as '/a'."""
    return WorldTopics(
        namespace=namespace,
        clock=CLOCK.within(namespace),
        scenario=SCENARIO.within(namespace),
        mission=MISSION.within(namespace),
        epoch=EPOCH.within(namespace),
        markers=MARKERS.within(namespace),
        completed_cells=COMPLETED_CELLS.within(namespace),
        tf=TF.within(namespace),
        recorder=RECORDER.within(namespace),
        join_service=f'{namespace}{JOIN_SERVICE}',
        control_service=f'{namespace}{CONTROL_SERVICE}',
        inject_service=f'{namespace}{INJECT_SERVICE}',
        fly_mission=f'{namespace}{FLY_MISSION_ACTION}',
        vouch_prefix=f'{namespace}/world/vouch_',
    )


def world_of(node_namespace: str, uav: int = 0) -> str:
    """The namespace of the world that a node belongs to.

    Args:
        node_namespace: the node's own; an agent's may end with its UAV, as '/a/uav_1' does.
        uav: id of the agent's UAV; 0 for other nodes.
    """
    namespace = node_namespace.rstrip('/')
    return namespace.removesuffix(f'/uav_{uav}') if uav else namespace


def uav_topics(uav: int, namespace: str = '') -> UavTopics:
    """The topics of the UAV with an id, from 1, in the world of a namespace."""
    own = f'{namespace}/uav_{uav}'
    return UavTopics(
        observation=Topic(name=f'{own}/observation', message=Observation, qos=_TO_UAV),
        command=Topic(name=f'{own}/command', message=Command, qos=_FROM_UAV),
        radio_tx=Topic(name=f'{own}/radio_tx', message=RadioMessage, qos=_FROM_UAV),
        radio_rx=Topic(name=f'{own}/radio_rx', message=RadioMessage, qos=_TO_UAV),
        refusal=Topic(name=f'{own}/refusal', message=Refusal, qos=_REPORTS),
        transition=Topic(name=f'{own}/transition', message=Transition, qos=_FROM_UAV),
        odometry=Topic(name=f'{own}/odometry', message=Odometry, qos=_SAMPLES),
        path=Topic(name=f'{own}/path', message=Path, qos=_PICTURES),
        battery=Topic(name=f'{own}/battery', message=BatteryState, qos=_SAMPLES),
        fix=Topic(name=f'{own}/fix', message=NavSatFix, qos=_SAMPLES),
    )


def topics_of_uav(uav: int, namespace: str = '') -> tuple[Topic, ...]:
    """All topics of one UAV."""
    topics = uav_topics(uav, namespace)
    return tuple(getattr(topics, field.name) for field in fields(topics))


def fleet_topics(n_uavs: int, namespace: str = '') -> tuple[Topic, ...]:
    """Every topic of a mission with this many UAVs: what a recording holds."""
    own = [topic for uav in range(1, n_uavs + 1) for topic in topics_of_uav(uav, namespace)]
    return (*world_topics(namespace).recorded(), *own)


def is_learned_from(topic: Topic) -> bool:
    """Whether a learner needs what is on a topic, to learn from it or to know what flew."""
    return topic.message in (Scenario, Mission, Epoch, Transition, Policy)


def patient_qos(offered: QoSProfile, depth: int) -> QoSProfile:
    """How to take everything that is offered, however busy the reader is.

    Args:
        depth: messages that may wait, if not more are offered.
    """
    return QoSProfile(
        depth=max(offered.depth, depth),
        reliability=offered.reliability,
        durability=offered.durability,
    )


def latest_only(topic: Topic) -> Topic:
    """The topic for a publisher of which nobody is to hear late what it has taken back."""
    qos = topic.qos
    return replace(
        topic,
        qos=QoSProfile(
            depth=1,
            reliability=qos.reliability,
            durability=qos.durability,
            liveliness=qos.liveliness,
            liveliness_lease_duration=qos.liveliness_lease_duration,
        ),
    )


def publisher(node: Node, topic: Topic) -> Publisher:
    """A publisher on a topic of the table; that of a node with a secret seals its messages."""
    secret = node.secret if isinstance(node, ProcessNode) else None
    if secret is None or not has_seal(topic.message):
        return node.create_publisher(topic.message, topic.name, topic.qos)
    sealed = node.create_publisher(
        topic.message, topic.name, topic.qos, publisher_class=SealedPublisher
    )
    sealed.signer = Signer(secret, topic.name)
    return sealed


def checker(node: ProcessNode, topic: Topic) -> Checker | None:
    """What checks the messages that a node gets on a topic; None if none is to be checked."""
    if node.secret is None or not has_seal(topic.message):
        return None
    return Checker(node.secret, topic.name)


def subscription(
    node: ProcessNode,
    topic: Topic,
    callback: Callable[[Any], None],
    *,
    qos: QoSProfile | None = None,
    on_event: SubscriptionEventCallbacks | None = None,
) -> Subscription:
    """A subscription to a topic of the table.

    Args:
        node: that listens.
        topic: to listen to.
        callback: gets each message.
        qos: how to listen; None: as the table says.
        on_event: what to do when a publisher comes, goes or falls silent.
    """
    # Raw: rclpy raises in its executor, where nobody can catch it, when bytes are no message.
    return node.create_subscription(
        topic.message,
        topic.name,
        partial(_receive, node, topic, callback, checker(node, topic)),
        topic.qos if qos is None else qos,
        event_callbacks=on_event,
        raw=True,
    )


def _receive(
    node: ProcessNode,
    topic: Topic,
    callback: Callable[[Any], None],
    seals: Checker | None,
    content: bytes,
) -> None:
    """Hand a message on, or refuse what is none, or comes from who has not the node's secret."""
    why = None if seals is None else seals.refusal(content)
    if why is not None:
        warn_of(node, f'{topic.name}: a message', why)
        return
    msg = None
    with suppress(Exception):  # the middleware's errors have no class that is public
        if len(content) <= _MOST_BYTES:
            msg = deserialize_message(content, topic.message)
    if msg is None:
        node.warn('no message', f'{topic.name}: {len(content)} bytes are no {topic.type_name}')
        return
    callback(msg)

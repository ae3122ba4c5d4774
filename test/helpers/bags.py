"""Bags made by hand, without ROS: the messages of missions flown in this process."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from uav_collect.recording.bag_writer import BagWriter, MessageTypes
from uav_collect.recording.mission_log import header_line, MissionLog
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOME
from uav_collect.world.sensor_field import demand_of

STARTED, ENDED, ABORTED = 0, 1, 2
QOS = Qos(
    history=QosHistory.KEEP_LAST,
    depth=1000,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.TRANSIENT_LOCAL,
    deadline=QosTime(0, 0),
    lifespan=QosTime(0, 0),
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=QosTime(2, 0),
    avoid_ros_namespace_conventions=False,
)
_MESSAGES = Path(__file__).parents[2] / 'msg_defs' / 'msg'
_FIGURES = 'uav_collect_msgs/msg/UavFigures'
_TIME = 'builtin_interfaces/msg/Time'
_ZEROS: Mapping[str, object] = {'bool': False, 'string': '', 'float64': 0.0, 'float32': 0.0}


def definition_text(type_name: str) -> str:
    """The .msg file of a type."""
    if type_name == _TIME:
        return 'int32 sec\nuint32 nanosec\n'
    package, _, name = type_name.split('/')
    assert package == 'uav_collect_msgs'
    return (_MESSAGES / f'{name}.msg').read_text()


class HandMadeMessages:
    """Serializes messages of uav_collect_msgs as the middleware does."""

    def __init__(self) -> None:
        self._types = get_typestore(Stores.EMPTY)
        for type_name in (_TIME, *(f'uav_collect_msgs/msg/{p.stem}' for p in _MESSAGES.iterdir())):
            self._types.register(get_types_from_msg(definition_text(type_name), type_name))

    def serialized(self, name: str, **fields: object) -> bytes:
        """A message; fields not named are zero."""
        type_name = f'uav_collect_msgs/msg/{name}'
        return bytes(self._types.serialize_cdr(self._message(type_name, fields), type_name))

    def of_mission(
        self, log: MissionLog, mission_id: str, end: int = ENDED
    ) -> Iterator[tuple[str, bytes]]:
        """All messages of a mission with their topics, but those that viewers and learners get."""
        n_decisions = sum(event['action'] != HOME for event in log.events)
        n_heard: Counter[int] = Counter()
        yield '/world/mission', self.serialized('Mission', mission_id=mission_id)
        for number, event in enumerate(log.events):
            fields = event_fields(event)
            uav, heard = fields['uav'], fields['heard']
            about = {'mission_id': mission_id, 'decision': fields['decision']}
            for hearer in [uav] * len(heard) + [*heard]:
                n_heard[hearer] += 1
                delivered = {'mission_id': mission_id, 'delivery': n_heard[hearer]}
                yield f'/uav_{hearer}/radio_rx', self.serialized('RadioMessage', **delivered)
            yield f'/uav_{uav}/observation', self.serialized('Observation', **about)
            sent = {'mission_id': mission_id, 'sequence': fields['decision']}
            yield f'/uav_{uav}/radio_tx', self.serialized('RadioMessage', **sent)
            yield f'/uav_{uav}/command', self.serialized('Command', **about)
            fields['terminal'] = number == len(log.events) - 1
            yield '/world/epoch', self.serialized('Epoch', mission_id=mission_id, **fields)
        uavs = [self._message(_FIGURES, {}) for _ in log.header.uavs]
        figures = {'phase': end, 'n_decisions': n_decisions, 'uavs': uavs}
        yield '/world/mission', self.serialized('Mission', mission_id=mission_id, **figures)

    def _message(self, type_name: str, fields: Mapping[str, object]) -> object:
        _, types = self._types.fielddefs[type_name]
        values = {name: self._value(field, fields.get(name)) for name, field in types}
        return self._types.types[type_name](**values)

    def _value(self, field: tuple[Any, Any], given: Any) -> object:  # noqa: ANN401 - any field
        kind, what = field
        if kind.name == 'NAME':
            return self._message(what, given or {})
        if kind.name == 'SEQUENCE' and what[0][0].name == 'NAME' and given is not None:
            return [
                self._message(what[0][1], it) if isinstance(it, Mapping) else it for it in given
            ]
        if given is not None:
            return given
        if kind.name == 'BASE':
            return _ZEROS.get(what[0], 0)
        (element, name), length = what
        if element.name == 'NAME' or name[0] == 'string':
            return []
        return np.zeros(length, dtype=name[0])


class HandMadeBag:
    """A bag that is written message by message; the time of reception counts up."""

    def __init__(self, folder: Path, *, chunk_byte: int = 1_000_000, step_ns: int = 1) -> None:
        self._step_ns = step_ns
        self.writer = BagWriter(folder, MessageTypes(definition_text), chunk_byte=chunk_byte)
        self._messages = HandMadeMessages()
        self.topics: dict[str, Connection] = {}
        self._sites: dict[str, Site] = {}  # by world
        self._n_written = 0

    def add(self, topic: str, name: str, **fields: object) -> None:
        """Write a message of uav_collect_msgs; fields not named are zero."""
        type_name = f'uav_collect_msgs/msg/{name}'
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_topic(topic, type_name, QOS)
        self.add_bytes(topic, self._messages.serialized(name, **fields))

    def add_bytes(self, topic: str, content: bytes) -> None:
        """Write what may be no message, on a topic that has one."""
        self._n_written += 1
        log_ns = self._n_written * self._step_ns
        self.writer.write(self.topics[topic], log_ns, content)

    def add_scenario(self, site: Site, world: str = 'world') -> None:
        """Write what a world says first."""
        self._sites[world] = site
        self.add(
            '/world/scenario',
            'Scenario',
            world_instance=world,
            yaml=site.scenario.to_yaml(),
            fingerprint=fingerprint(site.scenario),
            sensor_id=list(site.sensor_ids),
            sensor_x_m=site.position_m[:, 0].copy(),
            sensor_y_m=site.position_m[:, 1].copy(),
        )

    def add_mission(
        self,
        log: MissionLog,
        mission_id: str,
        *,
        world: str = 'world',
        phases: Iterable[int] = (STARTED, ENDED),
        leave_out: Iterable[int] = (),
        n_radio_messages: int = 0,
        demand_bit: Sequence[float] | None = None,
    ) -> None:
        """Write a mission: its start, its events but those left out, its end.

        Args:
            demand_bit: None: as the site of its world has it, if that is known.
        """
        if demand_bit is None:
            site = self._sites.get(world)
            drawn = [] if site is None else demand_of(site, log.header.mission_seed)
            demand_bit = [*drawn]
        about = {
            'mission_id': mission_id,
            'world_instance': world,
            'scenario_fingerprint': log.header.scenario_fingerprint,
            'log_header': header_line(log.header),
            'demand_bit': np.array(demand_bit, dtype=np.float64),
        }
        if STARTED in phases:
            self.add('/world/mission', 'Mission', phase=STARTED, **about)
        for number, event in enumerate(log.events):
            if number not in leave_out:
                self._add_epoch(event, mission_id, terminal=number == len(log.events) - 1)
        for _ in range(n_radio_messages):
            self.add('/uav_1/radio_rx', 'RadioMessage', mission_id=mission_id)
        for phase in phases:
            if phase != STARTED:
                self.add('/world/mission', 'Mission', phase=phase, **about)

    def _add_epoch(self, event: np.void, mission_id: str, *, terminal: bool) -> None:
        about = {'mission_id': mission_id, 'terminal': terminal}
        self.add('/world/epoch', 'Epoch', **about, **event_fields(event))


def event_fields(event: np.void) -> dict[str, Any]:
    """The fields of an Epoch message that an event of a log has."""
    fields = {name: event[name].item() for name in event.dtype.names}
    mask = fields['heard']
    fields['heard'] = np.array([i + 1 for i in range(64) if mask >> i & 1], dtype=np.uint8)
    fields['heard_back'] = True
    return fields

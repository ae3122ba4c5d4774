"""The log times of a recording: simulated time, by which it is replayed at any pace.

A mission that is flown as fast as possible is over in a fraction of a second; by the times of
reception nothing could be seen of it. So a message that has a stamp is logged at its stamp, any
other one at what the clock shows; and what a UAV hears, too, for its stamp is of the sender, who
may have sent it long before. The clock of each world begins at 0, so what a world says is placed
behind all that was there when it was heard of first. What a recording's clock shows is what such
worlds say of their missions and nothing else: anybody may publish on /clock. Whoever reads a bag
sorts by these times; messages of one time stay in the order in which they came.
"""

import struct

from uav_collect.recording.message_heads import FieldKind, FieldsOf

_TIME = 'builtin_interfaces/msg/Time'
_STAMP = struct.Struct('<iI')
_LENGTH = struct.Struct('<I')
_LITTLE_ENDIAN = b'\x00\x01'
_NANOSECONDS = 1_000_000_000
# These tell the wall-clock time of what they are about.
_WALL_STAMPED = frozenset(
    (
        'diagnostic_msgs/msg/DiagnosticArray',
        'uav_collect_msgs/msg/Policy',
        'uav_collect_msgs/msg/Scenario',
    )
)
# What worlds say as time goes on.
_CLOCKS = frozenset(f'uav_collect_msgs/msg/{name}' for name in ('Epoch', 'Mission', 'Observation'))

_HEARD = '/radio_rx'  # what its topics end with


class StampReader:
    """Reads the stamp in simulated time of serialized messages of one type, if they have one."""

    def __init__(self, type_name: str, fields_of: FieldsOf) -> None:
        """Find the stamp: it is in the first field, or in that of a list's first message.

        Args:
            type_name: such as `uav_collect_msgs/msg/Epoch`.
            fields_of: as rosbags has the fields of a type.
        """
        self._place = 0  # no message has it there, behind the encoding
        if type_name in _WALL_STAMPED:
            return
        first = _first_kind(type_name, fields_of)
        if first is not None and first[0].name == 'SEQUENCE':
            (element, what), _ = first[1]
            if element.name == 'NAME' and _begins_with_time(what, fields_of):
                self._place = 8
        elif _begins_with_time(type_name, fields_of):
            self._place = 4

    def read_ns(self, content: bytes) -> int | None:
        """The stamp [ns]; None if there is none, or none that a clock could show."""
        if not self._place or len(content) < self._place + _STAMP.size:
            return None
        if content[:2] != _LITTLE_ENDIAN:
            return None
        if self._place == 8 and _LENGTH.unpack_from(content, 4)[0] == 0:
            return None
        second, nanosecond = _STAMP.unpack_from(content, self._place)
        return None if second < 0 else int(second * _NANOSECONDS + nanosecond)


class LogTimes:
    """The log time of each message of a recording, and which of the clock's are kept."""

    def __init__(self) -> None:
        """Nothing has come yet: the clock shows 0."""
        self._clock_ns = 0  # the latest time that a known world has told
        self._begun_ns: dict[str, int] = {}  # log time at which the clock of a world began
        self._world = ''  # the one that was heard last
        self._has_news = True  # since the last message of the clock that is kept

    def begin_world(self, world: str) -> None:
        """Know a world: if it is new, what it says follows what was there.

        Args:
            world: what the ids of its missions begin with, before a dash.
        """
        self._begun_ns.setdefault(world, self._clock_ns)
        self._world = world

    def log_ns(
        self, topic: str, type_name: str, stamp_ns: int | None, mission_id: str = ''
    ) -> int:
        """When a message is logged.

        Args:
            topic: its name.
            type_name: of the message.
            stamp_ns: what its StampReader has read.
            mission_id: of the mission that it is about, if it names one.
        """
        if stamp_ns is None:
            return self._clock_ns
        world = mission_id.rpartition('-')[0] if mission_id else self._world
        begun_ns = self._begun_ns.get(world)
        if begun_ns is None:  # topics are not ordered: it may be of the first world
            return self._clock_ns if self._begun_ns else stamp_ns
        at_ns = begun_ns + stamp_ns
        is_heard = topic.endswith(_HEARD)
        if mission_id and (is_heard or type_name in _CLOCKS):
            self._world = world
            self._clock_ns = max(self._clock_ns, at_ns)
        return self._clock_ns if is_heard else at_ns

    def note_event(self) -> None:
        """Take note that an event, or a mission's start or end, was recorded."""
        self._has_news = True

    def keeps_clock(self) -> bool:
        """Whether a message of the clock is kept: the first one after each event is."""
        had_news, self._has_news = self._has_news, False
        return had_news


def _first_kind(type_name: str, fields_of: FieldsOf) -> FieldKind | None:
    fields = fields_of(type_name)
    return fields[0][1] if fields else None


def _begins_with_time(type_name: str, fields_of: FieldsOf) -> bool:
    if type_name == _TIME:
        return True
    first = _first_kind(type_name, fields_of)
    return first is not None and first[0].name == 'NAME' and _begins_with_time(first[1], fields_of)

"""Compares what a recording holds of missions with what their events say that there was.

An event names the UAV that decided and those that it heard: so it was sent an observation and
their messages, and answered with a command and a message of its own; and whether they heard that
at once. Whatever the order in which topics arrive; and missions that hold everything are soon
forgotten.
"""

from collections import defaultdict, OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
import re
from typing import NamedTuple

from uav_collect.limits import MAX_UAVS
from uav_collect.recording.message_heads import FieldsOf, HeadReader
from uav_collect.uav.action_codes import FAILSAFE, FAULT

# Phases of a Mission message; a bag knows no constants.
STARTED, ENDED, ABORTED = 0, 1, 2

_UAVS = frozenset(range(1, MAX_UAVS + 1))
_RECENT = 64  # missions whose last messages may still come
_MOST_MISSIONS = 1_000  # that lack something and may still get it
_MOST_NUMBERS = 100_000  # kept of a topic beyond its first gap
_ANSWERS = ('observation', 'command', 'radio_tx')  # one of each for a decision
_TOPIC = re.compile(r'(?P<world>.*)/(?:world|uav_(?P<uav>\d+))/(?P<what>\w+)')
_PACKAGE = 'uav_collect_msgs/msg/'
_READS = {
    'mission': ('Mission', ('mission_id', 'phase', 'n_decisions', 'uavs')),
    'epoch': (
        'Epoch',
        (*('mission_id', 'event', 'uav', 'decision', 'reason'), 'heard', 'heard_back', 'terminal'),
    ),
    'observation': ('Observation', ('mission_id', 'decision')),
    'command': ('Command', ('mission_id', 'decision')),
    'radio_tx': ('RadioMessage', ('mission_id', 'sequence')),
    'radio_rx': ('RadioMessage', ('mission_id', 'delivery')),
    'transition': ('Transition', ('mission_id', 'decision')),
}


class Lack(NamedTuple):
    """What is missing of one topic."""

    topic: str
    n_messages: int
    n_missions: int
    mission_id: str  # one of these

    def plus(self, n_messages: int) -> 'Lack':
        """With those that one more mission lacks."""
        n_total, n_missions = self.n_messages + n_messages, self.n_missions + 1
        return self._replace(n_messages=n_total, n_missions=n_missions)

    def __str__(self) -> str:
        """In words."""
        where = f'mission {self.mission_id}'
        if self.n_missions > 1:
            where += f' and {self.n_missions - 1} more'
        return f'{self.topic} lacks {self.n_messages} of {where}'


class Taken(NamedTuple):
    """What a message was about."""

    what: str  # mission, epoch, observation, ...
    mission_id: str
    has_ended: bool = False  # it says that its mission was ended or aborted


class Completeness:
    """What a recording holds of the missions of one world, by their events."""

    def __init__(self, fields_of: FieldsOf, namespace: str = '') -> None:
        """Hold nothing yet.

        Args:
            fields_of: as rosbags has the fields of a message type.
            namespace: of the world, '' or such as '/a'.
        """
        self._fields_of = fields_of
        self._namespace = namespace
        self._missions: OrderedDict[str, _Mission] = OrderedDict()  # in the order they came
        self._late: OrderedDict[str, _Mission] = OrderedDict()  # older ones that lack something
        self._given_up: dict[str, Lack] = {}  # by topic, of missions that are not kept any more
        self._is_frozen = False

    def taker(self, topic: str) -> Callable[[bytes], Taken] | None:
        """What takes note of the serialized messages of a topic, by its full name.

        Returns:
            A function that raises UnreadableError for bytes that are no message; None for a topic
            that events say nothing about.
        """
        match = _TOPIC.fullmatch(topic)
        if match is None or match['world'] != self._namespace or match['what'] not in _READS:
            return None
        type_name, wanted = _READS[match['what']]
        reader = HeadReader(f'{_PACKAGE}{type_name}', wanted, self._fields_of)
        if match['what'] == 'mission':
            return lambda content: self._add_phase(*reader.read(content))
        if match['what'] == 'epoch':
            return lambda content: self._add_event(*reader.read(content))
        return partial(self._take_numbered, reader, match['what'], int(match['uav']))

    def freeze(self) -> None:
        """Expect no more of missions in flight than their events so far say, and no new ones."""
        self._is_frozen = True
        for mission in (*self._late.values(), *self._missions.values()):
            mission.is_frozen = not mission.has_ended

    def lacks(self) -> list[Lack]:
        """What is missing, by topic: in missions that have not ended, up to their last event."""
        total = dict(self._given_up)
        for mission_id, mission in (*self._late.items(), *self._missions.items()):
            self._add_lacks(total, mission_id, mission)
        return [total[topic] for topic in sorted(total)]

    def _add_phase(self, mission_id: str, phase: int, n_decisions: int, n_uavs: int) -> Taken:
        mission = self._mission(mission_id)
        if phase == STARTED:
            mission.has_started = True
        elif not mission.is_frozen:
            mission.has_ended = True
        if phase == ENDED and not mission.is_frozen:
            mission.n_events = n_decisions + n_uavs  # each UAV turns home once
        return Taken('mission', mission_id, has_ended=phase != STARTED)

    def _add_event(
        self,
        mission_id: str,
        event: int,
        uav: int,
        decision: int,
        reason: int,
        heard: bytes,
        heard_back: bool,
        terminal: bool,
    ) -> Taken:
        mission = self._mission(mission_id)
        if mission.is_frozen:
            return Taken('epoch', mission_id)
        if uav in _UAVS and mission.events.add(event):
            if terminal:
                mission.n_events = event + 1
            if reason not in (FAILSAFE, FAULT):
                mission.expect(uav, decision, heard, heard if heard_back else b'')
        return Taken('epoch', mission_id)

    def _take_numbered(self, reader: HeadReader, what: str, uav: int, content: bytes) -> Taken:
        mission_id, number = reader.read(content)
        held = self._mission(mission_id).uavs[uav].held[what]
        held.add(number - (what == 'radio_rx'))  # deliveries count from 1
        return Taken(what, mission_id)

    def _mission(self, mission_id: str) -> '_Mission':
        mission = self._missions.get(mission_id) or self._late.get(mission_id)
        if mission is None and self._is_frozen:
            return _Mission(is_frozen=True)  # that nobody asks for again
        if mission is None:
            mission = self._missions[mission_id] = _Mission()
            self._make_room()
        return mission

    def _make_room(self) -> None:
        if len(self._missions) <= _RECENT:
            return
        mission_id, mission = self._missions.popitem(last=False)
        if mission.is_whole:
            return
        self._late[mission_id] = mission
        if len(self._late) > _MOST_MISSIONS:
            self._add_lacks(self._given_up, *self._late.popitem(last=False))

    def _add_lacks(self, total: dict[str, Lack], mission_id: str, mission: '_Mission') -> None:
        for name, n_lacking in mission.lacks():
            topic = f'{self._namespace}{name}'
            so_far = total.get(topic, Lack(topic, 0, 0, mission_id))
            total[topic] = so_far.plus(n_lacking)


class _Numbers:
    """A set of numbers from 0 on that has few gaps."""

    __slots__ = ('beyond', 'n_first')

    def __init__(self) -> None:
        self.n_first = 0  # all below it are here
        self.beyond: set[int] = set()

    def add(self, number: int) -> bool:
        """Add one; whether it is new."""
        if number < self.n_first or number in self.beyond:
            return False
        if number != self.n_first:
            if len(self.beyond) < _MOST_NUMBERS:
                self.beyond.add(number)
            return True
        self.n_first += 1
        while self.n_first in self.beyond:
            self.beyond.remove(self.n_first)
            self.n_first += 1
        return True

    def __len__(self) -> int:
        return self.n_first + len(self.beyond)

    def end(self) -> int:
        """One more than the largest."""
        return max(self.beyond, default=self.n_first - 1) + 1

    def n_missing_below(self, end: int) -> int:
        """How many numbers below an end are not among these."""
        return max(0, end - self.n_first) - sum(number < end for number in self.beyond)

    def n_not_in(self, other: '_Numbers') -> int:
        """How many of these are not among others."""
        return other.n_missing_below(self.n_first) + sum(
            number >= other.n_first and number not in other.beyond for number in self.beyond
        )


@dataclass(slots=True)
class _UavParts:
    """What one UAV was sent and sent itself in one mission."""

    asked: _Numbers = field(default_factory=_Numbers)  # decisions that events tell of
    n_heard: int = 0  # radio messages that events tell of
    held: defaultdict[str, _Numbers] = field(default_factory=lambda: defaultdict(_Numbers))

    def lacks(self) -> Iterator[tuple[str, int]]:
        wanted = [*_ANSWERS, *(['transition'] if 'transition' in self.held else [])]
        for what in wanted:
            yield what, self.asked.n_not_in(self.held[what])
        yield 'radio_rx', self.held['radio_rx'].n_missing_below(self.n_heard)


@dataclass(slots=True)
class _Mission:
    """What is held of one mission."""

    has_started: bool = False  # its first Mission message is here
    has_ended: bool = False
    is_frozen: bool = False  # judged by the events that are here, whatever comes
    n_events: int | None = None  # known when it has ended
    events: _Numbers = field(default_factory=_Numbers)
    uavs: defaultdict[int, _UavParts] = field(default_factory=lambda: defaultdict(_UavParts))

    def expect(self, uav: int, decision: int, heard: bytes, hearers: bytes) -> None:
        """Note what a decision was asked for with, whom it heard and who heard it at once."""
        self.uavs[uav].asked.add(decision)
        self.uavs[uav].n_heard += len(heard)
        for other in _UAVS.intersection(hearers):
            self.uavs[other].n_heard += 1

    @property
    def is_whole(self) -> bool:
        """Whether nothing of it is missing, and nothing more will come."""
        return self.has_ended and not any(True for _ in self.lacks())

    def lacks(self) -> Iterator[tuple[str, int]]:
        """Topics without their namespace, and how many messages each lacks."""
        if not (self.has_started or self.has_ended or len(self.events)):
            return  # agents have said something of a mission that no world tells of
        if not self.has_started:
            yield '/world/mission', 1
        n_events = self.events.end() if self.n_events is None else self.n_events
        if n_events > len(self.events):
            yield '/world/epoch', n_events - len(self.events)
        for uav, parts in self.uavs.items():
            for what, n_lacking in parts.lacks():
                if n_lacking > 0:
                    yield f'/uav_{uav}/{what}', n_lacking

"""All that a bag says of each mission, in one reading, however many missions there are."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
import re
from typing import Any, NamedTuple

from uav_collect.errors import BagError
from uav_collect.recording.bag_messages import MessageReader
from uav_collect.recording.bag_storage import Bag

_N_POLICIES = 64  # published ones kept; a mission may begin with one that is no longer the latest
_N_LATE = 2  # missions of a world that must have begun before the one before them has all messages

# Which field counts the messages of a kind, the last part of their topic's name.
_NUMBERED_BY = {
    'epoch': 'event',
    'observation': 'decision',
    'command': 'decision',
    'transition': 'decision',
    'radio_tx': 'sequence',
    'radio_rx': 'delivery',
}
_TOPIC = re.compile(
    r'.*/(?:world/(?P<shared>mission|epoch|scenario)'
    r'|uav_(?P<uav>\d+)/(?P<own>observation|command|transition|radio_tx|radio_rx)'
    r'|trainer/(?P<policy>policy))'
)


class MessagePlace(NamedTuple):
    """Where a message belongs in its mission: there should be one of each."""

    kind: str  # the last part of its topic's name
    uav: int  # id of the UAV on whose topic it is; 0 on a topic of the world
    number: int  # event, decision, sequence or delivery


@dataclass(kw_only=True)
class MissionMessages:
    """The messages of one mission."""

    mission_id: str
    phases: dict[int, Any] = field(default_factory=dict)  # Mission messages, the first of each
    placed: dict[MessagePlace, list[Any]] = field(default_factory=dict)

    @property
    def start(self) -> Any:  # noqa: ANN401 - a message
        """The message about its start, or else about its end; None without any."""
        return next((self.phases[phase] for phase in sorted(self.phases)), None)

    @property
    def world(self) -> str:
        """Which world process flew it."""
        return self.mission_id.rpartition('-')[0]


class MissionReader:
    """Reads a bag once; what missions have in common stays, each mission is given away."""

    def __init__(self, bag: Bag) -> None:
        """Read nothing yet but what types the messages have."""
        self._reader = MessageReader(bag, lambda name: bool(_TOPIC.fullmatch(name)))
        self.problems = self._reader.problems  # topics that cannot be read; one line each
        self._open: dict[str, MissionMessages] = {}  # by mission, in the order that they came
        self.scenarios: dict[str, list[Any]] = {}  # Scenario messages by world instance
        self.policies: deque[Any] = deque(maxlen=_N_POLICIES)  # Policy messages, the latest last

    def missions(self) -> Iterator[MissionMessages]:
        """The missions in the order they began, each once all of it should have come.

        Raises:
            BagError: its messages are those of another version.
        """
        for topic, message in self._reader.messages():
            match = _TOPIC.fullmatch(topic)
            if match is None:
                continue
            if match['policy']:
                self.policies.append(message)
            elif match['shared'] == 'scenario':
                self.scenarios.setdefault(message.world_instance, []).append(message)
            elif message.mission_id:  # else a greeting
                kind = match['shared'] or match['own']
                self._take(kind, int(match['uav'] or 0), message)
                if kind == 'mission':
                    yield from self._whole(message.mission_id)
        yield from self._open.values()

    def _take(self, kind: str, uav: int, message: Any) -> None:  # noqa: ANN401
        mission_id = message.mission_id
        mission = self._open.get(mission_id)
        if mission is None:
            mission = self._open[mission_id] = MissionMessages(mission_id=mission_id)
        if kind == 'mission':
            mission.phases.setdefault(int(message.phase), message)
            return
        number = getattr(message, _NUMBERED_BY[kind], None)
        if not isinstance(number, int):
            raise BagError(f'{kind} without {_NUMBERED_BY[kind]}: another version has recorded it')
        place = MessagePlace(kind, uav, number)
        mission.placed.setdefault(place, []).append(message)

    def _whole(self, latest_id: str) -> Iterator[MissionMessages]:
        """The missions of a world before its latest ones."""
        world = latest_id.rpartition('-')[0]
        begun = [it for it in self._open.values() if it.world == world and it.start is not None]
        for mission in begun[: -_N_LATE - 1]:
            yield self._open.pop(mission.mission_id)

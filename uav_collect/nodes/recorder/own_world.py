"""What a recorder keeps that records one world alone, whoever else is heard in the ROS domain."""

from uav_collect.nodes.identity import WorldIdentity
from uav_collect.nodes.topics import Topic
from uav_collect.recording.message_heads import FieldsOf, HeadReader
from uav_collect_msgs.msg import (
    Command,
    Epoch,
    Mission,
    Observation,
    RadioMessage,
    Scenario,
    Transition,
)

_OF_MISSIONS = (Command, Epoch, Mission, Observation, RadioMessage, Transition)


class OwnWorld:
    """Knows what the world with an instance and its fleet have sent."""

    def __init__(self, instance: str, fields_of: FieldsOf) -> None:
        """Know no topic yet.

        Args:
            instance: of the world, a UUID.
            fields_of: as rosbags has the fields of a message type.
        """
        self._world = WorldIdentity(started_s=0.0, instance=instance)
        self._fields_of = fields_of
        self._scenarios: set[str] = set()  # topics on which worlds present themselves
        self._readers: dict[str, HeadReader] = {}  # by topic, of the field that says whose it is

    def add_topic(self, topic: Topic) -> None:
        """Learn how to read whose the messages of a topic are, if they say so."""
        if topic.message is Scenario:
            self._scenarios.add(topic.name)
            self._readers[topic.name] = self._reader(topic, 'world_instance')
        elif topic.message in _OF_MISSIONS:
            self._readers[topic.name] = self._reader(topic, 'mission_id')

    def has_sent(self, topic: str, message: bytes) -> bool:
        """Whether a serialized message may be of the world, as far as it says.

        Raises:
            UnreadableError: it is no message of its topic.
        """
        reader = self._readers.get(topic)
        if reader is None:
            return True
        (said,) = reader.read(message)
        if topic in self._scenarios:
            return bool(said == self._world.instance)
        return not said or self._world.may_own(said)  # an agent that greets names no mission

    def _reader(self, topic: Topic, field: str) -> HeadReader:
        return HeadReader(topic.type_name, (field,), self._fields_of)

"""Plays a bag back on the topics that it was recorded from, as players do."""

from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from uav_collect.nodes import topics


class BagPlayer:
    """Publishes what a bag holds, latched topics among them."""

    def __init__(self, node: Any, bag: Path, n_uavs: int) -> None:  # noqa: ANN401
        """Advertise the topics of a mission of so many UAVs."""
        self._publishers = {
            topic.name: topics.publisher(node, topic) for topic in topics.fleet_topics(n_uavs)
        }
        with AnyReader([bag]) as reader:
            self._messages = [
                (connection.topic, bytes(content)) for connection, _, content in reader.messages()
            ]

    def play(self) -> int:
        """Publish all of it at once; how many messages."""
        for topic, content in self._messages:
            if topic in self._publishers:
                self._publishers[topic].publish(content)
        return len(self._messages)

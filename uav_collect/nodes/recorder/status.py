"""What a recorder says to worlds: what it does not hear yet."""

from collections.abc import Mapping, Sequence
from pathlib import Path
import time
from typing import Any
import uuid

from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.topics import publisher, Topic
from uav_collect_msgs.msg import RecorderStatus

_REPEATED_S = 0.5  # as long as something is missing
_ALIVE_S = 2.0  # between two messages when nothing is, so that worlds know that it is there


class StatusPublisher:
    """Publishes the status of a recorder when it has changed, and now and then."""

    def __init__(self, node: ProcessNode, topic: Topic, bag: Path) -> None:
        """Say nothing yet."""
        self._publisher = publisher(node, topic)
        self._instance, self._bag = str(uuid.uuid4()), str(bag.absolute())
        self._said: Any = None
        self._said_s = 0.0

    def publish(self, worlds: Mapping[str, str], waits_for: Sequence[str]) -> None:
        """Say what is missing, unless that was said just now.

        Args:
            worlds: fingerprint of the scenario by instance.
            waits_for: topics.
        """
        status = RecorderStatus(
            recorder_instance=self._instance,
            bag=self._bag,
            world_instances=[*worlds],
            scenario_fingerprints=[*worlds.values()],
            waits_for=[*waits_for],
        )
        now_s = time.monotonic()
        is_due = now_s - self._said_s > (_REPEATED_S if waits_for else _ALIVE_S)
        if status != self._said or is_due:
            self._said, self._said_s = status, now_s
            self._publisher.publish(status)

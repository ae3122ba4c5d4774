"""How a world tells what went wrong: at once in its log, every second in diagnostics."""

import time

from rclpy.node import Node
from uav_collect.lockstep.roster import Roster
from uav_collect.nodes import topics
from uav_collect.nodes.incidents import Incidents, world_diagnostics
from uav_collect.nodes.topics import publisher
from uav_collect.nodes.world.mission import Flight

_PERIOD_S = 1.0


class Reports:
    """The incidents of a world, and its publisher of diagnostics."""

    def __init__(self, node: Node, namespace: str) -> None:
        """Advertise diagnostics for the world of a namespace, '' or such as '/a'."""
        self._node = node
        self._namespace = namespace
        self._incidents = Incidents()
        self._published_s = 0.0
        self._publisher = publisher(node, topics.DIAGNOSTICS)

    def note(self, kind: str, text: str) -> None:
        """Tell an incident of a kind such as 'command refused'."""
        if self._incidents.note(kind, text):
            self._node.get_logger().warning(text)
            self._published_s = 0.0  # soon

    def note_lost(self, failure: str | None) -> None:
        """Tell what could not be written, if anything."""
        if failure is not None:
            self.note('log lost', failure)

    def is_due(self, now_s: float) -> bool:
        """Whether diagnostics are to be published, by the monotonic clock."""
        return now_s - self._published_s > _PERIOD_S

    def publish(self, roster: Roster, flight: Flight | None) -> None:
        """Publish how the world and its fleet are."""
        self._published_s = time.monotonic()
        message = world_diagnostics(
            self._node.get_clock().now().to_msg(),
            self._incidents,
            roster,
            '' if flight is None else flight.mission_id,
            () if flight is None else flight.unflown,
            self._namespace,
        )
        self._publisher.publish(message)

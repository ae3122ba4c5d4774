"""What a world says: to its fleet, to recorders and learners, to viewers."""

from typing import Any

from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from uav_collect.nodes.convert import stamp
from uav_collect.nodes.topics import publisher, WorldTopics


class Voice:
    """The publishers of a world, but those of its picture and its diagnostics."""

    def __init__(self, node: Node, names: WorldTopics, n_uavs: int) -> None:
        """Advertise the topics of a world and its fleet."""
        self._clock = publisher(node, names.clock)
        self._epochs = publisher(node, names.epoch)
        self._missions = publisher(node, names.mission)
        self._scenarios = publisher(node, names.scenario)
        own = {uav: names.uav(uav) for uav in range(1, n_uavs + 1)}
        self._observations = {uav: publisher(node, own[uav].observation) for uav in own}
        self._radio = {uav: publisher(node, own[uav].radio_rx) for uav in own}

    def tell_time(self, time_s: float) -> None:
        """Say which simulated time it is."""
        self._clock.publish(Clock(clock=stamp(time_s)))

    def tell_scenario(self, message: Any) -> None:
        """Say what is flown."""
        self._scenarios.publish(message)

    def tell_mission(self, message: Any) -> None:
        """Say that a mission has started or ended."""
        self._missions.publish(message)

    def tell_epoch(self, message: Any) -> None:
        """Say what an event was."""
        self._epochs.publish(message)

    def show(self, uav: int, message: Any) -> None:
        """Let a UAV, by id, see."""
        self._observations[uav].publish(message)

    def relay(self, uav: int, message: Any) -> None:
        """Let a UAV, by id, hear."""
        self._radio[uav].publish(message)

"""All that a world publishes: to its fleet, to recorders and learners, to viewers."""

import time
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.nodes import convert
from uav_collect.nodes.topics import publisher, WorldTopics
from uav_collect.nodes.world.markers import MissionMarkers
from uav_collect.scenario.site import Site
from uav_collect.uav.messages import Decision

_REFUSAL_PERIOD_S = 0.02


class WorldPublishers:
    """The publishers of a world, but those for viewers and that of its diagnostics."""

    def __init__(self, node: Node, names: WorldTopics, n_uavs: int) -> None:
        """Advertise the topics of a world and its fleet."""
        self._clock = publisher(node, names.clock)
        self._epochs = publisher(node, names.epoch)
        self._missions = publisher(node, names.mission)
        self._scenarios = publisher(node, names.scenario)
        own = {uav: names.uav(uav) for uav in range(1, n_uavs + 1)}
        self._observations = {uav: publisher(node, own[uav].observation) for uav in own}
        self._radio = {uav: publisher(node, own[uav].radio_rx) for uav in own}
        self._refusals = {uav: publisher(node, own[uav].refusal) for uav in own}
        self._refused_s = dict.fromkeys(own, 0.0)

    def publish_time(self, time: Time) -> None:
        """Publish the simulated time as the clock of the ROS domain."""
        self._clock.publish(Clock(clock=time))

    def publish_scenario(self, message: Any) -> None:
        """Publish what is flown, and who simulates it."""
        self._scenarios.publish(message)

    def publish_mission(self, message: Any) -> None:
        """Publish that a mission has started or ended."""
        self._missions.publish(message)

    def publish_epoch(self, message: Any) -> None:
        """Publish an event with the state of the fleet after it."""
        self._epochs.publish(message)

    def publish_observation(self, uav: int, message: Any) -> None:
        """Publish what a UAV, by id, sees."""
        self._observations[uav].publish(message)

    def publish_radio(self, uav: int, message: Any) -> None:
        """Publish what a UAV, by id, hears of another one."""
        self._radio[uav].publish(message)

    def publish_refusal(self, uav: int, message: Any) -> None:
        """Publish why something that a UAV's agent sent is not done, but not too often.

        A greeting is refused in any case: its agent takes itself for the UAV's own.
        """
        now_s, is_greeting = time.monotonic(), message.what == convert.GREETING
        if is_greeting or now_s - self._refused_s[uav] >= _REFUSAL_PERIOD_S:
            self._refused_s[uav] = now_s
            self._refusals[uav].publish(message)


class ViewerPublisher:
    """Publishes markers and grid, at most so many times per second of wall-clock time."""

    def __init__(self, node: Node, names: WorldTopics, site: Site, rate_hz: float) -> None:
        """Advertise both topics; a rate of 0 publishes nothing."""
        self._period_s = 1.0 / rate_hz if rate_hz > 0.0 else None
        self._published_s = 0.0
        self._mission = MissionMarkers(site)
        self._markers = publisher(node, names.markers)
        self._grid = publisher(node, names.completed_cells)

    def begin(self, simulation: Simulation) -> None:
        """Show a mission from now on, in the next picture."""
        self._mission.begin(simulation)

    def note_event(self, event: Event, decision: Decision | None) -> None:
        """Take note of an event, right after its decision was carried out."""
        if decision is not None:
            self._mission.note_event(event, decision)

    def publish(self, time_s: float, stamp: Time, *, now: bool = False) -> None:
        """Publish the picture at a time of the mission, if the last one is old enough, or now."""
        if self._period_s is None:
            return
        wall_s = time.monotonic()
        if now or wall_s - self._published_s > self._period_s:
            self._published_s = wall_s
            self._markers.publish(self._mission.markers(time_s, stamp))
            self._grid.publish(self._mission.completed_cells(stamp))

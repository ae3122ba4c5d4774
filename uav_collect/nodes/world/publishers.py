"""All that a world publishes: to its fleet, to recorders and learners, to viewers."""

import time
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from uav_collect.lockstep.schedule import ClockRate
from uav_collect.missions.flight_samples import TimeGrid
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.nodes import convert
from uav_collect.nodes.topics import latest_only, publisher, WorldTopics
from uav_collect.nodes.world.markers import MissionMarkers
from uav_collect.nodes.world.settings import WorldSettings
from uav_collect.nodes.world.standard import StandardPublisher
from uav_collect.scenario.site import Site
from uav_collect.uav.messages import Decision

_REFUSAL_PERIOD_S = 0.02


class WorldPublishers:
    """The publishers of a world, but those for viewers and that of its diagnostics."""

    def __init__(self, node: Node, names: WorldTopics) -> None:
        """Advertise the topics of a world, but those of UAVs."""
        self._node, self._names = node, names
        self._clock = publisher(node, names.clock)
        self._clock_rate = ClockRate()
        self._epochs = publisher(node, names.epoch)
        self._missions = publisher(node, names.mission)
        self._scenarios = publisher(node, latest_only(names.scenario))
        self._observations: dict[int, Publisher] = {}
        self._radio: dict[int, Publisher] = {}
        self._refusals: dict[int, Publisher] = {}
        self._refused_s: dict[int, float] = {}

    def add_uav(self, uav: int) -> None:
        """Advertise what a UAV, by id, is told."""
        own = self._names.uav(uav)
        self._observations[uav] = publisher(self._node, own.observation)
        self._radio[uav] = publisher(self._node, own.radio_rx)
        self._refusals[uav] = publisher(self._node, own.refusal)
        self._refused_s[uav] = 0.0

    def publish_time(self, clock_s: float, *, is_event: bool = False) -> None:
        """Publish what the clock of the ROS domain shows, if it was not told just now."""
        if self._clock_rate.is_due(clock_s, is_event=is_event):
            self._clock.publish(Clock(clock=convert.stamp(clock_s)))

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
    """Publishes what tools show of missions: pictures, which are markers and grid, and samples.

    Pictures come at most so many times per second of wall-clock time, for those who watch, and on
    a grid of simulated time, for those who record a mission that is flown faster than that.
    """

    def __init__(self, node: Node, names: WorldTopics, settings: WorldSettings) -> None:
        """Advertise the topics; a viewer rate of 0 publishes no picture."""
        rate_hz, self._grid_period_s = settings.viewer_rate_hz, settings.picture_period_s
        self._period_s = 1.0 / rate_hz if rate_hz > 0.0 else None
        self._published_s = 0.0
        self._markers = publisher(node, names.markers)
        self._cells = publisher(node, names.completed_cells)
        self._samples = StandardPublisher(node, names, settings.sample_rate_hz)

    def show(self, site: Site) -> None:
        """Show missions over a site from now on."""
        self._mission = MissionMarkers(site)
        self._samples.show(site.scenario)

    def begin(self, simulation: Simulation, clock_start_s: float) -> None:
        """Show a mission from now on, which began as the clock showed that time."""
        self._clock_start_s = clock_start_s
        self._mission.begin(simulation)
        self._samples.begin(simulation, clock_start_s)
        has_grid = self._period_s is not None and self._grid_period_s > 0.0
        self._grid = TimeGrid(1.0 / self._grid_period_s if has_grid else 0.0)

    def note_event(self, event: Event, decision: Decision | None) -> None:
        """Take note of an event, right after its decision was carried out."""
        if decision is not None:
            self._mission.note_event(event, decision)
            self._samples.note_event(event)

    def publish_until(self, time_s: float) -> None:
        """Publish what is due in simulated time up to a time of the mission.

        No UAV may have begun an action in between.
        """
        self._samples.publish_until(time_s)
        for at_s in self._grid.due(time_s):
            if self._is_watched:
                self._publish_picture(at_s)

    def publish(self, time_s: float) -> None:
        """Publish what is due at a time of the mission, by any clock."""
        self.publish_until(time_s)
        if self._period_s is not None and self._is_watched:
            wall_s = time.monotonic()
            if wall_s - self._published_s > self._period_s:
                self._published_s = wall_s
                self._publish_picture(time_s)

    def publish_end(self, time_s: float) -> None:
        """Publish what is left of a mission, and its end, for those too who look later."""
        self.publish_until(time_s)
        self._samples.publish_end(time_s)
        if self._period_s is not None:
            self._publish_picture(time_s)

    @property
    def _is_watched(self) -> bool:
        return any(it.get_subscription_count() for it in (self._markers, self._cells))

    def _publish_picture(self, time_s: float) -> None:
        stamp = convert.stamp(self._clock_start_s + time_s)
        self._markers.publish(self._mission.markers(time_s, stamp))
        self._cells.publish(self._mission.completed_cells(stamp))

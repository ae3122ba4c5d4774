"""Publishes the picture of a mission for viewers, as often as they need it."""

import time

from rclpy.node import Node
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.nodes import convert
from uav_collect.nodes.topics import publisher, WorldTopics
from uav_collect.nodes.world.markers import Viewers
from uav_collect.scenario.site import Site
from uav_collect.uav.messages import Decision


class Display:
    """Markers and grid, at most so many times per second of wall-clock time."""

    def __init__(self, node: Node, names: WorldTopics, site: Site, rate_hz: float) -> None:
        """Advertise both topics; a rate of 0 publishes nothing."""
        self._period_s = 1.0 / rate_hz if rate_hz > 0.0 else None
        self._shown_s = 0.0
        self._viewers = Viewers(site)
        self._markers = publisher(node, names.markers)
        self._grid = publisher(node, names.completed_cells)

    def begin(self, simulation: Simulation) -> None:
        """Show a mission from now on, in the next picture."""
        self._viewers.begin(simulation)

    def note_event(self, event: Event, decision: Decision | None) -> None:
        """Take note of an event, right after its decision was carried out."""
        if decision is not None:
            self._viewers.note_event(event, decision)

    def show(self, time_s: float, *, now: bool = False) -> None:
        """Publish the picture at a simulated time, if it is time to, or now."""
        if self._period_s is None:
            return
        wall_s = time.monotonic()
        if now or wall_s - self._shown_s > self._period_s:
            self._shown_s = wall_s
            stamp = convert.stamp(time_s)
            self._markers.publish(self._viewers.markers(time_s, stamp))
            self._grid.publish(self._viewers.completed_cells(stamp))

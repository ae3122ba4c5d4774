"""What every ROS tool understands of a flight: transforms, odometry, path, battery, satellite fix.

All in the frame `map` and of the true flight: east, north and up of the area's south-west corner,
angles counter-clockwise from east (REP 103). The frame `uav_N/base_link` has its x axis ahead.

A battery of the model holds joules and has no voltage: `percentage` is the energy left over the
energy budget, 0 to 1, so that times the scenario's `energy_budget_kj` it is the energy in kJ.
Voltage, current, charge, capacity and temperature are NaN, for they are unknown.

Messages are made once and filled anew: of thousands a second, that is half of the work.
"""

import math
import time
from typing import NamedTuple

from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import BatteryState, NavSatFix, NavSatStatus
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from uav_collect.missions.flight_samples import (
    Corner,
    FlightSampler,
    PathSchedule,
    TimeGrid,
    UavSample,
)
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.nodes import convert
from uav_collect.nodes.topics import publisher, UavTopics, WorldTopics
from uav_collect.nodes.world.markers import FRAME
from uav_collect.scenario.model import Scenario

_LOOK_S = 0.1  # wall-clock time between two looks for subscribers


class UavMessages:
    """The messages of one UAV, filled with one sample after the other."""

    def __init__(self, scenario: Scenario, uav: int) -> None:
        """Make them, for the UAV with an id."""
        own = f'uav_{uav}/base_link'
        self._budget_j = scenario.uavs[uav - 1].energy_budget_j
        self._reference = scenario.area.reference
        altitude_m = scenario.area.altitude_m
        place, turn = Point(z=altitude_m), Quaternion()
        self.transform = TransformStamped(
            header=Header(frame_id=FRAME),
            child_frame_id=own,
            transform=Transform(translation=Vector3(z=altitude_m), rotation=turn),
        )
        pose = PoseWithCovariance(pose=Pose(position=place, orientation=turn))
        self.odometry = Odometry(header=Header(frame_id=FRAME), child_frame_id=own, pose=pose)
        unknown = dict.fromkeys(('voltage', 'current', 'charge', 'capacity'), math.nan)
        self.battery = BatteryState(
            header=Header(frame_id=own),
            temperature=math.nan,
            design_capacity=math.nan,
            present=True,
            **unknown,
        )
        self._fix = NavSatFix(header=Header(frame_id=own), altitude=altitude_m)
        self._fix.status.status = NavSatStatus.STATUS_FIX  # by itself it is unknown
        self._fix.status.service = NavSatStatus.SERVICE_GPS
        self._places = (self.transform.transform.translation, place)
        self._turn = turn

    def fill(self, sample: UavSample, stamp: Time) -> None:
        """Write a sample into transform, odometry and battery."""
        for place in self._places:
            place.x, place.y = sample.x_m, sample.y_m
        self._turn.z = math.sin(sample.heading_rad / 2.0)
        self._turn.w = math.cos(sample.heading_rad / 2.0)
        self.odometry.twist.twist.linear.x = sample.speed_mps
        self.battery.percentage = sample.energy_left_j / self._budget_j
        self.battery.power_supply_status = (
            BatteryState.POWER_SUPPLY_STATUS_NOT_CHARGING
            if sample.has_landed
            else BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
        )
        for message in (self.transform, self.odometry, self.battery):
            message.header.stamp = stamp

    @property
    def has_fix(self) -> bool:
        """Whether the scenario says where on Earth its area lies."""
        return self._reference is not None

    def filled_fix(self, sample: UavSample) -> NavSatFix:
        """Where on Earth the sample is that was filled in last.

        The altitude is the scenario's: heights of the ground are taken as zero.
        """
        fix, reference = self._fix, self._reference
        if reference is None:
            raise RuntimeError('the scenario does not say where on Earth it lies')
        fix.latitude, fix.longitude = reference.lat_lon_deg(sample.x_m, sample.y_m)
        fix.header.stamp = self.transform.header.stamp
        return fix


class _UavPublishers(NamedTuple):
    odometry: Publisher
    path: Publisher
    battery: Publisher
    fix: Publisher

    @classmethod
    def of(cls, node: Node, own: UavTopics) -> '_UavPublishers':
        return cls(*(publisher(node, getattr(own, name)) for name in cls._fields))


class StandardPublisher:
    """Publishes samples of a mission to whoever has subscribed; nobody else pays for them."""

    def __init__(self, node: Node, names: WorldTopics, rate_hz: float) -> None:
        """Advertise the topics, but those of UAVs; a rate of 0 publishes nothing.

        Args:
            rate_hz: samples per second of simulated time.
        """
        self._node, self._names, self._rate_hz = node, names, rate_hz
        self._tf = publisher(node, names.tf)
        self._advertised: list[_UavPublishers] = []
        self._listened: frozenset[Publisher] = frozenset()  # those that have a subscriber
        self._looked_s = 0.0
        self._stamp: Time | None = None  # of the latest sample

    def show(self, scenario: Scenario) -> None:
        """Show missions of a scenario from now on; advertise the topics of its UAVs."""
        uavs, self._altitude_m = range(1, scenario.n_uavs + 1), scenario.area.altitude_m
        self._messages = [UavMessages(scenario, uav) for uav in uavs]
        self._transforms = TFMessage(transforms=[it.transform for it in self._messages])
        for uav in uavs[len(self._advertised) :]:
            self._advertised.append(_UavPublishers.of(self._node, self._names.uav(uav)))
        self._uavs = self._advertised[: scenario.n_uavs]

    def begin(self, simulation: Simulation, clock_start_s: float) -> None:
        """Show a mission from now on, which began as the clock showed that time."""
        self._sampler, self._clock_start_s = FlightSampler(simulation), clock_start_s
        self._grid, self._schedule = TimeGrid(self._rate_hz), PathSchedule()
        self._looked_s = 0.0

    def note_event(self, event: Event) -> None:
        """Take note of an event, before its action is sampled."""
        self._sampler.note_event(event)

    def publish_until(self, time_s: float) -> None:
        """Publish the samples up to a time of the mission that are not published yet.

        No UAV may have begun an action in between.
        """
        for at_s in self._grid.due(time_s):
            self._look()
            self._publish(at_s)

    def publish_end(self, time_s: float) -> None:
        """Publish what is left of a mission, and its last moment, whether on the grid or not."""
        if self._rate_hz > 0.0:
            self._looked_s = 0.0
            self.publish_until(time_s)
            self._publish(time_s)
            self._publish_paths(time_s)

    def _look(self) -> None:
        now_s = time.monotonic()
        if now_s - self._looked_s > _LOOK_S:
            self._looked_s = now_s
            every = [self._tf, *(each for own in self._uavs for each in own)]
            self._listened = frozenset(it for it in every if it.get_subscription_count())

    def _publish(self, time_s: float) -> None:
        listened = self._listened
        if not listened:
            return
        stamp = convert.stamp(self._clock_start_s + time_s)
        if stamp == self._stamp:  # a mission begins when the last one ended; tf2 takes a time once
            return
        self._stamp = stamp
        for uav, (own, messages) in enumerate(zip(self._uavs, self._messages, strict=True)):
            sample = self._sampler.sample(uav, time_s)
            messages.fill(sample, stamp)
            if own.odometry in listened:
                own.odometry.publish(messages.odometry)
            if own.battery in listened:
                own.battery.publish(messages.battery)
            if own.fix in listened and messages.has_fix:
                own.fix.publish(messages.filled_fix(sample))
        if self._tf in listened:
            self._tf.publish(self._transforms)
        if self._schedule.is_due(time_s):
            self._publish_paths(time_s)

    def _publish_paths(self, time_s: float) -> None:
        stamp = convert.stamp(self._clock_start_s + time_s)
        for uav, own in enumerate(self._uavs):
            if own.path in self._listened:
                poses = [self._pose(corner) for corner in self._sampler.path(uav, time_s)]
                own.path.publish(Path(header=Header(frame_id=FRAME, stamp=stamp), poses=poses))

    def _pose(self, corner: Corner) -> PoseStamped:
        stamp = convert.stamp(self._clock_start_s + corner.time_s)
        place = Point(x=corner.x_m, y=corner.y_m, z=self._altitude_m)
        return PoseStamped(header=Header(frame_id=FRAME, stamp=stamp), pose=Pose(position=place))

"""What standard tools are shown of a flight: samples on a grid of simulated time, and the path.

Legs are piecewise linear, so a sample is exact at any time, and corners are all of a path.
A mission that is flown in a fraction of a second yields as many samples as one in real time.
"""

from collections.abc import Iterator
import math
from typing import NamedTuple

from uav_collect.missions.simulation import Event, Simulation
from uav_collect.world.dynamics import LANDED

_FIRST_PERIOD_S = 2.0  # from one publication of the path to the next, as a mission begins
_GROWTH = 1.05  # later: so much longer a mission has taken by then


class UavSample(NamedTuple):
    """One UAV at one time, as it truly is."""

    x_m: float
    y_m: float
    heading_rad: float  # counter-clockwise from east; of a UAV that stays, where it came along
    speed_mps: float
    energy_left_j: float
    has_landed: bool


class Corner(NamedTuple):
    """Where the path of a UAV turns, and when the UAV came there."""

    time_s: float
    x_m: float
    y_m: float


class TimeGrid:
    """The times 0, 1 / rate, 2 / rate, ... of a mission, each handed out once."""

    def __init__(self, rate_hz: float) -> None:
        """Begin a mission; a rate of 0 has no times at all."""
        self._rate_hz = rate_hz
        self._n_passed = 0

    def due(self, time_s: float) -> Iterator[float]:
        """The times up to now, that of now included, that were not handed out yet."""
        while self._n_passed <= time_s * self._rate_hz and self._rate_hz > 0.0:
            at_s = self._n_passed / self._rate_hz
            self._n_passed += 1
            yield at_s


class PathSchedule:
    """When the path flown so far is published: the longer it is the more rarely.

    So all of them together take the bytes of some twenty whole paths, however long a mission is.
    """

    def __init__(self) -> None:
        """Begin a mission."""
        self._next_s = 0.0

    def is_due(self, time_s: float) -> bool:
        """Whether it is published at a time; the next time is later then."""
        if time_s < self._next_s:
            return False
        self._next_s = max(time_s + _FIRST_PERIOD_S, time_s * _GROWTH)
        return True


class FlightSampler:
    """Knows where the UAVs of a mission are, and the path they came by.

    `note_event` is called for each event, which costs next to nothing; the rest does the work, for
    times between the latest event noted and the next one.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Begin a mission."""
        self._simulation = simulation
        n_uavs = simulation.briefing.n_uavs
        self._corners: list[list[Corner]] = [[] for _ in range(n_uavs)]
        self._headings_rad = [0.0] * n_uavs  # on which each UAV came to its last corner

    def note_event(self, event: Event) -> None:
        """Take note of where a UAV has decided, before its next leg is sampled."""
        view, uav = event.view, event.uav
        corner, corners = Corner(view.time_s, view.x_m, view.y_m), self._corners[event.uav]
        if not corners:
            corners.append(corner)
            return
        last = corners[-1]
        if (last.x_m, last.y_m) == (corner.x_m, corner.y_m):
            return
        heading_rad = math.atan2(corner.y_m - last.y_m, corner.x_m - last.x_m)
        if len(corners) > 1 and heading_rad == self._headings_rad[uav]:
            corners.pop()  # it flew straight on
        corners.append(corner)
        self._headings_rad[uav] = heading_rad

    def sample(self, uav: int, time_s: float) -> UavSample:
        """One UAV, by index, at a time."""
        simulation, leg = self._simulation, self._simulation.leg(uav)
        x_m, y_m = simulation.position_m(uav, time_s)
        has_landed = simulation.phase(uav, time_s) == LANDED
        duration_s = leg.end_s - leg.start_s
        (from_x_m, from_y_m), (to_x_m, to_y_m) = simulation.straight(uav, time_s)
        east_m, north_m = to_x_m - from_x_m, to_y_m - from_y_m
        heading_rad, speed_mps, to_spend_j = self._headings_rad[uav], 0.0, 0.0
        if east_m or north_m:
            heading_rad = math.atan2(north_m, east_m)
        if duration_s > 0.0 and not has_landed:  # as a leg ends it is still flown
            speed_mps = leg.length_m / duration_s
            to_spend_j = leg.energy_j * (leg.end_s - time_s) / duration_s
        return UavSample(
            x_m=x_m,
            y_m=y_m,
            heading_rad=heading_rad,
            speed_mps=speed_mps,
            energy_left_j=simulation.energy_left_j(uav) + to_spend_j,
            has_landed=has_landed,
        )

    def path(self, uav: int, time_s: float) -> list[Corner]:
        """Where one UAV, by index, has flown: its corners, and where it is at a time."""
        here = Corner(time_s, *self._simulation.position_m(uav, time_s))
        turns = self._simulation.turns(uav, time_s)
        corners = [*self._corners[uav], *(Corner(at_s, *place_m) for at_s, place_m in turns)]
        if corners and (corners[-1].x_m, corners[-1].y_m) == (here.x_m, here.y_m):
            return corners
        return [*corners, here]

"""A mission as other tools are given it: stretches, times of the calendar, places on Earth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
import math

from uav_collect.analysis.legs import FlownLeg, HOME_LEG, HOVER_LEG, mission_legs
from uav_collect.analysis.readings import mission_readings, Reading
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Floats
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import GeoReference, Point
from uav_collect.scenario.site import Site

_STRAIGHT_RAD = 1e-9  # two legs that turn by less are one stretch
_DIGITS = 8  # of degrees: a millimetre


@dataclass(frozen=True, kw_only=True)
class UavFlight:
    """What one UAV flew."""

    uav: int  # id, from 1
    speed_mps: float
    take_off_m: Point
    stretches: tuple[FlownLeg, ...]  # legs that lead straight on as one; at least one
    has_landed: bool  # its way home is in the log


@dataclass(frozen=True, kw_only=True)
class MissionFlights:
    """What a fleet flew, and read."""

    name: str  # of the mission, for titles
    site: Site
    mission_seed: int
    start: datetime  # what the mission's time 0 is
    demand_bit: Floats  # (S,)
    flights: tuple[UavFlight, ...]  # of the UAVs that left the ground
    readings: tuple[Reading, ...]
    reference: GeoReference | None  # where on Earth the area lies

    @property
    def altitude_m(self) -> float:
        """Height over ground of all flights [m]."""
        return self.site.scenario.area.altitude_m

    def lat_lon_deg(self, place_m: Point) -> tuple[float, float]:
        """Latitude and longitude [deg] of a place of the area, to a millimetre.

        Raises:
            ConfigError: it is not known where on Earth the area lies.
        """
        if self.reference is None:
            raise ConfigError(
                f'{self.site.scenario.name}: area.reference is missing: must be {{lat_deg,'
                ' lon_deg, position_m}, a point of the area and where on Earth it is, or given by'
                ' --reference LAT LON, of its south-west corner; --to csv does without'
            )
        lat_deg, lon_deg = self.reference.lat_lon_deg(*place_m)
        return round(lat_deg, _DIGITS), round(lon_deg, _DIGITS)

    def bearing_deg(self, leg: FlownLeg) -> float:
        """Where a leg leads to, clockwise from true north; from y where that is not known."""
        y_bearing_deg = (self.reference and self.reference.y_bearing_deg) or 0.0
        return (math.degrees(math.pi / 2 - heading_rad(leg)) + y_bearing_deg) % 360

    def clock(self, time_s: float) -> str:
        """A time of the mission as ISO 8601 has it, to a millisecond.

        Raises:
            ConfigError: no calendar has it.
        """
        try:
            moment = self.start + timedelta(milliseconds=round(time_s * 1e3))
        except OverflowError as error:
            raise ConfigError(
                f'{self.name}: {time_s:g} s after {self.start:%Y-%m-%d} is beyond the year 9999'
            ) from error
        return f'{moment:%Y-%m-%dT%H:%M:%S}.{moment.microsecond // 1000:03d}Z'


def mission_flights(
    log: MissionLog,
    site: Site,
    demand_bit: Floats,
    *,
    start: datetime,
    reference: GeoReference | None = None,
) -> MissionFlights:
    """What a log tells of flights.

    Args:
        demand_bit: data at each sensor at the start [bit], shape (S,).
        start: what the mission's time 0 is; in UTC.
        reference: where on Earth the area lies, if the scenario does not say it.
    """
    header, scenario = log.header, site.scenario
    return MissionFlights(
        name=f'{site.scenario.name}, mission seed {header.mission_seed}',
        site=site,
        mission_seed=header.mission_seed,
        start=start,
        demand_bit=demand_bit,
        flights=tuple(
            UavFlight(
                uav=uav.id,
                speed_mps=uav.speed_mps,
                take_off_m=in_fleet.start_m,
                stretches=stretches,
                has_landed=legs[-1].kind == HOME_LEG,
            )
            for uav, in_fleet, legs in zip(
                header.uavs, scenario.uavs, mission_legs(log, scenario), strict=True
            )
            if (stretches := stretches_of(legs))
        ),
        readings=mission_readings(log, site, demand_bit),
        reference=site.scenario.area.reference or reference,
    )


def stretches_of(legs: Sequence[FlownLeg]) -> tuple[FlownLeg, ...]:
    """Legs, those of a kind that lead straight on as one; of no length only after gaps."""
    stretches: list[FlownLeg] = []
    for leg in legs:
        if leg.kind != HOVER_LEG and leg.length_m == 0.0 and not leg.is_after_gap:
            continue
        if stretches and _leads_on(stretches[-1], leg):
            energy_j = stretches[-1].energy_j + leg.energy_j
            stretches[-1] = replace(
                stretches[-1], end_s=leg.end_s, end_m=leg.end_m, energy_j=energy_j
            )
        else:
            stretches.append(leg)
    return tuple(stretches)


def heading_rad(leg: FlownLeg) -> float:
    """Where a leg leads to, counter-clockwise from east."""
    (start_x_m, start_y_m), (end_x_m, end_y_m) = leg.start_m, leg.end_m
    return math.atan2(end_y_m - start_y_m, end_x_m - start_x_m)


def _leads_on(stretch: FlownLeg, leg: FlownLeg) -> bool:
    if stretch.kind != leg.kind or leg.kind == HOVER_LEG or leg.is_after_gap:
        return False
    turn_rad = math.remainder(heading_rad(leg) - heading_rad(stretch), math.tau)
    return abs(turn_rad) < _STRAIGHT_RAD

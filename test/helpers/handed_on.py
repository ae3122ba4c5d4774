"""Missions on the Earth to hand on, and lengths on the ellipsoid to measure what came of it."""

from collections.abc import Sequence
from datetime import datetime, UTC
from itertools import pairwise

from pyproj import Geod
from tiny_world import fly_scripts, tiny, uav
from uav_collect.handover.flights import mission_flights, MissionFlights
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import FORWARD, HOVER, RIGHT
from uav_collect.world.sensor_field import demand_of

# The point (50, 100) m of the area is at Enschede's.
REFERENCE = {'lat_deg': 52.22, 'lon_deg': 6.89, 'position_m': [50.0, 100.0]}
START = datetime(2026, 6, 1, 8, 0, tzinfo=UTC)
GEOD = Geod(ellps='WGS84')

# The first UAV reads A and flies on; the second flies straight on, turns, reads B; both fly home.
SCRIPTS = ([RIGHT, HOVER, RIGHT, RIGHT], [FORWARD, FORWARD, RIGHT, RIGHT, HOVER])


def on_earth(**overrides: object) -> Scenario:
    """The tiny world where the Earth is known; the second UAV lands away from its start."""
    fleet = (uav(5.0), uav(10.0, home_m=[60.0, 10.0]))
    return tiny(*fleet, area__reference=REFERENCE, **overrides)


def handed_on(scenario: Scenario, log: MissionLog) -> MissionFlights:
    site = build_site(scenario)
    return mission_flights(log, site, demand_of(site, log.header.mission_seed), start=START)


def flown_on_earth(*scripts: Sequence[int]) -> tuple[MissionFlights, MissionLog]:
    scenario = on_earth()
    log = fly_scripts(scenario, *(scripts or SCRIPTS))
    return handed_on(scenario, log), log


def lengths_m(places_deg: Sequence[tuple[float, float]]) -> list[float]:
    """The geodesics between places one after the other, given by longitude and latitude."""
    return [GEOD.inv(*here, *there)[2] for here, there in pairwise(places_deg)]

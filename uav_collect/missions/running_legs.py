"""The actions that UAVs are carrying out: from where to where they lead, and where they turn."""

from itertools import pairwise
import math
from typing import NamedTuple

from uav_collect.scenario.model import Point
from uav_collect.uav.actions import home_way_m
from uav_collect.uav.briefing import Briefing
from uav_collect.world.dynamics import FLYING_HOME, Mission


class Leg(NamedTuple):
    """The running action of a UAV: from where and when to where and when, and what it costs."""

    start_x_m: float
    start_y_m: float
    end_x_m: float
    end_y_m: float
    length_m: float
    start_s: float
    end_s: float
    energy_j: float


def running_leg(briefing: Briefing, mission: Mission, uav: int) -> Leg:
    """The running action of a UAV; of one that waits for its next, the action that is over."""
    corners_m = _corners_m(briefing, mission, uav)
    return Leg(
        start_x_m=mission.leg_start_x_m[uav],
        start_y_m=mission.leg_start_y_m[uav],
        end_x_m=mission.leg_end_x_m[uav],
        end_y_m=mission.leg_end_y_m[uav],
        length_m=math.fsum(math.dist(*ends_m) for ends_m in pairwise(corners_m)),
        start_s=mission.leg_start_s[uav],
        end_s=mission.leg_end_s[uav],
        energy_j=mission.energy_j[uav],
    )


def turns_by(
    briefing: Briefing, mission: Mission, uav: int, time_s: float
) -> list[tuple[float, Point]]:
    """When and where a UAV has turned by a time, on a way home around closed cells."""
    corners_m, leg = _corners_m(briefing, mission, uav), running_leg(briefing, mission, uav)
    turned, flown_m = [], 0.0
    for from_m, to_m in pairwise(corners_m[:-1]):
        flown_m += math.dist(from_m, to_m)
        at_s = leg.start_s + (leg.end_s - leg.start_s) * flown_m / leg.length_m
        if at_s <= time_s:
            turned.append((at_s, to_m))
    return turned


def _corners_m(briefing: Briefing, mission: Mission, uav: int) -> tuple[Point, ...]:
    """The corners of a UAV's running action, both ends included."""
    start_m = float(mission.leg_start_x_m[uav]), float(mission.leg_start_y_m[uav])
    if mission.phase[uav] == FLYING_HOME:
        return home_way_m(briefing, uav, start_m)
    return start_m, (float(mission.leg_end_x_m[uav]), float(mission.leg_end_y_m[uav]))

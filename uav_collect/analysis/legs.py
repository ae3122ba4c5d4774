"""The legs of a mission: where each UAV flew or hovered, from when to when, and what it took.

A leg is straight, and the UAV's speed on it is constant: places and energies at any time follow.
An action is one leg; the way home has one for each straight part of it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
import math

import numpy as np
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Point, Scenario
from uav_collect.uav.action_codes import COLUMN_STEP, HOME, HOVER, ROW_STEP
from uav_collect.uav.actions import home_way_m
from uav_collect.uav.briefing import brief, Briefing

MOVE_LEG = 'move'
HOVER_LEG = 'hover'
HOME_LEG = 'home'


@dataclass(frozen=True, kw_only=True)
class FlownLeg:
    """One straight part of a UAV's flight, or a hover."""

    uav: int  # id, from 1
    event: int  # the decision that it follows from, as the log numbers it
    kind: str  # MOVE_LEG, HOVER_LEG or HOME_LEG
    start_s: float
    end_s: float
    start_m: Point  # east and north of the area's south-west corner
    end_m: Point
    energy_left_j: float  # as it begins
    energy_j: float  # that it takes
    is_after_gap: bool  # the log lacks what the UAV decided just before

    @property
    def length_m(self) -> float:
        """How far it leads [m]; 0 of a hover."""
        return math.dist(self.start_m, self.end_m)


@dataclass(frozen=True, kw_only=True)
class UavState:
    """Where a UAV is at one time."""

    place_m: Point
    energy_left_j: float
    leg: FlownLeg | None  # None: after its last one


def mission_legs(log: MissionLog, scenario: Scenario) -> tuple[tuple[FlownLeg, ...], ...]:
    """The legs of each UAV, in the order in which it flew them; empty without any event of it."""
    briefing, uavs = brief(scenario), range(len(log.header.uavs))
    return tuple(tuple(_legs_of(log, briefing, index)) for index in uavs)


def state_at(legs: Sequence[FlownLeg], time_s: float) -> UavState | None:
    """Where a UAV is at a time; after its last leg, where that ended; None where the log lacks it.

    Args:
        legs: of the UAV, at least one.
        time_s: from 0.
    """
    leg = next((leg for leg in legs if time_s < leg.end_s), None)
    if leg is None:
        last = legs[-1]
        left_j = last.energy_left_j - last.energy_j
        return UavState(place_m=last.end_m, energy_left_j=left_j, leg=None)
    if time_s < leg.start_s and leg.is_after_gap:
        return None
    share = max(0.0, time_s - leg.start_s) / (leg.end_s - leg.start_s)  # it waits for its start
    return UavState(
        place_m=between_m(leg.start_m, leg.end_m, share),
        energy_left_j=leg.energy_left_j - share * leg.energy_j,
        leg=leg,
    )


def between_m(start_m: Point, end_m: Point, share: float) -> Point:
    """The place at a share of the straight way between two, 0..1."""
    (start_x_m, start_y_m), (end_x_m, end_y_m) = start_m, end_m
    return (
        start_x_m + (end_x_m - start_x_m) * share,
        start_y_m + (end_y_m - start_y_m) * share,
    )


def _legs_of(log: MissionLog, briefing: Briefing, index: int) -> Iterator[FlownLeg]:
    n_decisions = 0
    for event in log.events[log.events['uav'] == log.header.uavs[index].id]:
        is_after_gap = bool(event['decision'] != n_decisions)
        n_decisions = int(event['decision']) + 1
        if event['action'] == HOME:
            yield from _way_home(event, briefing, index, is_after_gap=is_after_gap)
        else:
            yield _action_leg(event, log.header.cell_size_m, is_after_gap=is_after_gap)


def _action_leg(event: np.void, cell_size_m: float, *, is_after_gap: bool) -> FlownLeg:
    east, north = COLUMN_STEP[event['action']], ROW_STEP[event['action']]
    start_m = float(event['x_m']), float(event['y_m'])
    return FlownLeg(
        uav=int(event['uav']),
        event=int(event['event']),
        kind=HOVER_LEG if event['action'] == HOVER else MOVE_LEG,
        start_s=float(event['time_s']),
        end_s=float(event['time_s'] + event['duration_s']),
        start_m=start_m,
        end_m=(start_m[0] + east * cell_size_m, start_m[1] + north * cell_size_m),
        energy_left_j=float(event['energy_left_j']),
        energy_j=float(event['energy_j']),
        is_after_gap=is_after_gap,
    )


def _way_home(
    event: np.void, briefing: Briefing, index: int, *, is_after_gap: bool
) -> Iterator[FlownLeg]:
    """The straight parts of a way home; time and energy are shared by length."""
    places_m = home_way_m(briefing, index, (float(event['x_m']), float(event['y_m'])))
    lengths_m = [math.dist(*ends_m) for ends_m in pairwise(places_m)]
    total_m, done_m = math.fsum(lengths_m), 0.0
    start_s, duration_s = float(event['time_s']), float(event['duration_s'])
    left_j, energy_j = float(event['energy_left_j']), float(event['energy_j'])
    for (start_m, end_m), length_m in zip(pairwise(places_m), lengths_m, strict=True):
        before, done_m = (done_m / total_m if total_m else 0.0), done_m + length_m
        after = done_m / total_m if end_m is not places_m[-1] else 1.0
        yield FlownLeg(
            uav=int(event['uav']),
            event=int(event['event']),
            kind=HOME_LEG,
            start_s=start_s + before * duration_s,
            end_s=start_s + after * duration_s,
            start_m=start_m,
            end_m=end_m,
            energy_left_j=left_j - before * energy_j,
            energy_j=(after - before) * energy_j,
            is_after_gap=is_after_gap and start_m is places_m[0],
        )

"""What each UAV of a recorded mission knew at each event: found by flying its actions again.

A log has how many cells a UAV knew to be complete, not which. They follow from the actions, for
what UAVs see and hear does; so no policy is needed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from uav_collect.errors import in_one_line, UavCollectError
from uav_collect.film.shown import new_runs, News, unpacked_maps
from uav_collect.kernels.arrays import Bools
from uav_collect.limits import NO_AGENT
from uav_collect.missions.given_actions import GivenActions
from uav_collect.missions.reflight import FlownBy, fly_again, Reflight
from uav_collect.recording.mission_log import MissionLog
from uav_collect.recording.mission_messages import MessagePlace
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import FAILSAFE, NONE

_AS_RECORDED = 'as recorded'
# What must come out again; rewards and reasons are those of who flew.
_PROVING = ('event', 'time_s', 'uav', 'x_m', 'y_m', 'action', 'energy_left_j', 'known_complete')


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """The cells that UAVs came to know as complete, by event."""

    news: Sequence[News] = ()
    problem: str | None = None  # why there is none, in one line


def news_of(log: MissionLog, site: Site) -> Knowledge:
    """What UAVs came to know in a mission, event by event.

    There is none of a mission that does not come out again as it was recorded.
    """
    n_events = _n_in_a_row(log)
    if n_events == 0:
        return Knowledge(problem=None if len(log.events) == 0 else 'its first event is missing')
    try:
        flown = _again(log, site, n_events)
    except UavCollectError as error:
        return Knowledge(problem=_no_knowledge(str(error)))
    if (problem := _difference(log, flown, n_events)) is not None:
        return Knowledge(problem=_no_knowledge(problem))
    return Knowledge(news=[*_news(flown, n_events, site.scenario.n_cells)])


def _no_knowledge(reason: str) -> str:
    return f'what UAVs knew is not shown: flown again, the mission differs: {in_one_line(reason)}'


def _n_in_a_row(log: MissionLog) -> int:
    """Events from the first one on, none of them missing."""
    missing = np.flatnonzero(log.events['event'] != np.arange(len(log.events)))
    return int(missing[0]) if missing.size else len(log.events)


def _again(log: MissionLog, site: Site, n_events: int) -> Reflight:
    """The mission flown by its own actions."""
    events = log.events[:n_events]
    crew = []
    for uav in log.header.uavs:
        actions = events['action'][events['uav'] == uav.id].tolist()
        flown_by = FlownBy(
            policy=GivenActions(actions, _AS_RECORDED), allocator=uav.allocator, guard_after=NONE
        )
        crew.append(None if uav.policy == NO_AGENT else flown_by)
    failsafes = events['event'][events['reason'] == FAILSAFE].tolist()
    return fly_again(
        *(site, log.header, crew),
        failsafes={*failsafes},
        n_events=n_events,
        faults=[fault for fault in log.faults if fault.event < n_events],
    )


def _difference(log: MissionLog, flown: Reflight, n_events: int) -> str | None:
    """How the flight differs from the log; None if it does not."""
    again = flown.log.events
    for number, event in enumerate(log.events[:n_events]):
        if number >= len(again):
            return f'event {number}: {flown.failure or "the mission was over"}'
        for name in _PROVING:
            if event[name] != again[number][name]:
                return f'event {number}: {name} is {again[number][name]}, not {event[name]}'
    return None


def _news(flown: Reflight, n_events: int, n_cells: int) -> Iterator[News]:
    """By event, the cells that each UAV has come to know as complete since the last one."""
    known: Bools = np.zeros((len(flown.log.header.uavs), n_cells), dtype=np.bool_)
    for number in range(n_events):
        packed = flown.messages[MessagePlace('epoch', 0, number)]['uav_complete']
        before, known = known, unpacked_maps(bytes(packed), n_cells)  # type: ignore[call-overload]
        yield new_runs(before, known)

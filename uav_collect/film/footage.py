"""What a film shows of a mission, as values of JSON that a page reads.

One record stands for one event: who decided what where, what a hover reads at which rate, what
each UAV has come to know by then. A mission that still flies is the same with fewer records.
"""

from collections.abc import Iterator, Sequence

from uav_collect.analysis.readings import mission_readings, Reading
from uav_collect.film.ghosts import Ghost
from uav_collect.film.knowledge import Knowledge, news_of
from uav_collect.film.shown import event_values, fault_values, opening, Values
from uav_collect.kernels.arrays import Floats
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.site import Site
from uav_collect.uav.briefing import briefing_of


def footage(
    log: MissionLog,
    site: Site,
    demand_bit: Floats,
    *,
    ghosts: Sequence[Ghost] = (),
    notes: Sequence[str] = (),
) -> Values:
    """All that a page needs to show a mission, to its end or so far.

    Args:
        demand_bit: data waiting at each sensor at the start [bit], shape (S,).
        ghosts: the same mission flown by others.
        notes: lines that the page shows above all.
    """
    knowledge = news_of(log, site)
    flown = flight('flown', log, site, demand_bit, knowledge)
    return {
        **opening(log.header, site, demand_bit),
        'flights': [flown, *(_ghost_flight(ghost, site, demand_bit) for ghost in ghosts)],
        'notes': [*notes, *([knowledge.problem] if knowledge.problem else [])],
    }


def flight(
    name: str, log: MissionLog, site: Site, demand_bit: Floats, knowledge: Knowledge
) -> Values:
    """The events of a mission as it was flown by somebody, and the faults in it.

    Args:
        demand_bit: as for `footage`.
    """
    readings: dict[int, list[Reading]] = {}
    for reading in mission_readings(log, site, demand_bit):
        readings.setdefault(reading.event, []).append(reading)
    return {
        'name': name,
        'is_over': log.is_over,
        'lacks_events': log.lacks_events,
        'knows': bool(knowledge.news),
        'events': [*_events(log, site, readings, knowledge)],
        'faults': [fault_values(fault) for fault in log.faults],
    }


def _ghost_flight(ghost: Ghost, site: Site, demand_bit: Floats) -> Values:
    return flight(ghost.name, ghost.log, site, demand_bit, Knowledge())


def _events(
    log: MissionLog, site: Site, readings: dict[int, list[Reading]], knowledge: Knowledge
) -> Iterator[Values]:
    briefing = briefing_of(site)
    for number, event in enumerate(log.events):
        news = knowledge.news[number] if number < len(knowledge.news) else []
        yield event_values(event, briefing, readings.get(int(event['event']), ()), news)

"""Ghosts: the mission of a film, of the same scenario and seed, as others fly it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from uav_collect.analysis.flown_plan import fly_plan
from uav_collect.errors import in_one_line, UavCollectError
from uav_collect.missions import rollout
from uav_collect.planning.bound import Bound
from uav_collect.recording.mission_log import MissionHeader, MissionLog
from uav_collect.scenario.site import Site

RULES = ('sweep', 'hert')
PLAN = 'clairvoyant plan'


@dataclass(frozen=True, kw_only=True)
class Ghost:
    """A flight beside the one of a film."""

    name: str
    log: MissionLog


@dataclass(frozen=True, kw_only=True)
class Ghosts:
    """Those that can be flown, and of each other one why it cannot."""

    flown: tuple[Ghost, ...]
    problems: tuple[str, ...]  # a line each


def ghosts_of(site: Site, header: MissionHeader, bound: Bound | None) -> Ghosts:
    """The mission as rules fly it, and as the shortest plan does.

    Args:
        header: of the mission; a rule that flew all of it is no ghost.
        bound: of the mission, if there is one.
    """
    flown: list[Ghost] = []
    problems: list[str] = []
    for name, fly in _flights(site, header, bound):
        try:
            flown.append(Ghost(name=name, log=fly()))
        except UavCollectError as error:  # the others can be flown all the same
            problems.append(f'{name}: {in_one_line(str(error))}')
    return Ghosts(flown=tuple(flown), problems=tuple(problems))


def _flights(
    site: Site, header: MissionHeader, bound: Bound | None
) -> Iterator[tuple[str, Callable[[], MissionLog]]]:
    """Who else could fly the mission, and what has them do so."""
    allocators = {uav.allocator for uav in header.uavs}
    allocator = 'equal' if allocators == {'equal'} else 'exact'
    for rule in RULES:
        if {uav.policy for uav in header.uavs} != {rule}:
            yield rule, partial(_fly_rule, site, header.mission_seed, rule, allocator)
    if bound is not None and bound.shortest is not None:
        plan = bound.shortest
        yield PLAN, partial(fly_plan, site, header.mission_seed, plan, allocator, PLAN)


def _fly_rule(site: Site, mission_seed: int, rule: str, allocator: str) -> MissionLog:
    [log] = rollout.fly(site, [mission_seed], rule, allocator)
    return log

"""Makes the film of a mission: one page that plays it, and others' flights beside it."""

from uav_collect.analysis.results import FlownMission
from uav_collect.film.footage import footage
from uav_collect.film.ghosts import ghosts_of
from uav_collect.film.page import film_page
from uav_collect.planning.bound import Bound


def mission_page(mission: FlownMission, bound: Bound | None) -> bytes:
    """The page of a mission, as HTML.

    Args:
        bound: whose shortest plan flies beside it; None: no plan does.
    """
    notes = [f'The film ends early: {mission.lack}.'] if mission.lack else []
    ghosts = ghosts_of(mission.site, mission.log.header, bound)
    notes += [f'Not flown beside it: {problem}' for problem in ghosts.problems]
    values = footage(
        mission.log, mission.site, mission.demand_bit, ghosts=ghosts.flown, notes=notes
    )
    return film_page(values)

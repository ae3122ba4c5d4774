"""The scenario that somebody asks a running world to fly, as they name it in a message."""

from uav_collect.errors import ConfigError
from uav_collect.scenario.load import fingerprint, from_yaml, load, scenario_names
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.actions import check_can_start
from uav_collect.uav.briefing import briefing_of


def requested_site(scenario: str) -> Site:
    """The site of a scenario that a fleet can fly.

    Args:
        scenario: the name of an installed one, or the text of a resolved one. No path: whoever
            asks may be on another machine, and is not to read the files of this one.

    Raises:
        ConfigError: there is none of that name, or it is not valid; in one line.
    """
    names = scenario_names()
    if '\n' not in scenario and scenario not in names:
        known = ', '.join(names)
        raise ConfigError(
            f'scenario {scenario[:80]!r} is unknown: must be one of {known}, or a resolved text'
        )
    try:
        site = build_site(load(scenario) if scenario in names else from_yaml(scenario))
        check_can_start(site.scenario, briefing_of(site))
    except ConfigError as error:
        raise ConfigError(error.summary) from error
    return site


class ScenariosOfWorld:
    """Those that one world has had, which its recordings tell apart by fingerprint alone."""

    def __init__(self) -> None:
        """Have had none yet."""
        self._named: dict[str, tuple[str, object, object]] = {}  # name and place by fingerprint

    def add(self, scenario: Scenario) -> None:
        """Take note of one.

        Raises:
            ConfigError: another one had its fingerprint.
        """
        area = scenario.area
        own = scenario.name, area.reference, area.crs
        known = self._named.setdefault(fingerprint(scenario), own)
        if known != own:
            raise ConfigError(
                f'scenario {scenario.name} differs from {known[0]}, which this world has had, by'
                ' its name or its place on Earth alone: start another world for it'
            )

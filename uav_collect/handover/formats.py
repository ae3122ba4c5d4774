"""The kinds of files that a mission is handed on as, and what files there are of each."""

from collections.abc import Callable, Iterator

from uav_collect.handover.flights import MissionFlights, UavFlight
from uav_collect.handover.geojson_file import geojson_file
from uav_collect.handover.kml_file import kml_file
from uav_collect.handover.mission_items import plan_file, waypoint_file
from uav_collect.handover.states_file import states_file


def files_of(
    kind: str, mission: MissionFlights, stem: str, rate_hz: float
) -> Iterator[tuple[str, bytes]]:
    """The files of a kind, one of `limits.HANDOVER_KINDS`: name and content of each.

    Args:
        stem: with which names begin.
        rate_hz: of states in a table.

    Raises:
        ConfigError: it is not known where on Earth the area lies, or the table would be too long.
    """
    match kind:
        case 'plan':
            yield from _by_uav(mission, stem, '.plan', plan_file)
        case 'mavlink':
            yield from _by_uav(mission, stem, '.waypoints', waypoint_file)
        case 'kml':
            yield f'{stem}.kml', kml_file(mission)
        case 'geojson':
            yield f'{stem}.geojson', geojson_file(mission)
        case 'csv':
            yield f'{stem}_states.csv', states_file(mission, rate_hz)
        case _:
            raise RuntimeError(f'no kind of file is called {kind!r}')


def _by_uav(
    mission: MissionFlights,
    stem: str,
    suffix: str,
    content: Callable[[MissionFlights, UavFlight], bytes],
) -> Iterator[tuple[str, bytes]]:
    for flight in mission.flights:
        yield f'{stem}_uav_{flight.uav}{suffix}', content(mission, flight)

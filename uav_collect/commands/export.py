"""Hands flights on: missions for ground stations, maps of the Earth, tables of states."""

import argparse
from collections.abc import Iterator
from datetime import datetime, UTC
import errno
from pathlib import Path
import sys
from typing import NamedTuple, TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options, report, terminal
from uav_collect.errors import ConfigError, MissionLogError
from uav_collect.kernels.compile import interpret_kernels
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import HANDOVER_KINDS

if TYPE_CHECKING:  # loaded when needed, so that --help answers at once
    from uav_collect.analysis.results import FlownMission
    from uav_collect.handover.flights import MissionFlights
    from uav_collect.scenario.model import GeoReference, Scenario

_DESCRIPTION = """
Writes what a fleet flew, or would fly by a plan that knows all demand, as files for other tools:
plan (QGroundControl) and mavlink (waypoint files, QGC WPL 110), one for each UAV, with take-off,
speed, a waypoint at each corner, a stay of whole seconds at each hover, and the landing; kml and
geojson, with times; csv, the state of each UAV at regular times. Heights in plan and mavlink are
above the take-off point, with home at 0 m above sea level: the terrain is not followed, so check
that nothing stands higher on the way. All but csv need to know where on Earth the area lies:
area.reference of the scenario. No file is replaced unless --force is given.
"""
_PLANS = ('shortest', 'thriftiest')
_START = '2000-01-01T00:00:00+00:00'
_RATE_HZ = options.number_from(1e-6, 1000.0, 'Hz')
_FIRST_YEAR = 1900


class _Source(NamedTuple):
    """A mission to hand on, and how its files begin."""

    mission: 'FlownMission'
    stem: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    parser.add_argument(
        'path', nargs='?', type=Path, metavar='PATH', help='run folder, mission log or bag'
    )
    parser.add_argument(
        '--plan',
        choices=_PLANS,
        help='instead of a recording, the plan that bound finds for a mission of known demand',
    )
    options.add_scenario_options(parser)
    options.add_seed_option(parser, 'seed of the mission that is planned')
    options.add_allocator_option(parser)
    _add_files(parser)
    _add_origins(parser)


def _add_files(parser: argparse.ArgumentParser) -> None:
    """Which files are written, and where."""
    parser.add_argument(
        '--to', nargs='+', required=True, choices=HANDOVER_KINDS, help='kinds of files to write'
    )
    parser.add_argument(
        '--output',
        type=options.output,
        metavar='FOLDER',
        help='where to write (default: beside the recording; of a plan: here)',
    )
    parser.add_argument(
        '--rate-hz',
        type=_RATE_HZ,
        default=1.0,
        metavar='HZ',
        help='states per second of simulated time, of csv (default: %(default)g)',
    )
    parser.add_argument('--force', action='store_true', help='replace files that are there')


def _add_origins(parser: argparse.ArgumentParser) -> None:
    """When and where missions begin."""
    parser.add_argument(
        '--start',
        type=_moment,
        default=_moment(_START),
        metavar='TIME',
        help=f'when the mission starts, of kml and geojson, as ISO 8601 (default: {_START})',
    )
    parser.add_argument(
        '--reference',
        nargs=2,
        type=float,
        metavar=('LAT', 'LON'),
        help="where the area's south-west corner lies [deg], if the scenario does not say it; its"
        ' y must be true north, which that of a map grid is not',
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the files; returns the exit status."""
    _check(arguments)
    if arguments.path is not None and 'numba' not in sys.modules:
        interpret_kernels()  # one mission is read again in less time than kernels take to load
    reference = _reference(arguments.reference)
    contents: dict[Path, bytes] = {}
    for mission, stem in _sources(arguments):
        if mission.lack:
            terminal.say(f'warning: {stem}: {mission.lack}; its files hold what there is')
        with waiting_for('the files of a mission'):
            contents |= _files(arguments, mission, stem, reference)
    if not contents:
        raise MissionLogError('export: no flight of any UAV is known: there is nothing to hand on')
    _write(contents, is_forced=arguments.force)
    for path in contents:
        print(path)
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """Raise ConfigError unless one thing is to be handed on, once."""
    if (arguments.path is None) == (arguments.plan is None):
        raise ConfigError('export: must be given either PATH, a recording, or --plan')
    if len(set(arguments.to)) < len(arguments.to):
        raise ConfigError(f'--to {" ".join(arguments.to)}: names one twice')
    is_chosen = arguments.scenario != options.DEFAULT_SCENARIO or arguments.set or arguments.uavs
    is_chosen = is_chosen or arguments.seed or arguments.bandwidth != options.DEFAULT_ALLOCATOR
    if arguments.path is not None and is_chosen:
        raise ConfigError(
            f'{arguments.path}: tells its scenario and seed itself; --scenario, --set, --uavs,'
            ' --seed and --bandwidth are for --plan'
        )


def _sources(arguments: argparse.Namespace) -> Iterator[_Source]:
    """The missions to hand on."""
    if arguments.plan is not None:
        yield _planned(arguments)
        return
    seen: dict[str, int] = {}
    for mission, _, source in report.missions_at(arguments.path, report.refuse):
        _check_reference(arguments, mission.site.scenario)
        _check_log(mission, source)
        name = mission.site.scenario.name
        stem = f'{name}_seed_{mission.log.header.mission_seed}'
        seen[stem] = seen.get(stem, 0) + 1
        yield _Source(mission, stem if seen[stem] == 1 else f'{stem}_{seen[stem]}')


def _check_reference(arguments: argparse.Namespace, scenario: 'Scenario') -> None:
    """Raise ConfigError where the area already lies somewhere on Earth, and is given a place."""
    own = scenario.area.reference
    if arguments.reference is not None and own is not None:
        raise ConfigError(
            f'--reference {" ".join(f"{it:g}" for it in arguments.reference)}: must be left out,'
            f' as {scenario.name} has its own area.reference, {own.lat_deg:g} {own.lon_deg:g} deg'
        )


def _check_log(mission: 'FlownMission', source: Path) -> None:
    """Raise MissionLogError, naming its file, unless the log of a whole mission adds up."""
    from uav_collect.analysis.metrics import check_log

    try:
        if mission.is_whole:
            check_log(mission.log)
    except MissionLogError as error:
        raise MissionLogError(f'{source}: {error}') from error


def _planned(arguments: argparse.Namespace) -> _Source:
    """The mission that flies a clairvoyant plan."""
    from uav_collect.analysis.flown_plan import fly_plan
    from uav_collect.analysis.results import flown_mission
    from uav_collect.planning.bound import bound_of
    from uav_collect.scenario.site import build_site

    scenario = options.scenario_of(arguments)
    _check_reference(arguments, scenario)
    site, seed, allocator = build_site(scenario), arguments.seed, arguments.bandwidth
    with waiting_for('the plans of a fleet that knows all demand'):
        bound = bound_of(site, seed, allocator)
    plan = bound.shortest if arguments.plan == 'shortest' else bound.thriftiest
    if plan is None:
        raise ConfigError(
            f'{scenario.name}, seed {seed}: no {arguments.plan} plan within the energy budgets was'
            ' found: must have larger ones, or less data'
        )
    log = fly_plan(site, seed, plan, allocator, f'{arguments.plan} plan')
    return _Source(flown_mission(log, site), f'{scenario.name}_seed_{seed}_{arguments.plan}')


def _files(
    arguments: argparse.Namespace,
    mission: 'FlownMission',
    stem: str,
    reference: 'GeoReference | None',
) -> dict[Path, bytes]:
    """The files of a mission, by where they go; none where no flight is known."""
    from uav_collect.handover.flights import mission_flights
    from uav_collect.handover.formats import files_of

    flights = mission_flights(
        mission.log,
        mission.site,
        mission.demand_bit,
        start=arguments.start,
        reference=reference,
    )
    flown = {flight.uav for flight in flights.flights}
    for uav in mission.log.header.uavs:
        if uav.id not in flown:
            terminal.say(f'{stem}: UAV {uav.id} {_why_no_flight(mission, uav.id)}')
    if not flown:
        return {}
    folder = arguments.output or _beside(arguments.path)
    contents = {
        folder / name: content
        for kind in arguments.to
        for name, content in files_of(kind, flights, stem, arguments.rate_hz)
    }
    if {'plan', 'mavlink'} & {*arguments.to}:
        _say_shared_homes(flights, stem)
    return contents


def _why_no_flight(mission: 'FlownMission', uav: int) -> str:
    is_all_there = mission.is_whole or mission.given_up is not None
    if is_all_there or uav in mission.log.events['uav']:
        return 'stayed on the ground: it has no flight'
    return 'has no flight: none of its decisions was recorded, it is not known whether it flew'


def _say_shared_homes(flights: 'MissionFlights', stem: str) -> None:
    """Write which UAVs take off at one place, as all of them fly at one height."""
    by_home: dict[tuple[float, float], list[str]] = {}
    for flight in flights.flights:
        by_home.setdefault(flight.take_off_m, []).append(str(flight.uav))
    for uavs in by_home.values():
        if len(uavs) > 1:
            terminal.say(
                f'warning: {stem}: UAVs {", ".join(uavs)} take off and land at one place and fly '
                f'at one height, {flights.altitude_m:g} m: let them start one after the other'
            )


def _beside(path: Path | None) -> Path:
    """The folder that files go to: that of a recording, or the one around it."""
    if path is None:
        return Path.cwd()
    from uav_collect.recording.mission_folder import is_bag

    return path if path.is_dir() and not is_bag(path) else path.resolve().parent


def _write(contents: dict[Path, bytes], *, is_forced: bool) -> None:
    """Write all files, none over another unless that is wanted.

    Raises:
        ConfigError: a file is there.
        OSError: a file cannot be written, naming it.
    """
    there = [path for path in contents if path.exists()]
    if there and not is_forced:
        more = f', and {len(there) - 1} more of its files' if len(there) > 1 else ''
        raise ConfigError(f'{there[0]}: is there{more}: must be given --force to replace it')
    for folder in {path.parent for path in contents}:
        if folder.exists() and not folder.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, 'must be a folder', str(folder))
        folder.mkdir(parents=True, exist_ok=True)
    for path in contents:
        files.check_writable(path)
    for path, content in contents.items():
        files.write_atomically(path, content)


def _reference(corner_deg: list[float] | None) -> 'GeoReference | None':
    """Where on Earth the area lies, by its south-west corner."""
    from uav_collect.scenario.model import GeoReference

    if corner_deg is None:
        return None
    lat_deg, lon_deg = corner_deg
    if not (-89.0 <= lat_deg <= 89.0 and -180.0 <= lon_deg <= 180.0):
        raise ConfigError(
            f'--reference {lat_deg:g} {lon_deg:g}: must be a latitude from -89 to 89 deg and a'
            ' longitude from -180 to 180 deg'
        )
    return GeoReference(lat_deg=lat_deg, lon_deg=lon_deg, position_m=(0.0, 0.0))


def _moment(text: str) -> datetime:
    """A type for argparse: a time of the calendar, in UTC."""
    try:
        moment = datetime.fromisoformat(text)
        if moment.tzinfo is not None and moment.year >= _FIRST_YEAR:
            return moment.astimezone(UTC)
    except (ValueError, OverflowError):
        pass
    raise argparse.ArgumentTypeError(
        f'{text!r} must be a time from {_FIRST_YEAR} on with its zone, such as'
        ' 2026-06-01T08:00:00Z'
    )

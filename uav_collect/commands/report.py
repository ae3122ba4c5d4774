"""Shows missions that were flown: a table each, and a picture of the trajectories beside them."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import terminal
from uav_collect.errors import BagError, in_one_line, MissionLogError
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import UNUSABLE
from uav_collect.recording.mission_folder import is_bag, scenario_file, take_log
from uav_collect.recording.mission_log import MissionHeader, MissionLog, read_so_far

if TYPE_CHECKING:  # loaded when needed, so that --help answers at once
    from rich.console import Console
    from uav_collect.api import FlownMission
    from uav_collect.planning.bound import Bound
    from uav_collect.scenario.model import Scenario
    from uav_collect.scenario.site import Site

_DESCRIPTION = """
Prints, for each mission found, data collected [Mbit], energy [kJ], completion time [s], energy
efficiency [kbit/J], decisions, messages and each UAV's part, and draws the trajectories into a PNG
file beside it. PATH is a run folder, a mission log (.jsonl) or a bag; a bag needs nothing else.
What the bag of a run folder lacks, the mission log tells. What is damaged is named, the figures of
what is whole are shown with a warning. The exit status is 0 if missions were shown, 2 if one could
not be read or drawn.
"""
# What a disk or Matplotlib, its fonts and its renderer raise; all else is a mistake of ours.
_DRAWING_ERRORS = (MemoryError, OSError, OverflowError, RuntimeError, ValueError)
_LOG_SUFFIX = '.jsonl'
_MAX_DATA_CELLS = 200  # on average, up to which a mission's bound takes some seconds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    parser.add_argument('path', type=Path, metavar='PATH', help='run folder, mission log or bag')
    parser.add_argument(
        '--pictures', type=Path, metavar='FOLDER', help='where to draw to (default: beside PATH)'
    )


def run(arguments: argparse.Namespace) -> int:
    """Report the missions at the path; returns the exit status."""
    from uav_collect.analysis.console import plain_console

    console, n_lacking = plain_console(), 0
    for mission, picture, source in _find(arguments.path):
        file = (arguments.pictures or picture.parent) / picture.name
        try:
            n_lacking += not show(mission, file, console)
        except MissionLogError as error:
            raise MissionLogError(f'{source}: {error}') from error
    return UNUSABLE if n_lacking else 0


def show(mission: 'FlownMission', picture: Path, console: 'Console') -> bool:
    """Print a mission's tables and draw its picture; whether that could be drawn.

    Raises:
        MissionLogError: the log of a whole mission does not add up.
    """
    from uav_collect.analysis.metrics import check_log
    from uav_collect.analysis.tables import mission_tables

    if mission.is_whole:
        check_log(mission.log)
    header, n_messages = mission.log.header, mission.n_radio_messages
    bound = mission_bound(header, mission.site)
    console.print(mission_tables(header, mission.metrics, n_messages, bound))
    if not mission.is_whole:
        what = 'warning: not all of the mission was recorded, or some of it is damaged;'
        rest = ' these are the figures of what is whole'
        console.print(what + rest, style='bold red')
    try:
        with waiting_for('the picture'):
            mission.draw(picture)
    except _DRAWING_ERRORS as error:  # the other missions have tables, too
        reason = in_one_line(str(getattr(error, 'strerror', None) or error))
        terminal.say(f'error: {picture}: cannot be drawn: {reason}')
        return False
    console.print(f'picture: {picture}', soft_wrap=True)
    return True


def mission_bound(header: MissionHeader, site: 'Site') -> 'Bound | None':
    """The clairvoyant bound of a mission; None where that takes too long."""
    import numpy as np
    from uav_collect.planning.bound import bound_of

    share, n_cells = site.scenario.demand.cell_share, np.unique(site.cell).size
    n_wanted = site.scenario.n_cells * (1.0 if share == 'all' else share)
    if min(n_wanted, n_cells) > _MAX_DATA_CELLS:
        return None
    is_equal = all(uav.allocator == 'equal' for uav in header.uavs)
    with waiting_for('the plans of a fleet that knows all demand'):
        return bound_of(site, header.mission_seed, 'equal' if is_equal else 'exact')


def _find(path: Path) -> Iterator[tuple['FlownMission', Path, Path]]:
    """The missions at a path, each with where its picture goes, and the log or bag it is from."""
    files.check_there(path)
    if is_bag(path):
        yield from ((*found[:2], path) for found in _recorded(path, path.resolve().parent))
    elif not path.is_dir():
        yield _logged(path), path.with_suffix('.png'), path
    elif bags := [each for each in sorted(path.iterdir()) if is_bag(each)]:
        yield from _of_run(bags, path)  # bags know more than logs: messages, sensors as they were
    elif logs := sorted(path.glob(f'*{_LOG_SUFFIX}')):
        for log in logs:
            yield _logged(log), log.with_suffix('.png'), log
    else:
        raise MissionLogError(f'{path}: holds no mission log ({_LOG_SUFFIX}) and no bag')


def _of_run(bags: Sequence[Path], folder: Path) -> Iterator[tuple['FlownMission', Path, Path]]:
    """The missions of a run folder: by its bags, or where these lack something by their logs.

    Raises:
        BagError: a bag cannot be read, and no log tells its missions; after all that can be read.
    """
    logs = {log.name: log for log in sorted(folder.glob(f'*{_LOG_SUFFIX}'))}
    is_logged, unread = bool(logs), []
    for bag in bags:
        try:
            missions = [*_recorded(bag, folder)]
        except BagError as error:
            if is_logged:
                terminal.say(f'{error}; the figures are those of the mission log')
            else:
                unread.append(error)
            continue
        for mission, picture, index in missions:
            log = take_log(logs, mission.log.header.mission_seed, index)
            yield (mission if log is None else _fuller(mission, bag, log)), picture, bag
    for log in logs.values():
        yield _logged_so_far(log), log.with_suffix('.png'), log
    if unread:  # after those that can be read
        for problem in unread[:-1]:
            terminal.say_error(problem)
        raise unread[-1]


def _fuller(recorded: 'FlownMission', bag: Path, log: Path) -> 'FlownMission':
    """The mission of a bag, or of its log where that holds more of it."""
    if recorded.is_whole:
        return recorded
    logged = _logged_so_far(log)
    n_lacking = len(logged.log.events) - len(recorded.log.events)
    if n_lacking <= 0:
        return recorded
    terminal.say(f'{bag}: lacks {n_lacking} events; the figures are those of {log.name}')
    return logged


def _logged_so_far(log: Path) -> 'FlownMission':
    """The mission of a log that may have been cut off."""
    from uav_collect.analysis.metrics import check_log

    mission = _logged(log)
    try:
        check_log(mission.log)
    except MissionLogError:
        return replace(mission, is_whole=False)
    return mission


def _logged(path: Path) -> 'FlownMission':
    from uav_collect.api import flown_mission
    from uav_collect.scenario.site import build_site

    log = read_so_far(path)
    file = scenario_file(path.parent, log.header.scenario_fingerprint)
    mission = flown_mission(log, build_site(_scenario_of(log, file)))
    return replace(mission, is_whole=log.is_over)


def _scenario_of(log: MissionLog, file: Path) -> 'Scenario':
    """The scenario of a log: in the file beside it, or a shipped one that did not change since."""
    from uav_collect.scenario.load import fingerprint, from_file, load, scenario_names

    scenario = None
    if file.is_file():
        scenario = from_file(file)
    elif log.header.scenario in scenario_names():
        scenario = load(log.header.scenario)
    wanted = log.header.scenario_fingerprint
    if scenario is None or fingerprint(scenario) != wanted:
        raise MissionLogError(
            f'{file}: must be the scenario of the log, {log.header.scenario} with fingerprint'
            f' {wanted}, got {fingerprint(scenario) if scenario else "no such file"}'
        )
    return scenario


def _recorded(path: Path, pictures: Path) -> Iterator[tuple['FlownMission', Path, int]]:
    """The missions of a bag, each with where its picture goes and its running number."""
    from uav_collect.api import FlownMission
    from uav_collect.recording.bag_reader import read_recording

    seeds = set()
    recording = read_recording(path)
    for damage in recording.damages:
        terminal.say(damage)
    if recording.damages:
        terminal.say(f'recorder --repair {path} keeps what is whole')
    for recorded in recording.missions:
        mission = FlownMission(
            log=recorded.log,
            site=recorded.site,
            demand_bit=recorded.demand_bit,
            n_radio_messages=recorded.n_radio_messages,
            is_whole=recorded.is_complete,
        )
        seed, index = recorded.log.header.mission_seed, recorded.index
        again = f'_{index}' if seed in seeds else ''
        seeds.add(seed)
        yield mission, pictures / f'trajectories_seed_{seed}{again}.png', index

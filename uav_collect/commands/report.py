"""Shows missions that were flown: a table each, and a picture of the trajectories beside them."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
import sys
from typing import NoReturn, TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options, terminal
from uav_collect.errors import (
    BagError,
    counted,
    FilmError,
    in_one_line,
    MissionLogError,
    StoreError,
    UavCollectError,
)
from uav_collect.kernels.compile import interpret_kernels
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import UNUSABLE
from uav_collect.recording.mission_folder import BAG_FOLDER, is_bag, scenario_file, take_log
from uav_collect.recording.mission_log import MissionHeader, MissionLog, read_so_far

if TYPE_CHECKING:  # loaded when needed, so that --help answers at once
    from rich.console import Console
    from uav_collect.analysis.readings import Reading
    from uav_collect.analysis.results import FlownMission
    from uav_collect.planning.bound import Bound
    from uav_collect.scenario.model import Scenario
    from uav_collect.scenario.site import Site

_DESCRIPTION = """
Prints, for each mission found, data collected [Mbit], energy [kJ], completion time [s], energy
efficiency [kbit/J], decisions, messages and each UAV's part, and draws the trajectories into a PNG
file beside it; on request it makes a film, as a page (--html) or as GIF or MP4. PATH is a run
folder, a mission log (.jsonl) or a bag, which needs nothing else. What is missing in the bag of a
run folder is taken from the mission log. Damage is named, and what is intact is shown with a
warning. A file that cannot be read is named, and the others are shown. The exit status is 0 if all
missions were shown, 2 if one could not be read, drawn or written.
"""
# What a disk or Matplotlib, its fonts and its renderer raise; all else is a mistake of ours.
_DRAWING_ERRORS = (MemoryError, OSError, OverflowError, RuntimeError, ValueError)
_UNREADABLE = (OSError, UavCollectError)  # what is raised by a recording that is not one, say
_LOG_SUFFIX = '.jsonl'
_Found = tuple['FlownMission', Path, Path]  # with where its picture goes, and what it is from
_NameUnread = Callable[[Exception], None]  # gets why a log or a bag cannot be read
_MAX_DATA_CELLS = 200  # on average, up to which a mission's bound takes some seconds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    parser.add_argument('path', type=Path, metavar='PATH', help='run folder, mission log or bag')
    parser.add_argument(
        '--pictures',
        type=Path,
        metavar='FOLDER',
        help="where to draw to, made if there is none; names begin with that of the recording's"
        ' folder (default: beside PATH)',
    )
    parser.add_argument(
        '--readings',
        action='store_true',
        help='also show which sensor was read when, by which UAV, and at which rate',
    )
    parser.add_argument(
        '--csv', type=options.output, metavar='FILE', help='write these readings, one row for each'
    )
    parser.add_argument(
        '--gif', type=options.output, metavar='FILE', help='write a film of the mission as GIF'
    )
    parser.add_argument(
        '--mp4', type=options.output, metavar='FILE', help='the same as MP4, which needs ffmpeg'
    )
    parser.add_argument(
        '--html', action='store_true', help='also make a film, as one page that plays the mission'
    )


def run(arguments: argparse.Namespace) -> int:
    """Report the missions at the path, and who was chosen to fly them; returns the exit status."""
    if 'numba' not in sys.modules:  # all that a mission takes is less than kernels take to load
        interpret_kernels()
    from uav_collect.analysis.choice_file import read_choice
    from uav_collect.analysis.console import plain_console

    try:
        if (choice := read_choice(arguments.path)) is not None:
            plain_console().print(f'{choice}\n', soft_wrap=True)
    except StoreError as error:  # the missions are whole all the same
        terminal.say(str(error))
    return show_missions(arguments)


def show_missions(arguments: argparse.Namespace) -> int:
    """Report the missions at the path; returns the exit status."""
    from uav_collect.analysis.console import plain_console
    from uav_collect.analysis.reading_table import reading_table
    from uav_collect.analysis.readings import readings_csv

    options.check_outputs(arguments.csv, arguments.gif, arguments.mp4)
    console, n_lacking = plain_console(), 0
    readings: list[tuple[int, Sequence[Reading]]] = []
    unread = _Unread()
    if arguments.gif or arguments.mp4:
        missions = iter([_to_film(arguments)])
    else:
        missions = missions_at(arguments.path, unread.name)
    is_first = arguments.path.is_dir() and not is_bag(arguments.path)
    for mission, picture, source in missions:
        if arguments.pictures is not None:
            with suppress(OSError):  # who draws there says what is wrong; tables come all the same
                arguments.pictures.mkdir(parents=True, exist_ok=True)
        file = _place(picture, arguments.pictures)
        try:
            n_lacking += not show(mission, file, console)
            _write_films(mission, arguments.gif, arguments.mp4)
        except MissionLogError as error:
            unread.name(MissionLogError(f'{source}: {error}'))
            continue
        if arguments.html:
            name = _film_name(picture, is_first=is_first)
            film = _place(picture.with_name(name), arguments.pictures)
            n_lacking += not leave_film(mission, film, console)
        is_first = False
        if arguments.readings:
            console.print(reading_table(mission.readings))
        if arguments.csv is not None:
            readings.append((mission.log.header.mission_seed, mission.readings))
    if readings:
        n_lacking += not terminal.write_files({arguments.csv: readings_csv(readings)})
    return UNUSABLE if n_lacking or unread.named else 0


class _Unread:
    """What could not be read, and why; said once, as many logs may lack the same scenario."""

    def __init__(self) -> None:
        self.named: set[str] = set()

    def name(self, error: Exception) -> None:
        """Write a line, unless it was written before."""
        if str(error) not in self.named:
            terminal.say_error(error)
            self.named.add(str(error))


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
    console.print(mission_tables(header, mission.metrics, n_messages, bound, mission.unread))
    if mission.lack:
        text = f'warning: {mission.lack}; these are the figures of what there is'
        console.print(text, style='bold red', markup=False, highlight=False)
    try:
        with waiting_for('the picture'):
            mission.draw(picture)
    except _DRAWING_ERRORS as error:  # the other missions have tables, too
        reason = in_one_line(str(getattr(error, 'strerror', None) or error))
        terminal.say(f'error: {picture}: cannot be drawn: {reason}')
        return False
    console.print(f'picture: {picture}', soft_wrap=True)
    return True


def _to_film(arguments: argparse.Namespace) -> _Found:
    """The one mission that a film is asked for; what is in the way is said before any work.

    Raises:
        FilmError: there are several, or there is no ffmpeg for an MP4.
        OSError, UavCollectError: a log or a bag cannot be read.
    """
    from uav_collect.film.animation import check_ffmpeg

    if arguments.mp4:
        check_ffmpeg()
    found = [*missions_at(arguments.path, refuse)]
    if len(found) != 1:
        where = f'{arguments.path} holds {len(found)}'
        raise FilmError(f'a film shows one mission, {where}: PATH must be the log of one')
    return found[0]


def _write_films(mission: 'FlownMission', gif: Path | None, mp4: Path | None) -> None:
    if gif is None and mp4 is None:
        return
    from uav_collect.film import animation

    film = animation.film_of(mission.log, mission.site, mission.demand_bit)
    for path, write in ((gif, animation.write_gif), (mp4, animation.write_mp4)):
        if path is not None:
            with terminal.progress_bar(film.n_frames, 'frames') as advance:
                write(film, path, advance)
            terminal.say(f'film: {path}')


def _place(file: Path, pictures: Path | None) -> Path:
    """Where a file goes that would lie beside a recording: other folders may have its like."""
    if pictures is None:
        return file
    return pictures / f'{file.parent.resolve().name}_{file.name}'


def _film_name(picture: Path, *, is_first: bool) -> str:
    """The file of a mission's film; the first one of a folder has the short name."""
    return 'film.html' if is_first else f'film_{picture.stem.removeprefix("trajectories_")}.html'


def leave_film(mission: 'FlownMission', file: Path, console: 'Console') -> bool:
    """Write the film of a mission; whether the disk took it."""
    from uav_collect.film.mission_page import mission_page

    bound = mission_bound(mission.log.header, mission.site)
    with waiting_for('the same mission by rules'):
        page = mission_page(mission, bound)
    if not terminal.write_files({file: page}):
        return False
    console.print(f'film: {file}', soft_wrap=True)
    return True


def mission_bound(header: MissionHeader, site: 'Site') -> 'Bound | None':
    """The clairvoyant bound of a mission; None where that takes too long."""
    import numpy as np
    from uav_collect.planning.bound import bound_of
    from uav_collect.scenario.area import mean_data_cells

    if min(mean_data_cells(site.scenario), np.unique(site.cell).size) > _MAX_DATA_CELLS:
        return None
    is_equal = all(uav.allocator == 'equal' for uav in header.uavs)
    with waiting_for('the plans of a fleet that knows all demand'):
        return bound_of(site, header.mission_seed, 'equal' if is_equal else 'exact')


def refuse(error: Exception) -> NoReturn:
    """Do nothing with missions unless all can be read."""
    raise error


def missions_at(path: Path, name_unread: _NameUnread) -> Iterator[_Found]:
    """The missions at a path, each with where its picture goes, and the log or bag it is from.

    Args:
        name_unread: is given why a log or a bag cannot be read; unless it raises, others follow.

    Raises:
        OSError: there is nothing at the path; naming it.
        MissionLogError: it is a folder without logs and bags.
    """
    files.check_there(path)
    if is_bag(path):
        yield from _of_bags([path], path.resolve().parent, {}, name_unread)
    elif not path.is_dir():
        yield from _of_logs([path], _logged, name_unread)
    elif bags := [each for each in sorted(path.iterdir()) if is_bag(each)]:
        # Bags know more than logs: messages, sensors as they were.
        logs = {log.name: log for log in sorted(path.glob(f'*{_LOG_SUFFIX}'))}
        yield from _of_bags(bags, path, logs, name_unread)
        yield from _of_logs([*logs.values()], _logged_so_far, name_unread)
    elif found := sorted(path.glob(f'*{_LOG_SUFFIX}')):
        yield from _of_logs(found, _logged, name_unread)
    else:
        raise MissionLogError(f'{path}: holds no mission log ({_LOG_SUFFIX}) and no bag')


def _of_bags(
    bags: Sequence[Path], pictures: Path, logs: dict[str, Path], name_unread: _NameUnread
) -> Iterator[_Found]:
    """The missions of bags, or where these lack something of their logs.

    Args:
        pictures: where these go.
        logs: of the run, by name; those of missions in the bags are taken out.
    """
    is_logged = bool(logs)
    for bag in bags:
        try:
            missions = [*_recorded(bag, pictures)]
        except _UNREADABLE as error:
            if is_logged and isinstance(error, BagError):
                terminal.say(f'{error}; the figures are those of the mission log')
            else:
                name_unread(error)
            continue
        for mission, picture, index in missions:
            log = take_log(logs, mission.log.header.mission_seed, index)
            if log is None or mission.is_whole:
                yield mission, picture, bag
            else:
                yield _fuller(mission, bag, log, name_unread), picture, bag


def _of_logs(
    logs: Iterable[Path], read: Callable[[Path], 'FlownMission'], name_unread: _NameUnread
) -> Iterator[_Found]:
    for log in logs:
        try:
            mission = read(log)
        except _UNREADABLE as error:
            name_unread(error)
            continue
        yield mission, log.with_suffix('.png'), log


def _fuller(
    recorded: 'FlownMission', bag: Path, log: Path, name_unread: _NameUnread
) -> 'FlownMission':
    """The mission of a bag that lacks something, or of its log where that holds more of it."""
    try:
        logged = _logged_so_far(log)
    except _UNREADABLE as error:
        name_unread(error)
        return recorded
    n_lacking = len(logged.log.events) - len(recorded.log.events)
    if n_lacking <= 0:
        return recorded
    lacking = counted(n_lacking, 'event')
    terminal.say(f'{bag}: lacks {lacking}; the figures are those of {log.name}')
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
    from uav_collect.analysis.results import flown_mission
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
    from uav_collect.analysis.results import FlownMission
    from uav_collect.recording.bag_reader import read_recording

    seeds = set()
    bag = path.resolve().name  # of another name: more may lie in its folder
    whose = '' if bag == BAG_FOLDER else f'{bag}_'
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
            given_up=recorded.given_up,
        )
        seed, index = recorded.log.header.mission_seed, recorded.index
        again = f'_{index}' if seed in seeds else ''
        seeds.add(seed)
        yield mission, pictures / f'trajectories_{whose}seed_{seed}{again}.png', index

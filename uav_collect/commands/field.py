"""Makes a scenario of a list of loggers: proposes cells, fleet and base; writes file and map."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
import re
import shlex
import tempfile
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options
from uav_collect.config.arguments import program_name
from uav_collect.errors import ConfigError
from uav_collect.kernels.compile import interpret_kernels
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import is_name, MAX_NAME, MAX_UAVS, NAME_ALLOWED

if TYPE_CHECKING:  # loaded when needed, so that --help answers at once
    from uav_collect.fields.proposal import Proposal
    from uav_collect.fields.survey import Survey
    from uav_collect.scenario.model import Scenario
    from uav_collect.scenario.places import ReadOptions

_DESCRIPTION = """
Reads where loggers stand, proposes cells as large as the radio allows, a base and a fleet, and
writes a scenario, NAME.yaml, with the unit of each value and the reason for it, and a map,
NAME.png. LIST is a table (CSV, TSV, xlsx) or a map (GeoJSON, KML, KMZ). All its problems are
reported at once. Defaults that are not given here are in config/fields/usual.yaml. The exit status
is 0 if both files were written, 2 if not.
"""
_LENGTH = options.number_from(0.1, 10_000.0, 'm')
_COLUMNS_KEY = re.compile(r'\bcolumns: \{([^{}]*)\}')
_OTHER_KEY = re.compile(r'\b(doubles|blanks|crs): (?=first|last|skip|EPSG)')
_URL = re.compile('[A-Za-z][A-Za-z0-9+.-]+://')


@dataclass(frozen=True, kw_only=True)
class _Outputs:
    """The files that are written."""

    scenario: Path
    picture: Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    parser.add_argument('list', metavar='LIST', help='the loggers and where they stand')
    parser.add_argument(
        '--uavs',
        type=options.whole_number(1, MAX_UAVS),
        default=2,
        metavar='N',
        help='how many fly (default: %(default)s)',
    )
    _add_reading(parser)
    _add_proposed(parser)
    parser.add_argument(
        '--output',
        type=options.output,
        default=Path('.'),
        metavar='FOLDER',
        help='where to write to (default: here)',
    )
    parser.add_argument('--name', help="of the scenario and its files (default: the list's name)")
    parser.add_argument(
        '--force', action='store_true', help='write over files that are there already'
    )


def _add_reading(parser: argparse.ArgumentParser) -> None:
    """What says how the list is to be read."""
    parser.add_argument(
        '--columns',
        metavar='KEY=COLUMN,...',
        help='the meaning of columns whose names do not show it: id=station,lat=Y,lon=X',
    )
    parser.add_argument(
        '--crs', metavar='EPSG:N', help='coordinate system of the places, if not degrees or metres'
    )
    parser.add_argument(
        '--doubles',
        choices=('refuse', 'first', 'last', 'keep'),
        default='refuse',
        help='which row of one place or one id counts (default: %(default)s)',
    )
    parser.add_argument(
        '--blanks',
        choices=('refuse', 'skip'),
        default='refuse',
        help='what to do with rows without a place (default: %(default)s)',
    )
    parser.add_argument(
        '--area',
        metavar='FILE',
        help='GeoJSON, KML, KMZ or a table of corners: the polygon that nobody flies beyond, and'
        ' others if they are called no-fly zones',
    )
    parser.add_argument(
        '--widen',
        type=options.number_from(0.0, 10_000.0, 'm'),
        default=0.0,
        metavar='M',
        help="how far UAVs may fly beyond the area's edge [m] (default: 0)",
    )
    parser.add_argument(
        '--no-fly',
        metavar='FILE',
        help='the same kinds of file: polygons that nobody flies over, whatever their names',
    )


def _add_proposed(parser: argparse.ArgumentParser) -> None:
    """What is not to be proposed."""
    parser.add_argument(
        '--base',
        metavar='PLACE',
        help='where UAVs start and land: LAT,LON or X,Y or a sensor'
        ' (default: an open cell at the southern edge)',
    )
    parser.add_argument('--altitude', type=_LENGTH, metavar='M', help='at which UAVs fly [m]')
    parser.add_argument(
        '--airframe',
        metavar='NAME',
        help='the craft, one of config/airframes.yaml',
    )
    parser.add_argument(
        '--battery-wh',
        type=options.number_from(0.1, 1e5, 'Wh'),
        metavar='WH',
        help='battery of each UAV [Wh]',
    )
    parser.add_argument(
        '--speed',
        nargs='+',
        type=options.number_from(0.1, 100.0, 'm/s'),
        metavar='MPS',
        help='one speed of all UAVs, or one of each in turn, as 10 15 [m/s]'
        ' (default: that which takes the craft farthest)',
    )
    parser.add_argument(
        '--cell-size',
        type=_LENGTH,
        metavar='M',
        help='side of a cell [m] (default: as large as the radio allows)',
    )
    parser.add_argument(
        '--data-mbit',
        nargs=2,
        type=options.number_from(0.0, 10_000.0, 'Mbit'),
        metavar=('LOW', 'HIGH'),
        help='data that each sensor holds [Mbit], whatever the list says',
    )


def run(arguments: argparse.Namespace) -> int:
    """Propose, write, show; returns the exit status."""
    _check(arguments)
    outputs = _outputs(arguments)
    interpret_kernels()  # what is computed here takes less than to load compiled ones
    from uav_collect.fields.proposal import propose
    from uav_collect.fields.settings import usual_settings, Wishes
    from uav_collect.fields.survey import survey
    from uav_collect.scenario.load import load

    with waiting_for('the list'), _refused_by_options():
        found = survey(
            Path(arguments.list),
            _reading(arguments),
            area=None if arguments.area is None else Path(arguments.area),
            no_fly=None if arguments.no_fly is None else Path(arguments.no_fly),
            base=arguments.base,
            widen_m=arguments.widen,
        )
    settings = usual_settings()
    wishes = Wishes(
        n_uavs=arguments.uavs,
        cell_size_m=arguments.cell_size,
        altitude_m=arguments.altitude,
        airframe=arguments.airframe,
        battery_wh=arguments.battery_wh,
        speeds_mps=_speeds_mps(arguments),
        data_mbit=arguments.data_mbit and tuple(arguments.data_mbit),
    )
    with waiting_for('cells that fit the field'):
        proposal = propose(found.ground, wishes, settings, load(settings.base))
    scenario = _write(outputs, proposal, settings.base, found)
    _show(outputs, proposal, found, scenario)
    return 0


@contextmanager
def _refused_by_options() -> Iterator[None]:
    """Let refusals of a list name options of this command, not keys of a scenario file."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(*map(_with_options, error.problems)) from None


def _with_options(problem: str) -> str:
    """`doubles: first` as `--doubles first`, `columns: {id: Code}` as `--columns id=Code`."""
    columns = _COLUMNS_KEY.sub(
        lambda found: f'--columns {found[1].replace(": ", "=").replace(", ", ",")}', problem
    )
    return _OTHER_KEY.sub(r'--\1 ', columns)


def _check(arguments: argparse.Namespace) -> None:
    """Refuse what cannot be used.

    Raises:
        ConfigError: a file's path is none, amounts of data are none, or speeds are too many or
            too few.
        OSError: a file is not there.
    """
    for given in (arguments.list, arguments.area, arguments.no_fly):
        if given is None:
            continue
        if _URL.match(given):
            raise ConfigError(f'{given}: is an address: must be a file; download it first')
        if Path(given).is_dir():
            raise ConfigError(f'{given}: is a folder: must be a file')
        files.check_there(Path(given))
    low_mbit, high_mbit = arguments.data_mbit or (0.0, 1.0)
    if not low_mbit <= high_mbit or high_mbit == 0.0:
        what = 'must be LOW and HIGH, LOW not above HIGH, HIGH more than 0'
        raise ConfigError(f'--data-mbit is {low_mbit:g} {high_mbit:g}: {what}')
    n_speeds, n_uavs = len(arguments.speed or ()), arguments.uavs
    if n_speeds > 1 and n_speeds != n_uavs:
        given = ' '.join(f'{speed_mps:g}' for speed_mps in arguments.speed)
        what = f'must be one speed, of all UAVs, or as many as --uavs {n_uavs}'
        raise ConfigError(f'--speed is {given}: has {n_speeds} speeds [m/s]: {what}')


def _speeds_mps(arguments: argparse.Namespace) -> tuple[float, ...] | None:
    """The speed of each UAV [m/s]; None: none was given."""
    given: list[float] | None = arguments.speed
    if given is None:
        return None
    return tuple(given) if len(given) == arguments.uavs else (given[0],) * arguments.uavs


def _outputs(arguments: argparse.Namespace) -> _Outputs:
    """Where to write, if that may be written.

    Raises:
        ConfigError: the name cannot be one, or a file is there.
        OSError: a file could not be written.
    """
    name = _name_from(Path(arguments.list)) if arguments.name is None else arguments.name
    if not is_name(name):
        raise ConfigError(f'--name is {name!r}: must be {NAME_ALLOWED}')
    outputs = _Outputs(
        scenario=arguments.output / f'{name}.yaml', picture=arguments.output / f'{name}.png'
    )
    for path in (outputs.scenario, outputs.picture):
        if path.exists() and not arguments.force:
            raise ConfigError(f'{path}: is there already: give another --name, or --force')
        files.check_writable(path)
    return outputs


def _name_from(path: Path) -> str:
    """What a list's file name gives for a scenario's name."""
    name = re.sub(r'[^A-Za-z0-9_.-]+', '_', path.stem).strip('_.-')[:MAX_NAME]
    return name or 'field'


def _reading(arguments: argparse.Namespace) -> 'ReadOptions':
    """How the list is to be read.

    Raises:
        ConfigError: an option cannot be what it says.
    """
    from uav_collect.scenario.columns import parse_columns
    from uav_collect.scenario.grids import CRS_ALLOWED, crs_name
    from uav_collect.scenario.places import ReadOptions

    try:
        crs = crs_name(arguments.crs) if arguments.crs else ''
    except ValueError:
        raise ConfigError(f'--crs is {arguments.crs!r}: must be {CRS_ALLOWED}') from None
    return ReadOptions(
        columns=parse_columns(arguments.columns, '--columns') if arguments.columns else {},
        crs=crs,
        doubles=arguments.doubles,
        skips_blanks=arguments.blanks == 'skip',
    )


def _write(outputs: _Outputs, proposal: 'Proposal', base: str, found: 'Survey') -> 'Scenario':
    """Write scenario and map; the scenario as it is read again.

    Raises:
        ConfigError: what is proposed cannot be flown; then nothing is written.
        OSError: a file cannot be written.
    """
    from uav_collect.fields.map_picture import map_picture
    from uav_collect.fields.scenario_text import scenario_text
    from uav_collect.scenario.load import load

    text = scenario_text(proposal, base, found.source, found.crs).encode()
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / outputs.scenario.name
        trial.write_bytes(text)
        try:
            load(trial)
        except ConfigError as error:
            lines = (str(it).replace(f'{trial}:', 'what was proposed:') for it in error.lines)
            raise ConfigError(*lines) from error
    title = f'{outputs.scenario.stem}: {len(found.ground.sensor_ids)} sensors'
    picture = map_picture(proposal.grid, title)
    files.write_result(outputs.scenario, text)
    files.write_result(outputs.picture, picture)
    return load(outputs.scenario)


def _show(outputs: _Outputs, proposal: 'Proposal', found: 'Survey', scenario: 'Scenario') -> None:
    """Print what was proposed, and what to type next."""
    from uav_collect.analysis.console import plain_console
    from uav_collect.fields.summary import doubts, summary
    from uav_collect.planning.reach import energy_remark, spare_remark
    from uav_collect.scenario.site import build_site

    console = plain_console()
    title = f'{scenario.name}: {found.source}, {found.crs}'
    console.print(title, style='bold', soft_wrap=True)
    for title, text in summary(proposal):
        console.print(f'  {title:12}  {text}', soft_wrap=True)
    site = build_site(scenario)
    remark = energy_remark(site) or spare_remark(site)
    for note in (*found.notes, *doubts(proposal), *([] if remark is None else [remark])):
        console.print(f'  {"note":12}  {note}', soft_wrap=True, style='yellow')
    console.print(f'written: {outputs.scenario}, {outputs.picture}', soft_wrap=True)
    console.print(
        f'who flies it best: {_comparison(os.path.relpath(outputs.scenario))}', soft_wrap=True
    )
    console.print(f'next: {_next(os.path.relpath(outputs.scenario))}', soft_wrap=True)


def _comparison(path: str) -> str:
    """What shows which policy flies a scenario best, to be typed where this was."""
    program = '.venv/bin/python -m uav_collect' if _is_checkout() else program_name()
    command = f'{program} evaluate --scenario {shlex.quote(path)}'
    return f'{command} --policy best sweep hert --missions 100'


def _is_checkout() -> bool:
    return Path('uav_collect/commands/field.py').is_file()


def _next(path: str) -> str:
    """What flies a scenario, to be typed where this was."""
    if _is_checkout():
        return f'make mission SCENARIO={shlex.quote(path)}'
    return f'{program_name()} mission --scenario {shlex.quote(path)}'

"""Says how many UAVs and how much battery a site takes."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
import json
import math
from pathlib import Path
from time import monotonic
from typing import Any, TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options, terminal
from uav_collect.errors import ConfigError, counted
from uav_collect.limits import INTERRUPTED, MAX_UAVS, UNUSABLE
from uav_collect.missions.small_jobs import choose_kernels

if TYPE_CHECKING:  # loaded when flying, so that --help answers at once
    from uav_collect.analysis.sizing import Battery, FleetAtSite, Sized, Sizing
    from uav_collect.scenario.model import Scenario

_DESCRIPTION = """
Flies the same missions with each number of UAVs and says how large a battery each UAV needs: the
energy and time of a flight with ample energy, as quantiles over the missions, and the share of
missions that collect all data with each battery. It searches for the smallest battery that does,
unless --battery-wh names some. All UAVs of a fleet have the same battery; of its usable part, the
scenario's margin must be left after landing. The energy budgets in the scenario are ignored, and
so is the weight of a battery: the propulsion power stays the scenario's.
"""
_MAX_MISSIONS = 1_000_000
_USABLE_SHARE = 0.8  # of batteries of which nobody says it
_VOLT = 22.2
_FLIGHTS = 9  # of all missions that a search takes, more or less


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    options.add_unmanned_options(parser)
    parser.add_argument(
        '--uavs',
        nargs='+',
        type=options.whole_number(1, MAX_UAVS),
        metavar='N',
        help="fleets of N UAVs, the scenario's in turn (default: as the scenario has)",
    )
    parser.add_argument(
        '--policy',
        default='sweep',
        metavar='POLICY',
        help='who flies, as of evaluate, but not best (default: %(default)s)',
    )
    _add_battery(parser)
    parser.add_argument(
        '--missions',
        type=options.whole_number(1, _MAX_MISSIONS),
        default=10_000,
        metavar='N',
        help='missions to fly with each fleet and battery (default: %(default)s)',
    )
    options.add_seed_option(parser, 'seed of the first mission')
    options.add_allocator_option(parser, choices=('exact', 'equal'))
    options.add_guard_option(parser)
    options.add_file_options(
        parser, json='write all that was found', csv='write one row per fleet, battery and UAV'
    )
    parser.add_argument(
        '--picture', type=options.output, metavar='FILE', help='draw the shares into a PNG file'
    )


def _add_battery(parser: argparse.ArgumentParser) -> None:
    """What batteries are, and how often they must do."""
    parser.add_argument(
        '--battery-wh',
        type=options.number_from(0.001, 1e5, 'Wh'),
        nargs='+',
        metavar='WH',
        help='fly with these batteries instead of searching for the least',
    )
    parser.add_argument(
        '--complete',
        type=options.number_from(0.1, 100.0, '%'),
        default=99.0,
        metavar='PERCENT',
        help='share of missions that must collect all data (default: %(default)g)',
    )
    parser.add_argument(
        '--usable',
        type=options.number_from(1.0, 100.0, '%'),
        metavar='PERCENT',
        help='share of a battery that may be used; the rest is kept (default: that of the'
        f" scenario's batteries, else {100 * _USABLE_SHARE:g})",
    )
    parser.add_argument(
        '--volt',
        type=options.number_from(0.1, 10_000.0, 'V'),
        metavar='V',
        help="nominal voltage for charges in mAh (default: that of the scenario's batteries, else"
        f' {_VOLT:g}, six cells)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Fly the missions; returns the exit status."""
    from uav_collect.scenario.load import load

    scenario = load(arguments.scenario, options.overrides_of(arguments.set))
    numbers = [*dict.fromkeys(arguments.uavs or [scenario.n_uavs])]
    options.check_outputs(arguments.json, arguments.csv, arguments.picture)
    n_flights = 1 + len({*arguments.battery_wh}) if arguments.battery_wh else _FLIGHTS
    n_missions = len(numbers) * n_flights * arguments.missions
    choose_kernels(n_missions, scenario.n_cells, [arguments.policy])
    battery = _battery(arguments, scenario)
    fleets = _fleets(arguments, scenario, numbers)
    terminal.say(_plan(arguments, len(numbers), n_flights))
    start_s, status = monotonic(), 0
    n_of_fleet = n_flights * arguments.missions
    with terminal.progress_bar(len(numbers) * n_of_fleet, 'missions') as advance:
        share = _Share(n_of_fleet, advance)
        sizing = _sizing(arguments, fleets, battery, share)
        try:
            for n_uavs in numbers:
                _fly(arguments, sizing, n_uavs)
                share.end()
        except KeyboardInterrupt:
            status = INTERRUPTED
    return _end(arguments, scenario, sizing, numbers, status, monotonic() - start_s)


def _plan(arguments: argparse.Namespace, n_fleets: int, n_flights: int) -> str:
    """How many missions are going to be flown, and of what that is the product."""
    n_missions, total = arguments.missions, n_fleets * n_flights * arguments.missions
    about = '' if arguments.battery_wh else 'about '
    fleets = f'{n_fleets} fleet{"s" if n_fleets > 1 else ""}'
    return (
        f'{fleets} x {about}{n_flights} batteries (one of them ample) x {n_missions:,} missions ='
        f' {about}{total:,} missions; --missions says how many of each'
    )


class _Share:
    """A fleet's share of the progress: a search ends sooner or later than most."""

    def __init__(self, n_missions: int, advance: Callable[[int], None]) -> None:
        self._n_missions, self._advance = n_missions, advance
        self._n_done = 0

    def __call__(self, n_more: int) -> None:
        n_more = min(n_more, self._n_missions - 1 - self._n_done)
        self._n_done += n_more
        self._advance(n_more)

    def end(self) -> None:
        """Go on with the next fleet's."""
        self._advance(self._n_missions - self._n_done)
        self._n_done = 0


def _fleets(
    arguments: argparse.Namespace, scenario: 'Scenario', numbers: Sequence[int]
) -> 'dict[int, FleetAtSite]':
    """Find what is wrong before anything flies."""
    from uav_collect.analysis.sizing import FleetAtSite
    from uav_collect.scenario.load import with_uavs
    from uav_collect.scenario.site import build_site
    from uav_collect.uav.policy import policy_for, remarks

    site, fleets = build_site(scenario), {}
    for n_uavs in numbers:
        own = with_uavs(scenario, n_uavs)
        policy = policy_for(arguments.policy, own)
        for line in remarks(policy, own):
            terminal.say(line)
        fleets[n_uavs] = FleetAtSite(
            site=replace(site, scenario=own), policy_for=partial(policy_for, arguments.policy)
        )
    return fleets


def _battery(arguments: argparse.Namespace, scenario: 'Scenario') -> 'Battery':
    """What batteries are: as asked, else as those of the scenario.

    Raises:
        ConfigError: these are of several kinds.
    """
    from uav_collect.analysis.sizing import Battery

    own = [uav.battery for uav in scenario.uavs if uav.battery is not None]
    asked_share = None if arguments.usable is None else arguments.usable / 100
    shares = {it.usable_share for it in own if it.usable_share is not None}
    volts = {it.nominal_v for it in own if it.nominal_v is not None}
    return Battery(
        usable_share=_only('--usable', asked_share, shares, _USABLE_SHARE),
        volt=_only('--volt', arguments.volt, volts, _VOLT),
    )


def _only(option: str, asked: float | None, own: set[float], usual: float) -> float:
    if asked is not None:
        return asked
    if len(own) > 1:
        several = ' and '.join(f'{each:g}' for each in sorted(own))
        raise ConfigError(
            f'{option}: must be given, as all UAVs have the same battery here, and those of the'
            f' scenario have {several}'
        )
    return next(iter(own), usual)


def _sizing(
    arguments: argparse.Namespace,
    fleets: 'dict[int, FleetAtSite]',
    battery: 'Battery',
    advance: Callable[[int], None],
) -> 'Sizing':
    from uav_collect.analysis.sizing import Sizing
    from uav_collect.analysis.statistics import mission_seeds

    return Sizing(
        fleets,
        mission_seeds(arguments.seed, arguments.missions),
        battery,
        allocator=arguments.bandwidth,
        guard_after=arguments.guard_after,
        advance=advance,
    )


def _fly(arguments: argparse.Namespace, sizing: 'Sizing', n_uavs: int) -> None:
    if not arguments.battery_wh:
        sizing.search(n_uavs, arguments.complete / 100)
        return
    sizing.fly_freely(n_uavs)
    for battery_wh in sorted({*arguments.battery_wh}):
        sizing.fly(n_uavs, battery_wh)


def _end(
    arguments: argparse.Namespace,
    scenario: 'Scenario',
    sizing: 'Sizing',
    numbers: Sequence[int],
    status: int,
    wall_s: float,
) -> int:
    """Write and show what was flown, also where that was interrupted; the exit status."""
    from uav_collect.analysis.sizing import sized

    if not sizing.trials:
        terminal.say('interrupted before anything was known')
        return status
    wanted_share = arguments.complete / 100
    found = [sized(sizing.trials, n_uavs, sizing.battery, wanted_share) for n_uavs in numbers]
    # Before anything is shown: whoever reads that may have left.
    is_written = terminal.write_files(_contents(arguments, scenario, sizing, found))
    _show(arguments, scenario, sizing, found, wall_s)
    return status if status or is_written else UNUSABLE


def _heading(arguments: argparse.Namespace, scenario: 'Scenario') -> dict[str, Any]:
    from uav_collect.scenario.load import fingerprint

    return {
        'scenario': scenario.name,
        'fingerprint': fingerprint(scenario),
        'policy': arguments.policy,
        'bandwidth': arguments.bandwidth,
        'seed': arguments.seed,
    }


def _contents(
    arguments: argparse.Namespace, scenario: 'Scenario', sizing: 'Sizing', found: 'list[Sized]'
) -> dict[Path, bytes]:
    """What the files are to hold, by path."""
    from uav_collect.analysis.size_table import rows

    heading, contents = _heading(arguments, scenario), {}
    table = [heading | row for row in rows(sizing.trials, sizing.battery)]
    if arguments.csv is not None:
        cells = [['' if cell is None else cell for cell in row.values()] for row in table]
        contents[arguments.csv] = files.csv_of([[*table[0]], *cells])
    if arguments.json is not None:
        document = heading | {
            'wanted_share': arguments.complete / 100,
            'found': [
                {
                    'uavs': one.n_uavs,
                    'battery_wh': None if math.isnan(one.needed_wh) else one.needed_wh,
                    'best_share': None if math.isnan(one.best_share) else one.best_share,
                }
                for one in found
            ],
            'trials': [*rows(sizing.trials, sizing.battery)],
        }
        contents[arguments.json] = (
            json.dumps(document, indent=2, allow_nan=False) + '\n'
        ).encode()
    if arguments.picture is not None:
        from uav_collect.analysis.size_picture import draw_sizes

        title = f'{scenario.name}, {arguments.policy}, {counted(arguments.missions, "mission")}'
        share = arguments.complete / 100
        contents[arguments.picture] = draw_sizes(
            sizing.trials, found, sizing.battery, share, title
        )
    return contents


def _show(
    arguments: argparse.Namespace,
    scenario: 'Scenario',
    sizing: 'Sizing',
    found: 'list[Sized]',
    wall_s: float,
) -> None:
    from uav_collect.analysis.console import plain_console
    from uav_collect.analysis.size_table import composition, needs_table, summary, trials_table
    from uav_collect.analysis.tables import headline

    console, trials = plain_console(), sizing.trials
    unfinished = [trial for trial in trials if not trial.is_whole]
    for trial in unfinished:
        what = f'interrupted after {trial.n_missions} of {trial.n_asked} missions of a flight'
        console.print(what, style='bold red')
    console.print(
        headline(
            scenario.name,
            f', {arguments.policy}, {counted(arguments.missions, "mission")} from seed'
            f' {arguments.seed},'
            f' {arguments.bandwidth} bandwidth',
        )
    )
    battery = sizing.battery
    what = f'{100 * battery.usable_share:g} % of each battery are usable'
    console.print(f'{what}; charges at {battery.volt:g} V; ample: whatever it takes', style='dim')
    console.print(composition(trials, sizing.battery), style='dim', soft_wrap=True)
    console.print(needs_table(trials, sizing.battery))
    console.print(trials_table(trials, sizing.battery))
    is_searched = not arguments.battery_wh
    console.print(summary(found, arguments.complete / 100, is_searched=is_searched))
    n_flown = sum(trial.n_missions for trial in trials if trial.metrics is not None)
    console.print(f'{counted(n_flown, "mission")} flown in {wall_s:.1f} s', style='dim')

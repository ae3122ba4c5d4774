"""Says what a fleet could do in missions if it knew all demand beforehand."""

import argparse
from collections.abc import Mapping, Sequence
import json
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options, terminal
from uav_collect.errors import counted
from uav_collect.limits import INTERRUPTED, UNUSABLE

if TYPE_CHECKING:  # loaded when searching, so that --help answers at once
    from uav_collect.analysis.statistics import Estimate
    from uav_collect.planning.bound import Bound
    from uav_collect.scenario.model import Scenario

_DESCRIPTION = """
Plans missions whose demand and channels are all known, once for the shortest time and once for the
least energy, and prints mean, 95 % bootstrap interval and median of completion time [s], energy
[kJ] and energy efficiency [kbit/J] of both plans, and a proven limit for each, which no flight
that collects everything can beat. Completion times are compared with the shortest plan, energy and
efficiency with the thriftiest.
"""
_MAX_MISSIONS = 100_000
_MAX_ROUNDS = 10**9

_Bounds = Mapping[str, Sequence['Bound']]  # by bandwidth; the same seeds for each


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    options.add_scenario_options(parser)
    parser.add_argument(
        '--missions',
        type=options.whole_number(1, _MAX_MISSIONS),
        default=100,
        metavar='N',
        help='missions to plan (default: %(default)s)',
    )
    options.add_seed_option(parser, 'seed of the first mission')
    options.add_allocator_option(parser, several=True)
    parser.add_argument(
        '--rounds',
        type=options.whole_number(0, _MAX_ROUNDS),
        metavar='R',
        help='of the search for each plan; more take longer and may find better ones',
    )
    options.add_file_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Plan the missions; returns the exit status."""
    from uav_collect.analysis.plan_shares import bound_metrics, mean_estimates

    scenario = options.scenario_of(arguments)
    options.check_files(arguments)
    bounds, status = _plan(arguments, scenario)
    rows = {
        bandwidth: mean_estimates([bound_metrics(bound) for bound in some], arguments.seed)
        for bandwidth, some in bounds.items()
        if some
    }
    # Before anything is shown: whoever reads that may have left.
    contents = {}
    if rows and arguments.json is not None:
        contents[arguments.json] = _json(arguments, scenario, bounds, rows)
    if rows and arguments.csv is not None:
        contents[arguments.csv] = _csv(scenario, bounds)
    is_written = terminal.write_files(contents)
    if status == INTERRUPTED:
        _show_interrupted(arguments, bounds)
    for bandwidth, (n_known, estimates) in rows.items():
        _show(arguments, scenario, bandwidth, len(bounds[bandwidth]), n_known, estimates)
    return status if status or is_written else UNUSABLE


def _plan(arguments: argparse.Namespace, scenario: 'Scenario') -> 'tuple[_Bounds, int]':
    """The plans of all missions, or of those before Ctrl-C, and the exit status by that."""
    from uav_collect.analysis.statistics import mission_seeds
    from uav_collect.planning.bound import bound_of, N_ROUNDS
    from uav_collect.scenario.site import build_site

    site = build_site(scenario)
    seeds = mission_seeds(arguments.seed, arguments.missions)
    n_rounds = N_ROUNDS if arguments.rounds is None else arguments.rounds
    bounds: dict[str, list[Bound]] = {bandwidth: [] for bandwidth in arguments.bandwidth}
    try:
        with terminal.progress_bar(len(seeds) * len(bounds), 'plans') as advance:
            for seed in seeds:
                for bandwidth, found in bounds.items():
                    found.append(bound_of(site, seed, bandwidth, n_rounds))
                    advance(1)
    except KeyboardInterrupt:
        n_missions = min(map(len, bounds.values()))
        return {bandwidth: found[:n_missions] for bandwidth, found in bounds.items()}, INTERRUPTED
    return bounds, 0


def _show_interrupted(arguments: argparse.Namespace, bounds: '_Bounds') -> None:
    from uav_collect.analysis.console import plain_console

    n_missions = min(map(len, bounds.values()))
    what = f'interrupted after {n_missions} of {arguments.missions} missions'
    plain_console().print(what, style='bold red')


def _show(
    arguments: argparse.Namespace,
    scenario: 'Scenario',
    bandwidth: str,
    n_missions: int,
    n_known: int,
    estimates: Mapping[str, 'Estimate'],
) -> None:
    from uav_collect.analysis.console import plain_console
    from uav_collect.analysis.tables import bound_table, headline

    console = plain_console()
    console.print(
        headline(
            scenario.name,
            f', {counted(scenario.n_uavs, "UAV")}, {counted(n_missions, "mission")} from seed'
            f' {arguments.seed},'
            f' {bandwidth} bandwidth, all demand known',
        )
    )
    if estimates:
        console.print(bound_table(estimates))
    n_without = n_missions - n_known
    if n_without:
        what = f'no plan within the energy budgets was found in {counted(n_without, "mission")}'
        console.print(what, style='yellow')


def _json(
    arguments: argparse.Namespace,
    scenario: 'Scenario',
    bounds: '_Bounds',
    rows: Mapping[str, tuple[int, Mapping[str, 'Estimate']]],
) -> bytes:
    from uav_collect.scenario.load import fingerprint

    document = {
        bandwidth: {
            'scenario': scenario.name,
            'fingerprint': fingerprint(scenario),
            'seed': arguments.seed,
            'missions': len(bounds[bandwidth]),
            'missions_with_plans': n_known,
            'bandwidth': bandwidth,
        }
        | {key: estimate.to_json() for key, estimate in estimates.items()}
        for bandwidth, (n_known, estimates) in rows.items()
    }
    return (json.dumps(document, indent=2, allow_nan=False) + '\n').encode()


def _csv(scenario: 'Scenario', bounds: '_Bounds') -> bytes:
    """One row per mission; a number without a plan is left empty."""
    from uav_collect.analysis.plan_shares import bound_metrics
    from uav_collect.scenario.load import fingerprint

    table: list[tuple[object, ...]] = []
    fixed = (scenario.name, fingerprint(scenario))
    for bandwidth, some in bounds.items():
        for bound in some:
            numbers = bound_metrics(bound)
            if not table:
                heading = ('scenario', 'fingerprint', 'bandwidth', 'mission_seed', 'data_cells')
                table.append((*heading, 'total_mbit', *numbers))
            cells = map(files.blank_if_nan, numbers.values())
            about = (bound.mission_seed, bound.n_data_cells, bound.total_bit / 1e6)
            table.append((*fixed, bandwidth, *about, *cells))
    return files.csv_of(table)

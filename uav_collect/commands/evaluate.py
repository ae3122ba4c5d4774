"""Flies many missions in this process and says what they achieve on average."""

import argparse
from collections.abc import Mapping, Sequence
import csv
import io
import json
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from uav_collect.commands import files, options, progress

if TYPE_CHECKING:  # loaded when flying, so that --help answers at once
    from uav_collect.evaluation import Estimate
    from uav_collect.metrics import MissionFigures
    from uav_collect.scenario import Scenario

_DESCRIPTION = """
Flies the same missions with each policy and prints mean, 95 % bootstrap interval and median of
energy efficiency [kbit/J], completion time [s], energy [kJ], the share of the data that was
collected and the share of missions in which every UAV landed with its energy margin. The missions'
seeds are SEED, SEED + 1, ...; the first is the one that "mission --seed SEED" flies.
"""
INTERRUPTED = 130  # exit status after Ctrl-C, as shells have it
_MAX_MISSIONS = 100_000  # their figures are kept
_AT_ONCE = 50  # missions flown between two looks at Ctrl-C

_Flown = Mapping[str, Sequence['MissionFigures']]  # by policy, the same seeds for each
_Estimates = Mapping[str, Sequence['Estimate']]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    options.add_scenario_options(parser)
    parser.add_argument(
        '--policy',
        nargs='+',
        default=['sweep'],
        metavar='NAME',
        help='one or more of hert, hert-equal, sweep, random (default: sweep)',
    )
    parser.add_argument(
        '--missions',
        type=options.whole_number(1, _MAX_MISSIONS),
        default=1000,
        metavar='N',
        help='missions to fly with each policy (default: %(default)s)',
    )
    options.add_seed_option(parser, 'seed of the first mission')
    options.add_allocator_option(parser)
    parser.add_argument('--json', type=Path, metavar='FILE', help='write means and intervals')
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write one row per mission')


def run(arguments: argparse.Namespace) -> int:
    """Evaluate the policies; the exit status."""
    scenario = options.scenario_of(arguments)
    _check(arguments)
    flown: dict[str, list[MissionFigures]] = {policy: [] for policy in arguments.policy}
    start_s = monotonic()
    try:
        _fly(arguments, scenario, flown)
    except KeyboardInterrupt:
        n_missions = min(len(missions) for missions in flown.values())
        whole = {policy: missions[:n_missions] for policy, missions in flown.items()}
        _show(arguments, scenario, whole, monotonic() - start_s)
        return INTERRUPTED
    estimates = _show(arguments, scenario, flown, monotonic() - start_s)
    if arguments.json is not None:
        files.write_atomically(arguments.json, _json(arguments, scenario, estimates))
    if arguments.csv is not None:
        files.write_atomically(arguments.csv, _csv(arguments, scenario, flown))
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """Find what is wrong before a thousand missions are flown for nothing."""
    from uav_collect.frozen import PolicyMismatchError
    from uav_collect.policy import policy_for

    for policy in arguments.policy:
        policy_named(policy)
    if len(set(arguments.policy)) < len(arguments.policy):
        raise PolicyMismatchError(f'--policy {" ".join(arguments.policy)}: names one twice')
    for path in filter(None, (arguments.json, arguments.csv)):
        files.check_writable(path)


def _fly(
    arguments: argparse.Namespace,
    scenario: 'Scenario',
    flown: Mapping[str, 'list[MissionFigures]'],
) -> None:
    """Fly all missions, a few with each policy in turn, into `flown`."""
    from uav_collect.evaluation import mission_seeds
    from uav_collect.metrics import figures
    from uav_collect.rollout import fly
    from uav_collect.site import build_site

    site = build_site(scenario)
    seeds = mission_seeds(arguments.seed, arguments.missions)
    at_once = 1 if arguments.bandwidth == 'cvxpy' else _AT_ONCE
    progress.say_if_compiling()
    with progress.counting(len(seeds) * len(flown), 'missions') as advance:
        for start in range(0, len(seeds), at_once):
            for policy, missions in flown.items():
                some = seeds[start : start + at_once]
                logs = fly(scenario, site, some, policy, arguments.bandwidth)
                missions += [figures(log) for log in logs]
                advance(len(some))


def _show(
    arguments: argparse.Namespace, scenario: 'Scenario', flown: _Flown, wall_s: float
) -> _Estimates:
    """Print the figures of what was flown; they are the estimates returned."""
    from rich.console import Console
    from uav_collect.evaluation import estimates
    from uav_collect.tables import evaluation_table

    console = Console()
    n_missions = len(flown[arguments.policy[0]])
    if n_missions < arguments.missions:
        what = (
            f'interrupted after {n_missions} of {arguments.missions} missions; no file is written'
        )
        console.print(what, style='bold red')
    if n_missions == 0:
        return {}
    rows = {policy: estimates(missions, arguments.seed) for policy, missions in flown.items()}
    console.print(
        f'[bold]{scenario.name}[/], {scenario.n_uavs} UAVs, {n_missions} missions from seed'
        f' {arguments.seed}, {arguments.bandwidth} bandwidth',
        highlight=False,
    )
    console.print(evaluation_table(flown, rows))
    n_flown = n_missions * len(flown)
    console.print(f'{n_flown} missions flown in {wall_s:.1f} s', style='dim', highlight=False)
    return rows


def _heading(arguments: argparse.Namespace, scenario: 'Scenario') -> dict[str, str | int]:
    from uav_collect.scenario import fingerprint

    return {
        'scenario': scenario.name,
        'fingerprint': fingerprint(scenario),
        'seed': arguments.seed,
        'missions': arguments.missions,
        'bandwidth': arguments.bandwidth,
    }


def _json(arguments: argparse.Namespace, scenario: 'Scenario', estimates: _Estimates) -> bytes:
    """Means and intervals by policy, each policy's entry complete in itself."""
    from uav_collect.evaluation import MEASURES

    heading = _heading(arguments, scenario)
    document = {
        policy: heading
        | {
            measure.key: {'mean': row.mean, 'low': row.low, 'high': row.high}
            for measure, row in zip(MEASURES, rows, strict=True)
        }
        for policy, rows in estimates.items()
    }
    return (json.dumps(document, indent=2, allow_nan=False) + '\n').encode()


def _csv(arguments: argparse.Namespace, scenario: 'Scenario', flown: _Flown) -> bytes:
    """One row per mission."""
    heading = _heading(arguments, scenario)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(('scenario', 'fingerprint', 'bandwidth', 'policy', *_COLUMNS))
    fixed = [heading[name] for name in ('scenario', 'fingerprint', 'bandwidth')]
    for policy, missions in flown.items():
        for mission in missions:
            writer.writerow((*fixed, policy, *_row(mission)))
    return text.getvalue().encode()


_COLUMNS = (
    'mission_seed', 'efficiency_kbit_per_j', 'completion_s', 'energy_kj', 'collected_mbit',
    'total_mbit', 'collected_share', 'decisions', 'is_safe', 'is_complete',
)  # fmt: skip


def _row(mission: 'MissionFigures') -> tuple[float, ...]:
    return (
        mission.mission_seed,
        mission.efficiency_kbit_per_j,
        mission.completion_s,
        mission.energy_j / 1e3,
        mission.collected_bit / 1e6,
        mission.total_bit / 1e6,
        mission.collected_share,
        mission.n_decisions,
        int(mission.is_safe),
        int(mission.is_complete),
    )

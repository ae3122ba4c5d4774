"""Flies many missions in this process and says what they achieve on average."""

import argparse
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
import json
from time import monotonic
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options, terminal
from uav_collect.errors import counted, PolicyMismatchError
from uav_collect.limits import BEST, INTERRUPTED, UNUSABLE
from uav_collect.missions.small_jobs import choose_kernels, FLIGHTS_OF_A_PLAN

if TYPE_CHECKING:  # loaded when flying, so that --help answers at once
    from uav_collect.analysis.metrics import MissionMetrics
    from uav_collect.analysis.statistics import Estimate
    from uav_collect.planning.bound import Bound
    from uav_collect.scenario.model import Scenario
    from uav_collect.uav.policy import NamedPolicy

_DESCRIPTION = """
Flies the same missions with each policy and prints mean, 95 % bootstrap interval and median of
energy efficiency [kbit/J], completion time [s], energy [kJ], the share of the data that was
collected, the share of missions that collected all of it, and the share of missions in which all
UAVs landed with their energy margin; and energy and landing time of each UAV, mean and maximum.
The missions' seeds are SEED, SEED + 1, ...; the first is the one that "mission --seed SEED" flies.
"""
_MAX_MISSIONS = 100_000  # their figures are kept
_AT_ONCE = 50  # missions flown between two looks at Ctrl-C


@dataclass(frozen=True, kw_only=True, eq=False)
class _Contender:
    """A policy and the bandwidth that it flies with."""

    label: str  # in tables and as the key in JSON
    name: str  # of the policy alone
    policy: 'NamedPolicy'
    bandwidth: str


_Flown = Mapping[_Contender, Sequence['MissionMetrics']]  # the same seeds for each
_Estimates = Mapping[str, Sequence['Estimate']]  # by label
_Bounds = Mapping[str, dict[int, 'Bound']]  # by bandwidth and mission seed; empty unless wanted


@dataclass(frozen=True, kw_only=True)
class _Results:
    """What the missions say about the policies."""

    estimates: _Estimates
    differences: Mapping[str, _Estimates]  # the first policy less each other one; by its label
    # Of the clairvoyant plans, by label: how many missions count, and the estimates by key.
    shares: Mapping[str, tuple[int, Mapping[str, 'Estimate']]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    options.add_scenario_options(parser)
    parser.add_argument(
        '--policy',
        nargs='+',
        default=['sweep'],
        metavar='POLICY',
        help='one or more of hert, hert-equal, sweep, random, shipped policies, .safetensors'
        ' files, functions or classes as module:name, lookahead:RULE, strong, the policy'
        ' shipped for the scenario, and best, which of them does best in sampled missions of it'
        ' (default: sweep)',
    )
    options.add_candidates_option(parser)
    parser.add_argument(
        '--missions',
        type=options.whole_number(1, _MAX_MISSIONS),
        default=1000,
        metavar='N',
        help='missions to fly with each policy (default: %(default)s)',
    )
    options.add_seed_option(parser, 'seed of the first mission')
    options.add_allocator_option(parser, several=True)
    options.add_guard_option(parser)
    parser.add_argument(
        '--compare',
        action='store_true',
        help='show how the first policy differs from each other one, mission by mission',
    )
    parser.add_argument(
        '--bound',
        action='store_true',
        help='show how near each policy comes to what is possible when all demand is known',
    )
    options.add_file_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fly the missions and evaluate the policies; returns the exit status."""
    options.check_candidates(arguments, arguments.policy)
    scenario = options.scenario_of(arguments)
    of_each = len(arguments.policy) + (FLIGHTS_OF_A_PLAN if arguments.bound else 0)
    names = [*arguments.policy, *arguments.candidates.split(',')]
    n_flights = arguments.missions * len(arguments.bandwidth) * of_each
    choose_kernels(n_flights, scenario.n_cells, names)
    contenders = _contenders(arguments, scenario)
    terminal.say_reach(scenario)
    flown: dict[_Contender, list[MissionMetrics]] = {contender: [] for contender in contenders}
    bounds: _Bounds = {bandwidth: {} for bandwidth in arguments.bandwidth if arguments.bound}
    start_s = monotonic()
    status = 0
    try:
        _fly(arguments, scenario, flown, bounds)
    except KeyboardInterrupt:
        status, n_missions = INTERRUPTED, min(map(len, flown.values()))
        flown = {contender: missions[:n_missions] for contender, missions in flown.items()}
    findings = _find(arguments, flown, bounds) if all(flown.values()) else None
    # Before anything is shown: whoever reads that may have left.
    contents = {}
    if findings is not None and arguments.json is not None:
        contents[arguments.json] = _json(arguments, scenario, flown, findings)
    if findings is not None and arguments.csv is not None:
        contents[arguments.csv] = _csv(arguments, scenario, flown, bounds)
    is_written = terminal.write_files(contents)
    _show(arguments, scenario, flown, findings, monotonic() - start_s)
    return status if status or is_written else UNUSABLE


def _contenders(arguments: argparse.Namespace, scenario: 'Scenario') -> list[_Contender]:
    """Find what is wrong before a thousand missions are flown for nothing."""
    from uav_collect.uav.policy import remarks

    for option, values in (('policy', arguments.policy), ('bandwidth', arguments.bandwidth)):
        if len(set(values)) < len(values):
            raise PolicyMismatchError(f'--{option} {" ".join(values)}: names one twice')
    if arguments.compare and len(arguments.policy) == 1:
        raise PolicyMismatchError('--compare: name two policies or more with --policy')
    options.check_files(arguments)
    policies = {given: _policy(given, arguments, scenario) for given in arguments.policy}
    shown = _without_best_again(policies)
    for policy in policies.values():
        for line in remarks(policy, scenario):
            terminal.say(line)
    n_called = Counter(policy.name for policy in policies.values())
    contenders = []
    for (given, policy), bandwidth in product(policies.items(), arguments.bandwidth):
        name = policy.name if n_called[policy.name] == 1 else given
        who = shown.get(given, name)
        label = who if len(arguments.bandwidth) == 1 else f'{who}, {bandwidth}'
        contenders.append(_Contender(label=label, name=name, policy=policy, bandwidth=bandwidth))
    return contenders


def _without_best_again(policies: 'dict[str, NamedPolicy]') -> dict[str, str]:
    """Drop whoever was chosen as the best from those that fly besides; what the best is called."""
    if BEST not in policies:
        return {}
    best = policies[BEST]
    again = [
        given
        for given, it in policies.items()
        if given != BEST and (it.name, it.version) == (best.name, best.version)
    ]
    for given in again:
        del policies[given]
    return {BEST: f'{BEST} ({best.name})'} if again else {}


def _policy(name: str, arguments: argparse.Namespace, scenario: 'Scenario') -> 'NamedPolicy':
    """A policy that is asked for; the best one is chosen first, in other missions, and shown."""
    from uav_collect.analysis.choosing import candidates_for, choose
    from uav_collect.analysis.console import plain_console
    from uav_collect.scenario.site import build_site
    from uav_collect.uav.own_policy import own_policies
    from uav_collect.uav.policy import listed_names, policy_for

    if name != BEST:
        return policy_for(name, scenario)
    own = own_policies(arguments.scenario, scenario.n_uavs)
    candidates, left_out = candidates_for(scenario, listed_names(arguments.candidates), own)
    for line in left_out:
        terminal.say(line)
    choice = choose(
        build_site(scenario),
        candidates,
        allocator=arguments.bandwidth[0],
        guard_after=arguments.guard_after,
    )
    plain_console().print(f'{choice}\n', soft_wrap=True)
    return policy_for(choice.policy, scenario)


def _fly(
    arguments: argparse.Namespace,
    scenario: 'Scenario',
    flown: Mapping[_Contender, 'list[MissionMetrics]'],
    bounds: '_Bounds',
) -> None:
    """Fly all missions, a few with each policy in turn, into `flown`; plan them into `bounds`."""
    from uav_collect.analysis.metrics import mission_metrics
    from uav_collect.analysis.statistics import mission_seeds
    from uav_collect.missions.rollout import fly
    from uav_collect.planning import bound
    from uav_collect.scenario.site import build_site

    site = build_site(scenario)
    seeds = mission_seeds(arguments.seed, arguments.missions)
    at_once = 1 if 'cvxpy' in arguments.bandwidth else _AT_ONCE
    noun = 'missions and plans' if bounds else 'missions'
    with terminal.progress_bar(len(seeds) * (len(flown) + len(bounds)), noun) as advance:
        for start in range(0, len(seeds), at_once):
            some = seeds[start : start + at_once]
            for bandwidth, found in bounds.items():
                for seed in some:
                    found[seed] = bound.bound_of(site, seed, bandwidth)
                    advance(1)
            for contender, missions in flown.items():
                make_policy = partial(replace, contender.policy)
                bandwidth, guard_after = contender.bandwidth, arguments.guard_after
                logs = fly(site, some, make_policy, bandwidth, guard_after)
                missions += [mission_metrics(log) for log in logs]
                advance(len(some))


def _show(
    arguments: argparse.Namespace,
    scenario: 'Scenario',
    flown: _Flown,
    findings: _Results | None,
    wall_s: float,
) -> None:
    """Print what was found, if anything was."""
    from uav_collect.analysis.console import plain_console
    from uav_collect.analysis.tables import (
        difference_table,
        evaluation_table,
        headline,
        share_table,
        verdict,
    )

    console = plain_console()
    n_missions = min(len(missions) for missions in flown.values())
    if n_missions < arguments.missions:
        what = f'interrupted after {n_missions} of {arguments.missions} missions'
        console.print(what, style='bold red')
    if findings is None:
        return
    console.print(
        headline(
            scenario.name,
            f', {counted(scenario.n_uavs, "UAV")}, {counted(n_missions, "mission")} from seed'
            f' {arguments.seed},'
            f' {" and ".join(arguments.bandwidth)} bandwidth',
        )
    )
    labelled = {contender.label: missions for contender, missions in flown.items()}
    console.print(evaluation_table(labelled, findings.estimates, console.width))
    for first, rows in findings.differences.items():
        console.print(difference_table(first, rows, console.width))
    if findings.shares:
        console.print(share_table(findings.shares, console.width))
    if len(findings.estimates) > 1:
        console.print(verdict(findings.estimates), soft_wrap=True)
    n_flown = n_missions * len(flown)
    console.print(f'{counted(n_flown, "mission")} flown in {wall_s:.1f} s', style='dim')


def _find(arguments: argparse.Namespace, flown: _Flown, bounds: '_Bounds') -> _Results:
    from uav_collect.analysis.plan_shares import mean_estimates, plan_shares
    from uav_collect.analysis.statistics import estimates, paired_differences

    seed = arguments.seed
    n_bandwidths = len(arguments.bandwidth)
    is_compared = arguments.compare and len(flown) > n_bandwidths  # the best may be the other
    firsts = [*flown][:n_bandwidths] if is_compared else []
    return _Results(
        estimates={each.label: estimates(missions, seed) for each, missions in flown.items()},
        differences={
            first.label: {
                other.label: paired_differences(flown[first], missions, seed)
                for other, missions in flown.items()
                if other.bandwidth == first.bandwidth and other is not first
            }
            for first in firsts
        },
        shares={
            each.label: mean_estimates(
                [
                    plan_shares(flight, bounds[each.bandwidth][flight.mission_seed])
                    for flight in missions
                ],
                seed,
            )
            for each, missions in flown.items()
            if bounds
        },
    )


def _heading(
    arguments: argparse.Namespace,
    scenario: 'Scenario',
    contender: _Contender,
    n_missions: int,
) -> dict[str, str | int]:
    from uav_collect.scenario.load import fingerprint

    return {
        'policy': contender.name,
        'version': contender.policy.version,
        'scenario': scenario.name,
        'fingerprint': fingerprint(scenario),
        'seed': arguments.seed,
        'missions': n_missions,
        'bandwidth': contender.bandwidth,
    }


def _json(
    arguments: argparse.Namespace, scenario: 'Scenario', flown: _Flown, findings: _Results
) -> bytes:
    """Means and intervals by policy, each policy's entry complete in itself."""
    from uav_collect.analysis.per_uav import uav_figures

    document: dict[str, dict[str, object]] = {
        contender.label: _heading(arguments, scenario, contender, len(missions))
        | _by_measure(findings.estimates[contender.label])
        | {'uavs': [uav.to_json() for uav in uav_figures(missions)]}
        for contender, missions in flown.items()
    }
    for first, rows in findings.differences.items():
        document[first]['minus'] = {other: _by_measure(row) for other, row in rows.items()}
    for label, (n_missions, rows_of) in findings.shares.items():
        means = {key: row.to_json() for key, row in rows_of.items()}
        document[label]['bound'] = {'missions': n_missions, **means}
    return (json.dumps(document, indent=2, allow_nan=False) + '\n').encode()


def _by_measure(estimates: Iterable['Estimate']) -> dict[str, object]:
    from uav_collect.analysis.statistics import MEASURES

    return {measure.key: row.to_json() for measure, row in zip(MEASURES, estimates, strict=True)}


def _csv(
    arguments: argparse.Namespace, scenario: 'Scenario', flown: _Flown, bounds: '_Bounds'
) -> bytes:
    """One row per mission."""
    from uav_collect.analysis.metrics import METRIC_COLUMNS, metrics_row
    from uav_collect.analysis.per_uav import uav_columns, uav_values
    from uav_collect.analysis.plan_shares import plan_shares, SHARE_KEYS

    fixed = ('scenario', 'fingerprint', 'bandwidth', 'policy')
    shares = SHARE_KEYS if bounds else ()
    columns = (*fixed, *METRIC_COLUMNS, *shares, *uav_columns(scenario.n_uavs))
    table: list[tuple[object, ...]] = [columns]
    for contender, missions in flown.items():
        heading = _heading(arguments, scenario, contender, len(missions))
        for mission in missions:
            known = bounds.get(contender.bandwidth, {}).get(mission.mission_seed)
            reached = plan_shares(mission, known).values() if known else ()
            cells = map(files.blank_if_nan, reached)
            row = metrics_row(mission).values()
            uavs = map(files.blank_if_nan, uav_values(mission))
            table.append((*(heading[name] for name in fixed), *row, *cells, *uavs))
    return files.csv_of(table)

"""Measures policies in conditions of all kinds, each beside the better of sweep and HERT.

python bench/anywhere.py [--missions N] [--rows PATTERN] [--policies NAME ...] [--csv FILE]
python bench/anywhere.py --courses anywhere [--drawn N] [--within POLICY] ...

Every policy flies the same missions of a row, with optimal bandwidth. What it is held against is,
in each row, the better of sweep and HERT: the one that collects everything in more missions, and
where that is the same, has the better mean energy efficiency: who leaves data behind flies less.
Ctrl-C keeps the rows that are done.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
import math
from pathlib import Path
import sys
from typing import Annotated, Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table
from uav_collect import files
from uav_collect.analysis.against_rules import (
    better_rule,
    Flown,
    HERT,
    RULES,
    Standing,
    standing_of,
    TOO_LONG,
)
from uav_collect.analysis.console import plain_console
from uav_collect.analysis.metrics import percent
from uav_collect.commands import options, terminal
from uav_collect.config import layers
from uav_collect.config.rules import Entries, number, Rule, Section, text, validated, whole
from uav_collect.errors import ConfigError, PolicyMismatchError
from uav_collect.kernels.arrays import Floats
from uav_collect.limits import INTERRUPTED, MAX_UAVS, UNUSABLE
from uav_collect.missions.rollout import fly_for_metrics
from uav_collect.planning.bound import bound_of
from uav_collect.scenario.load import fingerprint, load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.training.course_draw import draw_course
from uav_collect.training.courses import load_distribution
from uav_collect.uav.briefing import brief
from uav_collect.uav.policy import policy_for, policy_named, rule_of, shipped_policies, STRONG

HERE = Path(__file__).parent
BASE = 'paper_10x10'
PAPER = 'paper'  # the kind of rows that fly more missions
ANYWHERE = 'anywhere'
FIRST_SEED = 777_000
DRAWN_SEED = 2**61  # of drawn conditions
N_MISSIONS, N_PAPER_MISSIONS, N_PLANS = 300, 1000, 50
N_DRAWN, MOST_DRAWS = 100, 100  # the latter for each row that is kept
MOST_COLUMNS = 200  # of the table


def overrides() -> Rule:
    """Values by dotted path; the scenario's own rules say what each may be."""

    def parse(value: object) -> object:
        if not isinstance(value, dict) or not all(isinstance(path, str) for path in value):
            raise ValueError
        return value

    return Rule('a mapping of dotted paths to values', parse)


class RowConfig(Section):
    """One condition, as its file has it."""

    name: Annotated[str, text(60)]
    kind: Annotated[str, text(20)]
    scenario: Annotated[str | None, text(60)] = None  # a shipped one; absent: BASE
    uavs: Annotated[int | None, whole(1, MAX_UAVS)] = None
    speeds_mps: Annotated[
        tuple[Annotated[float, number(0.01, 100, 'm/s')], ...] | None, Entries(1, MAX_UAVS)
    ] = None  # of a fleet in place of the scenario's
    list: Annotated[str | None, text(200)] = None  # file of sensors
    set: Annotated[dict[str, Any] | None, overrides()] = None


class Conditions(Section):
    """A file of conditions."""

    rows: Annotated[tuple[RowConfig, ...], Entries(1)]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One condition, ready to be flown."""

    name: str
    kind: str
    scenario: Scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """One policy in the missions of a row."""

    version: str
    flown: Flown
    standing: Standing
    plan_share: float  # shortest plans' energy over the policy's, nan without plans


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """All that was flown in a row, by policy; the rules are there always."""

    row: Row
    rule: str  # the better one
    judged: Mapping[str, Judged]

    @property
    def n_missions(self) -> int:
        """How many missions each policy flew."""
        return self.judged[self.rule].flown.metrics.n_missions


def rows_of(path: Path, list_folders: Sequence[Path], pattern: str = '*') -> Iterator[Row]:
    """The rows of a file whose name or kind fits a pattern; a line for each whose list is missing.

    Raises:
        ConfigError: the file, a row or its scenario cannot be read.
    """
    document = layers.parse(layers.read_text(path), label=str(path), folder=path.parent)
    config = validated(Conditions, document)
    names = [row.name for row in config.rows]
    if doubles := {name for name in names if names.count(name) > 1}:
        raise ConfigError(f'{path}: two rows are called {", ".join(sorted(doubles))}')
    for row in config.rows:
        if not (_fits(row.name, pattern) or _fits(row.kind, pattern)):
            continue
        found = _list_file(row, (path.parent, *list_folders))
        if row.list is not None and found is None:
            terminal.say(f'row {row.name} is left out: there is no {row.list}: name its --lists')
            continue
        try:
            scenario = _scenario_of(row, found)
        except ConfigError as error:
            raise ConfigError(f'{path}: row {row.name}: {error}') from error
        yield Row(name=row.name, kind=row.kind, scenario=scenario)


def drawn_rows(courses: str, number: int, within: str | None = None) -> Iterator[Row]:
    """Rows that are drawn as courses of trainings are, by a seed that none has.

    Args:
        number: of rows; fewer, where hardly any lies within.
        within: a policy; rows in which it would fly as a rule are left out.

    Raises:
        ConfigError: there are no such courses, or they cannot be flown.
    """
    distribution, n_found = load_distribution(courses), 0
    judge = None if within is None else policy_named(within)
    for index in range(number if judge is None else MOST_DRAWS * number):
        scenario = draw_course(distribution, DRAWN_SEED, index)
        if judge is not None and rule_of(judge, brief(scenario)) is not None:
            continue
        area, n_uavs = scenario.area, scenario.n_uavs
        name = f'{scenario.name}: {n_uavs} over {area.n_rows} x {area.n_columns}'
        yield Row(name=name, kind=distribution.name, scenario=scenario)
        n_found += 1
        if n_found == number:
            return


def _fits(name: str, pattern: str) -> bool:
    return fnmatch(name, pattern) or pattern in name


def _list_file(row: RowConfig, folders: Sequence[Path]) -> Path | None:
    if row.list is None:
        return None
    return next((file for folder in folders if (file := folder / row.list).is_file()), None)


def _scenario_of(row: RowConfig, list_file: Path | None) -> Scenario:
    values = dict(row.set or {})
    if list_file is not None:
        listed = {'kind': 'csv', 'file': str(list_file.resolve()), 'origin': 'auto'}
        values['sensors'] = listed
    if row.speeds_mps is not None:
        values['fleet.uavs'] = [{'speed_mps': speed_mps} for speed_mps in row.speeds_mps]
    scenario = load(row.scenario or BASE, values)
    return scenario if row.uavs is None else with_uavs(scenario, row.uavs)


def fly_row(
    row: Row,
    policies: Sequence[str],
    n_missions: int,
    n_plans: int,
    advance: Callable[[int], None],
) -> Result:
    """Fly a row by the rules and by those of the policies that fit.

    Args:
        n_plans: of the missions are planned for, too, unless UAVs are lost in them.
        advance: called with the number of missions that are done with.
    """
    site, seeds = build_site(row.scenario), range(FIRST_SEED, FIRST_SEED + n_missions)
    flown: dict[str, Flown] = {}
    versions: dict[str, str] = {}
    for name in dict.fromkeys((*RULES, *policies)):
        try:
            versions[name] = policy_for(name, row.scenario).version
        except PolicyMismatchError:  # it does not fit
            advance(n_missions)
            continue
        flown[name] = Flown(metrics=fly_for_metrics(site, seeds, name))
        advance(n_missions)
    plans_j = shortest_plans_j(site, seeds[:n_plans], advance)
    return Result(
        row=row,
        rule=better_rule(flown),
        judged={
            name: Judged(
                version=versions[name],
                flown=own,
                standing=standing_of(own, flown, FIRST_SEED),
                plan_share=plan_share(own, plans_j),
            )
            for name, own in flown.items()
        },
    )


def shortest_plans_j(site: Site, seeds: Sequence[int], advance: Callable[[int], None]) -> Floats:
    """Energy of missions' shortest clairvoyant plans [J], nan where there is none."""
    plans_j = np.full(len(seeds), np.nan)
    for place, seed in enumerate(seeds):
        if not site.scenario.faults:  # a plan would know the UAVs that are lost
            shortest = bound_of(site, seed).shortest
            plans_j[place] = math.nan if shortest is None else shortest.total_energy_j
        advance(1)
    return plans_j


def plan_share(own: Flown, plans_j: Floats) -> float:
    """Mean share of a policy's energy that shortest plans take, where it collects everything."""
    n_plans = len(plans_j)
    known = own.metrics.is_complete[:n_plans] & np.isfinite(plans_j)
    shares = plans_j / own.metrics.energy_j[:n_plans].sum(axis=1)
    return float(shares[known].mean()) if known.any() else math.nan


def table_of(results: Sequence[Result]) -> Table:
    """A line for each policy in each row."""
    caption = '*: the better rule; !: below it by more than the 95 % interval'
    table = Table(box=SIMPLE_HEAD, caption=caption, pad_edge=False)
    for heading in ('condition', 'policy'):
        table.add_column(heading, no_wrap=True)
    for heading in ('missions', 'kbit/J', 'less the better rule', '%', 'of the plan'):
        table.add_column(heading, justify='right', no_wrap=True)
    for heading in ('incomplete', 'as no rule is', '> 2 sweeps'):
        table.add_column(heading, justify='right', no_wrap=True)
    for result in results:
        condition, n_missions = result.row.name, str(result.n_missions)
        for name, judged in result.judged.items():
            is_rule = name == result.rule
            figures = _figures(judged, is_rule=is_rule)
            table.add_row(condition, name + '*' * is_rule, n_missions, *figures)
            condition = n_missions = ''
    return table


def _figures(judged: Judged, *, is_rule: bool) -> Iterator[str]:
    flown, standing = judged.flown, judged.standing
    difference, mark = standing.difference, '! ' if standing.is_below else ''
    span = f'{difference.mean:+.3f} ({difference.low:+.3f} to {difference.high:+.3f})'
    yield f'{flown.mean_kbit_per_j:.3f}'
    yield '' if is_rule else f'{mark}{span}'
    yield '' if is_rule else f'{100 * standing.gain_share:+.1f}'
    yield '' if math.isnan(judged.plan_share) else f'{100 * judged.plan_share:.1f} %'
    collected = percent(float(flown.metrics.collected_share.mean()))
    yield f'{flown.n_incomplete}, {collected}' if flown.n_incomplete else ''
    for count in (standing.n_missed, standing.n_too_long):
        yield str(count) if count else ''


def rules_verdict(results: Sequence[Result]) -> str:
    """In which rows HERT is the better rule, in one line."""
    by_hert = [it.row.name for it in results if it.rule == HERT]
    named = f': {"; ".join(by_hert)}' if by_hert else ''
    return f'HERT is the better rule in {len(by_hert)} of {len(results)} rows{named}'


def verdict_of(results: Sequence[Result], policy: str) -> Iterator[str]:
    """What the rows say of a policy, in lines."""
    own = {it.row.name: it.judged[policy].standing for it in results if policy in it.judged}
    n_missions = sum(it.n_missions for it in results if policy in it.judged)
    if not own:
        yield f'{policy}: fits none of {len(results)} rows'
        return
    gains = sorted(100 * it.gain_share for it in own.values())
    yield (
        f'{policy}: flew {len(own)} of {len(results)} rows, {n_missions:,} missions; against the'
        f' better rule {np.median(gains):+.1f} % in the median row, {gains[0]:+.1f} to'
        f' {gains[-1]:+.1f} %'
    )
    yield _counted('  below it by more than the interval', own, lambda it: int(it.is_below))
    yield _counted('  incomplete where a rule is not', own, lambda it: it.n_missed, 'missions')
    yield _counted(
        f"  over {TOO_LONG:g} times the sweep's time", own, lambda it: it.n_too_long, 'missions'
    )


def _counted(
    what: str, own: Mapping[str, Standing], count: Callable[[Standing], int], noun: str = ''
) -> str:
    counts = {name: n for name, it in own.items() if (n := count(it))}
    if not counts:
        return f'{what}: none'
    if not noun:
        return f'{what}: {len(counts)} rows: {"; ".join(counts)}'
    rows = '; '.join(f'{name} {n}' for name, n in counts.items())
    return f'{what}: {sum(counts.values())} {noun}: {rows}'


def comparison_of(results: Sequence[Result], policy: str, other: str) -> str:
    """How a policy stands to another where both flew, in one line."""
    gains = {
        it.row.name: 100
        * (it.judged[policy].flown.mean_kbit_per_j / it.judged[other].flown.mean_kbit_per_j - 1.0)
        for it in results
        if {policy, other} <= it.judged.keys()
    }
    if not gains:
        return f'{policy} and {other}: no row was flown by both'
    worst, best = min(gains, key=gains.__getitem__), max(gains, key=gains.__getitem__)
    return (
        f'{policy} against {other}, {len(gains)} rows: {np.median([*gains.values()]):+.1f} % in'
        f' the median row, {gains[worst]:+.1f} % ({worst}) to {gains[best]:+.1f} % ({best})'
    )


def csv_of(results: Sequence[Result]) -> bytes:
    """A row for each policy in each condition."""
    rows = [_csv_row(result, name) for result in results for name in result.judged]
    return files.csv_of([tuple(rows[0]), *(row.values() for row in rows)])


def _csv_row(result: Result, name: str) -> dict[str, object]:
    judged, scenario = result.judged[name], result.row.scenario
    metrics, standing = judged.flown.metrics, judged.standing
    return {
        'condition': result.row.name,
        'kind': result.row.kind,
        'fingerprint': fingerprint(scenario),
        'uavs': scenario.n_uavs,
        'missions': metrics.n_missions,
        'better_rule': result.rule,
        'policy': name,
        'version': judged.version,
        'efficiency_kbit_per_j': judged.flown.mean_kbit_per_j,
        'difference_kbit_per_j': standing.difference.mean,
        'difference_low_kbit_per_j': standing.difference.low,
        'difference_high_kbit_per_j': standing.difference.high,
        'shortest_plan_share': files.blank_if_nan(judged.plan_share),
        'collected_share': float(metrics.collected_share.mean()),
        'completion_s': float(metrics.completion_s.mean()),
        'energy_kj': float(metrics.energy_j.sum(axis=1).mean() / 1e3),
        'incomplete': judged.flown.n_incomplete,
        'incomplete_as_no_rule': standing.n_missed,
        'over_twice_sweep': standing.n_too_long,
    }


def arguments_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description='Flies policies in conditions of all kinds.')
    default = [name for name in (ANYWHERE,) if name in shipped_policies()] + [STRONG]
    parser.add_argument(
        '--conditions', type=Path, default=HERE / 'anywhere.yaml', metavar='FILE',
        help='the conditions (default: anywhere.yaml; anywhere_held_out.yaml has others)',
    )  # fmt: skip
    parser.add_argument(
        '--courses', metavar='NAME|FILE',
        help='conditions drawn as these courses of trainings are, in place of a file of them',
    )  # fmt: skip
    parser.add_argument(
        '--drawn', type=options.whole_number(1, 100_000), default=N_DRAWN, metavar='N',
        help='how many of these (%(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--within', metavar='NAME|FILE',
        help='of these, only those in which this policy decides by itself: in its domains',
    )  # fmt: skip
    parser.add_argument(
        '--policies', nargs='*', default=default, metavar='NAME|FILE',
        help='what flies beside sweep and HERT (default: anywhere, if shipped, and strong)',
    )  # fmt: skip
    parser.add_argument(
        '--rows', default='*', metavar='PATTERN', help='a part of the name or kind of rows, or *'
    )
    parser.add_argument(
        '--missions', type=options.whole_number(1, 100_000), metavar='N',
        help=f"in each row ({N_MISSIONS}; {N_PAPER_MISSIONS} where it is the paper's)",
    )  # fmt: skip
    parser.add_argument(
        '--plans', type=options.whole_number(0, 100_000), default=N_PLANS, metavar='N',
        help='missions of each row that are planned for (%(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--lists', nargs='+', type=Path, default=[], metavar='FOLDER',
        help='where else lists of sensors are',
    )  # fmt: skip
    parser.add_argument('--csv', type=options.output, metavar='FILE', help='write a table, too')
    arguments = parser.parse_args(words)
    if arguments.within is not None and arguments.courses is None:
        parser.error('--within: must come with --courses')
    return arguments


def fly_all(arguments: argparse.Namespace, rows: Sequence[Row], results: list[Result]) -> None:
    """Fly the rows into `results`; their table on the disk is kept up to date."""
    n_missions = [
        arguments.missions or (N_PAPER_MISSIONS if row.kind == PAPER else N_MISSIONS)
        for row in rows
    ]
    n_plans = [min(arguments.plans, most) for most in n_missions]
    n_policies = len({*RULES, *arguments.policies})
    total = sum(n_policies * most for most in n_missions) + sum(n_plans)
    with terminal.progress_bar(total, 'missions and plans') as advance:
        for row, most, plans in zip(rows, n_missions, n_plans, strict=True):
            results.append(fly_row(row, arguments.policies, most, plans, advance))
            if arguments.csv is not None:
                terminal.write_files({arguments.csv: csv_of(results)})


def show(results: Sequence[Result], policies: Sequence[str]) -> None:
    """Print the table, and what it says."""
    console = plain_console()
    table, whole_options = table_of(results), console.options.update(max_width=MOST_COLUMNS)
    # In fewer columns than it takes it would lose figures: the terminal wraps its lines then.
    console.width = max(console.width, console.measure(table, options=whole_options).maximum)
    console.print(table)
    lines = [rules_verdict(results)]
    for policy in dict.fromkeys(policies):
        lines += verdict_of(results, policy)
    if len(policies) > 1:
        lines += [comparison_of(results, policies[0], other) for other in policies[1:]]
    for line in lines:
        console.print(line, soft_wrap=True)


def main(words: Sequence[str] | None = None) -> int:
    """Fly all, print the table and what it says; returns the exit status."""
    arguments, results = arguments_of(words), list[Result]()
    try:
        for name in {*arguments.policies} - {STRONG} | {arguments.within} - {None}:
            policy_named(name)
        rows = (
            [*rows_of(arguments.conditions, arguments.lists, arguments.rows)]
            if arguments.courses is None
            else [*drawn_rows(arguments.courses, arguments.drawn, arguments.within)]
        )
        if not rows:
            where = arguments.courses or f'{arguments.conditions}, --rows {arguments.rows}'
            raise ConfigError(f'{where}: there is no such row')
    except (ConfigError, PolicyMismatchError) as error:
        terminal.say_error(error)
        return UNUSABLE
    status = 0
    try:
        fly_all(arguments, rows, results)
    except KeyboardInterrupt:
        terminal.say(f'interrupted after {len(results)} of {len(rows)} rows')
        status = INTERRUPTED
    if results:
        show(results, arguments.policies)
    return status


if __name__ == '__main__':
    sys.exit(main())

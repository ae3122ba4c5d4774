"""Says what not to know the demand costs: on tiny areas exactly, on paper_10x10 at most so much.

python bench/unknown_demand.py [--missions N] [--seed FIRST] [--share PHI]
    [--areas 3x3 4x4 ...] [--pair-areas 2x3 3x3 ...] [--pair-speeds 5,5 5,10 ...]

One UAV flies at 5 m/s from the south-west cell. On a tiny area every cell has a sensor of 3 Mbit
and a channel that never changes; missions are the world's own, or, for more than 20 cells, fields
of which each cell holds data by itself, so that less is to be searched: of 5x5, minutes and
gigabytes. Five rows: all demand known; known, but every cell must be seen all the same, as no
mission of a policy ends sooner; the best policy that does not know the demand; sweep; HERT.

Two UAVs fly over the pair areas at each pair of speeds [m/s] and hear each other always: all
demand known; the best pair that does not know it; sweep; HERT; the first two once for the least
time and once for the least energy.

Then paper_10x10 by one UAV: the plan, the energy that no flight gets below, the shipped policy,
sweep and HERT. All by the same missions.
"""

from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
import math
import time

import numpy as np
from rich.console import Console
from rich.table import Table
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.analysis.statistics import bootstrap_interval
from uav_collect.kernels.arrays import Floats, row_of
from uav_collect.missions.rollout import fly
from uav_collect.planning.bound import bound_of
from uav_collect.planning.pair_policy import BestPairPolicy
from uav_collect.planning.pair_search import PairSearch
from uav_collect.planning.problem import problem_of
from uav_collect.planning.search import Aim
from uav_collect.planning.seeing import least_seeing_energy_j
from uav_collect.planning.unknown_demand import (
    BestPolicy,
    drawn_counts,
    independent_counts,
    UnknownDemand,
)
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.briefing import briefing_of
from uav_collect.uav.policy import ANYWHERE
from uav_collect.world.sensor_field import demand_by_cell, demand_of, lay_out

MOST_DRAWN_CELLS = 20  # of an area whose beliefs are few enough by the world's own law
DATA_MBIT = 3.0
CERTAIN = {'radio.los_b': 10.0, 'radio.rician_a1': 1000.0, 'radio.rician_a2': 20.0}
RULES = ('sweep', 'hert')


@dataclass(frozen=True, kw_only=True)
class Flown:
    """Missions of an area by several ways to fly them, (N,) each."""

    energy_j: Mapping[str, Floats]
    bit: Floats


def tiny(
    n_rows: int,
    n_columns: int,
    share: float,
    cells: Sequence[int] | None = None,
    speeds_mps: Sequence[float] = (5.0,),
) -> Scenario:
    """A tiny area with a sensor in every cell, or in some, all of which hold data then."""
    size_m = 50.0
    some = range(n_rows * n_columns) if cells is None else cells
    entries = [
        {
            'id': f'S{cell}',
            'x_m': (cell % n_columns + 0.5) * size_m,
            'y_m': (cell // n_columns + 0.5) * size_m,
            'data_mbit': DATA_MBIT,
        }
        for cell in some
    ]
    demand = {'cell_share': 'all' if cells is not None else share, 'data_mbit': 'csv'}
    values = {
        'name': f'{n_rows}x{n_columns}',
        'area': {
            'rows': n_rows, 'columns': n_columns, 'cell_size_m': size_m, 'altitude_m': 100.0
        },
        'sensors': {'kind': 'listed', 'entries': entries},
        'demand': {**demand, 'known_empty': 'none'},
        'radio.contact_range_m': math.inf,
        'fleet.uavs': [{'speed_mps': speed_mps} for speed_mps in speeds_mps],
        **CERTAIN,
    }  # fmt: skip
    return load('paper_10x10', values)


def fields(
    scenario: Scenario, share: float, seeds: Sequence[int], is_independent: bool
) -> Iterator[tuple[Site, int]]:
    """The missions of an area: sites and seeds."""
    n_rows, n_columns = scenario.area.n_rows, scenario.area.n_columns
    site = build_site(scenario)
    for seed in seeds:
        if is_independent:
            rng = np.random.Generator(np.random.Philox(key=seed))
            cells = np.flatnonzero(rng.random(scenario.n_cells) < share).tolist()
            if not cells:  # no list of sensors is empty; of 25 cells one in 7,500 is
                continue
            yield build_site(tiny(n_rows, n_columns, share, cells)), seed
        else:
            yield site, seed


def data_cells(site: Site, seed: int) -> list[int]:
    """The cells that hold data in a mission."""
    by_cell = demand_by_cell(lay_out(site).first_sensor, demand_of(site, seed).tolist())
    return [int(cell) for cell in np.flatnonzero(by_cell)]


def whole(site: Site, seed: int, policy: str | Callable[[], BestPolicy]) -> MissionMetrics:
    """A mission flown, which must have collected everything."""
    [log] = fly(site, [seed], policy, guard_after=0)
    mission = mission_metrics(log)
    assert mission.is_complete, (site.scenario.name, seed)
    return mission


def on_tiny_area(
    n_rows: int, n_columns: int, share: float, seeds: Sequence[int], console: Console
) -> None:
    """Print what is possible on a tiny area, and what is flown."""
    scenario = tiny(n_rows, n_columns, share)
    n_cells = n_rows * n_columns
    is_independent = n_cells > MOST_DRAWN_CELLS
    counts = independent_counts(n_cells, share) if is_independent else drawn_counts(scenario)
    start_s = time.process_time()
    best = UnknownDemand(build_site(scenario), counts, is_independent=is_independent)
    length = best.expected_length()
    used_s = time.process_time() - start_s
    briefing, size_m = best.briefing, scenario.area.cell_size_m
    speed_mps = briefing.speed_mps[0]
    side_j = briefing.flight_power_w[0] * size_m / speed_mps
    names = ('demand known', 'known, every cell seen', 'best not knowing', *RULES)
    energy_j: dict[str, list[float]] = {name: [] for name in names}
    bit, ways = [], []
    for site, seed in fields(scenario, share, seeds, is_independent):
        cells = data_cells(site, seed)
        mission = whole(site, seed, lambda: BestPolicy(best))
        way = mission.uavs[0].flight_s * speed_mps / size_m
        hover_j = mission.energy_j - way * side_j
        ways.append(way)
        bit.append(mission.total_bit)
        for name, sees_all in zip(names, (False, True), strict=False):
            known = best.length_knowing(cells, sees_all=sees_all)
            energy_j[name].append(known * side_j + hover_j)
        energy_j[names[2]].append(mission.energy_j)
        for rule in RULES:
            energy_j[rule].append(whole(site, seed, rule).energy_j)
    low, high = interval(np.array(ways))
    law = 'each cell by itself' if is_independent else "the world's own draws"
    console.print(
        f'\n{n_rows}x{n_columns} cells, data density {share:g} ({law}), {len(bit)} missions from'
        f' seed {seeds[0]}. Best policy: a way of {length:.4f} cell sides on average, exactly;'
        f' flown {np.mean(ways):.3f} ({low:.3f} to {high:.3f}); {best.n_states:,} states,'
        f' {used_s:.0f} s of CPU time'
    )
    flown = Flown(energy_j={k: np.array(v) for k, v in energy_j.items()}, bit=np.array(bit))
    console.print(table_of(flown, names[2]))


def on_pair_area(
    n_rows: int,
    n_columns: int,
    share: float,
    speeds_mps: Sequence[float],
    seeds: Sequence[int],
    console: Console,
) -> None:
    """Print what two UAVs can do on a tiny area, and what is flown."""
    scenario = tiny(n_rows, n_columns, share, speeds_mps=speeds_mps)
    site = build_site(scenario)
    briefing, counts = briefing_of(site), drawn_counts(scenario)
    known_cells = [sum(1 << cell for cell in data_cells(site, seed)) for seed in seeds]
    flown = {rule: all_whole(site, seeds, rule) for rule in RULES}
    nothing = row_of([0.0, 0.0])
    aims = {
        'time s': (Aim(1.0, nothing, nothing), completion_s),
        'energy kJ': (Aim(0.0, briefing.flight_power_w, briefing.hover_power_w), energy_kj),
    }
    fleet = ' and '.join(f'{speed_mps:g}' for speed_mps in speeds_mps)
    console.print(
        f'\n{n_rows}x{n_columns} cells, two UAVs at {fleet} m/s, data density {share:g},'
        f' {len(seeds)} missions from seed {seeds[0]}'
    )
    for what, (aim, measured) in aims.items():
        start_s = time.process_time()
        search = PairSearch(site, counts, aim)
        expected = search.expected()
        used_s = time.process_time() - start_s
        pair = all_whole(site, seeds, partial(BestPairPolicy, search, []))
        unit = 1.0 if what == 'time s' else 1e-3
        best = measured(pair)
        values = {
            'demand known': np.array([search.knowing(cells) * unit for cells in known_cells]),
            'best not knowing': best,
            **{rule: measured(missions) for rule, missions in flown.items()},
        }
        console.print(
            f'least {what}: {expected * unit:.4f} on average, exactly; {search.n_states:,} states,'
            f' {used_s:.0f} s of CPU time'
        )
        table = Table('', what, '% of the best not knowing')
        for name, each in values.items():
            low, high = interval(each)
            ratios = ratio_interval(best, each)
            table.add_row(
                name,
                f'{each.mean():.3f} ({low:.3f} to {high:.3f})',
                f'{100 * best.sum() / each.sum():.1f}'
                f' ({100 * ratios[0]:.1f} to {100 * ratios[1]:.1f})',
            )
        console.print(table)


def all_whole(
    site: Site, seeds: Sequence[int], policy: str | Callable[[], BestPairPolicy]
) -> list[MissionMetrics]:
    """Missions flown, which must have collected everything."""
    missions = [mission_metrics(log) for log in fly(site, seeds, policy, guard_after=0)]
    assert all(mission.is_complete for mission in missions)
    return missions


def completion_s(missions: Sequence[MissionMetrics]) -> Floats:
    """When all are home, (N,)."""
    return np.array([mission.completion_s for mission in missions])


def energy_kj(missions: Sequence[MissionMetrics]) -> Floats:
    """What both used, (N,)."""
    return np.array([mission.energy_kj for mission in missions])


def on_paper_area(seeds: Sequence[int], console: Console) -> None:
    """Print how near one UAV comes to what no flight gets beyond on the paper's area."""
    site = build_site(with_uavs(load('paper_10x10'), 1))
    briefing = briefing_of(site)
    policies = (ANYWHERE, *RULES)
    limits = ('no flight below, cells unseen', 'no flight below')
    energy_j: dict[str, list[float]] = {name: [] for name in ('plan', *limits, *policies)}
    bit = []
    for seed in seeds:
        bound = bound_of(site, seed)
        assert bound.thriftiest is not None
        plan_j = bound.thriftiest.total_energy_j
        seeing_j = least_seeing_energy_j(briefing, problem_of(site, seed, 'exact'), plan_j)
        bit.append(bound.total_bit)
        found = (plan_j, bound.least_energy_j, seeing_j)
        for name, each_j in zip(('plan', *limits), found, strict=True):
            energy_j[name].append(each_j)
    for policy in policies:
        missions = [mission_metrics(log) for log in fly(site, seeds, policy)]
        assert all(mission.is_complete for mission in missions)
        energy_j[policy] = [mission.energy_j for mission in missions]
    console.print(f'\npaper_10x10, one UAV, {len(bit)} missions from seed {seeds[0]}')
    flown = Flown(energy_j={k: np.array(v) for k, v in energy_j.items()}, bit=np.array(bit))
    console.print(table_of(flown, limits[1]))


def table_of(flown: Flown, reference: str) -> Table:
    """Mean energy and efficiency by way to fly; each also of the reference's efficiency."""
    table = Table('', 'energy kJ', 'kbit/J', f'efficiency, % of {reference}')
    for name, energy_j in flown.energy_j.items():
        kbit_per_j = flown.bit / energy_j / 1e3
        share = flown.energy_j[reference].sum() / energy_j.sum()
        ratios = ratio_interval(flown.energy_j[reference], energy_j)
        low, high = interval(energy_j / 1e3)
        table.add_row(
            name,
            f'{energy_j.mean() / 1e3:.3f} ({low:.3f} to {high:.3f})',
            f'{kbit_per_j.mean():.4f}',
            f'{100 * share:.1f} ({100 * ratios[0]:.1f} to {100 * ratios[1]:.1f})',
        )
    return table


def interval(values: Floats) -> tuple[float, float]:
    """Of the mean, by bootstrap."""
    low, high = bootstrap_interval(values[:, None], 0)
    return float(low[0]), float(high[0])


def ratio_interval(one: Floats, other: Floats) -> tuple[float, float]:
    """Of the ratio of two means over the same missions, by bootstrap."""
    rng = np.random.Generator(np.random.Philox(key=0))
    rows = rng.integers(len(one), size=(2000, len(one)))
    low, high = np.quantile(one[rows].sum(axis=1) / other[rows].sum(axis=1), [0.025, 0.975])
    return float(low), float(high)


def main() -> None:
    """Print the tables."""
    parser = ArgumentParser()
    parser.add_argument('--missions', type=int, default=300)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--areas', nargs='*', default=['3x3', '4x4', '4x5'])
    parser.add_argument('--pair-areas', nargs='*', default=['2x3', '3x3'])
    parser.add_argument('--pair-speeds', nargs='*', default=['5,5', '5,10'])
    parser.add_argument('--share', type=float, default=0.3)
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.missions)
    console = Console(width=120)
    for area in arguments.areas:
        n_rows, n_columns = map(int, area.split('x'))
        on_tiny_area(n_rows, n_columns, arguments.share, seeds, console)
    for area in arguments.pair_areas:
        n_rows, n_columns = map(int, area.split('x'))
        for speeds in arguments.pair_speeds:
            speeds_mps = [float(speed) for speed in speeds.split(',')]
            on_pair_area(n_rows, n_columns, arguments.share, speeds_mps, seeds, console)
    on_paper_area(seeds, console)


if __name__ == '__main__':
    main()

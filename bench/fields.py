"""Flies rules and shipped policies over fields that are no open squares, beside the shortest plan.

python bench/fields.py [MISSIONS [ROUNDS]]

ROUNDS are those of the search for the plans. Energy is plenty everywhere: what is compared is how
policies fly, not how they run out of it.
"""

from collections.abc import Iterator, Sequence
import sys
import time

import numpy as np
from rich.console import Console
from rich.table import Table
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.errors import PolicyMismatchError
from uav_collect.missions.rollout import fly
from uav_collect.planning.bound import Bound, bound_of, N_ROUNDS
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.briefing import brief
from uav_collect.uav.policy import policy_for, shipped_policies
from uav_collect.uav.sharing import shared_tour

Values = dict[str, object]

FLEET: Values = {
    'fleet.default.energy_budget_kj': 5000.0,
    'fleet.uavs': [{'speed_mps': 10.0}, {'speed_mps': 18.0}],
}
WEST = {'cell': [25, 0]}


def sensors(places_m: Sequence[tuple[float, float]]) -> Values:
    """Sensors at places [m], where everybody knows that no other cell holds data."""
    entries = [
        {'id': f'S{number}', 'x_m': float(x_m), 'y_m': float(y_m)}
        for number, (x_m, y_m) in enumerate(places_m, start=1)
    ]
    return {
        'sensors': {'kind': 'listed', 'entries': entries},
        'demand': {'cell_share': 'all', 'data_mbit': [0.5, 2.0], 'known_empty': 'sensors'},
    }


def square(west_m: float, south_m: float, side_m: float) -> list[list[float]]:
    """A no-fly zone."""
    east_m, north_m = west_m + side_m, south_m + side_m
    return [[west_m, south_m], [east_m, south_m], [east_m, north_m], [west_m, north_m]]


def fields() -> Iterator[tuple[str, Scenario]]:
    """The fields, by what they are."""
    pipeline = [(100.0 * km, 2500.0 + 40.0 * (-1) ** (km + 1)) for km in range(51)]
    values = {'area.cells_per_side': 51, 'area.cell_size_m': 100.0, **sensors(pipeline)}
    home = {'fleet.default.start': WEST, 'fleet.default.home': WEST}
    yield '51 sensors along 5 km', load('paper_10x10', {**FLEET, **values, **home})
    zones = {'area.no_fly': [square(500.0, 500.0, 500.0), square(200.0, 200.0, 150.0)]}
    angle = {'area.cells_per_side': 20, **zones}
    yield 'an L, a no-fly square in it', load('paper_10x10', {**FLEET, **angle})
    yield 'Lillgrund, 48 turbines', load('lillgrund', {**FLEET, 'demand.known_empty': 'sensors'})
    places_m = np.random.default_rng(0).uniform(0.0, 3000.0, (6000, 2))
    large = {'area.cells_per_side': 60, **sensors([(x_m, y_m) for x_m, y_m in places_m])}
    few = {'demand.cell_share': 0.1}
    yield '6,000 sensors, 60 x 60 cells', load('paper_10x10', {**FLEET, **large, **few})


def fitting(scenario: Scenario) -> list[str]:
    """The shipped policies that can fly a scenario."""
    names = []
    for name in shipped_policies():
        try:
            policy_for(name, scenario)
        except PolicyMismatchError:
            continue
        names.append(name)
    return names


def flown(site: Site, policy: str, seeds: range) -> tuple[float, float, float]:
    """Mean efficiency [kbit/J], completion time [s] and collected share of some missions."""
    missions = [mission_metrics(log) for log in fly(site, seeds, policy)]
    return (
        float(np.mean([mission.efficiency_kbit_per_j for mission in missions])),
        float(np.mean([mission.completion_s for mission in missions])),
        float(np.mean([mission.collected_share for mission in missions])),
    )


def planned(bounds: Sequence[Bound]) -> tuple[float, float]:
    """Mean efficiency [kbit/J] and completion time [s] of the shortest plans."""
    plans = [(bound, bound.shortest) for bound in bounds if bound.shortest is not None]
    return (
        float(np.mean([bound.efficiency_kbit_per_j(plan) for bound, plan in plans])),
        float(np.mean([plan.completion_s for _, plan in plans])),
    )


def main() -> None:
    """Fly and plan all, and print the table."""
    n_missions = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    n_rounds = int(sys.argv[2]) if len(sys.argv) > 2 else N_ROUNDS
    table = Table('field', 'policy', 'kbit/J', 'of the plan', 's', 'of the plan', 'collected')
    for name, scenario in fields():
        site, seeds = build_site(scenario), range(n_missions)
        start_s = time.perf_counter()
        shared_tour(brief(scenario))
        took_ms = 1e3 * (time.perf_counter() - start_s)
        most, least_s = planned([bound_of(site, seed, 'exact', n_rounds) for seed in seeds])
        table.add_row(name, 'shortest plan', f'{most:.3f}', '', f'{least_s:.0f}', '', '')
        results = {policy: flown(site, policy, seeds) for policy in ('sweep', 'hert')}
        learned = {policy: flown(site, policy, seeds) for policy in fitting(scenario)}
        if learned:
            best = max(learned, key=lambda policy: (learned[policy][2], learned[policy][0]))
            results[best] = learned[best]
        for policy, (efficiency, completion_s, share) in results.items():
            table.add_row(
                f'tour in {took_ms:.0f} ms' if policy == 'sweep' else '',
                policy,
                f'{efficiency:.3f}',
                f'{100 * efficiency / most:.0f} %',
                f'{completion_s:.0f}',
                f'{completion_s / least_s:.2f}',
                f'{100 * share:.1f} %',
            )
    Console(width=110).print(table)


if __name__ == '__main__':
    main()

"""The best policy that does not know the demand: it is as good as trying everything finds.

  north
2 . . .     3 x 3 cells of 50 m and less; the UAV starts and lands at 0, in the south-west cell.
1 . . .     Each cell has a sensor of 3 Mbit under its centre and a channel that is certain.
0 . . .
  0 1 2
"""

from functools import cache
import math

from interpreted import interpreted
import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.missions.rollout import fly
from uav_collect.planning import unknown_demand
from uav_collect.planning.bound import bound_of
from uav_collect.planning.problem import problem_of
from uav_collect.planning.relaxation import least_energy_j
from uav_collect.planning.seeing import least_seeing_energy_j
from uav_collect.planning.unknown_demand import (
    BestPolicy,
    drawn_counts,
    independent_counts,
    UnknownDemand,
)
from uav_collect.scenario.site import build_site
from uav_collect.uav.briefing import briefing_of
from uav_collect.world.sensor_field import demand_of
from unknown_demand import demands, field, SHARE, SIZE_M, STEPS

pytestmark = pytest.mark.usefixtures('bound_cache')


def best_of(n_rows: int, n_columns: int) -> UnknownDemand:
    scenario = field(n_rows, n_columns)
    return UnknownDemand(build_site(scenario), drawn_counts(scenario))


def way(mission: MissionMetrics) -> float:
    """The way of one UAV, in sides of a cell."""
    assert mission.is_complete
    return mission.uavs[0].flight_s * 5.0 / SIZE_M


def by_trying_everything(n_rows: int, n_columns: int) -> float:
    """The least way expected, over all policies, also those that hover later."""
    n_cells = n_rows * n_columns
    every = frozenset(range(n_cells))
    places = [divmod(cell, n_columns) for cell in range(n_cells)]
    view = [
        frozenset(
            other
            for other in range(n_cells)
            if max(abs(places[other][0] - row), abs(places[other][1] - column)) < 2
        )
        for row, column in places
    ]
    law = [(frozenset(cells), chance) for cells, chance in demands(n_rows, n_columns)]

    @cache
    def looks(
        seen: frozenset[int], held: frozenset[int], cell: int
    ) -> list[tuple[frozenset[int], float]]:
        """What the cells seen may hold after a look, with chances."""
        now: dict[frozenset[int], float] = {}
        for cells, chance in law:
            if cells & seen == held:
                found = cells & (seen | view[cell])
                now[found] = now.get(found, 0.0) + chance
        total = sum(now.values())
        return [(found, chance / total) for found, chance in now.items() if chance > 0.0]

    def after(seen, held, done, cell, back):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        wider = seen | view[cell]
        return sum(
            chance * value(wider, found, done, cell, back)
            for found, chance in looks(seen, held, cell)
        )

    def value(seen, held, done, cell, back):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        if seen == every and held == done:
            return math.hypot(*places[cell])
        if seen == every:  # what was collected is no longer of use
            held, done = held - done, frozenset()
        return level(seen, held, done)[cell, back]

    @cache
    def level(seen, held, done):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        """Values by cell and move back, none of which brings news."""
        nodes = {(c, b): math.inf for c in range(n_cells) if view[c] <= seen for b in range(-1, 4)}
        events: dict[tuple[int, int], float] = {}

        def arrival(there: int, move: int) -> float:
            back = (move + 2) % 4
            if view[there] <= seen:
                return nodes[there, back]
            if (there, back) not in events:
                events[there, back] = after(seen, held, done, there, back)
            return events[there, back]

        here = [c for c in held - done if view[c] <= seen]
        hovers = {c: value(seen, held, done | {c}, c, -1) for c in here}
        is_better = True
        while is_better:
            is_better = False
            for cell, back in nodes:
                row, column = places[cell]
                ways = {
                    move: (row + up) * n_columns + column + right
                    for move, (up, right) in enumerate(STEPS)
                    if 0 <= row + up < n_rows and 0 <= column + right < n_columns
                }
                least = hovers.get(cell, math.inf)
                for move, there in ways.items():
                    if move != back or len(ways) == 1:
                        least = min(least, 1.0 + arrival(there, move))
                if least < nodes[cell, back] - 1e-12:
                    nodes[cell, back], is_better = least, True
        return nodes

    return float(after(frozenset(), frozenset(), frozenset(), 0, -1))


@pytest.mark.parametrize(('n_rows', 'n_columns'), [(1, 4), (2, 2), (2, 3), (3, 3)])
def test_its_value_is_what_trying_everything_finds(n_rows: int, n_columns: int) -> None:
    found = best_of(n_rows, n_columns).expected_length()
    assert found == pytest.approx(by_trying_everything(n_rows, n_columns), rel=1e-12)


def test_flown_over_every_demand_it_has_the_value_that_was_found_and_no_rule_has_less() -> None:
    best = best_of(2, 3)
    flown = {'best': 0.0, 'sweep': 0.0, 'hert': 0.0}
    for cells, chance in demands(2, 3):
        if chance == 0.0:  # that nothing waits is not drawn
            continue
        site = build_site(field(2, 3, cells))
        for name in flown:
            policy = (lambda: BestPolicy(best)) if name == 'best' else name
            [log] = fly(site, [0], policy, guard_after=0)
            flown[name] += chance * way(mission_metrics(log))
    assert flown['best'] == pytest.approx(best.expected_length(), rel=1e-9)
    assert min(flown['sweep'], flown['hert']) >= flown['best']


def test_in_missions_as_the_world_draws_them_it_flies_its_value() -> None:
    best, site = best_of(3, 3), build_site(field(3, 3))
    logs = fly(site, range(300), lambda: BestPolicy(best), guard_after=0)
    ways = [way(mission_metrics(log)) for log in logs]
    away = abs(np.mean(ways) - best.expected_length())
    assert away < 3.0 * np.std(ways) / math.sqrt(len(ways))


def test_who_knows_the_demand_is_never_behind() -> None:
    best, site = best_of(3, 3), build_site(field(3, 3))
    for seed, log in enumerate(fly(site, range(40), lambda: BestPolicy(best), guard_after=0)):
        cells = np.flatnonzero(demand_of(site, seed)).tolist()
        known = best.length_knowing(cells, sees_all=False)
        seeing = best.length_knowing(cells, sees_all=True)
        assert known <= seeing + 1e-9 <= way(mission_metrics(log)) + 2e-9
        shortest = bound_of(site, seed).thriftiest
        assert shortest is not None
        move_j = briefing_of(site).flight_power_w[0] * SIZE_M / 5.0
        hover_j = mission_metrics(log).energy_j - way(mission_metrics(log)) * move_j
        assert known * move_j + hover_j == pytest.approx(shortest.total_energy_j, rel=1e-9)


def test_the_limit_with_every_cell_seen_is_below_the_exact_way_and_above_the_limit_without() -> (
    None
):
    site = build_site(field(4, 5))
    briefing, best = briefing_of(site), best_of(4, 5)
    move_j = briefing.flight_power_w[0] * SIZE_M / 5.0
    n_higher = 0
    for seed in range(12):
        problem = problem_of(site, seed, 'exact')
        cells = np.flatnonzero(demand_of(site, seed)).tolist()
        hover_j = briefing.hover_power_w[0] * sum(problem.hover_s)
        exact_j = best.length_knowing(cells, sees_all=True) * move_j + hover_j
        limit_j = least_seeing_energy_j(briefing, problem, exact_j)
        assert limit_j <= exact_j
        n_higher += limit_j > 1.01 * least_energy_j(problem, exact_j)
    assert n_higher > 0


def test_a_law_that_says_nothing_of_other_cells_may_be_used_without_counting() -> None:
    site, counts = build_site(field(3, 3)), independent_counts(9, SHARE)
    counting = UnknownDemand(site, counts)
    short = UnknownDemand(site, counts, is_independent=True)
    assert short.expected_length() == pytest.approx(counting.expected_length(), rel=1e-12)
    assert short.n_states < counting.n_states


def test_a_square_is_searched_by_halves(monkeypatch: pytest.MonkeyPatch) -> None:
    half = best_of(3, 3)
    whole = best_of(3, 3)
    whole._search = whole._search._replace(side=0)
    assert half.expected_length() == pytest.approx(whole.expected_length(), rel=1e-12)
    assert half.n_states < 0.6 * whole.n_states
    monkeypatch.setattr(unknown_demand, '_FIRST_BITS', 4)
    grown = best_of(3, 3)
    assert grown.expected_length() == half.expected_length()


def value_of_a_square() -> str:
    best = best_of(3, 3)
    return repr((float(best.expected_length()), best.length_knowing([2, 5, 6], sees_all=True)))


def test_compiled_and_interpreted_the_value_is_the_same() -> None:
    assert interpreted(value_of_a_square) == value_of_a_square()


def test_what_it_cannot_search_is_refused() -> None:
    two = tiny(uav(5.0), uav(5.0))
    with pytest.raises(ValueError, match='2 UAVs over 16 cells: must be 1 over 25'):
        UnknownDemand(build_site(two), independent_counts(16, SHARE))
    large = field(5, 6)
    with pytest.raises(ValueError, match='1 UAVs over 30 cells'):
        UnknownDemand(build_site(large), drawn_counts(large))
    empty = tiny(uav(5.0), demand__known_empty='sensors')
    with pytest.raises(ValueError, match='all must be alike'):
        UnknownDemand(build_site(empty), independent_counts(16, SHARE))

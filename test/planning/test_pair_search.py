"""The best pair that does not know the demand: it is as good as trying everything finds.

Areas are of cells of 50 m, with a sensor of 3 Mbit under each centre and a channel that is
certain; both UAVs start and land at 0, in the south-west cell, and always hear each other.
"""

from collections.abc import Callable, Iterator
from functools import partial
import math

import pytest
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.kernels.arrays import row_of
from uav_collect.missions.rollout import fly
from uav_collect.planning.bound import bound_of
from uav_collect.planning.pair_policy import BestPairPolicy
from uav_collect.planning.pair_search import PairSearch
from uav_collect.planning.search import Aim
from uav_collect.planning.unknown_demand import drawn_counts, UnknownDemand
from uav_collect.scenario.site import build_site
from uav_collect.uav.briefing import briefing_of
from unknown_demand import demands, field, SIZE_M, STEPS

pytestmark = pytest.mark.usefixtures('bound_cache')
TIME = 'time'
ENERGY = 'energy'
NOWHERE = -1  # the cell of a UAV that flies home

Cells = frozenset[int]
Uav = tuple[int, int, int]  # cell, the way back, and when its action ends from now
State = tuple[int, tuple[Uav, Uav], Cells, Cells, Cells]  # who decides, seen, held, served
Outcome = tuple[float, list[tuple[float, State]]]  # what passes costs; what follows, how likely


def pair(n_rows: int, n_columns: int, speeds: tuple[float, ...], what: str) -> PairSearch:
    site = build_site(field(n_rows, n_columns, speeds=speeds))
    briefing, nothing = briefing_of(site), row_of([0.0, 0.0])
    aim = Aim(1.0, nothing, nothing)
    if what == ENERGY:
        aim = Aim(0.0, briefing.flight_power_w, briefing.hover_power_w)
    return PairSearch(site, drawn_counts(site.scenario), aim)


class EveryPolicy:
    """All that two UAVs may do, state by state, each that of an event, after the look."""

    def __init__(
        self, n_rows: int, n_columns: int, speeds: tuple[float, ...], what: str, hover_ns: int
    ) -> None:
        briefing = briefing_of(build_site(field(n_rows, n_columns, speeds=speeds)))
        self.n_rows, self.n_columns, self.hover_ns = n_rows, n_columns, hover_ns
        self.move_ns = [round(SIZE_M / speed * 1e9) for speed in speeds]
        is_energy = what == ENERGY
        self.flight_w = [power_w * is_energy for power_w in briefing.flight_power_w]
        self.hover_w = [power_w * is_energy for power_w in briefing.hover_power_w]
        self.per_s = 0.0 if is_energy else 1.0
        self.law = [(frozenset(c), chance) for c, chance in demands(n_rows, n_columns)]
        self.every = frozenset(range(n_rows * n_columns))
        self.options: dict[State, list[Outcome]] = {}

    def least(self) -> float:
        """The least that is expected, by going over all states again and again."""
        nothing: Cells = frozenset()
        cost, begun = self._event(((0, -1, 0), (0, -1, 0)), nothing, nothing, nothing)
        waiting = [state for _, state in begun]
        while waiting:
            state = waiting.pop()
            if state not in self.options:
                self.options[state] = list(self._options(state))
                waiting += [then for _, after in self.options[state] for _, then in after]
        values = dict.fromkeys(self.options, math.inf)
        is_better = True
        while is_better:
            is_better = False
            for state, options in reversed(self.options.items()):
                least = min(
                    cost + sum(chance * values[then] for chance, then in after)
                    for cost, after in options
                )
                if least < values[state] - 1e-9:
                    values[state], is_better = least, True
        return cost + sum(chance * values[state] for chance, state in begun)

    def _region(self, cell: int) -> Cells:
        row, column = divmod(cell, self.n_columns)
        return frozenset(
            other
            for other in self.every
            if max(abs(other // self.n_columns - row), abs(other % self.n_columns - column)) < 2
        )

    def _event(self, fleet: tuple[Uav, Uav], seen: Cells, held: Cells, done: Cells) -> Outcome:
        """Go on to the next event, and look."""
        active = [index for index in (0, 1) if fleet[index][0] != NOWHERE]
        if not active:
            latest_ns = max(0, *(uav[2] for uav in fleet))
            return self.per_s * latest_ns / 1e9, []
        deciding = min(active, key=lambda index: fleet[index][2])
        passed_ns = fleet[deciding][2]
        first, second = ((cell, back, max(ns - passed_ns, 0)) for cell, back, ns in fleet)
        wider = seen | self._region(fleet[deciding][0])
        found: dict[Cells, float] = {}
        for cells, chance in self.law:
            if cells & seen == held:
                now = cells & wider
                found[now] = found.get(now, 0.0) + chance
        total = sum(found.values())
        after = [
            (chance / total, (deciding, (first, second), wider, now, done))
            for now, chance in found.items()
        ]
        return self.per_s * passed_ns / 1e9, after

    def _options(self, state: State) -> Iterator[Outcome]:
        deciding, fleet, seen, held, done = state
        cell, back, _ = fleet[deciding]
        row, column = divmod(cell, self.n_columns)

        def started(uav: Uav, price: float, now_done: Cells) -> Outcome:
            flown = (uav, fleet[1]) if deciding == 0 else (fleet[0], uav)
            cost, after = self._event(flown, seen, held, now_done)
            return price * uav[2] / 1e9 + cost, after

        is_done = seen == self.every and held == done
        if is_done or fleet[1 - deciding][0] != NOWHERE:
            home_ns = round(self.move_ns[deciding] * math.hypot(row, column))
            yield started((NOWHERE, -1, home_ns), self.flight_w[deciding], done)
        if is_done:
            return
        if cell in held - done:
            hover = (cell, -1, self.hover_ns)
            yield started(hover, self.hover_w[deciding], done | {cell})
        ways = {
            move: (row + up) * self.n_columns + column + right
            for move, (up, right) in enumerate(STEPS)
            if 0 <= row + up < self.n_rows and 0 <= column + right < self.n_columns
        }
        legal = [move for move in ways if move != back]
        if not legal and cell not in held - done:
            legal = [*ways]
        for move in legal:
            uav = (ways[move], (move + 2) % 4, self.move_ns[deciding])
            yield started(uav, self.flight_w[deciding], done)


@pytest.mark.parametrize(
    ('n_rows', 'n_columns', 'speeds', 'what'),
    [
        (1, 3, (5.0, 10.0), ENERGY),
        (1, 4, (5.0, 5.0), TIME),
        (2, 2, (5.0, 5.0), TIME),
    ],
)
def test_its_value_is_what_trying_everything_finds(
    n_rows: int, n_columns: int, speeds: tuple[float, ...], what: str
) -> None:
    search = pair(n_rows, n_columns, speeds, what)
    least = EveryPolicy(n_rows, n_columns, speeds, what, search.hover_ns).least()
    assert search.expected() == pytest.approx(least, rel=1e-9)


@pytest.mark.parametrize(('speeds', 'what'), [((5.0, 10.0), TIME), ((5.0, 5.0), ENERGY)])
def test_flown_over_every_demand_it_has_the_value_that_was_found_and_no_rule_has_less(
    speeds: tuple[float, ...], what: str
) -> None:
    search = pair(1, 4, speeds, what)
    policies: dict[str, str | Callable[[], BestPairPolicy]] = {
        'best': partial(BestPairPolicy, search, []),
        'sweep': 'sweep',
        'hert': 'hert',
    }
    means = dict.fromkeys(policies, 0.0)
    for cells, chance in demands(1, 4):
        site = build_site(field(1, 4, cells, speeds))
        bound = bound_of(site, 0)
        limit = bound.least_completion_s if what == TIME else bound.least_energy_j
        known = search.knowing(sum(1 << cell for cell in cells))
        for name, policy in policies.items():
            [log] = fly(site, [0], policy, guard_after=0)
            flown = measured(mission_metrics(log), what)
            assert limit <= known * (1.0 + 1e-7) <= flown * (1.0 + 2e-7)
            means[name] += chance * flown
    assert means['best'] == pytest.approx(search.expected(), rel=1e-7)  # fading is that small
    assert min(means['sweep'], means['hert']) >= means['best']


def measured(mission: MissionMetrics, what: str) -> float:
    assert mission.is_complete
    return mission.completion_s if what == TIME else mission.energy_j


def test_missions_flown_side_by_side_share_nothing() -> None:
    search, site = pair(2, 3, (5.0, 10.0), TIME), build_site(field(2, 3, speeds=(5.0, 10.0)))
    together = fly(site, [0, 1, 2], partial(BestPairPolicy, search, []), guard_after=0)
    apart = [
        fly(site, [seed], partial(BestPairPolicy, search, []), guard_after=0)[0]
        for seed in (0, 1, 2)
    ]
    assert [*map(mission_metrics, together)] == [*map(mission_metrics, apart)]


def test_two_take_no_more_energy_than_one_of_them_alone_and_less_time() -> None:
    alone_site = build_site(field(2, 3))
    briefing, counts = briefing_of(alone_site), drawn_counts(alone_site.scenario)
    way = UnknownDemand(alone_site, counts).expected_length()
    energy, time = pair(2, 3, (5.0, 5.0), ENERGY), pair(2, 3, (5.0, 5.0), TIME)
    hover_s = energy.hover_ns / 1e9  # at half the bandwidth, as one of two has it
    hovers_s = hover_s * sum(count * chance for count, chance in enumerate(counts))
    flight_s = way * SIZE_M / 5.0
    alone_j = briefing.flight_power_w[0] * flight_s + briefing.hover_power_w[0] * hovers_s
    assert energy.expected() <= alone_j * (1.0 + 1e-9)
    assert time.expected() < flight_s + hovers_s


def test_what_it_cannot_search_is_refused() -> None:
    with pytest.raises(ValueError, match='1 UAVs over 6 cells: must be 2 over 12 cells at most'):
        pair(2, 3, (5.0,), TIME)
    with pytest.raises(ValueError, match='2 UAVs over 15 cells'):
        pair(3, 5, (5.0, 5.0), TIME)
    scenario, nothing = field(2, 3, (0, 1, 2, 3, 4), (5.0, 5.0)), row_of([0.0, 0.0])
    with pytest.raises(ValueError, match='hovers take unlike times'):
        PairSearch(build_site(scenario), drawn_counts(scenario), Aim(1.0, nothing, nothing))

"""The clairvoyant bound: the world flies its plans, and no plan and no policy beats its limits."""

from dataclasses import replace
from functools import cache
from itertools import permutations
import math
from pathlib import Path

from bounds import bound, flown, plans
from interpreted import interpreted
import numpy as np
import pytest
from tiny_world import CELL_A, CELL_B, HOVER_W, MOVE_10_J, rate_bps, tiny, uav
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.plan_shares import bound_metrics, mean_estimates
from uav_collect.missions.rollout import fly
from uav_collect.physics.radio import channel_draw
from uav_collect.planning import bound as bound_module
from uav_collect.planning.bound import Bound, bound_of, Plan
from uav_collect.planning.problem import PlanProblem, problem_of
from uav_collect.planning.relaxation import least_completion_s, least_energy_j
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.open_ways import OpenCells
from uav_collect.world.sensor_field import lay_out

pytestmark = pytest.mark.usefixtures('bound_cache')
# Fading as it is: channels differ between UAVs.
FADING = {'radio__rician_a1': 1.0, 'radio__rician_a2': 4.39, 'radio__los_b': 0.14}
CELL_M = 50.0


def check_flies(scenario: Scenario, seed: int = 0, allocator: str = 'exact') -> None:
    """The world flies both plans as they say."""
    for plan in plans(bound(scenario, seed, allocator)):
        mission = flown(scenario, plan, seed, allocator)
        assert mission.is_complete
        assert mission.is_safe
        assert mission.completion_s == pytest.approx(plan.completion_s, rel=1e-9)
        assert mission.energy_j == pytest.approx(plan.total_energy_j, rel=1e-9)
        assert mission.uav_energy_j == pytest.approx(plan.energy_j, rel=1e-9)


def random_world(seed: int) -> Scenario:
    """One to seven data cells among 5 x 5, one or two UAVs, starts and homes anywhere."""
    rng = np.random.default_rng(seed)
    n_cells = int(rng.integers(1, 8))
    sensors = [
        (
            CELL_M * (cell % 5 + rng.random()),
            CELL_M * (cell // 5 + rng.random()),
            rng.uniform(0, 8),
        )
        for cell in rng.choice(25, n_cells, replace=False)
    ]
    uavs = [
        uav(
            float(rng.choice([5.0, 8.0, 10.0, 15.0])),
            rng.integers(0, 5, 2).tolist(),
            rng.uniform(0.0, 5 * CELL_M, 2).tolist(),
        )
        for _ in range(int(rng.integers(1, 3)))
    ]
    return tiny(*uavs, sensors=sensors, area__cells_per_side=5, **FADING)


def best_alone(scenario: Scenario, problem: PlanProblem, index: int) -> list[tuple[float, float]]:
    """The least time [s] and energy [J] of one UAV for each set of data cells, as bits."""
    n_cells, side = problem.n_cells, problem.n_columns
    config = scenario.uavs[index]
    place_m = [
        ((cell % side + 0.5) * CELL_M, (cell // side + 0.5) * CELL_M) for cell in problem.cell
    ]

    @cache
    def shortest_m(here_m: tuple[float, float], left: int) -> float:
        ways = [
            abs(here_m[0] - place_m[cell][0])
            + abs(here_m[1] - place_m[cell][1])
            + shortest_m(place_m[cell], left & ~(1 << cell))
            for cell in range(n_cells)
            if left >> cell & 1
        ]
        return min(ways) if ways else math.dist(here_m, config.home_m)

    best = []
    for served in range(1 << n_cells):
        flight_s = shortest_m(config.start_m, served) / config.speed_mps
        hover_s = sum(
            problem.hover_s[index * n_cells + cell]
            for cell in range(n_cells)
            if served >> cell & 1
        )
        flight_j = problem.flight_power_w[index] * flight_s
        best.append((flight_s + hover_s, flight_j + problem.hover_power_w[index] * hover_s))
    return best


def best_together(scenario: Scenario, problem: PlanProblem) -> tuple[float, float]:
    """The least time [s] and the least energy [J] over all ways to share the cells."""
    alone = [best_alone(scenario, problem, index) for index in range(scenario.n_uavs)]
    every = (1 << problem.n_cells) - 1
    if scenario.n_uavs == 1:
        return alone[0][every]
    splits = [(alone[0][served], alone[1][every - served]) for served in range(every + 1)]
    return min(max(a[0], b[0]) for a, b in splits), min(a[1] + b[1] for a, b in splits)


# The plans


def test_plans_of_tiny_worlds_are_those_that_trying_everything_finds() -> None:
    for seed in range(200):
        scenario = random_world(seed)
        problem = problem_of(build_site(scenario), seed, 'exact')
        least_s, least_j = best_together(scenario, problem)
        found = bound(scenario, seed)
        shortest, thriftiest = plans(found)
        assert shortest.completion_s == pytest.approx(least_s, rel=1e-6), seed
        assert thriftiest.total_energy_j == pytest.approx(least_j, rel=1e-6), seed
        assert found.least_completion_s <= least_s, seed
        assert found.least_energy_j <= least_j, seed


def test_trying_everything_tries_all_orders() -> None:
    scenario = random_world(7)
    problem = problem_of(build_site(scenario), 7, 'exact')
    config, side = scenario.uavs[0], problem.n_columns
    place_m = [
        ((cell % side + 0.5) * CELL_M, (cell // side + 0.5) * CELL_M) for cell in problem.cell
    ]

    def length_m(order: tuple[int, ...]) -> float:
        ways_m, here_m = 0.0, config.start_m
        for cell in order:
            ways_m += abs(here_m[0] - place_m[cell][0]) + abs(here_m[1] - place_m[cell][1])
            here_m = place_m[cell]
        return ways_m + math.dist(here_m, config.home_m)

    assert problem.n_cells == 7
    shortest_s = min(map(length_m, permutations(range(7)))) / config.speed_mps
    hover_s = sum(problem.hover_s[cell] for cell in range(7))
    assert best_alone(scenario, problem, 0)[-1][0] == pytest.approx(shortest_s + hover_s)


def test_one_uav_and_one_data_cell_take_what_was_worked_out_by_hand() -> None:
    scenario = tiny(uav(10.0), sensors=[(75.0, 25.0, 2.0)])
    hover_s = 2e6 / rate_bps(1e6)
    for plan in plans(bound(scenario)):
        assert plan.cells == ((CELL_A,),)
        assert plan.completion_s == pytest.approx(10.0 + hover_s, rel=1e-6)
        assert plan.total_energy_j == pytest.approx(2 * MOVE_10_J + HOVER_W * hover_s, rel=1e-6)


def test_the_fast_uav_saves_energy_and_the_slow_one_time() -> None:
    shortest, thriftiest = plans(bound(tiny()))
    assert thriftiest.cells == ((), (CELL_A, CELL_B))
    assert thriftiest.landed_s[0] == thriftiest.energy_j[0] == 0.0
    assert shortest.cells == ((CELL_A,), (CELL_B,))
    assert shortest.completion_s < thriftiest.completion_s


@pytest.mark.parametrize('allocator', ['exact', 'equal'])
@pytest.mark.parametrize('name', ['paper_8x8', 'paper_10x10', 'lillgrund'])
def test_the_world_flies_a_plan_in_the_time_and_by_the_energy_that_it_says(
    name: str, allocator: str
) -> None:
    for seed in (3, 4):
        check_flies(load(name), seed, allocator)


def test_plans_with_estimated_channels_fly() -> None:
    check_flies(load('paper_8x8', {'radio.csi_error_variance': 0.1, 'radio.n_antennas': 2}), 1)


def test_plans_of_any_fleet_fly_from_anywhere_to_anywhere() -> None:
    for seed in range(40):
        check_flies(random_world(seed), seed)
    three = [uav(5.0, (0, 3), (10.0, 190.0)), uav(20.0, (3, 3)), uav(8.0, (2, 1))]
    check_flies(tiny(*three, **FADING))


def test_a_cell_on_the_way_is_served_when_the_uav_first_comes_there() -> None:
    # From 0 to 3, then back to 1: the way to 3 leads over 1.
    row = OpenCells(1, 4, [1] * 4)
    assert bound_module._flight(row, 0, [3, 1, 0]) == ([0, 1, 3], [0, 2, 0, 2, 2, 0])


def test_plans_lead_around_closed_cells_and_the_world_flies_them() -> None:
    # . . . .    4 x 4 cells, # closed; from the south-western cell to both sensors, S.
    # . # S .
    # . # # .
    # . # S .
    zone = [[50.0, 0.0], [100.0, 0.0], [100.0, 150.0], [50.0, 150.0]]
    hook = [[100.0, 50.0], [150.0, 50.0], [150.0, 100.0], [100.0, 100.0]]
    sensors = [(125.0, 125.0, 1.0), (125.0, 25.0, 0.5)]
    scenario = tiny(uav(10.0), sensors=sensors, area__no_fly=[zone, hook])
    problem = problem_of(build_site(scenario), 0, 'exact')
    n_points = problem.n_cells + 2
    # Cells 2 and 10; three moves north, two east, one south; three more, and three back.
    assert problem.way_m[2 * n_points + 1] == 6 * CELL_M
    assert problem.way_m[1] == 4 * CELL_M
    check_flies(scenario)


def test_where_nothing_waits_the_plan_is_to_fly_home() -> None:
    # One of two cells is drawn, and the first holds nothing.
    sensors = [(75.0, 25.0, 0.0), (125.0, 125.0, 1.0)]
    away = [uav(5.0, (1, 0), (25.0, 175.0)), uav(10.0)]
    scenario = tiny(*away, sensors=sensors, demand__cell_share=0.01)
    [seed, *_] = [seed for seed in range(20) if bound(scenario, seed).n_data_cells == 0]
    found = bound(scenario, seed)
    for plan in plans(found):
        assert plan.cells == ((), ())
        assert plan.completion_s == pytest.approx(20.0)
        assert found.least_completion_s == pytest.approx(20.0)
        assert found.least_energy_j == pytest.approx(plan.total_energy_j)
    check_flies(scenario, seed)


# Budgets


def test_plans_keep_to_the_energy_budgets() -> None:
    rich, poor = (
        tiny(uav(10.0, energy_budget_kj=kj), uav(10.0, energy_budget_kj=kj)) for kj in (100.0, 5.4)
    )
    thriftiest_rich, thriftiest_poor = plans(bound(rich))[1], plans(bound(poor))[1]
    assert sorted(map(len, thriftiest_rich.cells)) == [0, 2]
    assert max(thriftiest_rich.energy_j) > 4.4e3  # of 5.4 kJ one must be left
    assert sorted(map(len, thriftiest_poor.cells)) == [1, 1]
    assert max(thriftiest_poor.energy_j) <= 4.4e3
    check_flies(poor)


def test_without_the_energy_there_is_no_plan_but_still_a_limit() -> None:
    scenario = tiny(uav(10.0, energy_budget_kj=4.0), uav(10.0, energy_budget_kj=4.0))
    found = bound(scenario)
    assert found.shortest is found.thriftiest is None
    assert found.least_energy_j > 0.0
    numbers = bound_metrics(found)
    assert math.isnan(numbers['shortest_completion_s'])
    assert mean_estimates([numbers], seed=0) == (0, {})


# The limits


@pytest.mark.parametrize('allocator', ['exact', 'equal'])
@pytest.mark.parametrize('policy', ['sweep', 'hert'])
def test_no_policy_that_collects_everything_gets_beyond_the_limits(
    policy: str, allocator: str
) -> None:
    scenario = load('paper_8x8')
    logs = fly(build_site(scenario), range(20), policy, allocator)
    for mission in map(mission_metrics, logs):
        found = bound(scenario, mission.mission_seed, allocator)
        assert mission.is_complete
        assert found.least_completion_s < mission.completion_s
        assert found.least_energy_j < mission.energy_j


def test_limits_lie_below_the_plans_of_many_uavs() -> None:
    for seed in range(5):
        scenario = load('paper_10x10')
        fleet = replace(scenario.fleet, uavs=scenario.uavs * 3)
        found = bound(replace(scenario, fleet=fleet), seed)
        shortest, thriftiest = plans(found)
        assert 0.5 * shortest.completion_s < found.least_completion_s <= shortest.completion_s
        low_j, high_j = 0.8 * thriftiest.total_energy_j, thriftiest.total_energy_j
        assert low_j < found.least_energy_j <= high_j


def test_the_limit_of_energy_is_close_in_the_papers_scenario() -> None:
    for seed in range(5):
        found = bound(load('paper_10x10'), seed)
        assert found.least_energy_j > 0.95 * plans(found)[1].total_energy_j


def test_limits_hold_whatever_steps_are_made_to() -> None:
    for seed in range(30):
        scenario = random_world(seed)
        problem = problem_of(build_site(scenario), seed, 'exact')
        least_s, least_j = best_together(scenario, problem)
        for factor in (0.5, 1.0, 3.0):
            assert least_completion_s(problem, factor * 500.0, factor * least_s) <= least_s
            assert least_energy_j(problem, factor * least_j) <= least_j


def test_no_visit_of_any_uav_draws_a_shorter_hover_than_the_limit_counts_with() -> None:
    scenario = tiny(sensors=[(60.0, 40.0, 1.0)], **FADING)
    problem = problem_of(build_site(scenario), 0, 'exact')
    sensor_field = lay_out(build_site(scenario))
    best = max(
        channel_draw(
            0, index, 0, visit, 1, sensor_field.los_probability[0], sensor_field.path_gain[0],
            sensor_field.nlos_attenuation, sensor_field.rician_factor[0],
        )[0]
        for index in range(2)
        for visit in range(2000)
    )  # fmt: skip
    signal_w = scenario.radio.tx_power_w * best
    noise_w = scenario.radio.noise_w_per_hz * scenario.bandwidth_hz
    hover_s = 1e6 / (scenario.bandwidth_hz * math.log2(1.0 + signal_w / noise_w))
    assert 0.9 * hover_s < problem.least_hover_s[0] < hover_s
    assert min(problem.hover_s) > hover_s * (1.0 - 1e-9)


# What is kept on the disk


def bounds_of_a_few() -> str:
    site = build_site(load('paper_8x8'))
    return repr([bound_module._find(problem_of(site, seed, 'exact'), seed, 200)
                 for seed in range(3)])  # fmt: skip


def test_compiled_and_interpreted_the_bound_is_the_same() -> None:
    assert interpreted(bounds_of_a_few) == bounds_of_a_few()


def searched(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The seeds that were searched from now on."""
    seeds: list[int] = []
    search = bound_module._find

    def find(problem: PlanProblem, mission_seed: int, n_rounds: int) -> Bound:
        seeds.append(mission_seed)
        return search(problem, mission_seed, n_rounds)

    monkeypatch.setattr(bound_module, '_find', find)
    return seeds


def test_a_bound_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = searched(monkeypatch)
    scenario = tiny(**FADING)
    first = bound(scenario, 5)
    assert bound(scenario, 5) == first
    assert seeds == [5]
    bound(scenario, 6)
    bound(scenario, 5, 'equal')
    bound_of(build_site(scenario), 5, n_rounds=10)
    bound(tiny(**FADING, demand__cell_share=0.5), 5)
    assert seeds == [5, 6, 5, 5, 5]
    assert bound(scenario, 5, 'cvxpy') == first
    assert len(seeds) == 5


@pytest.mark.parametrize('text', ['', '{', '[]', '{"mission_seed": 5}', '{"shortest": 3}', '\xff'])
def test_a_broken_file_is_searched_again(
    text: str, bound_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = bound(tiny(), 5)
    [file] = bound_cache.rglob('5.json')
    file.write_text(text, encoding='latin-1')
    seeds = searched(monkeypatch)
    assert bound(tiny(), 5) == bound(tiny(), 5) == first
    assert seeds == [5]


def test_a_number_that_was_changed_in_a_file_is_found_again(
    bound_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = bound(tiny(), 5)
    [file] = bound_cache.rglob('5.json')
    whole = file.read_text()
    assert '"n_data_cells": ' in whole
    file.write_text(whole.replace('"n_data_cells": ', '"n_data_cells": 1'))
    seeds = searched(monkeypatch)
    assert bound(tiny(), 5) == first
    assert seeds == [5]
    assert file.read_text() == whole


def test_without_room_on_the_disk_the_bound_is_found_all_the_same(
    bound_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bound_cache.write_text('no folder')
    seeds = searched(monkeypatch)
    assert bound(tiny(), 5) == bound(tiny(), 5)
    assert seeds == [5, 5]


def test_a_plan_is_printed_with_times_energies_and_hovers() -> None:
    plan = Plan(cells=((3, 14), ()), landed_s=(12.34, 0.0), energy_j=(1_500.0, 0.0))
    assert str(plan).splitlines() == [
        '12.3 s, 1.50 kJ',
        '  UAV 1: 12.3 s, 1.50 kJ, hovers over cells: 3, 14',
        '  UAV 2: 0.0 s, 0.00 kJ, hovers over cells: none',
    ]

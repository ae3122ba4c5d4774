"""No UAV ever ends with less than its margin, nor is it ever too far from home for what it has.

Random fleets, areas, homes and budgets; the way home is reckoned here from the paper's formula.
"""

from collections.abc import Iterator

import numpy as np
import pytest
from tiny_world import HOVER_W, MOVE_10_J, tiny, uav
from uav_collect.analysis.metrics import check_log, mission_metrics
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Floats
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import ACTION_NAMES, FORWARD, HOVER, NONE, REASON_NAMES, RIGHT

N_SCENARIOS = 25
N_SEEDS = 20
POLICIES = ('hert', 'hert-equal', 'sweep', 'random')
HOME = ACTION_NAMES.index('home')
ROUNDING = 1e-9  # of the budget


def random_scenario(number: int, **more: object) -> Scenario:
    rng = np.random.default_rng([2025, number])
    side, cell_size_m = int(rng.integers(2, 13)), float(rng.uniform(20.0, 120.0))
    fleet = [
        {
            'speed_mps': float(rng.uniform(2.0, 25.0)),
            'energy_budget_kj': float(rng.uniform(20.0, 400.0)),
            'energy_margin_kj': float(rng.choice([0.0, 0.5, 1.0, 5.0])),
            'start': {'cell': rng.integers(0, side, size=2).tolist()},
            'home': {'position_m': rng.uniform(0.0, side * cell_size_m, size=2).tolist()},
        }
        for _ in range(rng.integers(1, 5))
    ]
    overrides = {
        'name': f'random-{number}',
        'area.cells_per_side': side,
        'area.cell_size_m': cell_size_m,
        'sensors.seed': number,
        'demand.cell_share': float(rng.uniform(0.05, 1.0)),
        'radio.contact_range_m': float(rng.choice([0.0, 100.0, 200.0, np.inf])),
        'radio.csi_error_variance': float(rng.choice([0.0, 0.05])),
        'radio.system_bandwidth_mhz': float(rng.choice([0.02, 0.2, 1.0])),  # long hovers, too
        'fleet.uavs': fleet,
    }
    return load('paper_10x10', overrides | more)


def flight_power_w(speed_mps: float) -> float:
    square = speed_mps**2
    induced_w = 88.63 * np.sqrt(np.sqrt(1 + square**2 / (4 * 4.03**4)) - square / (2 * 4.03**2))
    return float(79.86 * (1 + 3 * square / 120**2) + induced_w + 0.009242625 * speed_mps**3)


def reserves_j(scenario: Scenario, log: MissionLog) -> Iterator[tuple[Floats, float, float]]:
    """Of each UAV: energy beyond the way home and the margin at its decisions, and when landed."""
    for unit, config in enumerate(scenario.uavs):
        own = log.events[log.events['uav'] == unit + 1]
        away_m = np.hypot(own['x_m'] - config.home_m[0], own['y_m'] - config.home_m[1])
        home_j = flight_power_w(config.speed_mps) * away_m / config.speed_mps
        spare_j = own['energy_left_j'] - home_j - config.energy_margin_j
        landed_j = own['energy_left_j'][-1] - own['energy_j'][-1] - config.energy_margin_j
        yield spare_j, landed_j, config.energy_budget_j


@pytest.mark.parametrize('policy', POLICIES)
def test_no_uav_is_ever_short_of_its_reserve(policy: str) -> None:
    n_reserve = n_missions = 0
    for number in range(N_SCENARIOS):
        scenario = random_scenario(number)
        allocator = ('exact', 'equal')[number % 2]
        for log in fly(build_site(scenario), range(N_SEEDS), policy, allocator):
            for spare_j, landed_j, budget_j in reserves_j(scenario, log):
                assert spare_j.min() >= -ROUNDING * budget_j
                assert landed_j >= -ROUNDING * budget_j
            assert mission_metrics(log).is_safe
            at_home = log.events[log.events['action'] == HOME]
            assert len(at_home) == scenario.n_uavs
            n_reserve += (at_home['reason'] == REASON_NAMES.index('energy reserve')).any()
            n_missions += 1
    assert n_missions == N_SCENARIOS * N_SEEDS
    assert n_reserve >= n_missions / 20  # budgets are such that the rule bites


@pytest.mark.parametrize('policy', POLICIES)
def test_the_log_of_a_random_scenario_adds_up(policy: str) -> None:
    for number in range(N_SCENARIOS):
        site = build_site(random_scenario(number))
        log = fly(site, [99], policy)[0]
        check_log(log)


WAITING = VectorEnvConfig(allocator='exact', is_synchronous=True, is_logged=True)


def test_no_uav_that_waits_for_others_is_ever_short_of_its_reserve() -> None:
    rng, n_turned = np.random.default_rng(5), 0
    for number in range(N_SCENARIOS):
        # Uploads take long, and those who wait for them hover.
        scenario = random_scenario(number, **{'radio.system_bandwidth_mhz': 0.02})
        env = VectorEnv(build_site(scenario), [number], WAITING)
        while env.decisions.uav[0] != NONE:
            env.step(rng.choice(np.flatnonzero(env.decisions.legal[0]), 1))
        for spare_j, landed_j, budget_j in reserves_j(scenario, env.mission_log(0, 'random')):
            assert spare_j.min() >= -ROUNDING * budget_j
            assert landed_j >= -ROUNDING * budget_j
            n_turned += abs(spare_j[-1]) < ROUNDING * budget_j
    assert n_turned > 0


def test_a_uav_turns_home_when_it_can_wait_no_longer_and_the_others_go_on() -> None:
    # Both fly for 10 s or wait; then the first uploads A for 10.2 s. The second flies on, to two
    # moves from home, in 5 s, and has 300 J to wait with.
    budget_j = 4 * MOVE_10_J + 5.0 * HOVER_W + 1000.0 + 300.0
    hasty = uav(10.0, energy_budget_kj=budget_j / 1e3, energy_margin_kj=1.0)
    scenario = tiny(uav(5.0), hasty, radio__system_bandwidth_mhz=0.02)
    env = VectorEnv(build_site(scenario), [0], WAITING)
    for action in (RIGHT, FORWARD, HOVER, FORWARD):
        env.step(np.array([action]))
    turn = env.mission_log(0, 'script').events[-1]
    assert (turn['uav'], turn['action']) == (2, HOME)
    assert REASON_NAMES[turn['reason']] == 'energy reserve'
    assert turn['time_s'] == pytest.approx(15.0 + 300.0 / HOVER_W, rel=1e-4)
    assert turn['energy_left_j'] - turn['energy_j'] == pytest.approx(1000.0, rel=1e-9)
    assert env.decisions.uav[0] == 0
    assert env.decisions.time_s[0] > 20.0


@pytest.mark.parametrize('budget_kj', [20.0, 50.0, 100.0, 400.0])
@pytest.mark.parametrize('policy', POLICIES)
def test_the_papers_fleet_lands_safely_on_any_budget(policy: str, budget_kj: float) -> None:
    site = build_site(load('paper_10x10', {'fleet.default.energy_budget_kj': budget_kj}))
    for log in fly(site, range(5), policy):
        assert mission_metrics(log).is_safe


def test_a_uav_goes_home_for_its_reserve_only_when_nothing_else_is_affordable() -> None:
    scenario = load('paper_10x10', {'fleet.default.energy_budget_kj': 20.0})
    moves_j = [flight_power_w(speed_mps) * 50.0 / speed_mps for speed_mps in (5.0, 10.0)]
    for log in fly(build_site(scenario), range(20), 'random'):
        for unit, (spare_j, _, _) in enumerate(reserves_j(scenario, log)):
            own = log.events[log.events['uav'] == unit + 1]
            assert own['reason'][-1] == REASON_NAMES.index('energy reserve')
            # Straight away from home a move and the way back cost twice the move at most.
            assert spare_j[-1] < 2 * moves_j[unit]


@pytest.mark.parametrize(
    ('values', 'problem'),
    [
        (
            {'fleet.default.energy_budget_kj': 1e6, 'fleet.default.speed_mps': 100.0,
             'area.cell_size_m': 0.1},
            'scenario paper_10x10: fleet.uavs.0.energy_budget_kj is 1e+06: must be less, as it is '
            'enough for ',
        ),
        (
            {'fleet.default.energy_budget_kj': 1e6, 'radio.beacon_period_s': 0.1},
            'scenario paper_10x10: radio.beacon_period_s is 0.1: must be more, as UAV 1, which ',
        ),
    ],
)  # fmt: skip
def test_a_mission_that_would_not_end_is_refused(values: dict[str, object], problem: str) -> None:
    uavs = [{}] if 'fleet.default.speed_mps' in values else [{'speed_mps': 5.0}]
    site = build_site(load('paper_10x10', {**values, 'fleet.uavs': uavs}))
    with pytest.raises(ConfigError) as caught:
        fly(site, [0], 'hert')
    assert str(caught.value).startswith(problem)
    assert str(caught.value).endswith(', at most 10,000,000')


def test_a_large_fleet_that_cannot_start_is_still_one_short_line() -> None:
    fleet = {'fleet.uavs': [{'speed_mps': 5.0}] * 64, 'fleet.default.energy_budget_kj': 1.5}
    with pytest.raises(ConfigError, match=r'UAV 2 has .*; 62 more UAVs$') as caught:
        fly(build_site(load('paper_10x10', fleet)), [0], 'hert')
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize('policy', POLICIES)
def test_a_mission_that_cannot_start_says_why(policy: str) -> None:
    scenario = load('paper_10x10', {'fleet.default.energy_budget_kj': 1.5})
    with pytest.raises(ConfigError, match=r'no UAV has the energy for a single move: UAV 1 has'):
        fly(build_site(scenario), [0], policy)

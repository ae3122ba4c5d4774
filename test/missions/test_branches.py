"""Branches: what an action is worth is what the mission comes to that goes on by it."""

from collections.abc import Callable

import numpy as np
from odd_areas import corridor, maze
import pytest
from tiny_world import tiny, uav
from uav_collect.kernels.arrays import Floats
from uav_collect.missions.experience import Episode
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.observation import Layout
from uav_collect.world.reward import Reward

UNIT_J = 700.0
SEEDS = [5, 6]
FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)
ROUGH = {'radio__loss_share': 0.3, 'radio__delay_s': [1.0, 0.5]}
GONE = {'faults': [{'uav': 1, 'kind': 'gone', 'at_decision': [1, 3]}]}
SCENARIOS = [
    lambda: tiny(*FLEET),
    lambda: tiny(*FLEET, **ROUGH),
    lambda: tiny(*FLEET, **GONE),
    lambda: corridor(7, 3),
    maze,
]


def env_of(scenario: Scenario, branch_share: float) -> VectorEnv:
    config = VectorEnvConfig(
        layout=Layout.RELATIVE,
        reward=Reward.ENERGY,
        energy_unit_j=UNIT_J,
        max_decisions=300,
        branch_share=branch_share,
    )
    return VectorEnv(build_site(scenario), SEEDS, config)


def by_chance(env: VectorEnv, n_decisions: int) -> list[list[int]]:
    """Fly so many decisions by legal actions, mostly the advised; returns what was done."""
    rng = np.random.default_rng(3)
    done: list[list[int]] = []
    for _ in range(n_decisions):
        decisions = env.decisions
        drawn = (decisions.legal * rng.uniform(0.1, 1.0, decisions.legal.shape)).argmax(axis=1)
        is_advised = rng.uniform(size=len(drawn)) < 0.6
        chosen = np.where(is_advised & (decisions.advice != NONE), decisions.advice, drawn)
        env.step(chosen)
        done.append(chosen.tolist())
    return done


def worth_by_hand(scenario: Scenario, done: list[list[int]], world: int, action: int) -> float:
    """Fly the mission again, do the action, then what the sweep advises; count the end."""
    env = env_of(scenario, 0.0)
    for chosen in done:
        env.step(np.array(chosen))
    others = np.where(env.decisions.uav == NONE, 0, env.decisions.advice)
    chosen = others.copy()
    chosen[world] = action
    env.step(chosen)
    while (env.decisions.uav != NONE).any():
        env.step(np.where(env.decisions.uav == NONE, 0, env.decisions.advice))
    n_cells = len(env.briefing.is_open)
    maps = env.global_state(world)[-(scenario.n_uavs + 1) * n_cells : -n_cells]
    n_complete = int(maps.reshape(scenario.n_uavs, n_cells).any(axis=0).sum())
    return 2.0 * n_complete - float(env.metrics().energy_j[world].sum()) / UNIT_J


@pytest.mark.parametrize('scenario_of', SCENARIOS)
def test_an_action_is_worth_what_the_mission_that_goes_on_by_it_and_the_sweep_comes_to(
    scenario_of: Callable[[], Scenario],
) -> None:
    scenario = scenario_of()
    n_tried = 0
    for n_before in (0, 3, 7):
        env = env_of(scenario, 1.0)
        done = by_chance(env, n_before)
        decisions = env.decisions
        waiting, legal = decisions.uav.copy(), decisions.legal.copy()
        env.step(np.where(waiting == NONE, 0, legal.argmax(axis=1)))
        for world in np.flatnonzero(waiting != NONE).tolist():
            worth = worths(env.episode(world))[n_before]
            assert (np.isnan(worth) == ~legal[world]).all()
            for action in np.flatnonzero(legal[world]).tolist():
                by_hand = worth_by_hand(scenario, done, world, action)
                assert worth[action] == pytest.approx(by_hand, rel=1e-6)
                n_tried += 1
    assert n_tried > 8


def worths(episode: Episode) -> Floats:
    legal = np.unpackbits(episode.records.legal[:, None], axis=1, bitorder='little')
    is_known = (legal[:, :N_ACTIONS] == 1) & (episode.records.is_judged == 1)[:, None]
    return np.where(is_known, episode.records.worth, np.nan)


def test_branching_changes_nothing_of_the_missions_and_is_the_same_when_flown_again() -> None:
    scenario = tiny(*FLEET, **ROUGH)
    plain, branched, again = env_of(scenario, 0.0), env_of(scenario, 0.5), env_of(scenario, 0.5)
    assert by_chance(plain, 9) == by_chance(branched, 9)
    again.fly_again(branched.flights())
    for world in range(len(SEEDS)):
        first, second, third = (env.episode(world) for env in (plain, branched, again))
        for name in first.records._fields:
            if name not in ('is_judged', 'worth'):
                assert (getattr(first.records, name) == getattr(second.records, name)).all()
        is_tried = ~np.isnan(worths(second)).all(axis=1)
        assert 0 < is_tried.sum() < len(is_tried)
        assert np.isnan(worths(first)).all()
        assert np.array_equal(worths(second), worths(third), equal_nan=True)
        assert worths(second).shape == (second.n_decisions, N_ACTIONS)

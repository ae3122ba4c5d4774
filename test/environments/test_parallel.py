"""Synchronous missions as PettingZoo has them are those of all else that flies synchronously."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pettingzoo import ParallelEnv
from pettingzoo.test import parallel_api_test, parallel_seed_test
import pytest
from uav_collect.environments.parallel import parallel_env
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import HOVER, NONE
from uav_collect.world.reward import Reward

SEED = 3


def short(more: Mapping[str, Any] | None = None) -> Scenario:
    """Missions that random flight ends within some hundred decisions; all start over one cell."""
    uavs = [{'speed_mps': speed, 'energy_budget_kj': 25.0} for speed in (5.0, 10.0, 7.5)]
    return load('paper_8x8', {'fleet.uavs': uavs, **(more or {})})


def over_data() -> Scenario:
    """Where a UAV that takes off may do anything: data wait in every cell with sensors."""
    return short({'fleet.default.start': {'cell': [1, 1]}, 'demand.cell_share': 1.0})


def at_random(infos: Mapping[str, Any], rng: np.random.Generator) -> dict[str, int]:
    return {
        agent: int((info['action_mask'] * rng.uniform(0.1, 1.0, 5)).argmax())
        for agent, info in infos.items()
    }


def flown(
    world: ParallelEnv, seed: int = SEED
) -> list[tuple[float, dict[str, Any], dict[str, Any]]]:
    """Reward, infos and masks of each step of a mission that is flown at random."""
    rng, steps = np.random.default_rng(0), []
    _, infos = world.reset(seed=seed)
    while world.agents:
        _, rewards, _, _, after = world.step(at_random(infos, rng))
        assert len({*rewards.values()}) == 1
        steps.append((rewards['uav_1'], after, infos))
        infos = after
    return steps


def synchronous(scenario: Scenario, reward: str = 'paper') -> VectorEnv:
    config = VectorEnvConfig(
        allocator='exact', reward=Reward[reward.upper()], is_synchronous=True, is_logged=True
    )
    return VectorEnv(build_site(scenario), [SEED], config)


@pytest.mark.parametrize('more', [{}, {'layout': 'relative'}, {'max_decisions': 40}])
def test_pettingzoos_parallel_api_test_passes_without_a_warning(more: dict[str, Any]) -> None:
    parallel_api_test(parallel_env(short(), mask_in='observation', **more), num_cycles=60)


def test_pettingzoos_parallel_seed_test_passes() -> None:
    # It takes one step, and draws without masks.
    parallel_seed_test(lambda: parallel_env(over_data()), num_cycles=20)


def test_a_mission_leaves_the_log_of_a_synchronous_one_to_the_byte() -> None:
    world, other = parallel_env(short()), synchronous(short())
    flown(world)
    log = world.mission_log('x')
    for action in log.events['action'][log.events['action'] <= 4]:
        other.step(np.array([action]))
    assert other.decisions.uav[0] == NONE
    assert other.mission_log(0, 'x').to_jsonl() == log.to_jsonl()


@pytest.mark.parametrize('reward', ['paper', 'energy'])
def test_the_return_of_a_mission_is_that_of_the_team(reward: str) -> None:
    world, other = parallel_env(short(), reward=reward), synchronous(short(), reward)
    total, discount = 0.0, 1.0
    for earned, after, _ in flown(world):
        total += discount * earned
        discount *= after['uav_1']['discount']
    log = world.mission_log()
    gamma, due = short().reward.discount_per_s, 0.0
    for action in log.events['action'][log.events['action'] <= 4]:
        start_s = float(other.decisions.time_s[0])
        due += gamma**start_s * float(other.step(np.array([action])).reward[0])
    assert total == pytest.approx(due, rel=1e-9)


def test_uavs_decide_at_the_same_instants_until_they_fly_home() -> None:
    n_deciding = []
    for _, _, before in flown(parallel_env(short())):
        assert len({info['time_s'] for info in before.values()}) == 1
        n_deciding.append(sum(info['decides'] for info in before.values()))
        for info in before.values():
            assert info['decides'] or info['action_mask'].tolist() == [1, 0, 0, 0, 0]
    assert n_deciding[0] == 3
    assert n_deciding == sorted(n_deciding, reverse=True)
    assert n_deciding[-1] < 3


def test_over_one_cell_only_the_first_uav_that_may_hover_does() -> None:
    world = parallel_env(over_data())
    _, infos = world.reset(seed=SEED)
    masks = [infos[agent]['action_mask'].tolist() for agent in world.agents]
    assert masks == [[1, 1, 1, 1, 1], [0, 1, 1, 1, 1], [0, 1, 1, 1, 1]]
    with pytest.raises(ValueError, match='action 0 of uav_2 in mission 3 is not legal'):
        world.step(dict.fromkeys(world.agents, HOVER))
    world.step({'uav_1': HOVER, 'uav_2': 2, 'uav_3': 3})
    assert world.mission_log().events['action'].tolist() == [HOVER, 2, 3]


def test_what_is_looked_up_beforehand_changes_nothing_and_is_what_a_uav_sees_in_its_turn() -> None:
    world, other = parallel_env(short()), synchronous(short())
    observed, _ = world.reset(seed=SEED)
    for agent, moves in (('uav_1', 1), ('uav_2', 2), ('uav_3', 1)):
        decisions = other.decisions
        assert observed[agent].tolist() == decisions.observation[0].astype(np.float32).tolist()
        other.step(np.array([moves]))


def test_a_mission_is_cut_off_at_the_step_that_reaches_the_limit() -> None:
    world = parallel_env(short(), max_decisions=7)
    _, infos = world.reset(seed=SEED)
    for n_decisions in (3, 6, 9):
        _, _, terminated, truncated, infos = world.step(at_random(infos, np.random.default_rng(2)))
        assert not any(terminated.values())
        assert all(truncated.values()) == (n_decisions == 9)
    assert world.agents == []
    assert world.step({}) == ({}, {}, {}, {}, {})


def test_an_illegal_or_missing_action_is_refused_and_changes_nothing() -> None:
    world = parallel_env(short())
    world.reset(seed=SEED)
    with pytest.raises(ValueError, match=r'action 3 of uav_2 in mission 3 is not legal; legal'):
        world.step({'uav_1': 1, 'uav_2': 3, 'uav_3': 1})
    with pytest.raises(ValueError, match='uav_3 decides: it must have an action'):
        world.step({'uav_1': 1, 'uav_2': 1})
    assert world.mission_log().events.size == 0

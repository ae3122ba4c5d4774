"""The PettingZoo environment flies the missions that all else flies, and pays each UAV its due."""

from collections.abc import Callable
from functools import partial
import json
from typing import Any

import numpy as np
from pettingzoo import AECEnv
from pettingzoo.test import api_test, seed_test
import pytest
from tiny_world import tiny, uav
from uav_collect.analysis.metrics import check_log, mission_metrics
from uav_collect.environments.aec import env
from uav_collect.environments.shared import first_seed_of_resets
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Ints
from uav_collect.limits import MAX_SEED
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.seeds import (
    first_seed_of_part,
    first_training_seed,
    VALIDATION_SEED,
)
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOME, N_ACTIONS, NONE, RIGHT
from uav_collect.world.reward import Reward

SEED = 3


def fleet() -> Scenario:
    # The second and third UAV have too little energy: they turn home while the first goes on.
    uavs = [
        {'speed_mps': 5.0},
        {'speed_mps': 10.0, 'energy_budget_kj': 30.0},
        {'speed_mps': 7.5, 'energy_budget_kj': 20.0},
    ]
    return load('paper_10x10', {'fleet.uavs': uavs})


def short(n_uavs: int = 2) -> Scenario:
    """Missions that random flight ends within some hundred decisions."""
    return load(
        'paper_8x8', {'fleet.uavs': [{'speed_mps': 10.0, 'energy_budget_kj': 20.0}] * n_uavs}
    )


def sweep(scenario: Scenario, allocator: str = 'exact') -> Ints:
    """The actions of a mission of the sweep, in order."""
    [log] = fly(build_site(scenario), [SEED], 'sweep', allocator)
    actions: Ints = log.events['action'][log.events['action'] != HOME]
    return actions


def flown(world: AECEnv, actions: Ints) -> list[tuple[str, float, dict[str, Any]]]:
    """All that `last` says, but what is seen, until no agent is left."""
    turns, script = [], iter(actions.tolist())
    world.reset(seed=SEED)
    for agent in world.agent_iter():
        _, reward, terminated, truncated, info = world.last()
        turns.append((agent, reward, info))
        world.step(None if terminated or truncated else next(script))
    return turns


# PettingZoo's own tests; a warning is an error.

KINDS: list[Callable[[], AECEnv]] = [
    env,
    partial(env, short(), reward='energy', layout='paper'),
    partial(env, short(1), bandwidth='equal'),
    partial(env, short(6)),
    partial(env, short(7), layout='paper'),
    partial(env, 'lillgrund', max_decisions=50),
    partial(env, short(7), layout='relative'),
]
NAMES = ['default', 'ends', 'one', 'six', 'seven', 'cut off', 'relative']


@pytest.mark.parametrize('make', KINDS, ids=NAMES)
def test_pettingzoos_api_test_passes_without_a_warning(make: Callable[[], AECEnv]) -> None:
    api_test(make(), num_cycles=300)


@pytest.mark.parametrize('make', KINDS, ids=NAMES)
def test_pettingzoos_seed_test_passes(make: Callable[[], AECEnv]) -> None:
    seed_test(make, num_cycles=100)


# It knows by their names those environments whose agents it expects to observe a mask.
@pytest.mark.filterwarnings('ignore:Observation')
def test_pettingzoos_tests_pass_where_masks_are_observed() -> None:
    make = partial(env, short(), mask_in='observation')
    api_test(make(), num_cycles=100)
    seed_test(make, num_cycles=50)


# One world.


@pytest.mark.parametrize('allocator', ['exact', 'equal'])
@pytest.mark.parametrize('rule', ['sweep', 'random'])
def test_a_mission_leaves_the_log_of_a_rollout_to_the_byte(rule: str, allocator: str) -> None:
    scenario = fleet() if rule == 'sweep' else short()
    logs = fly(build_site(scenario), [SEED, SEED + 1], rule, allocator)
    world = env(scenario, bandwidth=allocator)
    for log in logs:
        own = log.events[log.events['action'] != HOME]
        world.reset(seed=log.header.mission_seed)
        for event in own:
            _, _, terminated, _, info = world.last()
            assert (world.agent_selection, terminated) == (f'uav_{event["uav"]}', False)
            assert info['time_s'] == event['time_s']
            world.step(event['action'])
        assert all(world.terminations.values())
        assert world.mission_log(rule).to_jsonl() == log.to_jsonl()


def test_in_the_relative_layout_actions_are_in_the_uavs_own_frame() -> None:
    home = {'cell': [7, 7]}
    places = {'fleet.default.start': home, 'fleet.default.home': home}
    scenario = load('paper_8x8', {'fleet.uavs': [{'speed_mps': 10.0}] * 2, **places})
    [log] = fly(build_site(scenario), [SEED], 'sweep')
    world = env(scenario, layout='relative')
    world.reset(seed=SEED)
    for _ in range(int((log.events['action'] != HOME).sum())):
        observed, _, terminated, _, info = world.last()
        advice = int(np.argmax(observed[-5:]))  # one-hot in the same frame, at the end
        assert info['action_mask'][advice] == 1
        assert not terminated
        world.step(advice)
    assert world.mission_log('sweep').events.tolist() == log.events.tolist()
    world.reset(seed=SEED)
    with pytest.raises(ValueError, match=r'action 3 of UAV 1 in mission .* legal are \[0, 1, 2\]'):
        world.step(3)  # out of the area: in the frame the UAV is in its south-west


def test_what_a_uav_sees_and_may_do_is_what_a_learned_policy_gets() -> None:
    scenario = fleet()
    vector_env = VectorEnv(build_site(scenario), [SEED], VectorEnvConfig(allocator='exact'))
    world = env(scenario)
    world.reset(seed=SEED)
    for action in sweep(scenario):
        seen, _, _, _, info = world.last()
        decisions = vector_env.decisions
        assert seen.tolist() == decisions.observation[0].astype(np.float32).tolist()
        assert info['action_mask'].tolist() == decisions.legal[0].tolist()
        assert world.state().tolist() == vector_env.global_state(0).astype(np.float32).tolist()
        assert world.state() in world.state_space
        world.step(action)
        vector_env.step(np.array([action]))


def test_a_uav_that_flies_sees_what_it_saw_when_it_decided() -> None:
    world = env(fleet())
    world.reset(seed=SEED)
    assert not world.observe('uav_2').any()
    first = world.observe('uav_1')
    world.step(FORWARD)
    assert world.agent_selection == 'uav_2'
    assert world.observe('uav_1') is first


def test_the_mask_can_be_part_of_what_is_observed() -> None:
    world = env(fleet(), mask_in='observation')
    world.reset(seed=SEED)
    assert world.observe('uav_2')['action_mask'].tolist() == [0] * N_ACTIONS
    for action in sweep(fleet())[:9]:
        seen, _, _, _, info = world.last()
        assert seen in world.observation_space(world.agent_selection)
        assert seen['action_mask'].tolist() == info['action_mask'].tolist()
        world.step(action)


# What UAVs earn.


@pytest.mark.parametrize('reward', ['paper', 'energy'])
def test_each_uav_earns_what_the_team_earns_between_its_decisions(reward: str) -> None:
    scenario = fleet()
    actions, gamma = sweep(scenario), scenario.reward.discount_per_s
    how = VectorEnvConfig(allocator='exact', reward=Reward[reward.upper()])
    vector_env = VectorEnv(build_site(scenario), [SEED], how)
    uavs, times_s, rewards = [], [], []
    for action in actions:
        uavs.append(int(vector_env.decisions.uav[0]))
        times_s.append(float(vector_env.decisions.time_s[0]))
        rewards.append(float(vector_env.step(np.array([action])).reward[0]))
    assert vector_env.decisions.uav[0] == NONE
    turns = flown(env(scenario, reward=reward), actions)
    assert {*uavs[:-25]} == {0, 1, 2} != {*uavs[-25:]}  # one turns home early
    for uav_index in range(3):
        own = [place for place, decider in enumerate(uavs) if decider == uav_index]
        due = [
            sum(
                gamma ** (times_s[place] - times_s[start]) * rewards[place]
                for place in range(start, stop)
            )
            for start, stop in zip(own, [*own[1:], len(uavs)], strict=True)
        ]
        got = [earned for agent, earned, _ in turns if agent == f'uav_{uav_index + 1}']
        assert got[0] == 0.0  # before its first decision
        assert got[1:] == pytest.approx(due, rel=1e-9, abs=1e-12)


def test_the_return_of_every_uav_is_that_of_the_team() -> None:
    scenario = fleet()
    [log] = fly(build_site(scenario), [SEED], 'sweep', 'exact')
    gamma = scenario.reward.discount_per_s
    of_team = (gamma ** log.events['time_s'] * log.events['reward']).sum()
    turns = flown(env(scenario), sweep(scenario))
    for agent in ('uav_1', 'uav_2', 'uav_3'):
        total, discount = 0.0, 1.0  # from decision to decision, as a learner goes
        for _, reward, info in (each for each in turns if each[0] == agent):
            total += discount * reward
            discount *= info['discount']
        assert total == pytest.approx(of_team, rel=1e-9)


def test_durations_are_those_between_a_uavs_own_decisions() -> None:
    turns = flown(env(fleet()), sweep(fleet()))
    for agent in ('uav_1', 'uav_2', 'uav_3'):
        infos = [info for name, _, info in turns if name == agent]
        times_s = [info['time_s'] for info in infos]
        assert [info['duration_s'] for info in infos] == [0.0, *np.diff(times_s).tolist()]
        assert [info['discount'] for info in infos] == [
            0.99 ** info['duration_s'] for info in infos
        ]


def test_a_uav_that_cannot_move_decides_nothing_and_earns_nothing() -> None:
    # The second UAV can pay for its margin alone.
    world = env(tiny(uav(5.0), uav(5.0, energy_budget_kj=1.5)))
    world.reset()
    of_second = []
    for agent in world.agent_iter():
        seen, reward, terminated, _, info = world.last()
        if agent == 'uav_2':
            of_second.append((terminated, reward, info['duration_s'], seen.any()))
        world.step(None if terminated else int(info['action_mask'].argmax()))
    assert of_second == [(True, 0.0, 0.0, False)]
    assert world.agents == []


# How missions begin and end.


def test_all_agents_leave_one_by_one_once_the_mission_is_over() -> None:
    world, actions = env(fleet()), sweep(fleet())
    names = [agent for agent, _, info in flown(world, actions) if not info['action_mask'].any()]
    assert names == ['uav_1', 'uav_2', 'uav_3']
    assert world.agents == []
    log = world.mission_log()
    check_log(log)
    assert mission_metrics(log).is_finished


def test_a_mission_that_is_cut_off_tells_what_is_next_of_one_uav_alone() -> None:
    world = env(fleet(), max_decisions=20)
    world.reset(seed=SEED)
    for action in sweep(fleet())[:20]:
        assert not any(world.truncations.values())
        world.step(action)
    assert all(world.truncations.values())
    assert not any(world.terminations.values())
    masks = [info['action_mask'].any() for info in world.infos.values()]
    assert masks.count(True) == 1
    for agent in ('uav_1', 'uav_2', 'uav_3'):
        assert world.agent_selection == agent
        world.step(None)
    assert world.agents == []


def test_resets_without_a_seed_fly_missions_that_no_test_flies() -> None:
    world = env(short())
    seeds = []
    for seed in (None, None, 40, None, 40, None):
        world.reset(seed=seed)
        world.step(FORWARD)
        seeds.append(json.loads(world.mission_log().to_jsonl().split(b'\n')[0])['mission_seed'])
    first, after_40 = first_seed_of_resets(0), first_seed_of_resets(40)
    assert seeds == [first, first + 1, 40, after_40, 40, after_40]
    of_trainings = first_training_seed(2**28 - 1), first_seed_of_part(2**28 - 1, 4095)
    assert max(MAX_SEED // 2, VALIDATION_SEED, *of_trainings) < first < after_40
    assert first_seed_of_resets(MAX_SEED - 1) <= MAX_SEED - 2**32


def test_a_reset_in_the_middle_of_the_end_begins_anew() -> None:
    world = env(fleet(), max_decisions=2)
    turns = flown(world, sweep(fleet()))
    world.reset(seed=SEED)
    world.step(FORWARD)
    world.step(FORWARD)
    world.step(None)  # uav_1 has left, the others have not
    again = flown(world, sweep(fleet()))
    assert [(agent, reward) for agent, reward, _ in again] == [
        (agent, reward) for agent, reward, _ in turns
    ]


@pytest.mark.parametrize('seed', [-1, 2**62 + 1])
def test_a_seed_out_of_range_is_refused(seed: int) -> None:
    with pytest.raises(ValueError, match=f'seed is {seed}: must be'):
        env(short()).reset(seed=seed)


@pytest.mark.parametrize('action', [BACKWARD, HOME, NONE, N_ACTIONS + 3])
def test_an_illegal_action_is_refused_and_changes_nothing(action: int) -> None:
    world = env(short())
    world.reset(seed=0)
    with pytest.raises(ValueError, match=rf'action {action} of UAV 1 in mission 0 .* \[0, 1, 2\]'):
        world.step(action)
    assert world.agent_selection == 'uav_1'
    world.step(RIGHT)
    assert world.agent_selection == 'uav_2'


@pytest.mark.parametrize('action', [10**30, -(2**63) - 1])
def test_an_action_that_no_array_holds_is_refused_as_others_are(action: int) -> None:
    world = env(short())
    world.reset()
    with pytest.raises(ValueError, match=f'action of uav_1 is {action}: must be 0..4'):
        world.step(action)
    world.step(RIGHT)


def test_an_agent_that_decides_must_act() -> None:
    world = env(short())
    world.reset()
    with pytest.raises(ValueError, match='uav_1 decides: its action must not be None'):
        world.step(None)


@pytest.mark.parametrize(
    ('argument', 'words'),
    [
        ({'reward': 'fuel'}, "reward is 'fuel': must be paper or energy"),
        ({'layout': 'round'}, "layout is 'round': must be paper or egocentric or relative"),
        ({'bandwidth': 'cvxpy'}, "'cvxpy' cannot be stepped; there are exact, equal"),
        ({'mask_in': 'state'}, "mask_in is 'state': must be info or observation"),
        ({'max_decisions': 0}, 'max_decisions is 0: must be 1 or more'),
        ({'render_mode': 'human'}, "render_mode is 'human': must be 'rgb_array'"),
    ],
)
def test_a_wrong_argument_is_named(argument: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        env(**argument)


def test_a_fleet_too_large_for_the_layout_is_refused() -> None:
    with pytest.raises(ConfigError, match='7 UAVs'):
        env(short(7))


def test_the_ways_so_far_can_be_drawn() -> None:
    world = env(fleet(), render_mode='rgb_array')
    world.reset(seed=SEED)
    before = world.render()
    for action in sweep(fleet())[:9]:
        world.step(action)
    after = world.render()
    assert before.shape == after.shape
    assert before.dtype == np.uint8
    assert before.shape[2] == 3
    assert 0.001 < (before != after).any(axis=2).mean() < 0.5


def test_nothing_is_drawn_unless_wanted() -> None:
    world = env(short())
    world.reset()
    with pytest.warns(UserWarning, match='nothing is drawn'):
        assert world.render() is None

"""Gymnasium's environments fly the missions that all else flies, one or many of them."""

from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv
import numpy as np
from numpy.typing import NDArray
import pytest
from tiny_world import tiny, uav
from uav_collect.environments import ID
from uav_collect.environments.shared import first_seed_of_resets
from uav_collect.environments.turns import TurnEnv
from uav_collect.environments.worlds import WorldsEnv
from uav_collect.kernels.arrays import Ints
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import HOME, NONE

SEED = 3


def short() -> Scenario:
    uavs = [{'speed_mps': speed, 'energy_budget_kj': 20.0} for speed in (5.0, 10.0)]
    return load('paper_8x8', {'fleet.uavs': uavs})


def at_random(mask: NDArray[Any], rng: np.random.Generator) -> Ints:
    chosen: Ints = (mask * rng.uniform(0.1, 1.0, mask.shape)).argmax(axis=-1)
    return chosen


def test_a_mission_leaves_the_log_of_a_rollout_to_the_byte() -> None:
    [log] = fly(build_site(short()), [SEED], 'random', 'exact')
    world = gymnasium.make(f'uav_collect.environments:{ID}', scenario=short())
    world.reset(seed=SEED)
    for event in log.events[log.events['action'] != HOME]:
        _, _, terminated, truncated, info = world.step(event['action'])
    assert (terminated, truncated) == (True, False)
    assert info['action_mask'].tolist() == [0] * 5
    assert world.unwrapped.mission_log('random').to_jsonl() == log.to_jsonl()


def test_the_return_is_the_teams() -> None:
    [log] = fly(build_site(short()), [SEED], 'random', 'exact')
    world, total, discount = TurnEnv(short()), 0.0, 1.0
    world.reset(seed=SEED)
    for event in log.events[log.events['action'] != HOME]:
        _, reward, _, _, info = world.step(event['action'])
        total += discount * reward
        discount *= info['discount']
    of_team = (short().reward.discount_per_s ** log.events['time_s'] * log.events['reward']).sum()
    assert total == pytest.approx(of_team, rel=1e-9)


def test_a_mission_that_is_cut_off_is_truncated() -> None:
    world, rng = TurnEnv(short(), max_decisions=2, mask_in='observation'), np.random.default_rng(0)
    seen, info = world.reset(seed=SEED)
    assert seen in world.observation_space
    assert (info['uav'], info['mission_seed']) == (1, SEED)
    for is_cut in (False, True):
        seen, _, terminated, truncated, info = world.step(at_random(seen['action_mask'], rng))
        assert (terminated, truncated) == (False, is_cut)
    with pytest.raises(
        ValueError, match=r'action 5 of UAV \d in mission 3 is not legal; legal are'
    ):
        world.step(5)


def test_worlds_fly_the_missions_that_are_flown_one_by_one() -> None:
    worlds, rng = WorldsEnv(short(), num_envs=3, max_decisions=25), np.random.default_rng(0)
    seeds = [SEED, 7, 8]
    observed, infos = worlds.reset(options={'mission_seeds': seeds})
    alone = [TurnEnv(short(), max_decisions=25) for _ in seeds]
    expected = [world.reset(seed=seed) for world, seed in zip(alone, seeds, strict=True)]
    next_seed, n_ended, n_cut = first_seed_of_resets(0), 0, 0
    nobody = np.zeros(3, bool)
    assert observed in worlds.observation_space
    for _ in range(60):
        assert observed.tolist() == [seen.tolist() for seen, _ in expected]
        assert infos['action_mask'].tolist() == [it['action_mask'].tolist() for _, it in expected]
        assert infos['uav'].tolist() == [it['uav'] for _, it in expected]
        actions = at_random(infos['action_mask'], rng)
        observed, rewards, terminated, truncated, infos = worlds.step(actions)
        for world, one in enumerate(alone):
            seen, reward, is_over, is_cut, info = one.step(actions[world])
            assert infos.get('_final_obs', nobody)[world] == (is_over or is_cut)
            found = rewards[world], terminated[world], truncated[world]
            assert found == (reward, is_over, is_cut)
            assert infos['discount'][world] == pytest.approx(info['discount'], rel=1e-12)
            if is_over or is_cut:
                n_cut += is_cut
                assert infos['final_obs'][world].tolist() == seen.tolist()
                log = one.mission_log()
                share = infos['final_info']['collected_share'][world]
                assert share == pytest.approx(
                    log.events['collected_bit'].sum() / log.header.total_bit
                )
                assert infos['final_info']['mission_seed'][world] == info['mission_seed']
                seen, info = one.reset(seed=next_seed)
                next_seed, n_ended = next_seed + 1, n_ended + 1
            expected[world] = seen, info
    assert n_ended > 4
    assert n_cut > 0


@pytest.mark.parametrize('max_decisions', [None, 5])
def test_what_was_seen_last_is_handed_out_as_by_gymnasiums_own_vectors(
    max_decisions: int | None,
) -> None:
    def one() -> gymnasium.Env[Any, Any]:
        return TurnEnv(short(), max_decisions=max_decisions, mask_in='observation')

    worlds = WorldsEnv(short(), num_envs=2, max_decisions=max_decisions, mask_in='observation')
    alike = SyncVectorEnv([one, one], autoreset_mode=AutoresetMode.SAME_STEP)
    observed, _ = worlds.reset(options={'mission_seeds': [SEED, 7]})
    alike.reset(seed=[SEED, 7])
    rng, has_ended = np.random.default_rng(0), np.zeros(2, bool)
    while not has_ended.any():
        actions = at_random(observed['action_mask'], rng)
        observed, _, terminated, truncated, infos = worlds.step(actions)
        *_, expected = alike.step(actions)
        has_ended = terminated | truncated
    assert infos['_final_obs'].tolist() == expected['_final_obs'].tolist() == has_ended.tolist()
    for world in np.flatnonzero(has_ended):
        for name, seen in expected['final_obs'][world].items():
            assert infos['final_obs'][name][world].tolist() == seen.tolist()


def test_what_worlds_hand_out_stays_as_it_is() -> None:
    worlds = WorldsEnv(short(), num_envs=2, mask_in='observation')
    first, infos = worlds.reset(seed=5)
    kept = first['observation'].copy(), first['action_mask'].copy(), infos['time_s'].copy()
    for _ in range(5):
        seen, *_ = worlds.step(
            at_random(worlds.reset()[0]['action_mask'], np.random.default_rng(1))
        )
    handed = first['observation'], first['action_mask'], infos['time_s']
    assert all(np.array_equal(old, new) for old, new in zip(kept, handed, strict=True))
    assert seen in worlds.observation_space


def test_a_seed_of_worlds_settles_missions_that_no_test_flies() -> None:
    def seeds_of(seed: int) -> list[int]:
        worlds, rng = WorldsEnv(short(), num_envs=2, max_decisions=1), np.random.default_rng(0)
        _, infos = worlds.reset(seed=seed)
        *_, infos = worlds.step(at_random(infos['action_mask'], rng))
        *_, after = worlds.step(at_random(infos['action_mask'], rng))
        both = infos['final_info']['mission_seed'], after['final_info']['mission_seed']
        return np.concatenate(both).tolist()

    for seed in (0, 9):
        assert seeds_of(seed) == [first_seed_of_resets(seed) + number for number in range(4)]


@pytest.mark.parametrize(
    ('actions', 'words'),
    [
        ([1, 3], r'action 3 of UAV 1 in mission \d+ is not legal; legal are \[.*1, 2\]'),
        ([1, -1], r'action -1 of UAV 1'),
        ([1, 5], r'action 5 of UAV 1'),
        ([1.0, 1.0], 'actions are float64: must be whole numbers'),
        ([1], r'actions must have shape \(2,\), got \(1,\)'),
    ],
)
def test_illegal_actions_of_worlds_are_refused_and_change_nothing(
    actions: list[Any], words: str
) -> None:
    worlds = WorldsEnv(short(), num_envs=2)
    worlds.reset(seed=0)
    with pytest.raises(ValueError, match=words):
        worlds.step(np.array(actions))
    _, _, _, _, infos = worlds.step(np.array([1, 1]))
    assert infos['uav'].tolist() == [2, 2]


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({'options': {'mission_seeds': [1, 2, 3]}}, r'mission_seeds must have shape \(2,\)'),
        ({'options': {'mission_seeds': [1, -2]}}, r'seed is -2: must be 0\.\.2\^62'),
    ],
)
def test_seeds_of_worlds_that_are_none_are_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        WorldsEnv(short(), num_envs=2).reset(**given)


@pytest.mark.parametrize('make', [TurnEnv, WorldsEnv])
def test_a_seed_is_any_whole_number_from_0_to_2_to_the_62(make: Any) -> None:  # noqa: ANN401
    world = make(short())
    for seed in (-1, 2**62 + 1):
        with pytest.raises(ValueError, match=rf'seed is {seed}: must be 0\.\.2\^62'):
            world.reset(seed=seed)
    by_numpy, _ = world.reset(seed=np.int64(SEED))
    assert by_numpy.tolist() == world.reset(seed=SEED)[0].tolist()


def test_gymnasium_makes_worlds_by_their_name() -> None:
    worlds = gymnasium.make_vec(
        f'uav_collect.environments:{ID}', num_envs=3, scenario=tiny(uav(5.0)), layout='paper'
    )
    assert isinstance(worlds.unwrapped, WorldsEnv)
    assert worlds.num_envs == len(worlds.reset(seed=1)[0]) == 3


def test_a_mission_in_which_nobody_is_left_to_decide_ends_with_its_first_step() -> None:
    gone = tiny(uav(5.0), faults=[{'uav': 1, 'kind': 'gone', 'at_decision': 0, 'share': 0.5}])
    worlds, alone = WorldsEnv(gone, num_envs=4), TurnEnv(gone)
    _, infos = worlds.reset(seed=0)
    is_over = infos['uav'] == 0
    assert 0 < is_over.sum() < 4
    assert (infos['action_mask'][is_over] == [1, 0, 0, 0, 0]).all()
    worlds.step(infos['action_mask'].argmax(axis=1))
    seen, infos = worlds.reset(seed=0)  # the same, whatever was seen before
    assert (seen[is_over] == 0.0).all()
    _, rewards, terminated, _, infos = worlds.step(infos['action_mask'].argmax(axis=1))
    assert terminated.tolist() == is_over.tolist()
    assert (rewards[is_over] == 0.0).all()
    alone.reset(seed=first_seed_of_resets(0) + int(is_over.argmin()))
    seen, info = alone.reset(seed=first_seed_of_resets(0) + int(is_over.argmax()))
    assert (info['uav'], info['action_mask'].tolist()) == (0, [1, 0, 0, 0, 0])
    assert not seen.any()
    assert alone.step(0)[1:4] == (0.0, True, False)


def test_a_twin_leaves_the_missions_it_came_from_as_they_are() -> None:
    def new() -> VectorEnv:
        config = VectorEnvConfig(allocator='exact', is_logged=True, max_decisions=99)
        return VectorEnv(build_site(short()), [SEED, 4], config)

    env, other, rng = new(), new(), np.random.default_rng(0)
    recorded = [env.episode(world).records for world in range(2)]
    twin = env.twin()
    while (twin.decisions.uav != NONE).all():
        twin.step(at_random(twin.decisions.legal, rng))
    for world, records in enumerate(recorded):
        for before, after in zip(records, env.episode(world).records, strict=True):
            np.testing.assert_array_equal(before, after)
    rng = np.random.default_rng(1)
    for _ in range(30):
        actions = at_random(other.decisions.legal, rng)
        env.step(actions)
        other.step(actions)
    logs = [[log.to_jsonl() for log in each.mission_logs('x')] for each in (env, other)]
    assert logs[0] == logs[1]

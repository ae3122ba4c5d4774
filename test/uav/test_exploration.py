"""Exploration: keyed by mission, UAV and decision, as often and as much over data as told."""

from collections import Counter

import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.kernels.arrays import row_of
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOVER, LEFT, N_ACTIONS, NONE, RIGHT
from uav_collect.uav.exploration import explore

N_DRAWS = 4000


def drawn(epsilon: float, hover_share: float, legal: tuple[int, ...], seed: int = 0) -> list[int]:
    """The actions of many decisions of one UAV."""
    row = row_of(legal)
    return [
        explore(seed, 1, decision, epsilon, hover_share, 0.0, NONE, row)
        for decision in range(N_DRAWS)
    ]


def share(actions: list[int], action: int) -> float:
    return Counter(actions)[action] / len(actions)


def test_a_uav_explores_about_as_often_as_epsilon_says() -> None:
    for epsilon in (0.05, 0.3, 0.9):
        explored = 1.0 - share(drawn(epsilon, -1.0, (1, 1, 1, 1, 1)), NONE)
        assert explored == pytest.approx(epsilon, abs=0.025)


def test_epsilon_0_never_explores_and_1_always_does() -> None:
    assert set(drawn(0.0, -1.0, (1, 1, 1, 1, 1))) == {NONE}
    assert NONE not in drawn(1.0, -1.0, (1, 1, 1, 1, 1))


def test_only_legal_actions_are_drawn_and_all_of_them_alike() -> None:
    actions = drawn(1.0, -1.0, (0, 1, 0, 1, 1))
    assert set(actions) == {FORWARD, BACKWARD, LEFT}
    for action in (FORWARD, BACKWARD, LEFT):
        assert share(actions, action) == pytest.approx(1.0 / 3.0, abs=0.025)


def test_with_a_hover_share_a_uav_hovers_so_often_where_it_can() -> None:
    # 0.6, and one in three of the rest, for all legal actions are alike there.
    actions = drawn(1.0, 0.6, (1, 0, 1, 0, 1))
    assert share(actions, HOVER) == pytest.approx(0.6 + 0.4 / 3.0, abs=0.025)
    assert share(actions, RIGHT) == pytest.approx(0.4 / 3.0, abs=0.025)
    assert HOVER not in drawn(1.0, 0.6, (0, 1, 1, 1, 1))
    assert set(drawn(1.0, 1.0, (1, 1, 1, 1, 1))) == {HOVER}


def test_a_negative_hover_share_treats_hovering_as_any_action() -> None:
    actions = drawn(1.0, -1.0, (1, 1, 1, 1, 1))
    assert share(actions, HOVER) == pytest.approx(0.2, abs=0.025)


def test_whether_it_explores_says_nothing_about_where_to() -> None:
    # The words for the two are drawn apart: a small epsilon does not pick the first actions.
    actions = [it for it in drawn(0.1, -1.0, (0, 1, 1, 1, 1)) if it != NONE]
    for action in (FORWARD, RIGHT, BACKWARD, LEFT):
        assert share(actions, action) == pytest.approx(0.25, abs=0.09)


def test_a_larger_epsilon_explores_wherever_a_smaller_one_does_and_alike() -> None:
    some, more = (drawn(epsilon, 0.3, (1, 1, 1, 1, 1)) for epsilon in (0.2, 0.5))
    assert all(it in (NONE, other) for it, other in zip(some, more, strict=True))


def test_other_missions_uavs_and_decisions_explore_otherwise() -> None:
    legal = row_of((1, 1, 1, 1, 1))
    keys = [(seed, uav_index) for seed in (0, 1, 2**61) for uav_index in range(3)]
    lists = {
        tuple(explore(seed, uav_index, it, 1.0, -1.0, 0.0, NONE, legal) for it in range(40))
        for seed, uav_index in keys
    }
    assert len(lists) == len(keys)


def test_a_mission_explores_the_same_alone_and_in_any_place_of_a_batch() -> None:
    site = build_site(tiny(uav(5.0), uav(10.0), uav(7.5)))
    together, alone = ([3, 4, 5], 1), ([4], 0)
    found = []
    for seeds, place in (together, alone):
        env = VectorEnv(site, seeds, VectorEnvConfig())
        actions = []
        for _ in range(30):
            explored = env.explore(0.5, 0.3)
            greedy = env.decisions.legal.argmax(axis=1)
            actions.append(int(explored[place]))
            env.step(np.where(explored == NONE, greedy, explored))
        found.append(actions)
    assert found[0] == found[1]
    assert len(set(found[0])) > 3
    assert set(found[0]) <= {NONE, *range(N_ACTIONS)}


def test_exploring_again_gives_the_same_and_moves_nothing() -> None:
    env = VectorEnv(build_site(tiny()), range(6), VectorEnvConfig())
    before = env.decisions.observation.copy()
    first = env.explore(0.5, 0.6)
    assert env.explore(0.5, 0.6).tolist() == first.tolist()
    assert (env.decisions.observation == before).all()

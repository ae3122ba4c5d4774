"""The replay: the latest missions, exactly as they were, in a ring of fixed size."""

from copy import deepcopy

from checkpoints import read_back
from episodes import drawn_episode
import numpy as np
import pytest
from tiny_world import tiny
from uav_collect.learning.replay import Replay, replay_bytes
from uav_collect.missions.experience import (
    Episode,
    new_records,
    record_bytes,
    Records,
    sparse_observations,
)
from uav_collect.scenario.load import load
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout

BRIEFING = brief(tiny())


def episode(n_decisions: int, seed: int) -> Episode:
    return drawn_episode(BRIEFING, n_decisions, seed)


def replay_of(capacity: int, most_observation_bytes: int = 10**6) -> Replay:
    return Replay(capacity, BRIEFING, Layout.EGOCENTRIC, most_observation_bytes)


def held(replay: Replay, n_draws: int = 200) -> dict[int, Episode]:
    """All missions of a replay, by their seed."""
    drawn = replay.sample(n_draws, np.random.default_rng(0))
    return {it.mission_seed: it for it in drawn}


def same(one: Episode, other: Episode) -> bool:
    tables = zip(one.records, other.records, strict=True)
    return (
        one.is_whole == other.is_whole
        and one.demand_bit.tolist() == other.demand_bit.tolist()
        and all(mine.tolist() == theirs.tolist() for mine, theirs in tables)
    )


def test_missions_come_back_as_they_were() -> None:
    replay, episodes = replay_of(100), [episode(9 + seed, seed) for seed in range(5)]
    for each in episodes:
        replay.add(each)
    assert replay.n_missions == 5
    assert replay.n_decisions == 9 + 10 + 11 + 12 + 13
    found = held(replay)
    assert all(same(found[seed], each) for seed, each in enumerate(episodes))


def test_the_oldest_missions_make_room() -> None:
    replay = replay_of(30)
    for seed in range(3):
        replay.add(episode(10, seed))
    assert set(held(replay)) == {0, 1, 2}
    replay.add(episode(11, 3))  # takes the place of the first two
    assert set(held(replay)) == {2, 3}
    assert replay.n_decisions == 21


def test_a_mission_never_lies_around_the_end_of_the_ring() -> None:
    replay = replay_of(30)
    for seed in range(3):
        replay.add(episode(9, seed))
    replay.add(episode(5, 3))  # 3 rows are left at the end: it starts over, in the first's place
    assert set(held(replay)) == {1, 2, 3}


def test_whatever_comes_the_latest_missions_are_held_whole() -> None:
    rng, replay = np.random.default_rng(0), replay_of(64)
    added: list[Episode] = []
    for seed in range(200):
        added.append(episode(int(rng.integers(1, 25)), seed))
        replay.add(deepcopy(added[-1]))
        n_held = replay.n_missions
        assert n_held >= 1
        assert replay.n_decisions == sum(it.n_decisions for it in added[-n_held:]) <= 64
        if seed % 20 == 0:
            found = held(replay)
            assert set(found) == {it.mission_seed for it in added[-n_held:]}
            assert all(same(found[it.mission_seed], it) for it in added[-n_held:])


def test_a_mission_that_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match='a mission of 31 decisions; the replay has room for 30'):
        replay_of(30).add(episode(31, 0))


def test_a_mission_that_fills_the_ring_is_held_alone() -> None:
    replay = replay_of(30)
    for seed in range(3):
        replay.add(episode(30 if seed == 1 else 4, seed))
        assert replay.n_missions == 1
    assert set(held(replay)) == {2}


def test_every_mission_has_the_same_chance_however_long() -> None:
    replay = replay_of(100)
    for seed, size in enumerate((1, 50, 5, 10)):
        replay.add(episode(size, seed))
    drawn = replay.sample(20_000, np.random.default_rng(0))
    counts = np.bincount([it.mission_seed for it in drawn])
    np.testing.assert_allclose(counts / len(drawn), 0.25, atol=0.015)


def test_the_generator_alone_decides_what_is_drawn() -> None:
    replay = replay_of(100)
    for seed in range(8):
        replay.add(episode(5, seed))
    first, second = (
        [it.mission_seed for it in replay.sample(20, np.random.default_rng(3))] for _ in range(2)
    )
    assert first == second


def test_a_restored_replay_holds_the_same_and_goes_on_alike() -> None:
    replay, other = replay_of(40), replay_of(40)
    for seed in range(7):
        replay.add(episode(9, seed))
    other.restore(read_back({'held': replay.state()}).part('held'))
    for seed in range(7, 12):
        found = held(replay)
        assert set(held(other)) == set(found)
        assert all(same(held(other)[key], each) for key, each in found.items())
        for each in (replay, other):
            each.add(episode(11, seed))


def test_an_empty_replay_is_restored_empty() -> None:
    replay = replay_of(40)
    assert replay_of(40).state() is None
    replay.add(episode(9, 0))
    replay.restore(None)
    assert (replay.n_missions, replay.n_decisions) == (0, 0)


def observation_bytes(one: Episode) -> int:
    return sparse_observations(one, Layout.EGOCENTRIC, BRIEFING).n_bytes


@pytest.mark.parametrize('most_observation_bytes', [0, 10**6])
def test_missions_come_with_their_observations_kept_or_not(most_observation_bytes: int) -> None:
    replay = replay_of(30, most_observation_bytes)
    for seed in range(9):
        replay.add(episode(9, seed))
        for found in replay.sample(5, np.random.default_rng(seed)):
            expected = sparse_observations(found, Layout.EGOCENTRIC, BRIEFING)
            pairs = zip(found.observation or (), expected, strict=True)
            assert all(mine.tolist() == theirs.tolist() for mine, theirs in pairs)


def test_observations_are_kept_as_long_as_there_is_room_and_go_with_their_missions() -> None:
    episodes = [episode(10, seed) for seed in range(6)]
    sizes = [observation_bytes(it) for it in episodes]
    replay = replay_of(30, sizes[0] + sizes[1])
    for each in episodes[:3]:
        replay.add(each)
    assert replay.n_bytes == replay_bytes(30, BRIEFING)  # none was asked for
    held(replay)
    n_kept = replay.n_bytes - replay_bytes(30, BRIEFING)
    assert 0 < n_kept <= sizes[0] + sizes[1]
    for each in episodes[3:]:
        replay.add(each)
    assert replay.n_bytes == replay_bytes(30, BRIEFING)


def test_observations_that_are_kept_are_made_once() -> None:
    replay = replay_of(30)
    replay.add(episode(10, 0))
    first, again = replay.sample(2, np.random.default_rng(0))
    assert first.observation is again.observation is not None
    replay.restore(read_back({'held': replay.state()}).part('held'))
    assert replay.n_bytes == replay_bytes(30, BRIEFING)


def test_its_bytes_are_what_was_announced() -> None:
    # One decision of two UAVs on 16 cells: 2 bytes a map.
    bytes_of_one = (
        *(1 + 4 + 8 + 8 + 4 + 1 + 1,),  # uav, decision, time, energy, cell, action before, legal
        *(3 * 2 * 8,),  # where and when the others were heard
        *(2 * 2 + 2 + 2,),  # both maps, the true one, what was seen
        *(2 * 4 * 4,),  # the fleet
        *(1 + 8 + 8,),  # action, reward, duration
        *(1 + 5 * 4,),  # whether it was branched, and what each action is worth
    )
    assert record_bytes(BRIEFING) == sum(bytes_of_one)
    assert replay_bytes(1000, BRIEFING) == 1000 * sum(bytes_of_one)
    assert sum(table.nbytes for table in new_records(1000, BRIEFING)) == 1000 * sum(bytes_of_one)


def test_a_million_decisions_of_the_paper_fit_into_a_quarter_of_a_gigabyte() -> None:
    assert replay_bytes(10**6, brief(load('paper_10x10'))) < 250e6


def test_a_record_is_a_tenth_of_an_observation() -> None:
    briefing = brief(load('paper_10x10'))
    assert record_bytes(briefing) < 0.15 * 4 * 415


def test_every_column_is_kept() -> None:
    replay = replay_of(20)
    one = episode(10, 0)
    replay.add(one)
    back = replay.sample(1, np.random.default_rng(0))[0]
    for name in Records._fields:
        assert getattr(back.records, name).dtype == getattr(one.records, name).dtype

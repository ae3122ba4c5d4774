"""The replay: the latest missions, exactly as they were, in a ring of fixed size."""

from copy import deepcopy

from checkpoints import read_back
from episodes import drawn_episode
import numpy as np
import pytest
from tiny_world import tiny
from uav_collect.learning.replay import Replay, replay_bytes
from uav_collect.missions.experience import Episode, new_records, record_bytes, Records
from uav_collect.scenario.load import load
from uav_collect.uav.briefing import brief

BRIEFING = brief(tiny())


def episode(n_decisions: int, seed: int) -> Episode:
    return drawn_episode(BRIEFING, n_decisions, seed)


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
    replay, episodes = Replay(100, BRIEFING), [episode(9 + seed, seed) for seed in range(5)]
    for each in episodes:
        replay.add(each)
    assert replay.n_missions == 5
    assert replay.n_decisions == 9 + 10 + 11 + 12 + 13
    found = held(replay)
    assert all(same(found[seed], each) for seed, each in enumerate(episodes))


def test_the_oldest_missions_make_room() -> None:
    replay = Replay(30, BRIEFING)
    for seed in range(3):
        replay.add(episode(10, seed))
    assert set(held(replay)) == {0, 1, 2}
    replay.add(episode(11, 3))  # takes the place of the first two
    assert set(held(replay)) == {2, 3}
    assert replay.n_decisions == 21


def test_a_mission_never_lies_around_the_end_of_the_ring() -> None:
    replay = Replay(30, BRIEFING)
    for seed in range(3):
        replay.add(episode(9, seed))
    replay.add(episode(5, 3))  # 3 rows are left at the end: it starts over, in the first's place
    assert set(held(replay)) == {1, 2, 3}


def test_whatever_comes_the_latest_missions_are_held_whole() -> None:
    rng, replay = np.random.default_rng(0), Replay(64, BRIEFING)
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
        Replay(30, BRIEFING).add(episode(31, 0))


def test_a_mission_that_fills_the_ring_is_held_alone() -> None:
    replay = Replay(30, BRIEFING)
    for seed in range(3):
        replay.add(episode(30 if seed == 1 else 4, seed))
        assert replay.n_missions == 1
    assert set(held(replay)) == {2}


def test_every_mission_has_the_same_chance_however_long() -> None:
    replay = Replay(100, BRIEFING)
    for seed, size in enumerate((1, 50, 5, 10)):
        replay.add(episode(size, seed))
    drawn = replay.sample(20_000, np.random.default_rng(0))
    counts = np.bincount([it.mission_seed for it in drawn])
    np.testing.assert_allclose(counts / len(drawn), 0.25, atol=0.015)


def test_the_generator_alone_decides_what_is_drawn() -> None:
    replay = Replay(100, BRIEFING)
    for seed in range(8):
        replay.add(episode(5, seed))
    first, second = (
        [it.mission_seed for it in replay.sample(20, np.random.default_rng(3))] for _ in range(2)
    )
    assert first == second


def test_a_restored_replay_holds_the_same_and_goes_on_alike() -> None:
    replay, other = Replay(40, BRIEFING), Replay(40, BRIEFING)
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
    replay = Replay(40, BRIEFING)
    assert Replay(40, BRIEFING).state() is None
    replay.add(episode(9, 0))
    replay.restore(None)
    assert (replay.n_missions, replay.n_decisions) == (0, 0)


def test_its_bytes_are_what_was_announced() -> None:
    # One decision of two UAVs on 16 cells: 2 bytes a map.
    bytes_of_one = (
        *(1 + 4 + 8 + 8 + 4 + 1 + 1,),  # uav, decision, time, energy, cell, action before, legal
        *(3 * 2 * 8,),  # where and when the others were heard
        *(2 * 2 + 2 + 2,),  # both maps, the true one, what was seen
        *(2 * 4 * 4,),  # the fleet
        *(1 + 8 + 8,),  # action, reward, duration
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
    replay = Replay(20, BRIEFING)
    one = episode(10, 0)
    replay.add(one)
    back = replay.sample(1, np.random.default_rng(0))[0]
    for name in Records._fields:
        assert getattr(back.records, name).dtype == getattr(one.records, name).dtype

"""A minibatch: observations packed by UAV, and for each decision who runs which action."""

from dataclasses import replace

from episodes import batch_of, drawn_episode, flown, hand_episode, HandDecision, small
from interpreted import interpreted
import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.learning.minibatch import Algorithm, Minibatch, NO_DECISION
from uav_collect.missions.experience import Episode, sparse_observations
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout

FLEET = uav(5.0), uav(10.0), uav(7.5)


def paper(name: str, *fleet: dict[str, object]) -> Scenario:
    return load(name, {'fleet.uavs': [*fleet]})


def drawn_batch(algorithm: Algorithm = Algorithm.AQMIX) -> tuple[list[Episode], Minibatch]:
    scenario = tiny(*FLEET)
    sizes = (11, 4, 17, 8)
    episodes = [drawn_episode(brief(scenario), size, seed) for seed, size in enumerate(sizes)]
    return episodes, batch_of(episodes, scenario, small(), algorithm)


def rows_by_uav(episodes: list[Episode], batch: Minibatch) -> dict[tuple[int, int], list[int]]:
    """Packed rows of each UAV's decisions in each mission, in order."""
    found: dict[tuple[int, int], list[int]] = {}
    first = 0
    for mission, episode in enumerate(episodes):
        for index, uav_index in enumerate(episode.records.uav):
            rows = found.setdefault((mission, int(uav_index)), [])
            rows.append(int(batch.row[first + index]))
        first += episode.n_decisions
    return found


def test_each_decision_has_one_row() -> None:
    episodes, batch = drawn_batch()
    assert sorted(batch.row) == list(range(sum(it.n_decisions for it in episodes)))
    assert sum(batch.step_sizes) == len(batch.row)


def test_a_uavs_decisions_of_a_mission_lie_at_one_place_of_successive_steps() -> None:
    episodes, batch = drawn_batch()
    starts = np.cumsum([0, *batch.step_sizes])
    places = []
    for rows in rows_by_uav(episodes, batch).values():
        place = rows[0]
        assert rows == [int(start) + place for start in starts[: len(rows)]]
        assert all(place < size for size in batch.step_sizes[: len(rows)])
        places.append(place)
    assert sorted(places) == list(range(len(places)))


def test_longer_sequences_come_first() -> None:
    episodes, batch = drawn_batch()
    lengths = {rows[0]: len(rows) for rows in rows_by_uav(episodes, batch).values()}
    ordered = [lengths[place] for place in range(len(lengths))]
    assert ordered == sorted(ordered, reverse=True)
    assert batch.step_sizes == sorted(batch.step_sizes, reverse=True)


def test_what_is_legal_and_what_was_done_stay_with_their_decision() -> None:
    episodes, batch = drawn_batch()
    records = [it.records for it in episodes]
    bits = np.concatenate([it.legal for it in records])
    assert (batch.legal[batch.row] @ (1 << np.arange(5)) == bits).all()
    assert (
        batch.action.tolist()
        == np.maximum(np.concatenate([it.action for it in records]), 0).tolist()
    )
    assert (batch.fleet == np.concatenate([it.fleet for it in records])).all()


def test_the_latest_decision_of_each_uav_is_its_own_last_one_of_this_mission() -> None:
    episodes, batch = drawn_batch()
    first = 0
    for episode in episodes:
        latest = [NO_DECISION] * 3
        for decision in range(first, first + episode.n_decisions):
            latest[int(episode.records.uav[decision - first])] = decision
            assert batch.latest[decision].tolist() == latest
        first += episode.n_decisions


def test_a_uav_that_flies_home_has_no_latest_decision_any_more() -> None:
    decisions = [
        HandDecision(uav=0, time_s=0.0, action=1),
        HandDecision(uav=1, time_s=0.0, action=1),
        HandDecision(uav=0, time_s=5.0, action=1, home=(1,)),
    ]
    batch = batch_of([hand_episode(brief(tiny()), decisions, 9.0)], tiny(), small())
    assert batch.latest.tolist() == [[0, NO_DECISION], [0, 1], [2, NO_DECISION]]


def test_alone_the_deciding_uav_decides_unless_all_do_at_an_instant() -> None:
    decisions = [
        HandDecision(uav=index % 2, time_s=5.0 * (index // 2), action=1) for index in range(4)
    ]
    episode = hand_episode(brief(tiny()), decisions, 9.0)
    asynchronous = batch_of([episode], tiny(), small(), Algorithm.AQMIX)
    assert asynchronous.decides.sum(axis=1).tolist() == [1, 1, 1, 1]
    synchronous = batch_of([episode], tiny(), small(), Algorithm.QMIX)
    assert synchronous.decides.sum(axis=1).tolist() == [1, 2, 1, 2]


def test_maps_are_those_of_all_uavs_then_the_true_one() -> None:
    episodes, batch = drawn_batch()
    records = episodes[0].records
    n_bytes = records.true_complete.shape[1]
    for index, packed in enumerate([*records.complete[3].reshape(3, n_bytes)]):
        bits = [int(packed[cell // 8]) >> cell % 8 & 1 for cell in range(16)]
        assert batch.complete[3, index].tolist() == bits
    true = records.true_complete[3]
    assert batch.complete[3, 3].tolist() == [int(true[c // 8]) >> c % 8 & 1 for c in range(16)]


@pytest.mark.parametrize('algorithm', (Algorithm.AQMIX, Algorithm.QMIX, Algorithm.AIQL))
def test_rewards_of_a_whole_mission_add_up_whatever_the_entries(algorithm: Algorithm) -> None:
    # Followed along a chain, rewards and discounts give the mission's discounted sum.
    scenario = tiny(*FLEET)
    decisions = [
        HandDecision(uav=index % 3, time_s=4.0 * (index // 3), action=1, reward=float(index))
        for index in range(12)
    ]
    episode = hand_episode(brief(scenario), decisions, 20.0)
    config = small(reward__discount_per_s=0.9)
    batch = batch_of([episode], scenario, config, algorithm)
    start = {Algorithm.AQMIX: 0, Algorithm.QMIX: 2, Algorithm.AIQL: 0}[algorithm]
    place = batch.entry.tolist().index(start)
    total, worth = 0.0, 1.0
    while place >= 0:
        total += worth * batch.reward[place]
        worth *= batch.discount[place]
        follows = batch.next_entry[place]
        place = batch.entry.tolist().index(follows) if follows >= 0 else NO_DECISION
    expected = sum(0.9**it.time_s * it.reward for it in decisions[start:])
    assert total == pytest.approx(expected)


@pytest.mark.parametrize('layout', ['paper', 'egocentric'])
@pytest.mark.parametrize('n_uavs', [1, 2, 3])
@pytest.mark.parametrize('name', ['tiny', 'paper_8x8', 'paper_10x10'])
def test_observations_are_those_that_were_encoded_in_flight(
    name: str, n_uavs: int, layout: str
) -> None:
    fleet = FLEET[:n_uavs]
    scenario = tiny(*fleet) if name == 'tiny' else paper(name, *fleet)
    missions = flown(scenario, [5, 6], 60, layout=Layout[layout.upper()])
    batch = batch_of(missions.episodes, scenario, small(observation=layout))
    seen = np.concatenate([np.array(it) for it in missions.observations])
    assert len(seen) > 40
    assert (batch.observation[batch.row] == seen.astype(np.float32)).all()


def rebuilt_of_a_large_area() -> str:
    """By how much rebuilt observations differ where nearly all of 289 cells are known complete."""
    scenario = tiny(*FLEET[:2], area__cells_per_side=17, demand__known_empty='sensors')
    missions = flown(scenario, [3], max_decisions=4)
    batch = batch_of(missions.episodes, scenario, small('strong'))
    seen = np.concatenate([np.array(it) for it in missions.observations]).astype(np.float32)
    return str(float(np.abs(batch.observation[batch.row] - seen).max()))


def test_observations_of_large_areas_are_rebuilt_by_interpreted_kernels_too() -> None:
    assert interpreted(rebuilt_of_a_large_area) == '0.0'


def test_where_observations_are_at_hand_the_minibatch_is_the_same() -> None:
    scenario = tiny(*FLEET)
    episodes, rebuilt = drawn_batch()
    episodes = [
        replace(it, observation=sparse_observations(it, small().layout, brief(scenario)))
        for it in episodes
    ]
    at_hand = batch_of(episodes, scenario, small(), Algorithm.AQMIX)
    for mine, theirs in zip(at_hand.sparse, rebuilt.sparse, strict=True):
        assert mine.tolist() == theirs.tolist()


def test_rows_of_zeros_stay_rows_of_zeros() -> None:
    _, batch = drawn_batch()
    empty = np.zeros_like(batch.sparse.start)
    zeros = replace(batch, sparse=batch.sparse._replace(
        column=empty[:0], value=np.zeros(0, dtype=np.float32), start=empty, stop=empty
    ))  # fmt: skip
    assert zeros.observation.shape == batch.observation.shape
    assert not zeros.observation.any()
    assert batch.observation.any(axis=1).all()

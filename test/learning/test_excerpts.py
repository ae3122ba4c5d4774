"""Excerpts of missions: what an update learns from them is what it would from whole missions."""

from collections.abc import Sequence

from episodes import batch_of, drawn_episode, single_threaded_torch, small
import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.learning.excerpts import draw_excerpts, Excerpt
from uav_collect.learning.minibatch import Algorithm, make_excerpt_minibatch, Minibatch
from uav_collect.learning.replay import Replay
from uav_collect.missions.experience import Episode
from uav_collect.scenario.model import Scenario
from uav_collect.uav.briefing import brief

torch = single_threaded_torch()
from uav_collect.learning.learner import Learner

FLEET = uav(5.0), uav(10.0), uav(7.5)
SIZES = (11, 4, 17, 8)
LONG = 1000  # decisions: more than any of the missions has


def missions(scenario: Scenario) -> list[Episode]:
    return [drawn_episode(brief(scenario), size, seed) for seed, size in enumerate(SIZES)]


def of_excerpts(
    excerpts: Sequence[Excerpt],
    scenario: Scenario,
    n_burn_in: int = LONG,
    algorithm: Algorithm = Algorithm.AQMIX,
) -> Minibatch:
    config = small()
    how = brief(scenario), config.layout, algorithm, config.reward.discount_per_s
    return make_excerpt_minibatch(excerpts, n_burn_in, *how)


def entries_of_excerpts(batch: Minibatch, excerpts: Sequence[Excerpt]) -> list[int]:
    """Which of the entries of whole missions lie in excerpts of them."""
    first = np.cumsum([0, *(it.episode.n_decisions for it in excerpts)])
    within = [range(at + it.start, at + it.stop) for at, it in zip(first, excerpts, strict=False)]
    return [
        place
        for place, entry in enumerate(batch.entry.tolist())
        if any(entry in each for each in within)
    ]


@pytest.mark.parametrize('algorithm', [Algorithm.AQMIX, Algorithm.QMIX, Algorithm.AIQL])
def test_targets_and_values_of_excerpts_are_those_of_whole_missions(algorithm: Algorithm) -> None:
    scenario = tiny(*FLEET)
    episodes = missions(scenario)
    places = ((0, 3), (2, 4), (6, 14), (5, 8))
    excerpts = [
        Excerpt(episode=episode, start=start, stop=stop)
        for episode, (start, stop) in zip(episodes, places, strict=True)
    ]
    learner = Learner(small(), [brief(scenario)], algorithm, seed=0)
    whole = batch_of(episodes, scenario, small(), algorithm)
    part = of_excerpts(excerpts, scenario, algorithm=algorithm)
    chosen = entries_of_excerpts(whole, excerpts)
    assert 0 < len(chosen) < len(whole.entry)
    assert len(part.row) < len(whole.row)
    with torch.no_grad():
        goals, all_goals = (learner.targets(batch) for batch in (part, whole))
        values, all_values = (learner._loss(batch, 0)[1] for batch in (part, whole))
    torch.testing.assert_close(goals, all_goals[chosen])
    torch.testing.assert_close(values, all_values[chosen])


def test_a_burn_in_runs_the_network_for_so_many_decisions_of_each_uav_before() -> None:
    scenario = tiny(*FLEET)
    [episode] = missions(scenario)[2:3]
    excerpt = Excerpt(episode=episode, start=9, stop=12)
    without, some, all_before = (of_excerpts([excerpt], scenario, n) for n in (0, 2, LONG))
    lengths = [len(it.step_sizes) for it in (without, some, all_before)]
    assert lengths == sorted(lengths)
    uavs = episode.records.uav
    first = {int(index) for index in without.latest[without.entry].ravel() if index >= 0}
    assert len(some.row) - len(without.row) <= 2 * len(FLEET)
    assert len(some.row) > len(without.row) >= len(first)
    assert len(all_before.row) <= len(uavs)


def test_excerpts_of_one_batch_know_nothing_of_each_other() -> None:
    scenario = tiny(*FLEET)
    episodes = missions(scenario)
    excerpts = [
        Excerpt(episode=it, start=1, stop=it.n_decisions) for it in (*episodes, episodes[0])
    ]
    learner = Learner(small(), [brief(scenario)], Algorithm.AQMIX, seed=0)
    together = learner.targets(of_excerpts(excerpts, scenario, 1))
    alone = torch.cat([learner.targets(of_excerpts([it], scenario, 1)) for it in excerpts])
    torch.testing.assert_close(together, alone)


def test_excerpts_lie_within_one_mission_and_reach_every_decision_alike() -> None:
    sizes = np.array([3, 10, 1])
    drawn = draw_excerpts(40_000, 4, sizes, np.random.default_rng(0))
    assert all(0 <= start < stop <= sizes[mission] for mission, start, stop in drawn)
    assert all(stop - start <= 4 for _, start, stop in drawn)
    counts = [np.zeros(size) for size in sizes]
    for mission, start, stop in drawn:
        counts[mission][start:stop] += 1
    # 4 of 23 places of excerpts hold each decision.
    shares = np.concatenate(counts) / len(drawn)
    assert shares == pytest.approx(np.full(14, 4 / 23), rel=0.05)


def test_a_replay_draws_excerpts_of_what_it_holds_now() -> None:
    scenario = tiny(*FLEET)
    replay = Replay(30, brief(scenario), small().layout)
    for number, episode in enumerate(missions(scenario)):
        replay.add(episode)
        excerpts = replay.sample_excerpts(50, 4, np.random.default_rng(number))
        again = replay.sample_excerpts(50, 4, np.random.default_rng(number))
        assert [(it.start, it.stop) for it in excerpts] == [(it.start, it.stop) for it in again]
        held = range(number + 1)[-replay.n_missions :]
        assert {it.episode.mission_seed for it in excerpts} == {*held}
    assert len(held) < len(SIZES)

"""Missions flown elsewhere are learned from as those of the rollout are, at the stated ratio."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from threading import Thread
from typing import Any

from checkpoints import read_back
from episodes import single_threaded_torch, small
import numpy as np
from processes import DEADLINE_S, wait_until
import pytest
from reports import joined, MissionSetup, reports_of
from tiny_world import tiny, uav
from uav_collect.ingest.join import JoinedMission
from uav_collect.missions.experience import Episode
from uav_collect.training.config import TrainingConfig
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout

torch = single_threaded_torch()
from uav_collect.learning.fleet_source import FleetSource
from uav_collect.learning.network import Drqn
from uav_collect.learning.trainer import Trainer
from uav_collect.training.progress import Budget

FLEET = uav(5.0, energy_budget_kj=9.0), uav(10.0, energy_budget_kj=5.0)
SETUP = MissionSetup(scenario=tiny(*FLEET), layout=Layout.PAPER, max_decisions=9)
LONG = Budget(decisions=10**9)


def agent() -> Drqn:
    return Drqn(35, 8)


def episodes(seeds: Sequence[int]) -> list[JoinedMission]:
    """Missions of the rollout as if they had been joined."""
    return [
        JoinedMission(mission_id=f'world-{it.mission_seed}', episode=it, efficiency_kbit_per_j=1.0)
        for it in SETUP.episodes(seeds)
    ]


def source_of(
    missions: Sequence[JoinedMission],
    most_waiting: int = 10**9,
    **values: Any,  # noqa: ANN401
) -> FleetSource:
    source = FleetSource(brief(SETUP.scenario), most_waiting, **values)
    for each in missions:
        source.add(each)
    return source


def settings(validation_every_updates: int) -> TrainingConfig:
    """An update for 20 decisions."""
    return small(
        'strong',
        observation='paper',
        rollout__decisions_per_update=20,
        validation__every_updates=validation_every_updates,
    )


class EnoughError(Exception):
    """So many updates were made."""


def trained(
    missions: Sequence[JoinedMission],
    n_updates: int,
    algorithm: str = 'aqmix',
    saved: Path | None = None,
) -> Trainer:
    """A training on missions, or the one that was saved, after so many updates."""

    def fly(epsilon: float) -> None:
        if trainer.n_updates == n_updates:
            raise EnoughError

    sources = [source_of(missions, fly=fly)]
    trainer = Trainer([SETUP.scenario], settings(50), algorithm, 0, sources=sources)
    if saved is not None:
        trainer.load(saved)
    with pytest.raises(EnoughError):
        deque(trainer.run(LONG), 0)
    return trainer


@pytest.mark.parametrize('algorithm', ['aqmix', 'aiql'])
def test_50_updates_on_joined_missions_give_the_weights_of_50_on_the_rollouts(
    algorithm: str,
) -> None:
    seeds = range(160)
    flown = joined(SETUP.joiner(), reports_of(SETUP, seeds))
    digests = [
        trained(missions, 50, algorithm).snapshot().digest for missions in (flown, episodes(seeds))
    ]
    assert digests[0] == digests[1]


def n_made(missions: Sequence[Episode]) -> int:
    return sum(int((it.records.action >= 0).sum()) for it in missions)


def test_it_hands_out_missions_until_there_are_as_many_decisions_as_were_asked_for() -> None:
    missions = episodes(range(40))
    source = source_of(missions)
    asked, taken = 0, []
    for n_decisions in (1, 30, 5, 5, 60):
        asked += n_decisions
        taken += source.collect(agent(), n_decisions, 0.5)
        most = max(it.episode.n_decisions for it in missions)
        assert asked <= source.n_decisions == n_made(taken) < asked + most
    assert [it.mission_seed for it in taken] == [*range(source.n_missions)]


def test_it_waits_for_missions_that_another_thread_adds() -> None:
    source, missions = FleetSource(brief(SETUP.scenario), 10**9), episodes(range(10))
    assert not source.is_awaited

    taken: list[Episode] = []

    def take() -> None:
        taken.extend(source.collect(agent(), n_made([it.episode for it in missions]), 0.5))

    taking = Thread(target=take, daemon=True)
    taking.start()
    wait_until(lambda: source.is_awaited)
    deque(map(source.add, missions), 0)
    taking.join(DEADLINE_S)
    assert len(taken) == 10
    assert not (source.is_over or source.is_awaited)


def test_it_is_over_when_no_more_come_and_what_is_there_is_too_little() -> None:
    missions = episodes(range(4))
    source = source_of(missions)
    source.close()
    assert len(source.collect(agent(), 10**6, 0.5)) == 4
    assert source.is_over
    assert source.collect(agent(), 1, 0.5) == []


def test_a_learner_that_is_too_slow_takes_what_waits_without_an_update_each() -> None:
    missions = episodes(range(40))
    source = source_of(missions, most_waiting=50)
    taken = source.collect(agent(), 10, 0.5)
    left = n_made([it.episode for it in missions]) - n_made(taken)
    assert 50 - 10 < left <= 50


def test_a_restored_source_goes_on_and_knows_what_was_learned_from() -> None:
    source, other = source_of(episodes(range(20))), FleetSource(brief(SETUP.scenario), 10**9)
    source.collect(agent(), 40, 0.5)
    other.restore(read_back(source.state()))
    assert other.known.state() == source.known.state() == {'world': [0, 20]}
    assert other.n_decisions == source.n_decisions
    first, second = (each.collect(agent(), 30, 0.5) for each in (source, other))
    assert [it.mission_seed for it in first] == [it.mission_seed for it in second]
    assert other.recent.reward == source.recent.reward


def test_a_mission_that_is_added_twice_is_handed_out_once_even_much_later(tmp_path: Path) -> None:
    [mission] = episodes([3])
    source = source_of([mission] * 2)
    source.collect(agent(), 1, 0.5)
    for number in range(10_000):
        source.known.add(f'later-{number}')
    source.add(mission)
    assert (source.n_missions, source.n_waiting) == (1, 0)


def test_recent_figures_are_those_of_the_missions_handed_out() -> None:
    source = source_of(episodes(range(5)))
    assert np.isnan(source.recent.reward)
    taken = source.collect(agent(), 30, 0.5)
    assert source.recent.reward == pytest.approx(
        np.mean([it.records.reward.sum() for it in taken])
    )
    assert source.recent.efficiency_kbit_per_j == 1.0


def test_a_training_on_a_fleet_source_is_resumed_where_it_was_saved(tmp_path: Path) -> None:
    missions = episodes(range(60))
    straight, stopped = trained(missions, 20), trained(missions, 8)
    stopped.save(tmp_path)
    resumed = trained([], 20, saved=tmp_path)
    assert resumed.n_decisions == straight.n_decisions
    assert resumed.snapshot().digest == straight.snapshot().digest


def test_a_training_ends_with_a_validation_when_missions_run_out() -> None:
    source = source_of(episodes(range(30)))
    source.close()
    trainer = Trainer([SETUP.scenario], settings(5), 'aqmix', 0, sources=[source])
    validated = [it.n_updates for it in trainer.run(LONG) if it.validation is not None]
    assert validated[-1] == trainer.n_updates == source.n_decisions // 20 - 1

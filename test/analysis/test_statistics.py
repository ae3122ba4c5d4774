"""Estimates of means: intervals that cover the truth, and differences mission by mission."""

from dataclasses import replace

import numpy as np
import pytest
from scripted_logs import fly, header, uav
from uav_collect.analysis import statistics
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.recording.mission_log import MissionLog


def mission(seed: int, hover_s: float, collected_mbit: float = 0.5) -> MissionMetrics:
    log = fly(header([uav(1)], total_bit=0.5e6), [[f'hover {hover_s} {collected_mbit}', 'home']])
    return mission_metrics(MissionLog(header=log.header, events=log.events))


def test_the_interval_of_equal_missions_is_a_point() -> None:
    for row in statistics.estimates([mission(0, 3.0)] * 7, seed=0):
        assert row.low == row.mean == row.high == row.median


def test_the_interval_of_one_mission_is_that_mission() -> None:
    efficiency, *_ = statistics.estimates([mission(0, 2.0)], seed=0)
    assert efficiency.low == efficiency.mean == efficiency.high == 0.5e3 / 400.0


def test_the_interval_is_that_of_the_normal_law_for_many_missions() -> None:
    values = np.random.default_rng(1).normal(10.0, 2.0, size=(4000, 1))
    low, high = statistics.bootstrap_interval(values, seed=0)
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert low[0] == pytest.approx(values.mean() - half, abs=0.15 * half)
    assert high[0] == pytest.approx(values.mean() + half, abs=0.15 * half)


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    samples = rng.exponential(1.0, size=(100, 200))  # 200 evaluations of 100 missions, mean 1
    bounds = [statistics.bootstrap_interval(column[:, None], 0) for column in samples.T]
    covered = np.mean([low[0] <= 1.0 <= high[0] for low, high in bounds])
    assert 0.88 <= covered <= 0.98


def test_the_interval_depends_on_the_seed_alone() -> None:
    values = np.random.default_rng(3).normal(size=(50, 2))
    once, again = (statistics.bootstrap_interval(values, seed=4) for _ in range(2))
    other = statistics.bootstrap_interval(values, seed=5)
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(once, other)


def test_the_interval_does_not_depend_on_the_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(6).normal(size=(64, 3))
    whole = statistics.bootstrap_interval(values, seed=0)
    monkeypatch.setattr(statistics, '_MAX_DRAWS', 64 * 100)
    np.testing.assert_array_equal(statistics.bootstrap_interval(values, seed=0), whole)


def test_no_mission_gives_no_estimate() -> None:
    with pytest.raises(ValueError, match='at least one mission'):
        statistics.estimates([], seed=0)


def test_a_paired_difference_is_that_of_each_mission() -> None:
    ours = [mission(seed, 2.0 + seed) for seed in range(5)]
    theirs = [mission(seed, 1.0 + seed) for seed in range(5)]
    _, completion, energy, *_ = statistics.paired_differences(ours, theirs, seed=0)
    # One second of hovering more in each mission, so no doubt about the mean, however they vary.
    assert completion.mean == completion.median == pytest.approx(1.0, rel=1e-12)
    assert completion.high - completion.low < 1e-9
    assert energy.mean == pytest.approx(ours[0].energy_j / 1e3 - theirs[0].energy_j / 1e3)


def test_missions_that_differ_are_not_compared() -> None:
    one = mission(0, 2.0)
    with pytest.raises(ValueError, match='the same missions'):
        statistics.paired_differences(
            [one], [replace(one, mission_seed=one.mission_seed + 1)], seed=0
        )

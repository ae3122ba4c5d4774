"""Aggregates over runs and tasks, beside what rliable 1.2.0 gives for the same scores."""

import numpy as np
import pytest
from uav_collect.analysis.run_scores import (
    improvement_probability,
    interquartile_mean,
    performance_profile,
    stratified_estimate,
)

ONE = np.array([[0.91, 0.40, 0.77, 0.60], [0.85, 0.52, 0.70, 0.64], [0.97, 0.31, 0.81, 0.58]])
OTHER = np.array([[0.80, 0.45, 0.66, 0.61], [0.88, 0.37, 0.79, 0.49], [0.74, 0.50, 0.62, 0.66]])
TIED = np.array([[0.91, 0.45, 0.66, 0.61], [0.88, 0.37, 0.79, 0.60], [0.74, 0.50, 0.62, 0.66]])


def test_the_interquartile_mean_is_rliables() -> None:
    assert interquartile_mean(ONE) == pytest.approx(0.6833333333333332)
    assert interquartile_mean(OTHER) == pytest.approx(0.6316666666666667)


def test_the_probability_of_improvement_is_rliables_with_ties_and_without() -> None:
    assert improvement_probability(ONE, OTHER) == pytest.approx(0.6388888888888888)
    assert improvement_probability(ONE, TIED) == pytest.approx(0.5555555555555555)


def test_the_performance_profile_is_rliables() -> None:
    thresholds = np.array([0.0, 0.4, 0.5, 0.6, 0.7, 0.8, 0.91, 1.0])
    expected = [1.0, 10 / 12, 10 / 12, 7 / 12, 5 / 12, 4 / 12, 1 / 12, 0.0]
    assert performance_profile(ONE, thresholds) == pytest.approx(expected)


def test_stratified_intervals_of_few_runs_are_rliables_widened() -> None:
    for statistic, scores, (low, high) in (
        (interquartile_mean, (ONE,), (0.65333, 0.71167)),
        (improvement_probability, (ONE, OTHER), (0.41667, 0.86111)),
    ):
        [estimate] = stratified_estimate(statistic, *scores)
        assert estimate.low < low - 0.01 < high + 0.01 < estimate.high


def test_a_stratified_interval_of_many_runs_is_that_of_their_mean() -> None:
    scores = np.random.Generator(np.random.Philox(key=3)).normal(size=(400, 1))
    [mean] = stratified_estimate(lambda it: it.mean(axis=(-2, -1)), scores)
    assert (mean.high - mean.low) / 2.0 == pytest.approx(1.96 * scores.std() / 20.0, rel=0.07)


def test_runs_of_two_algorithms_are_as_few_as_those_of_the_one_with_fewer() -> None:
    many, others = np.tile(ONE, (5, 1)), np.tile(OTHER, (5, 1))
    [few], [enough] = (
        stratified_estimate(improvement_probability, it, others) for it in (ONE, many)
    )
    assert few.high - few.low > 2.0 * (enough.high - enough.low)


def test_what_has_a_single_run_of_each_task_is_a_point() -> None:
    [mean] = stratified_estimate(interquartile_mean, ONE[:1])
    assert mean.low == mean.mean == mean.high

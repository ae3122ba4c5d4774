"""Means over trainings and missions, both drawn anew."""

import numpy as np
import pytest
from uav_collect.analysis.resampling import (
    estimate_mean,
    expanded_interval,
    resampled_deviations,
    resampled_means,
    student_quantile,
)

MISSIONS = np.linspace(0.0, 1.0, 50)


# Student, Biometrika 6, 1908, and every table since.
@pytest.mark.parametrize(
    ('n_degrees', 'value'), [(1, 12.7062), (2, 4.3027), (5, 2.5706), (10, 2.2281), (120, 1.9799)]
)
def test_students_quantiles_are_those_of_the_tables(n_degrees: int, value: float) -> None:
    assert student_quantile(0.975, n_degrees) == pytest.approx(value, abs=5e-5)


def test_one_lucky_training_widens_the_interval_that_missions_alone_would_give() -> None:
    alike = np.tile(MISSIONS, (4, 1))
    lucky = alike + np.array([0.0, 0.0, 0.0, 1.0])[:, None]
    spans = [estimate_mean(it, ('a', 'b', 'c', 'd')) for it in (alike, lucky)]
    assert spans[1].high - spans[1].low > 3.0 * (spans[0].high - spans[0].low)


def test_three_trainings_reach_as_far_as_they_differ() -> None:
    estimate = estimate_mean(np.array([[1.0], [2.0], [6.0]]), ('a', 'b', 'c'))
    assert (estimate.low, estimate.high) == (1.0, 6.0)


def test_what_shares_trainings_and_missions_is_drawn_alike() -> None:
    values = np.outer([1.0, 5.0, 3.0], MISSIONS)
    draws = [resampled_means(it, ('a', 'b', 'c')) for it in (values, values + 2.0)]
    assert draws[1] - draws[0] == pytest.approx(np.full(len(draws[0]), 2.0))


def test_other_trainings_are_drawn_for_themselves() -> None:
    values = np.array([[1.0], [2.0], [6.0]])
    one, other = (resampled_means(values, names) for names in (('a', 'b', 'c'), ('d', 'e', 'f')))
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.1


def test_deviations_are_of_trainings_that_differ_and_of_one_alone_there_is_none() -> None:
    values = np.array([1.0, 2.0, 6.0])
    drawn = resampled_deviations(values, ('a', 'b', 'c'))
    pairs = [value / np.sqrt(2.0) for value in (1.0, 4.0, 5.0)]
    expected = sorted((*pairs, float(values.std(ddof=1))))
    assert np.unique(drawn[np.isfinite(drawn)].round(9)) == pytest.approx(expected)
    assert np.isnan(drawn).mean() == pytest.approx(1 / 9, abs=0.01)


def test_deviations_are_drawn_about_that_of_all_trainings() -> None:
    values = np.array([1.0, 2.0, 6.0, 7.0, 3.0, 9.0])
    drawn = resampled_deviations(values, tuple('abcdef'))
    assert np.nanmean(drawn * drawn) == pytest.approx(values.var(ddof=1), rel=0.03)


def test_an_interval_of_many_is_that_of_their_mean() -> None:
    values = np.random.Generator(np.random.Philox(key=3)).normal(size=(1, 400))
    low, high = expanded_interval(resampled_means(values, ()), 400)
    half = 1.96 * values.std() / 20.0
    assert (high - low) / 2.0 == pytest.approx(half, rel=0.07)

"""Algorithms compared over many tasks by few runs of each: what a field of lucky seeds asks for.

A run is one training, a task one scenario; scores are (R, K), a row for each run and a column for
each task. Intervals come from runs drawn anew within each task (a stratified bootstrap), and are
widened for few runs like all that are of trainings.

Source: R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville and M. G. Bellemare, "Deep
Reinforcement Learning at the Edge of the Statistical Precipice", NeurIPS 2021, section 4.
"""

from collections.abc import Callable

import numpy as np
from uav_collect.analysis.resampling import expanded_interval, N_RESAMPLES
from uav_collect.analysis.statistics import Estimate
from uav_collect.kernels.arrays import Floats

_TRIMMED_SHARE = 0.25  # at either end
_KEY = 0  # of the draws


def interquartile_mean(scores: Floats) -> Floats:
    """The mean of the middle half of all scores.

    Args:
        scores: shape (..., R, K).

    Returns:
        Shape (...).
    """
    flat = np.sort(scores.reshape(*scores.shape[:-2], -1), axis=-1)
    n_cut = int(_TRIMMED_SHARE * flat.shape[-1])
    return np.asarray(flat[..., n_cut : flat.shape[-1] - n_cut].mean(axis=-1))


def performance_profile(scores: Floats, thresholds: Floats) -> Floats:
    """The share of runs whose score is above each threshold.

    Args:
        scores: shape (..., R, K).
        thresholds: shape (T,).

    Returns:
        Shape (..., T).
    """
    flat = scores.reshape(*scores.shape[:-2], -1, 1)
    return np.asarray((flat > thresholds).mean(axis=-2))


def improvement_probability(scores: Floats, others: Floats) -> Floats:
    """The probability that a run is better than one of another algorithm, on a task of all alike.

    Of two that are equal each counts half. Source: H. B. Mann and D. R. Whitney, 1947.

    Args:
        scores: shape (..., R, K).
        others: shape (..., Q, K).

    Returns:
        Shape (...).
    """
    one, other = scores[..., :, None, :], others[..., None, :, :]
    wins = (one > other) + 0.5 * (one == other)
    return np.asarray(wins.mean(axis=(-3, -2, -1)))


def stratified_estimate(statistic: Callable[..., Floats], *scores: Floats) -> tuple[Estimate, ...]:
    """A statistic with the interval that it has if runs are drawn anew within each task.

    It is as wide as on one task: several tell more, but how much more depends on how far the runs
    of each differ. What has a single run everywhere, as a rule has, is a point.

    Args:
        statistic: of scores with any dimensions before their last two; its last one is kept.
        scores: of one algorithm, or of several; shapes (R, K).

    Returns:
        One estimate for each number of the statistic.
    """
    rng = np.random.Generator(np.random.Philox(key=_KEY))
    value = np.atleast_1d(statistic(*scores))
    drawn = statistic(*(_redrawn(it, rng) for it in scores)).reshape(N_RESAMPLES, -1)
    several = [len(it) for it in scores if len(it) > 1]
    low, high = expanded_interval(drawn, min(several)) if several else (value, value)
    rows = np.stack((value, np.minimum(low, value), np.maximum(high, value)), axis=1)
    return tuple(
        Estimate(mean=mean, low=below, high=above, median=mean)
        for mean, below, above in rows.tolist()
    )


def _redrawn(scores: Floats, rng: np.random.Generator) -> Floats:
    """Runs drawn anew within each task, (N_RESAMPLES, R, K)."""
    n_runs, n_tasks = scores.shape
    rows = rng.integers(n_runs, size=(N_RESAMPLES, n_runs, n_tasks))
    return np.asarray(scores[rows, np.arange(n_tasks)])

"""Means of policies that were trained anew and flew the same missions, and how sure they are.

Two things are left to chance: the seed of a training, and the missions. Both are drawn anew, so
that neither one lucky training nor one lucky mission decides. All draws are keyed: what shares its
trainings shares their draws, and what shares its missions theirs, so differences stay paired.

Source: A. B. Owen, "The pigeonhole bootstrap", Annals of Applied Statistics, 2007.
"""

from collections.abc import Sequence
from functools import lru_cache
import hashlib
import math
from statistics import NormalDist

import numpy as np
from uav_collect.analysis.statistics import CONFIDENCE_LEVEL, Estimate
from uav_collect.kernels.arrays import Floats

N_RESAMPLES = 10_000  # of which those of six trainings leave 24 beyond either end of an interval
_MISSIONS_KEY = 0
_TAIL = (1.0 - CONFIDENCE_LEVEL) / 2.0


def resampled_means(values: Floats, trainings: Sequence[str]) -> Floats:
    """The mean over trainings and missions, once for each resampling, (N_RESAMPLES,).

    Args:
        values: shape (T, M), finite; a row for each training, or one where nothing was trained.
        trainings: names of the trainings, (T,), which key their draws; none if nothing was.
    """
    n_missions = values.shape[1]
    by_training = _shares(_MISSIONS_KEY, n_missions) @ values.T
    if not trainings:
        return np.asarray(by_training[:, 0])
    return np.asarray((by_training * _training_shares(trainings)).sum(axis=1))


def resampled_deviations(values: Floats, trainings: Sequence[str]) -> Floats:
    """The standard deviation over trainings, once for each resampling, (N_RESAMPLES,).

    It is that between trainings that differ: one that was drawn twice stands nowhere beside
    itself, or few trainings would seem nearer to each other than they are. nan where one alone
    was drawn.

    Args:
        values: of each training, shape (T,), finite.
        trainings: names of the trainings, (T,), which key their draws.
    """
    shares = _training_shares(trainings)
    centred = values - values.mean()
    mean, square = shares @ centred, shares @ (centred * centred)
    variance = np.maximum(square - mean * mean, 0.0)
    is_alone = shares.max(axis=1) == 1.0
    unlike = np.where(is_alone, np.nan, 1.0 - (shares * shares).sum(axis=1))
    return np.asarray(np.sqrt(variance / unlike))


def expanded_interval(draws: Floats, n_least: int) -> Floats:
    """The interval of a statistic at CONFIDENCE_LEVEL, from its value in each resampling.

    A bootstrap of a few is too narrow, that of three covers two thirds of what it should. So its
    percentiles are moved out as Student's t has it; with three they are the extremes.

    Args:
        draws: shape (N, ...), one for each resampling.
        n_least: of how many the fewest were drawn, at least 2: trainings, or missions.

    Returns:
        Lower and upper bound, shape (2, ...).

    Source: T. C. Hesterberg, "What Teachers Should Know About the Bootstrap", The American
    Statistician, 2015, section 3.2.
    """
    reach = math.sqrt(n_least / (n_least - 1)) * student_quantile(1.0 - _TAIL, n_least - 1)
    tail = NormalDist().cdf(-reach)
    return np.asarray(np.quantile(draws, [tail, 1.0 - tail], axis=0))


def estimate_mean(values: Floats, trainings: Sequence[str]) -> Estimate:
    """The mean over trainings and missions; of a single one of both the interval is a point.

    With one training the interval is that of its missions alone.

    Args:
        values: shape (T, M), finite.
        trainings: names of the trainings, (T,); none where nothing was trained.
    """
    mean = float(values.mean())
    several = [n for n in (len(trainings), values.shape[1]) if n > 1]
    low, high = (mean, mean)
    if several:
        low, high = expanded_interval(resampled_means(values, trainings), min(several)).tolist()
    # Rounding may put the mean of equal numbers beside them.
    low, high = min(low, mean), max(high, mean)
    return Estimate(mean=mean, low=low, high=high, median=float(np.median(values)))


def _training_shares(trainings: Sequence[str]) -> Floats:
    names = hashlib.sha256('\n'.join(trainings).encode()).digest()
    return _shares(int.from_bytes(names[:8], 'big'), len(trainings))


@lru_cache(maxsize=8)  # a thousand missions take 80 MB
def _shares(key: int, n: int) -> Floats:
    """How often each of n was drawn, as a share of all draws, (N_RESAMPLES, n)."""
    rng = np.random.Generator(np.random.Philox(key=key))
    rows = rng.integers(n, size=(N_RESAMPLES, n))
    rows += n * np.arange(N_RESAMPLES)[:, None]
    counts = np.bincount(rows.ravel(), minlength=N_RESAMPLES * n).reshape(N_RESAMPLES, n)
    return np.asarray(counts / n)


@lru_cache
def student_quantile(share: float, n_degrees: int) -> float:
    """The value that Student's t stays below with a probability, of 0.5 or more.

    Args:
        n_degrees: of freedom, at least 1.

    Source: Abramowitz and Stegun, Handbook of Mathematical Functions, 1964, 26.7.3 and 26.7.4.
    """
    low, high = 0.0, math.pi / 2.0  # the angle whose tangent is t / sqrt(n_degrees)
    for _ in range(80):
        middle = (low + high) / 2.0
        if 0.5 + 0.5 * _student_share(middle, n_degrees) < share:
            low = middle
        else:
            high = middle
    return math.sqrt(n_degrees) * math.tan(low)


def _student_share(angle: float, n_degrees: int) -> float:
    """The probability that the absolute value of t is below that of an angle."""
    sine, cosine = math.sin(angle), math.cos(angle)
    is_odd = n_degrees % 2
    term, total = (cosine, 0.0) if is_odd else (1.0, 0.0)
    for power in range(1 + is_odd, n_degrees, 2):  # of what comes next, less 1
        total += term
        term *= cosine * cosine * power / (power + 1)
    if is_odd:
        return 2.0 / math.pi * (angle + sine * total)
    return sine * total

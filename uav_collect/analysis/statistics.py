"""The metrics of many missions: mean, median and the interval that the mean lies in.

Every policy flies the same missions, so policies can be compared mission by mission.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from statistics import NormalDist

import numpy as np
from uav_collect.analysis.metrics import MissionMetrics
from uav_collect.kernels.arrays import Floats

CONFIDENCE_LEVEL = 0.95
N_RESAMPLES = 2000
_Z = NormalDist().inv_cdf((1.0 + CONFIDENCE_LEVEL) / 2.0)
_MAX_DRAWS = 4_000_000  # at once; bounds the memory


@dataclass(frozen=True, kw_only=True)
class Measure:
    """One number of a mission that is averaged over missions."""

    key: str  # in files; the unit is its last word
    title: str  # for people
    unit: str
    of: Callable[[MissionMetrics], float]


MEASURES = tuple(
    Measure(key=key, title=title, unit=unit, of=of)
    for key, title, unit, of in (
        ('efficiency_kbit_per_j', 'energy efficiency', 'kbit/J',
         lambda it: it.efficiency_kbit_per_j),
        ('completion_s', 'completion time', 's', lambda it: it.completion_s),
        ('energy_kj', 'energy', 'kJ', lambda it: it.energy_kj),
        ('collected_share', 'data collected', 'share', lambda it: it.collected_share),
        ('complete_share', 'complete missions', 'share', lambda it: float(it.is_complete)),
        ('safe_share', 'safe returns', 'share', lambda it: float(it.is_safe)),
    )
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """The mean of a measure, estimated from missions."""

    mean: float
    low: float  # bounds of the bootstrap interval at CONFIDENCE_LEVEL
    high: float
    median: float  # of the missions, not of the resampled means

    def to_json(self) -> dict[str, float]:
        """Mean and interval, as files hold them."""
        return {'mean': self.mean, 'low': self.low, 'high': self.high}


def mission_seeds(first_seed: int, n_missions: int) -> range:
    """The seeds of an evaluation's missions: the first, and those right after it."""
    return range(first_seed, first_seed + n_missions)


def estimates(missions: Sequence[MissionMetrics], seed: int) -> tuple[Estimate, ...]:
    """Estimate each of MEASURES over missions.

    Args:
        missions: at least one, all finished.
        seed: keys the bootstrap; the same missions and seed give the same interval.

    Raises:
        ValueError: there is no mission.
    """
    return column_estimates(_values(missions), seed)


def paired_differences(
    missions: Sequence[MissionMetrics], others: Sequence[MissionMetrics], seed: int
) -> tuple[Estimate, ...]:
    """Estimate by how much each of MEASURES differs, mission by mission: the first less the other.

    Args:
        missions: of one policy, at least one, all finished.
        others: the same missions, flown by another policy.
        seed: keys the bootstrap.

    Raises:
        ValueError: the missions are not the same, or there is none.
    """
    if [mission.mission_seed for mission in missions] != [other.mission_seed for other in others]:
        raise ValueError('a paired difference needs the same missions in the same order')
    return column_estimates(_values(missions) - _values(others), seed)


def _values(missions: Sequence[MissionMetrics]) -> Floats:
    """MEASURES by mission, (N, M)."""
    if not missions:
        raise ValueError('an estimate needs at least one mission')
    return np.array([[measure.of(mission) for measure in MEASURES] for mission in missions])


def column_estimates(values: Floats, seed: int) -> tuple[Estimate, ...]:
    """Estimate the mean of each column of values, one row per mission, shape (N, M).

    Args:
        seed: keys the bootstrap; rows are drawn together, so columns stay paired.
    """
    low, high = bootstrap_interval(values, seed)
    columns = (_within(values, values.mean(axis=0)), low, high, np.median(values, axis=0))
    return tuple(
        Estimate(mean=row[0], low=row[1], high=row[2], median=row[3])
        for row in np.column_stack(columns).tolist()
    )


def bootstrap_interval(values: Floats, seed: int) -> tuple[Floats, Floats]:
    """Percentile bootstrap interval of the means of columns, at CONFIDENCE_LEVEL.

    Args:
        values: one row per mission, shape (N, M).
        seed: keys the resampling; rows are drawn together, so columns stay paired.

    Returns:
        Lower and upper bounds, each of shape (M,).

    Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, section 13.3.
    """
    rng = np.random.Generator(np.random.Philox(key=seed))
    n_missions = len(values)
    n_at_once = max(1, _MAX_DRAWS // n_missions)
    means = []
    for done in range(0, N_RESAMPLES, n_at_once):
        shape = (min(n_at_once, N_RESAMPLES - done), n_missions)
        rows = rng.integers(n_missions, size=shape)
        means.append(np.stack([column[rows].mean(axis=1) for column in values.T], axis=1))
    tail = (1.0 - CONFIDENCE_LEVEL) / 2.0
    low, high = np.quantile(np.concatenate(means), [tail, 1.0 - tail], axis=0)
    return _within(values, low), _within(values, high)


def share_interval(n_hits: int, n_missions: int) -> tuple[float, float]:
    """Interval of a share at CONFIDENCE_LEVEL, from how many missions of how many had something.

    Source: E. B. Wilson, "Probable Inference, the Law of Succession, and Statistical Inference",
    1927.
    """
    share, z_square = n_hits / n_missions, _Z * _Z / n_missions
    middle = (share + z_square / 2.0) / (1.0 + z_square)
    half = math.sqrt(z_square * (share * (1.0 - share) + z_square / 4.0)) / (1.0 + z_square)
    return max(0.0, middle - half), min(1.0, middle + half)


def n_missions_to_show(wanted_share: float) -> int | None:
    """Fewest missions whose `share_interval` lies above a share if all have it; None: no number.

    Without a miss the lower bound of the interval is n / (n + z^2).
    """
    if wanted_share >= 1.0:
        return None
    return math.ceil(_Z * _Z * wanted_share / (1.0 - wanted_share))


def _within(values: Floats, mean: Floats) -> Floats:
    # Rounding may put the mean of equal numbers beside them.
    return np.clip(mean, values.min(axis=0), values.max(axis=0))

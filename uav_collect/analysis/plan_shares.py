"""Clairvoyant plans and bounds of many missions: their means, and how near policies come."""

from collections.abc import Callable, Mapping, Sequence
import math

import numpy as np
from uav_collect.analysis.metrics import MissionMetrics
from uav_collect.analysis.statistics import column_estimates, Estimate
from uav_collect.planning.bound import Bound, Plan

_PLAN_NUMBERS: Mapping[str, Callable[[Bound, Plan], float]] = {
    'completion_s': lambda bound, plan: plan.completion_s,
    'energy_kj': lambda bound, plan: plan.total_energy_j / 1e3,
    'efficiency_kbit_per_j': Bound.efficiency_kbit_per_j,
}
SHARE_KEYS = ('time_share', 'efficiency_share', 'efficiency_share_of_shortest')


def bound_metrics(bound: Bound) -> dict[str, float]:
    """Of plans and bounds by key, the last word of which is the unit; nan without a plan."""
    numbers = {}
    for name, plan in (('shortest', bound.shortest), ('thriftiest', bound.thriftiest)):
        for key, number in _PLAN_NUMBERS.items():
            numbers[f'{name}_{key}'] = math.nan if plan is None else number(bound, plan)
    least_j = bound.least_energy_j
    numbers['limit_completion_s'] = bound.least_completion_s
    numbers['limit_energy_kj'] = least_j / 1e3
    numbers['limit_efficiency_kbit_per_j'] = (
        bound.total_bit / least_j / 1e3 if least_j > 0 else 0.0
    )
    return numbers


def time_share(mission: MissionMetrics, bound: Bound) -> float:
    """The shortest plan's time over a mission's; nan where there is no plan or data were left."""
    if bound.shortest is None or not (mission.is_complete and mission.is_finished):
        return math.nan
    plan_s = bound.shortest.completion_s
    return plan_s / mission.completion_s if mission.completion_s > 0.0 else 1.0


def efficiency_share(mission: MissionMetrics, bound: Bound) -> float:
    """A mission's energy efficiency over the thriftiest plan's; nan as for `time_share`."""
    if bound.thriftiest is None or not (mission.is_complete and mission.is_finished):
        return math.nan
    plan_j = bound.thriftiest.total_energy_j
    return plan_j / mission.energy_j if mission.energy_j > 0.0 else 1.0


def plan_shares(mission: MissionMetrics, bound: Bound) -> dict[str, float]:
    """How near a mission comes to its plans, by key; nan where it left data, or without a plan."""
    efficiency = efficiency_share(mission, bound)
    of_shortest = efficiency
    if bound.shortest is not None and bound.thriftiest is not None and efficiency > 0.0:
        of_shortest = bound.shortest.total_energy_j / mission.energy_j
    reached = (time_share(mission, bound), efficiency, of_shortest)
    return dict(zip(SHARE_KEYS, reached, strict=True))


def mean_estimates(
    rows: Sequence[Mapping[str, float]], seed: int
) -> tuple[int, dict[str, Estimate]]:
    """Estimate the means over the missions in which all numbers are known.

    Args:
        rows: numbers by key, one row per mission.
        seed: keys the bootstrap.

    Returns:
        How many missions count, and the estimates by key; none where no mission counts.
    """
    known = [row for row in rows if not any(map(math.isnan, row.values()))]
    if not known:
        return 0, {}
    values = np.array([[*row.values()] for row in known])
    return len(known), dict(zip(known[0], column_estimates(values, seed), strict=True))

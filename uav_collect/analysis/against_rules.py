"""How policies stand to the rules that anybody may fly by, mission by mission."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from uav_collect.analysis.statistics import column_estimates, Estimate
from uav_collect.kernels.arrays import Bools, Floats
from uav_collect.missions.batch_metrics import BatchMetrics
from uav_collect.uav.policy_header import policy_rank

SWEEP, HERT = RULES = ('sweep', 'hert')
TOO_LONG = 2.0  # times the sweep's completion time in the same mission


@dataclass(frozen=True, kw_only=True, eq=False)
class Flown:
    """What one policy achieved in missions."""

    metrics: BatchMetrics

    @cached_property
    def efficiency_kbit_per_j(self) -> Floats:
        """Energy efficiency, 0 where no energy was used, (N,)."""
        energy_j = self.metrics.energy_j.sum(axis=1)
        used_j = np.where(energy_j > 0.0, energy_j, 1.0)
        efficiency: Floats = self.metrics.collected_bit / used_j / 1e3
        return efficiency

    @property
    def mean_kbit_per_j(self) -> float:
        """Mean energy efficiency."""
        return float(self.efficiency_kbit_per_j.mean())

    @property
    def n_complete(self) -> int:
        """Missions in which all data were collected."""
        return int(self.metrics.is_complete.sum())

    @property
    def rank(self) -> tuple[float, float]:
        """How good the policy is: of two, the one of greater rank is better."""
        return policy_rank(self.n_complete / self.metrics.n_missions, 1.0, self.mean_kbit_per_j)

    @property
    def n_incomplete(self) -> int:
        """Missions in which data were left behind."""
        return self.metrics.n_missions - self.n_complete


@dataclass(frozen=True, kw_only=True)
class Standing:
    """How a policy stands to the rules."""

    difference: Estimate  # to the better rule's energy efficiency, mission by mission [kbit/J]
    gain_share: float  # the mean difference over that rule's mean
    n_missed: int  # missions that it left data in, and one of the rules did not
    n_too_long: int  # missions that took it over TOO_LONG times as long as the sweep

    @property
    def is_below(self) -> bool:
        """Whether the better rule is better by more than the interval."""
        return self.difference.high < 0.0


def better_rule(flown: Mapping[str, Flown]) -> str:
    """The rule that policies are held against.

    It is the one that collects everything in more missions, and where that is the same, the one of
    the better mean energy efficiency: who leaves data behind flies less.

    Args:
        flown: by name, RULES among them, all in the same missions.
    """
    return max(RULES, key=lambda name: (flown[name].n_complete, flown[name].mean_kbit_per_j))


def standing_of(own: Flown, rules: Mapping[str, Flown], seed: int) -> Standing:
    """Hold what a policy achieved against the rules, in the same missions.

    Args:
        rules: by name, RULES at least.
        seed: keys the bootstrap.

    Raises:
        ValueError: they did not fly as many missions.
    """
    if {flown.metrics.n_missions for flown in rules.values()} != {own.metrics.n_missions}:
        raise ValueError('a policy is held against rules in the same missions alone')
    better = rules[better_rule(rules)]
    difference = own.efficiency_kbit_per_j - better.efficiency_kbit_per_j
    by_a_rule: Bools = np.any([rules[rule].metrics.is_complete for rule in RULES], axis=0)
    too_long_s = TOO_LONG * rules[SWEEP].metrics.completion_s
    mean = better.mean_kbit_per_j
    return Standing(
        difference=column_estimates(difference[:, None], seed)[0],
        gain_share=float(difference.mean()) / mean if mean > 0.0 else 0.0,
        n_missed=int((by_a_rule & ~own.metrics.is_complete).sum()),
        n_too_long=int((own.metrics.completion_s > too_long_s).sum()),
    )

"""What a site's sweep achieves, and what follows from it for who learns there."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.missions.rollout import fly
from uav_collect.scenario.site import Site
from uav_collect.training.config import TrainingConfig
from uav_collect.training.seeds import first_seed_of_part
from uav_collect.uav.briefing import briefing_of
from uav_collect.world.reward import RewardUnits

_N_SWEPT = 16  # missions by which a site's sweep is judged
_LEAST_SHARE = 0.1  # of the data, that a sweep is taken to collect


class Swept(NamedTuple):
    """The means of the sweep's missions on a site."""

    kbit_per_j: float
    j_per_cell: float  # of all UAVs together, for each cell that became complete
    n_decisions: float


def swept(site: Site, seed: int = 0, part: int = 0) -> Swept:
    """Fly missions by the sweep, bandwidth shared equally.

    Args:
        seed: of a run; `part`: of its mission seeds.
    """
    logs = fly(site, seeds_of_swept(seed, part), 'sweep', 'equal')
    flown = [mission_metrics(log) for log in logs]
    share = max(float(np.mean([it.collected_share for it in flown])), _LEAST_SHARE)
    n_open = sum(briefing_of(site).is_open)
    return Swept(
        kbit_per_j=float(np.mean([it.efficiency_kbit_per_j for it in flown])),
        j_per_cell=float(np.mean([it.energy_j for it in flown])) / (n_open * share),
        n_decisions=float(np.mean([len(log.events) for log in logs])),
    )


def seeds_of_swept(seed: int, part: int) -> Sequence[int]:
    """The missions by which a part of a run judges the sweep."""
    first = first_seed_of_part(seed, part)
    return range(first, first + _N_SWEPT)


def reward_units(config: TrainingConfig, site: Site) -> RewardUnits:
    """What a second and a joule are worth on a site.

    By the unit `sweep` a mission of the sweep is worth about nothing on any field and for any
    fleet: values are small, and all courses count alike in the loss.
    """
    units = config.reward_units(briefing_of(site))
    if config.reward.unit != 'sweep':
        return units
    return units._replace(energy_j=swept(site).j_per_cell)


def branch_share(config: TrainingConfig, site: Site) -> float:
    """At which share of a site's decisions the algorithm `branches` tries each action.

    A branch flies the rest of a mission: where missions are long there are fewer of them.
    """
    if config.branches is None:
        return 0.0
    return min(1.0, config.branches.decisions_per_mission / max(swept(site).n_decisions, 1.0))

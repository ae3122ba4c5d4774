"""Who teaches on a site: whoever of the teachers at hand flies it best."""

from dataclasses import replace
from functools import partial
import math
from typing import NamedTuple

from uav_collect.errors import PolicyMismatchError
from uav_collect.learning.minibatch import Algorithm
from uav_collect.learning.units import seeds_of_swept, swept
from uav_collect.limits import MAX_CELLS_PER_SIDE
from uav_collect.missions.rollout import fly_for_metrics
from uav_collect.scenario.site import build_site, Site
from uav_collect.training.config import TrainingConfig
from uav_collect.training.teachers import teachers_of
from uav_collect.uav.briefing import briefing_of
from uav_collect.uav.lookahead import decision_us, LookaheadPolicy
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import NamedPolicy
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy


class Teaching(NamedTuple):
    """The best teacher of a site."""

    policy: NamedPolicy | None  # None: the sweep
    kbit_per_j: float  # its efficiency, bandwidth shared equally


def teaching(
    site: Site, config: TrainingConfig, algorithm: Algorithm, seed: int = 0, part: int = 0
) -> Teaching:
    """Let all teachers that fit a site fly its missions; the sweep teaches unless one is better.

    Better is who surpasses it by more than the standard error of these missions, with all UAVs in
    the air: once one is lost nobody but the adviser teaches.

    Args:
        algorithm: where it is not `imitation` nobody but the sweep is asked.
        seed: of a run; `part`: of its mission seeds.

    Raises:
        PolicyMismatchError: a teacher is unknown or broken, or takes a user's observation.
    """
    if algorithm is not Algorithm.IMITATION or config.imitation is None:
        return Teaching(None, swept(site, seed, part).kbit_per_j)
    if site.scenario.faults:
        site = build_site(replace(site.scenario, faults=None))
    seeds = seeds_of_swept(seed, part)
    by_sweep = fly_for_metrics(site, seeds, 'sweep', 'equal').efficiency_kbit_per_j
    best = Teaching(None, float(by_sweep.mean()))
    for _, teacher in teachers_of(config, algorithm.value):
        policy = _for_any_field(teacher)
        if not _is_fitting(policy, site, config.imitation.most_decision_ms):
            continue
        makes = partial(replace, policy)
        flown = fly_for_metrics(site, seeds, makes, 'equal').efficiency_kbit_per_j
        gains = flown - by_sweep
        least = float(gains.std(ddof=1)) / math.sqrt(len(gains))
        if gains.mean() > least and flown.mean() > best.kbit_per_j:
            best = Teaching(policy, float(flown.mean()))
    return best


def _for_any_field(policy: NamedPolicy) -> NamedPolicy:
    """A teacher that may be tried wherever it sees as much: over any area, by any fleet."""
    if not isinstance(policy, LearnedPolicy) or policy.frozen.header.layout.base == Layout.PAPER:
        return policy
    header = replace(
        policy.frozen.header,
        cells_per_side_min=1,
        cells_per_side_max=MAX_CELLS_PER_SIDE,
        n_uavs_min=1,
        n_uavs_max=policy.frozen.header.layout.max_uavs,
    )
    return LearnedPolicy(policy.name, FrozenPolicy(header, policy.frozen.weights))


def _is_fitting(policy: NamedPolicy, site: Site, most_decision_ms: float) -> bool:
    """Whether a teacher can fly a site's fleet over its area, and is not too slow there."""
    if isinstance(policy, LookaheadPolicy):
        decision_ms = decision_us(policy, site.scenario.n_cells, is_compiled=True) / 1e3
        return decision_ms <= most_decision_ms
    if not isinstance(policy, LearnedPolicy):
        return True
    if not isinstance(policy.frozen.header.layout, Layout):
        raise PolicyMismatchError(
            f"teacher {policy.name}: must be one that sees nothing of a user's own"
        )
    return policy.frozen.header.misfit(briefing_of(site)) is None

"""The team's reward between two events: the paper's, eqs (reward_plain), (imm_reward), or energy.

The energy reward is what the mission is about: one for each cell that becomes complete on the
union of all UAVs' maps, less the energy spent, in kilojoules or in another unit.
"""

from enum import IntEnum
import math
from typing import NamedTuple

from uav_collect.kernels.arrays import new_row, Row, row_of
from uav_collect.kernels.compile import kernel
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOVER, NONE
from uav_collect.uav.actions import cell_under
from uav_collect.uav.briefing import Briefing
from uav_collect.world.dynamics import end_s, Mission, next_uav

KILOJOULE_J = 1000.0
_USUAL_CROSSING_S = 7.5  # of a cell of 50 m at 5 and 10 m/s, on average


class Reward(IntEnum):
    """What a learner may maximise."""

    PAPER = 0
    ENERGY = 1


class RewardUnits(NamedTuple):
    """What energy and time are worth to a learner in one scenario."""

    discount_per_s: float
    energy_j: float  # that takes one from the energy reward


def crossing_units(discount_per_s: float, briefing: Briefing) -> RewardUnits:
    """Units by which fields of any size and fleets of any speed are alike to a learner.

    Energy counts in crossings of a cell, the mean over the UAVs; and a crossing is discounted as
    one of the usual 7.5 s.
    """
    crossing_s = [briefing.cell_size_m / speed_mps for speed_mps in briefing.speed_mps]
    pairs = zip(crossing_s, briefing.flight_power_w, strict=True)
    energy_j = math.fsum(each_s * power_w for each_s, power_w in pairs) / len(crossing_s)
    mean_s = math.fsum(crossing_s) / len(crossing_s)
    return RewardUnits(
        discount_per_s=discount_per_s ** (_USUAL_CROSSING_S / mean_s), energy_j=energy_j
    )


class RewardTerms(NamedTuple):
    """What rewards are computed from, beside the mission."""

    discount_per_s: float
    per_j: float  # what a joule takes from the energy reward
    move_penalty_per_s: float
    scale_bit: float  # that is worth one
    bonus_j: float  # alpha of the terminal reward: the largest energy budget
    first_sensor: Row[int]  # by cell, and one past the last


def reward_terms(site: Site, energy_unit_j: float = KILOJOULE_J) -> RewardTerms:
    """The terms of a site's scenario.

    Args:
        energy_unit_j: energy that takes one from the energy reward [J].
    """
    scenario = site.scenario
    return RewardTerms(
        discount_per_s=scenario.reward.discount_per_s,
        per_j=1.0 / energy_unit_j,
        move_penalty_per_s=scenario.reward.move_penalty_per_s,
        scale_bit=scenario.reward.scale_mbit * 1e6,
        bonus_j=max(uav.energy_budget_j for uav in scenario.uavs),
        first_sensor=row_of(site.first_sensor.tolist()),
    )


class Earnings(NamedTuple):
    """What missions earned since the decision before, discounted to it; kernels write it."""

    since_s: Row[float]  # (W,) time of that decision
    until_s: Row[float]  # (W,) time up to which rewards are counted
    reward: Row[float]  # (W,)


def new_earnings(n_worlds: int) -> Earnings:
    """Earnings of missions at their start."""
    return Earnings(
        since_s=new_row(n_worlds, 0.0),
        until_s=new_row(n_worlds, 0.0),
        reward=new_row(n_worlds, 0.0),
    )


@kernel
def start_earning(earnings: Earnings, world: int, time_s: float) -> None:
    """Count from a decision on."""
    earnings.since_s[world] = time_s
    earnings.until_s[world] = time_s
    earnings.reward[world] = 0.0


@kernel
def earn_interval(
    earnings: Earnings, world: int, terms: RewardTerms, reward: float, stop_s: float
) -> None:
    """Add the reward of an interval, discounted to its start, and go on to its end."""
    earn(earnings, world, terms, reward)
    earnings.until_s[world] = stop_s


@kernel
def earn(earnings: Earnings, world: int, terms: RewardTerms, reward: float) -> None:
    """Add a reward of the moment up to which rewards are counted."""
    waited_s = earnings.until_s[world] - earnings.since_s[world]
    earnings.reward[world] += discount(terms, waited_s) * reward


@kernel
def energy_reward(
    briefing: Briefing, terms: RewardTerms, mission: Mission, start_s: float, stop_s: float
) -> float:
    """Minus the energy that all UAVs spend over an interval, discounted to its start.

    A UAV that waits after its action, as all do in synchronous missions, hovers.
    """
    spent = 0.0
    for uav in range(briefing.n_uavs):
        acted_s = mission.leg_start_s[uav] + mission.duration_s[uav]
        hover_w = briefing.hover_power_w[uav]
        acting_w = hover_w if mission.action[uav] == HOVER else briefing.flight_power_w[uav]
        acting_s = min(stop_s, acted_s) - start_s
        if acting_s > 0.0:
            spent += acting_w * terms.per_j * _discounted_s(terms, acting_s)
        waits_from_s = max(start_s, acted_s)
        waiting_s = min(stop_s, mission.leg_end_s[uav]) - waits_from_s
        if waiting_s > 0.0:
            spent += (
                hover_w
                * terms.per_j
                * discount(terms, waits_from_s - start_s)
                * _discounted_s(terms, waiting_s)
            )
    return -spent


@kernel
def news_reward(known: Row[int], complete: Row[int]) -> float:
    """One for each cell that a deciding UAV is the first to know complete.

    Args:
        known: its map, (C,).
        complete: the union of all UAVs' maps before, (C,); what is new is added.
    """
    n_new = 0
    for cell in range(len(known)):
        if known[cell] == 1 and complete[cell] == 0:
            complete[cell] = 1
            n_new += 1
    return 1.0 * n_new


@kernel
def paper_reward(
    briefing: Briefing, terms: RewardTerms, mission: Mission, start_s: float, stop_s: float
) -> float:
    """The scenario's own reward of an interval, the bonus at the mission's end included."""
    reward = interval_reward(briefing, terms, mission, start_s, stop_s)
    return reward + terminal_reward(briefing, terms, mission, start_s)


@kernel
def interval_reward(
    briefing: Briefing, terms: RewardTerms, mission: Mission, start_s: float, stop_s: float
) -> float:
    """Reward of all UAVs' running actions over an interval, discounted to its start.

    While a UAV hovers it counts each sensor's rate until that sensor's data is up, so that an
    undiscounted hover is worth its data; while it flies, the way home included, a small penalty.
    """
    reward = 0.0
    for uav in range(briefing.n_uavs):
        stop_leg_s = min(stop_s, mission.leg_end_s[uav])
        if mission.action[uav] == NONE or stop_leg_s <= start_s:
            continue
        if mission.action[uav] == HOVER:
            reward += _upload_reward(briefing, terms, mission, uav, start_s, stop_s)
        else:
            flown_s = _discounted_s(terms, stop_leg_s - start_s)
            reward -= terms.move_penalty_per_s * flown_s
    return reward


@kernel
def terminal_reward(
    briefing: Briefing, terms: RewardTerms, mission: Mission, start_s: float
) -> float:
    """The bonus at the mission's end, discounted to the start of its last interval.

    alpha Gamma: the mission's data over its energy, times the largest energy budget; 0 before the
    last UAV flies home.
    """
    if next_uav(mission) >= 0:
        return 0.0
    energy_j = 0.0
    for uav in range(briefing.n_uavs):
        energy_j += briefing.energy_budget_j[uav] - mission.energy_left_j[uav]
    if energy_j <= 0.0:
        return 0.0
    collected = mission.collected_bit[0] / terms.scale_bit
    return discount(terms, end_s(mission) - start_s) * terms.bonus_j * collected / energy_j


@kernel
def discount(terms: RewardTerms, duration_s: float) -> float:
    """What a reward is worth that comes so much later."""
    return math.exp(math.log(terms.discount_per_s) * duration_s)


@kernel
def _upload_reward(
    briefing: Briefing,
    terms: RewardTerms,
    mission: Mission,
    uav: int,
    start_s: float,
    stop_s: float,
) -> float:
    cell = cell_under(briefing, mission.leg_end_x_m[uav], mission.leg_end_y_m[uav])
    reward = 0.0
    for sensor in range(terms.first_sensor[cell], terms.first_sensor[cell + 1]):
        up_s = mission.leg_start_s[uav] + mission.upload_s[sensor]
        sent_s = min(stop_s, up_s) - start_s
        if mission.rate_bps[sensor] > 0.0 and sent_s > 0.0:
            rate = mission.rate_bps[sensor] / terms.scale_bit
            reward += rate * _discounted_s(terms, sent_s)
    return reward


@kernel
def _discounted_s(terms: RewardTerms, duration_s: float) -> float:
    """The integral of gamma^t over a duration, eq. (reward_plain)."""
    if terms.discount_per_s >= 1.0:
        return duration_s
    log_discount = math.log(terms.discount_per_s)
    return math.expm1(log_discount * duration_s) / log_discount

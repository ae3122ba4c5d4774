"""Rewards that users write: what each decision of a mission was worth, once that mission is known.

`reward.goal: module:name` names a function of `Outcomes`. It is called when a mission is over
or cut off, on what a learner keeps of it, so it is the same whether the mission was flown in this
process or told by a fleet.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Floats, Ints, Row
from uav_collect.missions.experience import Episode, N_UAV_SCALARS
from uav_collect.uav.action_codes import HOVER
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.named_code import named_code
from uav_collect.uav.user_code import numbers_of, UserCodeError, value_text
from uav_collect.uav.user_policy import arrayed

_ENERGY = 2  # place among a UAV's scalars of the global state


@dataclass(frozen=True, kw_only=True)
class Outcomes:
    """The N decisions of a mission in order, and what came of each until the next one."""

    briefing: Briefing
    uav: Ints  # (N,) index of the UAV that decided
    action: Ints  # (N,)
    time_s: Floats  # (N,)
    duration_s: Floats  # (N,) until the next decision of any UAV, or until all have landed
    energy_j: Floats  # (N,) that the actions take which began meanwhile, ways home included
    collected_bit: Floats  # (N,) that hovers claimed which began meanwhile
    n_new_cells: Ints  # (N,) that some UAV was then the first to know complete
    energy_reward: Floats  # (N,) what the goal `energy` would give
    is_whole: bool  # False: cut off at the last decision, whose outcome does not count


OwnReward = Callable[[Outcomes], Floats]  # of each decision, (N,)


@cache
def own_reward(name: str) -> OwnReward:
    """The reward of a user's function, `module:name`, checked each time that it is asked.

    Raises:
        UserCodeError: there is none.
    """
    code = named_code(name)

    def reward(mission: Outcomes) -> Floats:
        try:
            answer = code.call(code.target, mission)
        except UserCodeError as error:
            raise ConfigError(f'reward {name}: {error}') from error
        rewards, wanted = numbers_of(answer), mission.time_s.shape
        if rewards is None or rewards.shape != wanted or not np.isfinite(rewards).all():
            what = f'must be {len(mission.time_s)} finite numbers, one for each decision'
            raise ConfigError(f'reward {name}: gives {value_text(answer)}: {what}')
        return rewards

    return reward


def rewarded(
    reward: OwnReward,
    episode: Episode,
    briefing: Briefing,
    energy_left_j: Row[float],
    n_complete: int,
) -> Episode:
    """A mission by another reward than it was recorded with.

    Args:
        episode: its rewards are those of the goal `energy`.
        energy_left_j: of each UAV in the end, (U,).
        n_complete: cells that some UAV knows complete in the end.

    Raises:
        ConfigError: the user's function fails, or does not give a number for each decision.
    """
    records = episode.records
    rewards = reward(_flown(episode, arrayed(briefing), energy_left_j, n_complete))
    if not episode.is_whole:
        rewards[-1] = 0.0
    return replace(episode, records=records._replace(reward=rewards))


def _flown(
    episode: Episode, briefing: Briefing, energy_left_j: Row[float], n_complete: int
) -> Outcomes:
    records, n_uavs = episode.records, briefing.n_uavs
    budget_j = np.asarray(briefing.energy_budget_j)
    left_j = records.fleet[:, _ENERGY::N_UAV_SCALARS].astype(np.float64) * budget_j
    in_the_end = np.array([*energy_left_j])
    spent_j = -np.diff(np.vstack([left_j, in_the_end]), axis=0).sum(axis=1)
    known = records.complete.reshape(episode.n_decisions, n_uavs, -1)
    union = np.unpackbits(np.bitwise_or.reduce(known, axis=1), axis=1).sum(axis=1)
    is_hover = records.action == HOVER  # which takes all that its cell held from the start
    return Outcomes(
        briefing=briefing,
        uav=records.uav.astype(np.int64),
        action=records.action.astype(np.int64),
        time_s=records.time_s.copy(),
        duration_s=records.duration_s.copy(),
        energy_j=spent_j,
        collected_bit=np.where(is_hover, episode.demand_bit[records.cell], 0.0),
        n_new_cells=np.diff(union.astype(np.int64), append=n_complete),
        energy_reward=records.reward.copy(),
        is_whole=episode.is_whole,
    )

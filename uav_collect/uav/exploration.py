"""Exploration: random actions now and then, keyed, so that a mission can be flown again.

Whether and where a UAV explores follows from the mission's seed, the UAV and the running number of
its decision, whoever flies it.
"""

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.keyed_random import draw_words, EXPLORATION
from uav_collect.uav.action_codes import HOVER, N_ACTIONS, NONE

_WORDS = 4294967296.0


@kernel
def explore(
    mission_seed: int,
    uav: int,
    decision: int,
    epsilon: float,
    hover_share: float,
    advice_share: float,
    advice: int,
    legal: Row[int],
) -> int:
    """The random action of a decision, or NONE where the UAV does not explore.

    Args:
        epsilon: probability to explore.
        hover_share: probability that a UAV which explores hovers where it can; otherwise, and
            where it is negative always, all legal actions are alike.
        advice_share: probability that a UAV which explores takes the advice instead.
        advice: a legal action; NONE: there is none.
        legal: at least one, shape (N_ACTIONS,).
    """
    whether, hover, which, advised = draw_words(mission_seed, EXPLORATION, uav, decision, 0)
    if whether >= epsilon * _WORDS:
        return NONE
    if advice != NONE and advised < advice_share * _WORDS:
        return advice
    if legal[HOVER] == 1 and hover < hover_share * _WORDS:
        return HOVER
    n_legal = 0
    for action in range(N_ACTIONS):
        n_legal += legal[action]
    left = int(which / _WORDS * n_legal)
    for action in range(N_ACTIONS):
        if legal[action] == 1:
            if left == 0:
                return action
            left -= 1
    return NONE

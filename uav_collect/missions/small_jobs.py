"""Small jobs fly interpreted as long as nobody has compiled the kernels: that takes minutes.

This is settled before anything imports kernels: here none is imported.
"""

from collections.abc import Iterable

from uav_collect.kernels.compile import interpret_unless_cached, kernels_were_left_plain
from uav_collect.kernels.patience import say
from uav_collect.limits import is_lookahead_name

FLIGHTS_OF_A_PLAN = 20  # that take as long as interpreted kernels plan for a mission
# Missions times cells. Interpreted kernels take .13 ms for each by a rule and .3 ms by a network:
# less than it takes to compile them.
_MOST_MISSION_CELLS = 100_000
_KERNEL = 'batch_kernels.fly_batch'  # which flies missions
_NOW = '(UAV_COLLECT_KERNELS=compiled: now)'


def choose_kernels(n_missions: int, n_cells: int, policies: Iterable[str] = ()) -> None:
    """Let this process fly so many missions in the quicker way; before anything imports kernels.

    Args:
        n_missions: of all policies and fleets together.
        n_cells: of the area.
        policies: that fly; no job is small by one that looks ahead.
    """
    is_small = n_missions * n_cells <= _MOST_MISSION_CELLS
    if not is_small or any(map(is_lookahead_name, policies)):
        if kernels_were_left_plain():
            what = 'flying with interpreted kernels, as this process began with a small job'
            say(f'{what}: one that begins with a larger one compiles them {_NOW}')
        return
    if interpret_unless_cached(_KERNEL):
        what = 'flying with interpreted kernels, as none are compiled yet'
        say(f'{what}: the first larger job compiles them {_NOW}')

"""Small jobs fly interpreted as long as nobody has compiled the kernels: that takes a minute."""

from collections.abc import Iterable

from uav_collect.commands import terminal
from uav_collect.kernels.compile import interpret_unless_cached
from uav_collect.limits import is_lookahead_name

# Missions times cells. Interpreted kernels take .13 ms for each by a rule and .3 ms by a network:
# at most half as long as to compile them, which takes a minute.
_MOST_MISSION_CELLS = 100_000
_KERNEL = 'batch_kernels.fly_batch'  # which flies missions


def choose_kernels(n_missions: int, n_cells: int, policies: Iterable[str] = ()) -> None:
    """Let this process fly so many missions in the quicker way; before anything imports kernels.

    Args:
        n_missions: of all policies and fleets together.
        n_cells: of the area.
        policies: that fly; no job is small by one that looks ahead.
    """
    if any(map(is_lookahead_name, policies)):
        return
    if n_missions * n_cells > _MOST_MISSION_CELLS or not interpret_unless_cached(_KERNEL):
        return
    what = 'flying with interpreted kernels, as none are compiled yet'
    terminal.say(f'{what}: the first larger job compiles them (UAV_COLLECT_KERNELS=compiled: now)')

"""What policies that users write decide by: a situation, and the way to a cell.

Users import this before they fly, so no kernel is imported here until one runs: how kernels run
is open until then.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from uav_collect.kernels.arrays import Ints, Row

if TYPE_CHECKING:
    from uav_collect.uav.belief import Belief
    from uav_collect.uav.briefing import Briefing
    from uav_collect.uav.view import LocalView


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What one UAV knows as it decides. Rows are numpy arrays, copies of its own."""

    briefing: 'Briefing'
    uav: int  # index of the UAV
    belief: 'Belief'
    view: 'LocalView'  # rows of sensors are (n_sensors,)
    legal: Ints  # (N_ACTIONS,) 1 for each legal action; at least one is


def step_towards(briefing: 'Briefing', cell: int, target: int, legal: Row[int]) -> int:
    """The legal move that leads nearest to a target, along the longer way first.

    Args:
        cell: where the UAV is.
        target: a cell that a way leads to.
        legal: 1 for each legal action, shape (N_ACTIONS,), at least one move.
    """
    from uav_collect.uav.moves import new_moves, step

    return step(briefing, cell, target, legal, new_moves(briefing))

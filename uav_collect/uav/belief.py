"""What one UAV believes: its completion map, the demand it saw, where it last heard the others.

The map is a grow-only set: merging is OR, so messages that are lost, repeated or late can delay
what a UAV knows but never make it wrong.
"""

from typing import Generic, NamedTuple, TypeVar

from uav_collect.kernels.arrays import new_map_table, new_table, Row
from uav_collect.kernels.compile import kernel, row_kernel
from uav_collect.uav import actions
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.view import LocalView, VIEW_CELLS

NEVER = -1.0  # a time at which nothing was heard

_Ints = TypeVar('_Ints')
_Floats = TypeVar('_Floats')


class BeliefRows(NamedTuple, Generic[_Ints, _Floats]):
    """What one UAV believes, a row each; or what many do, tables of rows, (N, ...)."""

    complete: _Ints  # (C,) 1 where nothing is left to collect, as far as it knows
    n_complete: _Ints  # (1,)
    seen_bit: _Floats  # (C,) demand when it last saw the cell; 0 where it never saw any
    peer_x_m: _Floats  # (U,) where it last heard each UAV
    peer_y_m: _Floats
    peer_s: _Floats  # (U,) when; NEVER


Belief = BeliefRows[Row[int], Row[float]]
Beliefs = BeliefRows[Row[Row[int]], Row[Row[float]]]


def new_beliefs(briefing: Briefing, n_beliefs: int) -> Beliefs:
    """Beliefs before the first look."""
    n_cells, n_uavs = briefing.n_rows * briefing.n_columns, briefing.n_uavs
    beliefs: Beliefs = BeliefRows(
        complete=new_map_table(n_beliefs, n_cells),
        n_complete=new_table(n_beliefs, 1, 0),
        seen_bit=new_table(n_beliefs, n_cells, 0.0),
        peer_x_m=new_table(n_beliefs, n_uavs, 0.0),
        peer_y_m=new_table(n_beliefs, n_uavs, 0.0),
        peer_s=new_table(n_beliefs, n_uavs, NEVER),
    )
    for index in range(n_beliefs):
        forget(belief_of(beliefs, index), briefing)
    return beliefs


@row_kernel
def belief_of(beliefs: Beliefs, index: int) -> Belief:
    """One belief of many."""
    return BeliefRows(
        beliefs.complete[index],
        beliefs.n_complete[index],
        beliefs.seen_bit[index],
        beliefs.peer_x_m[index],
        beliefs.peer_y_m[index],
        beliefs.peer_s[index],
    )


@kernel
def forget(belief: Belief, briefing: Briefing) -> None:
    """Back to the belief before the first look: what everybody knows."""
    n_complete = 0
    for cell in range(len(belief.complete)):
        belief.complete[cell] = briefing.known_complete[cell]
        belief.seen_bit[cell] = 0.0
        n_complete += briefing.known_complete[cell]
    belief.n_complete[0] = n_complete
    for uav in range(len(belief.peer_s)):
        belief.peer_x_m[uav] = 0.0
        belief.peer_y_m[uav] = 0.0
        belief.peer_s[uav] = NEVER


@kernel
def observe(belief: Belief, briefing: Briefing, view: LocalView) -> None:
    """Take in the 3 x 3 region: a cell with nothing to collect is complete."""
    for index in range(VIEW_CELLS):
        cell = actions.neighbour(briefing, view.cell, index // 3 - 1, index % 3 - 1)
        if cell < 0:
            continue
        belief.seen_bit[cell] = view.region_bit[index]
        if view.region_bit[index] <= 0.0 and belief.complete[cell] == 0:
            belief.complete[cell] = 1
            belief.n_complete[0] += 1


@kernel
def hear(
    belief: Belief, sender: int, complete: Row[int], x_m: float, y_m: float, time_s: float
) -> None:
    """Merge another UAV's message: its map by OR, its position if newer than the last one."""
    merge(belief, complete)
    if time_s >= belief.peer_s[sender]:
        belief.peer_x_m[sender] = x_m
        belief.peer_y_m[sender] = y_m
        belief.peer_s[sender] = time_s


@kernel
def merge(belief: Belief, complete: Row[int]) -> None:
    """Take in a completion map by OR."""
    n_complete = 0
    for cell in range(len(belief.complete)):
        known = belief.complete[cell] | complete[cell]
        belief.complete[cell] = known
        n_complete += known
    belief.n_complete[0] = n_complete

"""What a learned policy sees: the belief and the local view as one vector, in one of two layouts.

A layout's name carries its version: a frozen policy refuses any other.
- `paper/1`: remaining energy, position, completion map, demand of the 3 x 3 region.
- `egocentric/1`: a 9 x 9 patch around the UAV (incomplete, seen demand, outside), the same
  incomplete and demand maps pooled coarsely further out, home, and where others were last heard.
Both end with the previous action and the UAV's index, one-hot.
"""

from enum import IntEnum
import math

from uav_collect.actions import N_ACTIONS
from uav_collect.arrays import Row
from uav_collect.belief import Belief, NEVER
from uav_collect.briefing import Briefing
from uav_collect.compiled import kernel
from uav_collect.missions import LocalView, VIEW_CELLS

PATCH_SIDE = 9  # cells of the egocentric layout's fine patch
POOL_SIDE = 3  # cells pooled into one of its coarse blocks
BLOCKS_SIDE = 7  # coarse blocks: 21 x 21 cells about the UAV
_DEMAND_SCALE_BIT = 1e6
_TIME_SCALE_S = 100.0  # the horizon of a discount of 0.99 per second


class Layout(IntEnum):
    """The layouts of an observation."""

    PAPER = 0
    EGOCENTRIC = 1

    @property
    def label(self) -> str:
        """Name and version."""
        return ('paper/1', 'egocentric/1')[self]


def observation_size(layout: Layout, cells_per_side: int, n_uavs: int) -> int:
    """Length of an observation."""
    common = N_ACTIONS + n_uavs
    if layout == Layout.PAPER:
        return 3 + cells_per_side * cells_per_side + VIEW_CELLS + common
    return 5 + 3 * PATCH_SIDE * PATCH_SIDE + 2 * BLOCKS_SIDE * BLOCKS_SIDE + 4 * n_uavs + common


@kernel
def encode(
    layout: int, briefing: Briefing, uav: int, belief: Belief, view: LocalView, out: Row[float]
) -> None:
    """Write the observation of the deciding UAV.

    Args:
        out: written, demand in Mbit, all else within -1..1, shape (observation_size,).
    """
    if layout == Layout.PAPER:
        filled = _encode_paper(briefing, uav, belief, view, out)
    else:
        filled = _encode_egocentric(briefing, uav, belief, view, out)
    for action in range(N_ACTIONS):
        out[filled + action] = 1.0 if view.previous_action == action else 0.0
    filled += N_ACTIONS
    for other in range(briefing.n_uavs):
        out[filled + other] = 1.0 if other == uav else 0.0


@kernel
def _encode_paper(
    briefing: Briefing, uav: int, belief: Belief, view: LocalView, out: Row[float]
) -> int:
    side_m = briefing.cells_per_side * briefing.cell_size_m
    out[0] = view.energy_left_j / briefing.energy_budget_j[uav]
    out[1] = view.x_m / side_m
    out[2] = view.y_m / side_m
    filled = 3
    for cell in range(len(belief.complete)):
        out[filled + cell] = 1.0 * belief.complete[cell]
    filled += len(belief.complete)
    for index in range(VIEW_CELLS):
        seen_bit = view.region_bit[index]
        out[filled + index] = 0.0 if math.isnan(seen_bit) else seen_bit / _DEMAND_SCALE_BIT
    return filled + VIEW_CELLS


@kernel
def _encode_egocentric(
    briefing: Briefing, uav: int, belief: Belief, view: LocalView, out: Row[float]
) -> int:
    side_m = briefing.cells_per_side * briefing.cell_size_m
    out[0] = view.energy_left_j / briefing.energy_budget_j[uav]
    out[1] = view.x_m / side_m
    out[2] = view.y_m / side_m
    out[3] = (briefing.home_x_m[uav] - view.x_m) / side_m
    out[4] = (briefing.home_y_m[uav] - view.y_m) / side_m
    filled = _encode_patch(briefing, belief, view.cell, 5, out)
    filled = _encode_blocks(briefing, belief, view.cell, filled, out)
    for other in range(briefing.n_uavs):
        heard = other != uav and belief.peer_s[other] != NEVER
        out[filled] = 1.0 if heard else 0.0
        out[filled + 1] = (belief.peer_x_m[other] - view.x_m) / side_m if heard else 0.0
        out[filled + 2] = (belief.peer_y_m[other] - view.y_m) / side_m if heard else 0.0
        age_s = view.time_s - belief.peer_s[other]
        out[filled + 3] = math.exp(-age_s / _TIME_SCALE_S) if heard else 0.0
        filled += 4
    return filled


@kernel
def _encode_patch(
    briefing: Briefing, belief: Belief, centre: int, filled: int, out: Row[float]
) -> int:
    side, n_patch = briefing.cells_per_side, PATCH_SIDE * PATCH_SIDE
    south, west = centre // side - PATCH_SIDE // 2, centre % side - PATCH_SIDE // 2
    for index in range(n_patch):
        row, column = south + index // PATCH_SIDE, west + index % PATCH_SIDE
        is_inside = 0 <= row < side and 0 <= column < side
        cell = row * side + column
        is_open = is_inside and belief.complete[cell] == 0
        out[filled + index] = 1.0 if is_open else 0.0
        out[filled + n_patch + index] = (
            belief.seen_bit[cell] / _DEMAND_SCALE_BIT if is_open else 0.0
        )
        out[filled + 2 * n_patch + index] = 0.0 if is_inside else 1.0
    return filled + 3 * n_patch


@kernel
def _encode_blocks(
    briefing: Briefing, belief: Belief, centre: int, filled: int, out: Row[float]
) -> int:
    side, n_blocks = briefing.cells_per_side, BLOCKS_SIDE * BLOCKS_SIDE
    reach = BLOCKS_SIDE * POOL_SIDE // 2
    south, west = centre // side - reach, centre % side - reach
    for index in range(2 * n_blocks):
        out[filled + index] = 0.0
    for row in range(max(south, 0), min(south + 2 * reach + 1, side)):
        for column in range(max(west, 0), min(west + 2 * reach + 1, side)):
            cell = row * side + column
            if belief.complete[cell] != 0:
                continue
            block = (row - south) // POOL_SIDE * BLOCKS_SIDE + (column - west) // POOL_SIDE
            out[filled + block] += 1.0 / (POOL_SIDE * POOL_SIDE)
            out[filled + n_blocks + block] += belief.seen_bit[cell] / (
                POOL_SIDE * POOL_SIDE * _DEMAND_SCALE_BIT
            )
    return filled + 2 * n_blocks

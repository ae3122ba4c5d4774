"""What a learned policy sees: belief and local view as one vector, in one of three layouts.

A layout's name carries its version: a frozen policy refuses any other.
- `paper/1`: remaining energy, position, completion map, demand of the 3 x 3 region, the previous
  action and the UAV's index, one-hot.
- `egocentric/2`: a 9 x 9 patch around the UAV (incomplete, seen demand, outside), the incomplete
  and demand maps pooled more coarsely further out, walls, home, the fleet and where others were
  last heard. Its size depends neither on the area nor on the fleet, and lengths count in cells, so
  that one policy may fly several of both.
- `egocentric/3`, see `relative_observation`: for any field and fleet, in a frame of the UAV's own,
  with the advice of the sweep.
Behind the numbers of a layout may stand a user's own ones: an `OwnLayout`, see `own_observation`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
import math

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Floats, Ints, new_row, Row
from uav_collect.kernels.compile import kernel
from uav_collect.limits import EGOCENTRIC_MAX_UAVS, MAX_UAVS, RELATIVE_MAX_UAVS
from uav_collect.uav import relative_observation
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.belief import Belief, NEVER
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.frames import frame_of, IDENTITY
from uav_collect.uav.heuristics import choose, Heuristic, MEMORY_SIZE, shares_for
from uav_collect.uav.moves import new_moves
from uav_collect.uav.relative_observation import encode_relative
from uav_collect.uav.sharing import Shares
from uav_collect.uav.situation import Situation
from uav_collect.uav.user_policy import arrayed, situation_of
from uav_collect.uav.view import LocalView, VIEW_CELLS

PATCH_SIDE = 9  # cells of the egocentric layout's fine patch
NEAR_POOL_SIDE, NEAR_BLOCKS_SIDE = (
    3,
    7,
)  # cells a block, blocks a side: 21 x 21 cells about the UAV
FAR_POOL_SIDE, FAR_BLOCKS_SIDE = 9, 5  # 45 x 45 cells
_PATCH_REACH = PATCH_SIDE // 2  # cells from the UAV to the last ones
_NEAR_REACH = NEAR_POOL_SIDE * NEAR_BLOCKS_SIDE // 2
_FAR_REACH = FAR_POOL_SIDE * FAR_BLOCKS_SIDE // 2
_N_SCALARS = 10
_N_PER_PEER = 5
_DEMAND_SCALE_BIT = 1e6
_LENGTH_SCALE_CELLS = 10.0
_COUNT_SCALE_CELLS = 100.0
_SPEED_SCALE_MPS = 10.0
_TIME_SCALE_S = 100.0  # the horizon of a discount of 0.99 per second


class Layout(IntEnum):
    """The layouts of an observation."""

    PAPER = 0
    EGOCENTRIC = 1
    RELATIVE = 2

    @property
    def label(self) -> str:
        """Name and version."""
        return ('paper/1', 'egocentric/2', 'egocentric/3')[self]

    @property
    def max_uavs(self) -> int:
        """UAVs of a fleet that it has room for."""
        return (MAX_UAVS, EGOCENTRIC_MAX_UAVS, RELATIVE_MAX_UAVS)[self]

    @property
    def adviser(self) -> int:
        """The rule whose advice it shows, and by whose word a UAV flies home; NONE: none's."""
        return int(Heuristic.SWEEP) if self == Layout.RELATIVE else NONE

    @property
    def base(self) -> 'Layout':
        """The layout itself, which kernels encode."""
        return self

    @property
    def n_own(self) -> int:
        """How many numbers of a user's stand behind it."""
        return 0


@dataclass(frozen=True)
class OwnLayout:
    """A layout with numbers behind it that a user's code makes, in Python wherever it flies."""

    label: str  # module:name of the code
    base: Layout
    n_own: int
    numbers: Callable[[Situation], Floats] = field(compare=False, repr=False)  # (n_own,)

    @property
    def max_uavs(self) -> int:
        """UAVs of a fleet that it has room for."""
        return self.base.max_uavs

    @property
    def adviser(self) -> int:
        """The rule whose advice it shows; NONE: none's."""
        return self.base.adviser


AnyLayout = Layout | OwnLayout


def frames(layout: AnyLayout, briefing: Briefing) -> Ints:
    """The frame of each UAV, in which a layout shows it places and actions, (U,)."""
    uavs = range(briefing.n_uavs)
    if layout.base != Layout.RELATIVE:
        return np.full(briefing.n_uavs, IDENTITY)
    return np.array([frame_of(briefing, uav) for uav in uavs])


def observation_size(layout: AnyLayout, n_cells: int, n_uavs: int) -> int:
    """Length of an observation.

    Raises:
        ConfigError: the layout has no room for so many UAVs.
    """
    return _base_size(layout.base, n_cells, n_uavs) + layout.n_own


def _base_size(layout: Layout, n_cells: int, n_uavs: int) -> int:
    if layout == Layout.PAPER:
        return 3 + n_cells + VIEW_CELLS + N_ACTIONS + n_uavs
    if n_uavs > layout.max_uavs:
        raise ConfigError(
            f'fleet.uavs: {n_uavs} UAVs; observations {layout.label} have room for '
            f'{layout.max_uavs}'
        )
    if layout == Layout.RELATIVE:
        return relative_observation.SIZE
    blocks = NEAR_BLOCKS_SIDE * NEAR_BLOCKS_SIDE + FAR_BLOCKS_SIDE * FAR_BLOCKS_SIDE
    peers = _N_PER_PEER * (EGOCENTRIC_MAX_UAVS - 1)
    maps = 3 * PATCH_SIDE * PATCH_SIDE + 2 * blocks
    return _N_SCALARS + maps + peers + N_ACTIONS + EGOCENTRIC_MAX_UAVS


def observation_bound(layout: AnyLayout, briefing: Briefing, most_bit: float) -> float:
    """What no number of an observation exceeds, in either direction; a whole number, and rough.

    Args:
        most_bit: the most data that a cell can hold [bit].

    Returns:
        Infinity where some numbers are a user's own.
    """
    if layout.n_own:
        return math.inf
    if layout == Layout.PAPER:
        return math.ceil(max(1.0, most_bit / _DEMAND_SCALE_BIT))
    if layout == Layout.RELATIVE:
        return math.ceil(relative_observation.bound(briefing, most_bit))
    bounds = (
        max(briefing.n_rows, briefing.n_columns) / _LENGTH_SCALE_CELLS,
        briefing.n_rows * briefing.n_columns / _COUNT_SCALE_CELLS,
        max(briefing.speed_mps) / _SPEED_SCALE_MPS,
        FAR_POOL_SIDE * _demand(most_bit),  # all cells of a block full
    )
    return math.ceil(max(1.0, *bounds))


def advice_columns(layout: AnyLayout, size: int) -> range:
    """Which numbers of an observation show the advice, one-hot by action in the UAV's frame.

    Args:
        size: of the observation.

    Returns:
        None where the layout shows none.
    """
    end = size - layout.n_own
    return range(0) if layout.adviser == NONE else range(end - N_ACTIONS, end)


class Observer:
    """What one UAV sees, and what the layout's adviser would do.

    It writes the observations of one UAV, one after the other, into the same row.
    """

    def __init__(self, layout: AnyLayout, briefing: Briefing, uav: int) -> None:
        """Get ready to look with a UAV, by index.

        Raises:
            ConfigError: the layout has no room for the fleet.
        """
        size = observation_size(layout, len(briefing.is_open), briefing.n_uavs)
        self.frame = int(frames(layout, briefing)[uav])
        self.observation: Row[float] = new_row(size, 0.0)  # the latest; not to be written
        self._layout, self._briefing, self._uav = layout, briefing, uav
        self._adviser = layout.adviser
        self._shares = shares_for(self._adviser, briefing)
        self._moves = new_moves(briefing)
        self._memory: Row[int] = new_row(MEMORY_SIZE, 0)  # that a rule without memory leaves alone

    def advice(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """What the layout's adviser would do, by the compass, or HOME; NONE: it has no adviser."""
        if self._adviser == NONE:
            return NONE
        ways = self._shares, self._moves
        return choose(
            self._adviser, self._briefing, *ways, self._uav, belief, view, legal, self._memory
        )

    def encode(self, belief: Belief, view: LocalView, legal: Row[int], advice: int) -> Row[float]:
        """The observation; the same row each time."""
        layout, row, of = self._layout, self.observation, (self._briefing, self._shares, self._uav)
        encode(int(layout.base), *of, belief, view, advice, row)
        if isinstance(layout, OwnLayout):
            write_own(layout, arrayed(self._briefing), self._uav, belief, view, legal, row)
        return row

    def observe(self, belief: Belief, view: LocalView, legal: Row[int]) -> Row[float]:
        """The observation of a decision among legal actions."""
        return self.encode(belief, view, legal, self.advice(belief, view, legal))


def write_own(
    layout: OwnLayout,
    briefing: Briefing,
    uav: int,
    belief: Belief,
    view: LocalView,
    legal: Row[int],
    out: Row[float],
) -> None:
    """Write a user's numbers behind those of the layout that they extend.

    The sensors below are left out of what the user's code sees: what a learner keeps of a decision
    does not have them, and it must give the same numbers again.

    Args:
        briefing: its rows are arrays.
        out: written at its end, shape (observation_size,).

    Raises:
        ConfigError: the user's code fails, or does not give so many finite numbers.
    """
    seen = view._replace(n_sensors=0)
    numbers = layout.numbers(situation_of(briefing, uav, belief, seen, legal)).tolist()
    for index, number in enumerate(numbers, start=len(out) - layout.n_own):
        out[index] = number


@kernel
def encode(
    layout: int,
    briefing: Briefing,
    shares: Shares,
    uav: int,
    belief: Belief,
    view: LocalView,
    advice: int,
    out: Row[float],
) -> None:
    """Write the observation of the deciding UAV.

    Args:
        shares: of the layout's adviser, if it has one.
        advice: the same's, an action by the compass.
        out: written; numbers of the order of one, shape (observation_size,).
    """
    if layout == Layout.RELATIVE:
        encode_relative(briefing, shares, uav, belief, view, advice, out)
        return
    if layout == Layout.PAPER:
        filled = _encode_paper(briefing, uav, belief, view, out)
        n_places = briefing.n_uavs
    else:
        filled = _encode_egocentric(briefing, uav, belief, view, out)
        n_places = EGOCENTRIC_MAX_UAVS
    for action in range(N_ACTIONS):
        out[filled + action] = 1.0 if view.previous_action == action else 0.0
    filled += N_ACTIONS
    for place in range(n_places):
        out[filled + place] = 1.0 if place == uav else 0.0


@kernel
def _encode_paper(
    briefing: Briefing, uav: int, belief: Belief, view: LocalView, out: Row[float]
) -> int:
    out[0] = view.energy_left_j / briefing.energy_budget_j[uav]
    out[1] = view.x_m / (briefing.n_columns * briefing.cell_size_m)
    out[2] = view.y_m / (briefing.n_rows * briefing.cell_size_m)
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
    scale_m = _LENGTH_SCALE_CELLS * briefing.cell_size_m
    out[0] = view.energy_left_j / briefing.energy_budget_j[uav]
    out[1] = view.x_m / scale_m
    out[2] = view.y_m / scale_m
    out[3] = (briefing.n_columns * briefing.cell_size_m - view.x_m) / scale_m
    out[4] = (briefing.n_rows * briefing.cell_size_m - view.y_m) / scale_m
    out[5] = (briefing.home_x_m[uav] - view.x_m) / scale_m
    out[6] = (briefing.home_y_m[uav] - view.y_m) / scale_m
    out[7] = briefing.speed_mps[uav] / _SPEED_SCALE_MPS
    out[8] = briefing.n_uavs / EGOCENTRIC_MAX_UAVS
    out[9] = (len(belief.complete) - belief.n_complete[0]) / _COUNT_SCALE_CELLS
    filled = _encode_maps(briefing, belief, view.cell, _N_SCALARS, out)
    return _encode_peers(briefing, uav, belief, view, scale_m, filled, out)


@kernel
def _encode_peers(
    briefing: Briefing,
    uav: int,
    belief: Belief,
    view: LocalView,
    scale_m: float,
    filled: int,
    out: Row[float],
) -> int:
    for index in range(_N_PER_PEER * (EGOCENTRIC_MAX_UAVS - 1)):
        out[filled + index] = 0.0
    for other in range(briefing.n_uavs):
        if other == uav:
            continue
        place = filled + _N_PER_PEER * (other - 1 if other > uav else other)
        out[place] = briefing.speed_mps[other] / _SPEED_SCALE_MPS
        if belief.peer_s[other] == NEVER:
            continue
        out[place + 1] = 1.0
        out[place + 2] = (belief.peer_x_m[other] - view.x_m) / scale_m
        out[place + 3] = (belief.peer_y_m[other] - view.y_m) / scale_m
        out[place + 4] = math.exp((belief.peer_s[other] - view.time_s) / _TIME_SCALE_S)
    return filled + _N_PER_PEER * (EGOCENTRIC_MAX_UAVS - 1)


@kernel
def _encode_maps(
    briefing: Briefing, belief: Belief, centre: int, filled: int, out: Row[float]
) -> int:
    """Write the patch and both pooled maps: each cell is looked at once, in the order of cells."""
    n_columns, n_patch = briefing.n_columns, PATCH_SIDE * PATCH_SIDE
    n_near, n_far = NEAR_BLOCKS_SIDE * NEAR_BLOCKS_SIDE, FAR_BLOCKS_SIDE * FAR_BLOCKS_SIDE
    outside = filled + 2 * n_patch
    near, far = filled + 3 * n_patch, filled + 3 * n_patch + 2 * n_near
    end = far + 2 * n_far
    for index in range(filled, outside):
        out[index] = 0.0
    for index in range(outside, near):
        out[index] = 1.0
    for index in range(near, end):
        out[index] = 0.0
    is_open, complete, seen_bit = briefing.is_open, belief.complete, belief.seen_bit
    centre_row, centre_column = centre // n_columns, centre % n_columns
    west, east = -min(_FAR_REACH, centre_column), min(_FAR_REACH, n_columns - 1 - centre_column)
    south, north = -min(_FAR_REACH, centre_row), min(_FAR_REACH, briefing.n_rows - 1 - centre_row)
    for up in range(south, north + 1):
        patch_reach = _PATCH_REACH if abs(up) <= _PATCH_REACH else -1
        near_reach = _NEAR_REACH if abs(up) <= _NEAR_REACH else -1
        in_patch = (up + _PATCH_REACH) * PATCH_SIDE + _PATCH_REACH
        in_near = near + (up + _NEAR_REACH) // NEAR_POOL_SIDE * NEAR_BLOCKS_SIDE
        in_far = far + (up + _FAR_REACH) // FAR_POOL_SIDE * FAR_BLOCKS_SIDE
        for right in range(west, east + 1):
            cell = centre + up * n_columns + right
            is_in_patch = -patch_reach <= right <= patch_reach and is_open[cell] == 1
            if is_in_patch:
                out[outside + in_patch + right] = 0.0
            if complete[cell] != 0:
                continue
            demand = _demand(seen_bit[cell]) if seen_bit[cell] > 0.0 else 0.0
            if is_in_patch:
                out[filled + in_patch + right] = 1.0
                out[filled + n_patch + in_patch + right] = demand
            if -near_reach <= right <= near_reach:
                block = in_near + (right + _NEAR_REACH) // NEAR_POOL_SIDE
                out[block] += 1.0 / (NEAR_POOL_SIDE * NEAR_POOL_SIDE)
                out[block + n_near] += demand / NEAR_POOL_SIDE
            block = in_far + (right + _FAR_REACH) // FAR_POOL_SIDE
            out[block] += 1.0 / (FAR_POOL_SIDE * FAR_POOL_SIDE)
            out[block + n_far] += demand / FAR_POOL_SIDE
    return end


@kernel
def _demand(seen_bit: float) -> float:
    """Seen demand on a scale that suits a megabit as well as a hundred."""
    return math.log1p(seen_bit / _DEMAND_SCALE_BIT) if seen_bit > 0.0 else 0.0

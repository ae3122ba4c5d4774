"""The layout `egocentric/3`: what a UAV sees of any field and fleet, with the advice of a rule.

It knows neither an index nor a corner. Places and actions are in the UAV's own frame (`frames`),
lengths count in cells, times in the fleet's mean time to cross a cell, energies in crossings.
Peers are a set. In order:

- scalars: energy above what the way home and the margin take, room to the four sides, the way
  home, the own speed and cost, the fleet, the contact range, what is left to do, the time;
- peers: how many were heard, how fast they are, and the two that were heard nearest;
- a 9 x 9 patch: incomplete cells, those of the own share among them, seen demand, no way;
- 7 x 7 blocks of 3 x 3 cells: the first three of these, and where peers were heard;
- 9 x 9 blocks of 9 x 9 cells: incomplete, seen demand, peers;
- the previous action and the advice, one-hot.
"""

import math

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel
from uav_collect.limits import RELATIVE_MAX_UAVS
from uav_collect.uav import actions
from uav_collect.uav.action_codes import N_ACTIONS
from uav_collect.uav.belief import Belief, NEVER
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.frames import (
    cells_to_compass,
    cells_to_frame,
    frame_of,
    MIRROR_X,
    MIRROR_Y,
    to_frame,
    TRANSPOSE,
    TURNED,
)
from uav_collect.uav.heuristics import is_own_place
from uav_collect.uav.sharing import Shares
from uav_collect.uav.view import LocalView

PATCH_SIDE = 9  # cells
NEAR_POOL_SIDE, NEAR_BLOCKS_SIDE = 3, 7  # cells a block, blocks a side: 21 x 21 cells
FAR_POOL_SIDE, FAR_BLOCKS_SIDE = 9, 9  # 81 x 81 cells
N_SCALARS = 20
N_NEAREST, N_PER_PEER = 2, 5
N_PEER_SCALARS = 4
_N_PEERS = N_PEER_SCALARS + N_NEAREST * N_PER_PEER
_N_PATCH = PATCH_SIDE * PATCH_SIDE
_N_NEAR = NEAR_BLOCKS_SIDE * NEAR_BLOCKS_SIDE
_N_FAR = FAR_BLOCKS_SIDE * FAR_BLOCKS_SIDE
FIRST_OF_PATCH = N_SCALARS + _N_PEERS
FIRST_OF_NEAR = FIRST_OF_PATCH + 4 * _N_PATCH
FIRST_OF_FAR = FIRST_OF_NEAR + 4 * _N_NEAR
_FIRST_OF_ACTIONS = FIRST_OF_FAR + 3 * _N_FAR
SIZE = _FIRST_OF_ACTIONS + 2 * N_ACTIONS

_DEMAND_SCALE_BIT = 1e6
_LENGTH_SCALE_CELLS = 10.0
_COUNT_SCALE_CELLS = 100.0
_FLEET_SCALE = 8.0
_LOG_RANGE_SCALE, _LOG_MOVES_SCALE = 4.0, 5.0
_MOST_PLANNED = 4.0  # planned times of a tour; later, time says no more
_FADING_CROSSINGS = 12.0  # after which what was heard counts for a third
_HALF_CELL = 0.5 - 1e-6  # what lies half way between two cells counts to the nearer to oneself


def bound(briefing: Briefing, most_bit: float) -> float:
    """What no number exceeds, in either direction; rough.

    Args:
        most_bit: the most data that a cell can hold [bit].
    """
    uavs = range(briefing.n_uavs)
    crossing_s = [briefing.cell_size_m / briefing.speed_mps[uav] for uav in uavs]
    moves = [
        briefing.energy_budget_j[uav] / (briefing.flight_power_w[uav] * crossing_s[uav])
        for uav in uavs
    ]
    side = max(briefing.n_rows, briefing.n_columns)
    return max(
        _MOST_PLANNED,
        float(RELATIVE_MAX_UAVS),
        side / _LENGTH_SCALE_CELLS,
        briefing.n_rows * briefing.n_columns / _COUNT_SCALE_CELLS,
        FAR_POOL_SIDE * _demand(most_bit),
        math.log1p(max(moves)) / _LOG_MOVES_SCALE,
        math.log1p(briefing.hover_s / min(crossing_s)),
    )


@kernel
def encode_relative(
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
        shares: of the sweep.
        advice: an action, by the compass; any other number: there is none.
        out: written, shape (SIZE,).
    """
    frame = frame_of(briefing, uav)
    crossing_s, crossing_j = mean_crossing(briefing)
    for index in range(SIZE):
        out[index] = 0.0
    _write_own_state(briefing, uav, view, frame, crossing_j, out)
    _write_mission(briefing, shares, belief, view, crossing_s, out)
    _write_patch(briefing, shares, uav, belief, view.cell, frame, out)
    _write_blocks(briefing, shares, uav, belief, view.cell, frame, out)
    _write_peers(briefing, uav, belief, view, frame, crossing_s, out)
    for action in range(N_ACTIONS):
        turned = TURNED[frame][action]
        if turned == view.previous_action:
            out[_FIRST_OF_ACTIONS + action] = 1.0
        if turned == advice:
            out[_FIRST_OF_ACTIONS + N_ACTIONS + action] = 1.0


@kernel
def mean_crossing(briefing: Briefing) -> tuple[float, float]:
    """What it takes a UAV to fly over a cell, on average over the fleet [s], [J]."""
    total_s, total_j = 0.0, 0.0
    for uav in range(briefing.n_uavs):
        duration_s = actions.move_duration_s(briefing, uav)
        total_s += duration_s
        total_j += duration_s * briefing.flight_power_w[uav]
    return total_s / briefing.n_uavs, total_j / briefing.n_uavs


@kernel
def _write_own_state(
    briefing: Briefing, uav: int, view: LocalView, frame: int, crossing_j: float, out: Row[float]
) -> None:
    size_m = briefing.cell_size_m
    scale_m = _LENGTH_SCALE_CELLS * size_m
    to_land_j = actions.home_energy_j(briefing, uav, view.x_m, view.y_m)
    spare_j = view.energy_left_j - to_land_j - briefing.energy_margin_j[uav]
    own_j = briefing.flight_power_w[uav] * actions.move_duration_s(briefing, uav)
    out[0] = math.log1p(max(spare_j, 0.0) / own_j) / _LOG_MOVES_SCALE
    out[1] = spare_j / briefing.energy_budget_j[uav]
    west, south = view.x_m / scale_m, view.y_m / scale_m
    east = (briefing.n_columns * size_m - view.x_m) / scale_m
    north = (briefing.n_rows * size_m - view.y_m) / scale_m
    if frame & MIRROR_X:
        west, east = east, west
    if frame & MIRROR_Y:
        south, north = north, south
    if frame & TRANSPOSE:
        west, south, east, north = south, west, north, east
    out[2], out[3], out[4], out[5] = west, south, east, north
    home_north = (briefing.home_y_m[uav] - view.y_m) / scale_m
    home_east = (briefing.home_x_m[uav] - view.x_m) / scale_m
    out[6], out[7] = to_frame(frame, home_north, home_east)
    out[8] = briefing.speed_mps[uav] / _mean_speed_mps(briefing)
    out[9] = own_j / crossing_j


@kernel
def _write_mission(
    briefing: Briefing,
    shares: Shares,
    belief: Belief,
    view: LocalView,
    crossing_s: float,
    out: Row[float],
) -> None:
    n_cells, n_known = len(belief.complete), 0
    for cell in range(n_cells):
        n_known += briefing.known_complete[cell]
    n_left = n_cells - belief.n_complete[0]
    across = math.sqrt(
        1.0 * briefing.n_rows * briefing.n_rows + briefing.n_columns * briefing.n_columns
    )
    range_cells = min(briefing.contact_range_m / briefing.cell_size_m, across)
    out[10] = briefing.n_uavs / _FLEET_SCALE
    out[11] = math.log1p(range_cells) / _LOG_RANGE_SCALE
    out[12] = 1.0 if range_cells <= 0.0 else 0.0
    out[13] = 1.0 if range_cells >= across else 0.0
    out[14] = n_left / max(n_cells - n_known, 1)
    out[15] = n_left / _COUNT_SCALE_CELLS
    out[16] = min(view.time_s / max(shares.planned_s, 1), _MOST_PLANNED)
    out[17] = briefing.data_share
    out[18] = math.log1p(briefing.hover_s / crossing_s)
    out[19] = 1.0 if briefing.has_obstacles == 1 else 0.0


@kernel
def _write_patch(
    briefing: Briefing,
    shares: Shares,
    uav: int,
    belief: Belief,
    centre: int,
    frame: int,
    out: Row[float],
) -> None:
    n_rows, n_columns, reach = briefing.n_rows, briefing.n_columns, PATCH_SIDE // 2
    for index in range(_N_PATCH):
        rows, columns = cells_to_compass(
            frame, index // PATCH_SIDE - reach, index % PATCH_SIDE - reach
        )
        row, column = centre // n_columns + rows, centre % n_columns + columns
        cell = row * n_columns + column
        place = FIRST_OF_PATCH + index
        if not (0 <= row < n_rows and 0 <= column < n_columns) or briefing.is_open[cell] == 0:
            out[place + 3 * _N_PATCH] = 1.0
        elif belief.complete[cell] == 0:
            out[place] = 1.0
            out[place + _N_PATCH] = 1.0 if is_own_place(shares, uav, cell) else 0.0
            out[place + 2 * _N_PATCH] = _demand(belief.seen_bit[cell])


@kernel
def _write_blocks(
    briefing: Briefing,
    shares: Shares,
    uav: int,
    belief: Belief,
    centre: int,
    frame: int,
    out: Row[float],
) -> None:
    n_columns = briefing.n_columns
    for cell in range(len(belief.complete)):
        if belief.complete[cell] != 0:
            continue
        rows, columns = cells_to_frame(
            frame, cell // n_columns - centre // n_columns, cell % n_columns - centre % n_columns
        )
        demand = _demand(belief.seen_bit[cell])
        near = _block(rows, columns, NEAR_POOL_SIDE, NEAR_BLOCKS_SIDE)
        if near >= 0:
            place = FIRST_OF_NEAR + near
            out[place] += 1.0 / (NEAR_POOL_SIDE * NEAR_POOL_SIDE)
            if is_own_place(shares, uav, cell):
                out[place + _N_NEAR] += 1.0 / (NEAR_POOL_SIDE * NEAR_POOL_SIDE)
            out[place + 2 * _N_NEAR] += demand / NEAR_POOL_SIDE
        far = _block(rows, columns, FAR_POOL_SIDE, FAR_BLOCKS_SIDE)
        if far >= 0:
            place = FIRST_OF_FAR + far
            out[place] += 1.0 / (FAR_POOL_SIDE * FAR_POOL_SIDE)
            out[place + _N_FAR] += demand / FAR_POOL_SIDE


@kernel
def _block(rows: int, columns: int, pool_side: int, blocks_side: int) -> int:
    """The block that holds a cell so far away in the frame; -1: it lies beyond all of them."""
    reach = pool_side * blocks_side // 2
    if abs(rows) > reach or abs(columns) > reach:
        return -1
    return (rows + reach) // pool_side * blocks_side + (columns + reach) // pool_side


@kernel
def _write_peers(
    briefing: Briefing,
    uav: int,
    belief: Belief,
    view: LocalView,
    frame: int,
    crossing_s: float,
    out: Row[float],
) -> None:
    """Write what was heard of the others, who have no order but by what is known of them."""
    size_m, mean_mps = briefing.cell_size_m, _mean_speed_mps(briefing)
    n_heard, fastest_mps, slowest_mps = 0, 0.0, math.inf
    # Those heard nearest; of equals the one heard last, then the faster one.
    nearest = (math.inf, 0.0, 0.0, 0.0, 0.0)
    second = nearest
    for other in range(briefing.n_uavs):
        if other == uav:
            continue
        speed_mps, heard_s = briefing.speed_mps[other], belief.peer_s[other]
        fastest_mps = max(fastest_mps, speed_mps)
        slowest_mps = min(slowest_mps, speed_mps)
        if heard_s == NEVER:
            continue
        n_heard += 1
        north, east = to_frame(
            frame,
            (belief.peer_y_m[other] - view.y_m) / size_m,
            (belief.peer_x_m[other] - view.x_m) / size_m,
        )
        age = (view.time_s - heard_s) / (_FADING_CROSSINGS * crossing_s)
        _add_to_blocks(_rounded(north), _rounded(east), math.exp(-age), out)
        key = (north * north + east * east, age, -speed_mps / mean_mps, north, east)
        if key < nearest:
            nearest, second = key, nearest
        elif key < second:
            second = key
    out[N_SCALARS] = n_heard / _FLEET_SCALE
    out[N_SCALARS + 1] = (briefing.n_uavs - 1 - n_heard) / _FLEET_SCALE
    if briefing.n_uavs > 1:
        out[N_SCALARS + 2] = fastest_mps / mean_mps
        out[N_SCALARS + 3] = slowest_mps / mean_mps
    if n_heard > 0:
        _write_peer(nearest, N_SCALARS + N_PEER_SCALARS, out)
    if n_heard > 1:
        _write_peer(second, N_SCALARS + N_PEER_SCALARS + N_PER_PEER, out)


@kernel
def _write_peer(
    peer: tuple[float, float, float, float, float], place: int, out: Row[float]
) -> None:
    _, age, slowness, north, east = peer
    out[place] = 1.0
    out[place + 1] = north / _LENGTH_SCALE_CELLS
    out[place + 2] = east / _LENGTH_SCALE_CELLS
    out[place + 3] = math.exp(-age)
    out[place + 4] = -slowness


@kernel
def _add_to_blocks(rows: int, columns: int, freshness: float, out: Row[float]) -> None:
    near = _block(rows, columns, NEAR_POOL_SIDE, NEAR_BLOCKS_SIDE)
    if near >= 0:
        out[FIRST_OF_NEAR + 3 * _N_NEAR + near] += freshness
    far = _block(rows, columns, FAR_POOL_SIDE, FAR_BLOCKS_SIDE)
    if far >= 0:
        out[FIRST_OF_FAR + 2 * _N_FAR + far] += freshness


@kernel
def _rounded(cells: float) -> int:
    """The nearest whole number of cells, alike on both sides of 0."""
    whole = int(abs(cells) + _HALF_CELL)
    return whole if cells >= 0.0 else -whole


@kernel
def _mean_speed_mps(briefing: Briefing) -> float:
    total_mps = 0.0
    for uav in range(briefing.n_uavs):
        total_mps += briefing.speed_mps[uav]
    return total_mps / briefing.n_uavs


@kernel
def _demand(seen_bit: float) -> float:
    """Seen demand on a scale that suits a megabit as well as a hundred."""
    return math.log1p(seen_bit / _DEMAND_SCALE_BIT) if seen_bit > 0.0 else 0.0

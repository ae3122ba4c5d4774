"""The policies that are rules: HERT, the paper's baseline; a stronger sweep; random legal actions.

All three decide on what one UAV knows, as a learned policy does: its belief, its local view and
the legal actions. `memory` is what a rule remembers between decisions, zeros at the start.
"""

from enum import IntEnum

from uav_collect import actions
from uav_collect.actions import COLUMN_STEP, FORWARD, HOME, HOVER, N_ACTIONS, ROW_STEP
from uav_collect.arrays import Row
from uav_collect.belief import Belief
from uav_collect.briefing import Briefing
from uav_collect.compiled import kernel
from uav_collect.philox import draw_uniform, EXPLORATION
from uav_collect.world import LocalView, VIEW_CELLS

MEMORY_SIZE = 1
_LANE_WIDTH = 3  # columns that one flight along a lane's middle sees
_DETOUR_CELLS = 3  # how far the sweep leaves its lane for demand it has seen


class Heuristic(IntEnum):
    """The rules, by the code kernels know them by."""

    HERT = 0  # sectors in proportion to speed
    HERT_EQUAL = 1  # equal sectors
    SWEEP = 2
    RANDOM = 3

    @property
    def label(self) -> str:
        """The name that users type."""
        return ('hert', 'hert-equal', 'sweep', 'random')[self]


@kernel
def choose(
    heuristic: int,
    briefing: Briefing,
    uav: int,
    belief: Belief,
    view: LocalView,
    legal: Row[int],
    memory: Row[int],
) -> int:
    """The action that a rule takes; HOME ends the UAV's mission.

    Args:
        legal: 1 for each legal action, shape (N_ACTIONS,), at least one.
        memory: read and written, shape (MEMORY_SIZE,).
    """
    if heuristic == Heuristic.RANDOM:
        return _choose_random(uav, view, legal, memory)
    if legal[HOVER] == 1:
        return HOVER
    if heuristic == Heuristic.SWEEP:
        return _choose_sweep(briefing, uav, belief, view, legal, memory)
    return _choose_hert(heuristic == Heuristic.HERT, briefing, uav, view, legal, memory)


@kernel
def sector_start(briefing: Briefing, uav: int, n_stops: int, by_speed: bool) -> int:
    """Where a UAV's share of a path of stops begins; that of the next UAV is where it ends."""
    total = 0.0
    before = 0.0
    for other in range(briefing.n_uavs):
        weight = briefing.speed_mps[other] if by_speed else 1.0
        total += weight
        if other < uav:
            before += weight
    return int(n_stops * before / total + 0.5)


@kernel
def step_towards(briefing: Briefing, cell: int, target: int, legal: Row[int]) -> int:
    """The legal move that leads nearest to a target, along the longer way first."""
    side = briefing.cells_per_side
    best = HOVER
    best_cost = 0
    for action in range(FORWARD, N_ACTIONS):
        if legal[action] == 0:
            continue
        rows = abs(target // side - cell // side - ROW_STEP[action])
        columns = abs(target % side - cell % side - COLUMN_STEP[action])
        # Manhattan distance first; among equals the move that leaves the most balanced way.
        cost = (rows + columns) * 4 * side + max(rows, columns)
        if best == HOVER or cost < best_cost:
            best = action
            best_cost = cost
    return best


@kernel
def _choose_random(uav: int, view: LocalView, legal: Row[int], memory: Row[int]) -> int:
    n_legal = 0
    for action in range(N_ACTIONS):
        n_legal += legal[action]
    uniform = draw_uniform(0, EXPLORATION, uav, memory[0], int(view.time_s * 1000.0))
    memory[0] += 1
    chosen = int(uniform * n_legal)
    for action in range(N_ACTIONS):
        if legal[action] == 1:
            if chosen == 0:
                return action
            chosen -= 1
    return HOME


@kernel
def _choose_hert(
    by_speed: bool,
    briefing: Briefing,
    uav: int,
    view: LocalView,
    legal: Row[int],
    memory: Row[int],
) -> int:
    n_cells = briefing.cells_per_side * briefing.cells_per_side
    start = sector_start(briefing, uav, n_cells, by_speed)
    stop = sector_start(briefing, uav + 1, n_cells, by_speed)
    if start + memory[0] < stop and view.cell == _boustrophedon(briefing, start + memory[0]):
        memory[0] += 1
    if start + memory[0] >= stop:
        return HOME
    return step_towards(briefing, view.cell, _boustrophedon(briefing, start + memory[0]), legal)


@kernel
def _boustrophedon(briefing: Briefing, stop: int) -> int:
    """The cell at a stop of the path that goes up one column and down the next."""
    side = briefing.cells_per_side
    column, row = stop // side, stop % side
    if column % 2 == 1:
        row = side - 1 - row
    return row * side + column


@kernel
def _choose_sweep(
    briefing: Briefing,
    uav: int,
    belief: Belief,
    view: LocalView,
    legal: Row[int],
    memory: Row[int],
) -> int:
    demand = _nearest(briefing, belief, view.cell, True)
    if demand >= 0 and _distance(briefing, view.cell, demand) <= _DETOUR_CELLS:
        return step_towards(briefing, view.cell, demand, legal)
    target = _next_stop(briefing, uav, belief, memory)
    if target < 0:
        # Its own sector is known: collect what it has seen, then help the others.
        target = demand if demand >= 0 else _nearest(briefing, belief, view.cell, False)
    if target < 0:
        return HOME
    return step_towards(briefing, view.cell, target, legal)


@kernel
def _next_stop(briefing: Briefing, uav: int, belief: Belief, memory: Row[int]) -> int:
    """The first stop of the UAV's lanes from where an unknown cell would be seen; -1 if none."""
    side = briefing.cells_per_side
    n_lanes = (side + _LANE_WIDTH - 1) // _LANE_WIDTH
    start = sector_start(briefing, uav, n_lanes * side, True)
    stop = sector_start(briefing, uav + 1, n_lanes * side, True)
    while start + memory[0] < stop:
        lane, row = (start + memory[0]) // side, (start + memory[0]) % side
        if lane % 2 == 1:
            row = side - 1 - row
        cell = row * side + (2 * lane + 1) * side // (2 * n_lanes)
        if _shows_unknown(briefing, belief, cell):
            return cell
        memory[0] += 1
    return -1


@kernel
def _shows_unknown(briefing: Briefing, belief: Belief, cell: int) -> bool:
    for index in range(VIEW_CELLS):
        seen = actions.neighbour(briefing, cell, index // 3 - 1, index % 3 - 1)
        if seen >= 0 and belief.complete[seen] == 0 and belief.seen_bit[seen] <= 0.0:
            return True
    return False


@kernel
def _nearest(briefing: Briefing, belief: Belief, cell: int, with_demand: bool) -> int:
    """The nearest incomplete cell, or only one where demand was seen; -1 if there is none."""
    nearest = -1
    least = 0
    for candidate in range(len(belief.complete)):
        if belief.complete[candidate] == 1 or (with_demand and belief.seen_bit[candidate] <= 0.0):
            continue
        distance = _distance(briefing, cell, candidate)
        if nearest < 0 or distance < least:
            nearest = candidate
            least = distance
    return nearest


@kernel
def _distance(briefing: Briefing, cell: int, other: int) -> int:
    side = briefing.cells_per_side
    return abs(cell // side - other // side) + abs(cell % side - other % side)

"""The way from cell to cell, move by move: straight on, or around closed cells."""

from typing import NamedTuple

from uav_collect.kernels.arrays import new_row, Row
from uav_collect.kernels.compile import kernel
from uav_collect.uav.action_codes import COLUMN_STEP, FORWARD, HOVER, N_ACTIONS, ROW_STEP
from uav_collect.uav.actions import neighbour
from uav_collect.uav.briefing import Briefing

NO_WAY = -1  # as a number of moves


class Moves(NamedTuple):
    """Rows to count moves in; without any where all cells of the area are open."""

    n_moves: Row[int]  # (C,) from the cell that was measured from last; NO_WAY
    queue: Row[int]  # (C,) cells in the order in which they are come to


def new_moves(briefing: Briefing) -> Moves:
    """Rows for the area of a briefing."""
    n_cells = len(briefing.is_open)
    size = 0 if sum(briefing.is_open) == n_cells else n_cells
    return Moves(n_moves=new_row(size, NO_WAY), queue=new_row(size, 0))


@kernel
def measure(briefing: Briefing, cell: int, moves: Moves) -> None:
    """Count the moves from a cell to every other one, where some are closed."""
    n_cells = len(moves.n_moves)
    if n_cells == 0:
        return
    for other in range(n_cells):
        moves.n_moves[other] = NO_WAY
    moves.n_moves[cell] = 0
    moves.queue[0] = cell
    n_known = 1
    for index in range(n_cells):
        if index >= n_known:
            return
        here = moves.queue[index]
        for action in range(FORWARD, N_ACTIONS):
            there = neighbour(briefing, here, ROW_STEP[action], COLUMN_STEP[action])
            if there >= 0 and moves.n_moves[there] == NO_WAY:
                moves.n_moves[there] = moves.n_moves[here] + 1
                moves.queue[n_known] = there
                n_known += 1


@kernel
def n_moves_to(briefing: Briefing, cell: int, other: int, moves: Moves) -> int:
    """The moves from a cell to another one, once they are measured from there, or NO_WAY."""
    if len(moves.n_moves) > 0:
        return moves.n_moves[other]
    n_columns = briefing.n_columns
    rows = abs(other // n_columns - cell // n_columns)
    return rows + abs(other % n_columns - cell % n_columns)


@kernel
def step(briefing: Briefing, cell: int, target: int, legal: Row[int], moves: Moves) -> int:
    """The legal move that leads nearest to a target; the moves are then those from there."""
    side, n_columns = max(briefing.n_rows, briefing.n_columns), briefing.n_columns
    measure(briefing, target, moves)
    best = HOVER
    best_cost = 0
    for action in range(FORWARD, N_ACTIONS):
        if legal[action] == 0:
            continue
        rows = abs(target // n_columns - cell // n_columns - ROW_STEP[action])
        columns = abs(target % n_columns - cell % n_columns - COLUMN_STEP[action])
        n_moves = rows + columns
        if len(moves.n_moves) > 0:
            n_moves = moves.n_moves[cell + ROW_STEP[action] * n_columns + COLUMN_STEP[action]]
        # Moves first; among equals the one that leaves the most balanced way.
        cost = n_moves * 4 * side + max(rows, columns)
        if best == HOVER or cost < best_cost:
            best = action
            best_cost = cost
    return best

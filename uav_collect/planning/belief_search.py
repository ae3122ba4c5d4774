"""Exact search over what one UAV can know of a tiny area, in kernels.

What a UAV knows is which cells it has seen, which of them still hold data, and how many ever did.
With its place and its last move that is a state. Nothing is learned between two events, which are
that the UAV serves a cell or sees new ones. The value of a state is the length of the way that is
expected until the UAV is home with all cells seen and all data collected; the search values each
state once that a best policy may come to.

Lengths are in sides of a cell. Sets of cells are the bits of an integer.
"""

import math
from typing import NamedTuple

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel, long_kernel
from uav_collect.uav.action_codes import FORWARD, N_ACTIONS, NONE
from uav_collect.uav.actions import opposite

MAX_CELLS = 25  # a state of so many is an integer of 63 bits
FREE = -1  # where the table holds no state
UNKNOWN = -1.0  # a value
STACK_SIZE = 4096
_MAX_LOAD = 0.75  # of the table

_BACK_BITS, _CELL_BITS = 3, 5
_HASH_BITS = 30


class BeliefSearch(NamedTuple):
    """An area, the law of its demand, and the states that are valued so far."""

    n_cells: int
    neighbour: Row[int]  # (C * A) by cell and move; NONE: there is none
    in_view: Row[int]  # (C,) the cells that are seen from one
    home: Row[float]  # (C,) way home
    pair_home: Row[float]  # (C * 2C * 2C) way from a cell over two tasks, in any order, home
    likelihood: Row[float]  # ((C + 1) * (C + 1)) that of so many cells those and only those hold
    # data that do, by how many do; the same whichever they are
    is_independent: int  # 1: what the other cells hold tells nothing of a cell
    side: int  # of a square that is alike north and east of its diagonal; 0: it is not one
    column: Row[int]  # (2^side) the cells of the southern row as those of the western column
    truth: Row[int]  # (1,) the cells that hold data, where the UAV knows beforehand; NONE
    key: Row[int]  # the states, FREE; a power of 2 of them
    value: Row[float]
    n_states: Row[int]  # (1,)
    stack: Row[int]  # states to be valued, the next one last
    n_stacked: Row[int]  # (1,)
    task: Row[int]  # (2C,) scratch; cells to serve by index, cells to see from C on
    queue: Row[int]  # (C * A) scratch; places with the move back, come to without an event
    length: Row[int]  # (C * A) scratch; of the way there, NONE
    first_move: Row[int]  # (C * A) scratch; of that way


@kernel
def count_cells(cells: int) -> int:
    """How many cells a set has."""
    n_cells = 0
    while cells != 0:
        cells &= cells - 1
        n_cells += 1
    return n_cells


@kernel
def state_of(
    search: BeliefSearch, seen: int, waiting: int, n_found: int, cell: int, back: int
) -> int:
    """The integer that stands for a state.

    Args:
        seen: cells that the UAV has seen.
        waiting: those of them that still hold data.
        n_found: how many of them ever did.
        back: the move that is not legal, straight back; 0 if all are.
    """
    n_cells = search.n_cells
    if search.is_independent == 1 or seen == (1 << n_cells) - 1:
        n_found = 0  # of no more use
    known = (n_found << n_cells | seen) << n_cells | waiting
    return (known << _CELL_BITS | cell) << _BACK_BITS | back


@kernel
def _one_of_mirrored(search: BeliefSearch, state: int) -> int:
    """The lesser of a state and its mirror image, where the two have the same value."""
    side = search.side
    if side == 0:
        return state
    seen, waiting, n_found, cell, back = _parts(search, state)
    if back > 0:  # north becomes east, south west
        back += 1 if back % 2 == 1 else -1
    mirrored_seen, mirrored_waiting = 0, 0
    for row in range(side):
        line = (1 << side) - 1
        mirrored_seen |= search.column[seen >> row * side & line] << row
        mirrored_waiting |= search.column[waiting >> row * side & line] << row
    cell = cell % side * side + cell // side
    return min(state, state_of(search, mirrored_seen, mirrored_waiting, n_found, cell, back))


@kernel
def _parts(search: BeliefSearch, state: int) -> tuple[int, int, int, int, int]:
    """What `state_of` made a state of."""
    n_cells = search.n_cells
    every = (1 << n_cells) - 1
    back = state & (1 << _BACK_BITS) - 1
    cell = state >> _BACK_BITS & (1 << _CELL_BITS) - 1
    known = state >> _BACK_BITS + _CELL_BITS
    return known >> n_cells & every, known & every, known >> 2 * n_cells, cell, back


@kernel
def place_of(search: BeliefSearch, state: int) -> int:
    """Where the table holds a state that `_one_of_mirrored` gave, or would."""
    mask, last = (1 << _HASH_BITS) - 1, len(search.key) - 1
    mixed = state ^ state >> 29
    mixed = (mixed & mask) * 0x5E3779B1 + (mixed >> _HASH_BITS & mask) * 0x45EBCA77
    place = (mixed ^ mixed >> 23) & last
    while search.key[place] != FREE and search.key[place] != state:
        place = place + 1 & last
    return place


@kernel
def value_of(search: BeliefSearch, state: int) -> float:
    """The value of a state, UNKNOWN if it must be valued first: then it is on the stack."""
    one = _one_of_mirrored(search, state)
    place = place_of(search, one)
    if search.key[place] == one:
        return search.value[place]
    search.stack[search.n_stacked[0]] = one
    search.n_stacked[0] += 1
    return UNKNOWN


@kernel
def least_length(search: BeliefSearch, unseen: int, waiting: int, cell: int) -> float:
    """No way home is shorter: that from a cell over any two tasks, to serve or to see a cell."""
    tasks, n_tasks, task = waiting | unseen << search.n_cells, 0, 0
    while tasks >> task != 0:
        if tasks >> task & 1:
            search.task[n_tasks] = task
            n_tasks += 1
        task += 1
    least, n_all = search.home[cell], 2 * search.n_cells
    for one in range(n_tasks):
        first = (cell * n_all + search.task[one]) * n_all
        for other in range(one + 1):
            least = max(least, search.pair_home[first + search.task[other]])
    return least


@kernel
def after_look(
    search: BeliefSearch, seen: int, waiting: int, n_found: int, cell: int, back: int
) -> float:
    """The value expected as a UAV has come to a cell, before it looks; it serves what waits there.

    Returns:
        UNKNOWN where a state that may follow must be valued first; they are on the stack then.
    """
    n_cells = search.n_cells
    every, new = (1 << n_cells) - 1, search.in_view[cell] & ~seen
    n_seen, all_seen = count_cells(seen), seen | new
    before = search.likelihood[n_seen * (n_cells + 1) + n_found]
    first = (n_seen + count_cells(new)) * (n_cells + 1) + n_found
    is_known, is_missing, expected = search.truth[0] != NONE, False, 0.0
    held = new & search.truth[0] if is_known else new
    while True:  # over what the new cells may hold, the sets within them
        n_held, chance = count_cells(held), 1.0
        if new != 0 and not is_known:
            chance = search.likelihood[first + n_held] / before
        if chance > 0.0:
            left = (waiting | held) & ~(1 << cell)
            value = search.home[cell]
            if left != 0 or all_seen != every:
                is_free = (waiting | held) >> cell & 1 == 1  # a hover lifts the ban
                next_back = 0 if is_free else back
                state = state_of(search, all_seen, left, n_found + n_held, cell, next_back)
                value = value_of(search, state)
                is_missing = is_missing or value == UNKNOWN
            expected += chance * value
        if held == 0 or is_known:
            return UNKNOWN if is_missing else expected
        held = (held - 1) & new


@kernel
def best_move(search: BeliefSearch, state: int) -> tuple[float, int]:
    """The value of a state and the move to begin with.

    Returns:
        UNKNOWN where a state that may follow must be valued first; they are on the stack then.
    """
    seen, waiting, n_found, start, back = _parts(search, state)
    unseen = (1 << search.n_cells) - 1 & ~seen
    for place in range(search.n_cells * N_ACTIONS):
        search.length[place] = NONE
    search.queue[0] = start * N_ACTIONS + back
    search.length[search.queue[0]] = 0
    n_queued, n_taken, value, chosen = 1, 0, math.inf, NONE
    while n_taken < n_queued:  # the ways on which nothing happens, the shortest first
        place = search.queue[n_taken]
        n_taken += 1
        cell, back, length = place // N_ACTIONS, place % N_ACTIONS, search.length[place] + 1
        for move in range(FORWARD, N_ACTIONS):
            there = search.neighbour[cell * N_ACTIONS + move]
            if there < 0 or (move == back and _n_ways(search, cell) > 1):
                continue
            is_served = (waiting >> there & 1) == 1
            way = there * N_ACTIONS + (0 if is_served else opposite(move))
            if search.length[way] != NONE:
                continue
            search.length[way] = length
            search.first_move[way] = move if n_taken == 1 else search.first_move[place]
            if not is_served and search.in_view[there] & ~seen == 0:
                search.queue[n_queued] = way
                n_queued += 1
                continue
            if length + least_length(search, unseen, waiting, there) >= value:
                continue
            after = after_look(search, seen, waiting, n_found, there, opposite(move))
            if after == UNKNOWN:
                return UNKNOWN, NONE
            if length + after < value:
                value, chosen = length + after, search.first_move[way]
    return value, chosen


@kernel
def _n_ways(search: BeliefSearch, cell: int) -> int:
    """The moves that lead from a cell to another."""
    n_ways = 0
    for move in range(FORWARD, N_ACTIONS):
        if search.neighbour[cell * N_ACTIONS + move] >= 0:
            n_ways += 1
    return n_ways


@long_kernel
def solve(search: BeliefSearch) -> bool:
    """Value the states on the stack, and all that it takes.

    Returns:
        Whether it is done; if not, the table must grow first.
    """
    room = int(_MAX_LOAD * len(search.key))
    while search.n_stacked[0] > 0:
        if search.n_states[0] >= room:
            return False
        state = search.stack[search.n_stacked[0] - 1]
        place = place_of(search, state)
        if search.key[place] == state:
            search.n_stacked[0] -= 1
            continue
        value, _ = best_move(search, state)
        if value != UNKNOWN:
            search.key[place] = state
            search.value[place] = value
            search.n_states[0] += 1
            search.n_stacked[0] -= 1
    return True


@long_kernel
def copy_states(search: BeliefSearch, other: BeliefSearch) -> None:
    """Put all states into another table."""
    for place in range(len(search.key)):
        if search.key[place] != FREE:
            there = place_of(other, search.key[place])
            other.key[there] = search.key[place]
            other.value[there] = search.value[place]

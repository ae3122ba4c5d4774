"""What one UAV imagines of the rest of a mission: futures, each flown to its end by a rule.

A future is drawn from what the UAV knows. Cells that it has seen hold what it saw; of the others,
those that it does not know to be complete hold data by the chance that the briefing gives. Other
UAVs fly by the rule as well, on from where they were last heard and by what they knew then. They
hear each other at once as soon as they are near. A cell's data comes up at one rate for all, so
that no sensor and no channel is needed: what an action is worth depends on the ways.
"""

from typing import NamedTuple

from uav_collect.kernels.arrays import new_map_table, new_row, new_table, Row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.keyed_random import draw_uniform, FUTURE
from uav_collect.uav import actions
from uav_collect.uav.action_codes import (
    BACKWARD,
    COLUMN_STEP,
    FORWARD,
    HOME,
    HOVER,
    LEFT,
    N_ACTIONS,
    NONE,
    RIGHT,
    ROW_STEP,
)
from uav_collect.uav.belief import Belief, belief_of, Beliefs, hear, NEVER, new_beliefs, observe
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.heuristics import choose, likely_memory, MEMORY_SIZE
from uav_collect.uav.moves import Moves
from uav_collect.uav.sharing import Shares
from uav_collect.uav.view import LocalView, new_view_rows, VIEW_CELLS, ViewRows


class Contacts(NamedTuple):
    """What a UAV remembers of the last time that it heard each other one; rows by UAV."""

    complete: Row[Row[int]]  # (U, C) its map then, which both had
    x_m: Row[float]  # (U,) where the other was
    y_m: Row[float]
    time_s: Row[float]  # (U,) when; NEVER
    heading: Row[int]  # (U,) the move that the other was on, as far as that shows; NONE


class Future(NamedTuple):
    """A mission as a UAV imagines it; rows by UAV unless said otherwise. Kernels write it."""

    beliefs: Beliefs  # (U, ...)
    memory: Row[Row[int]]  # (U, MEMORY_SIZE) of the rule
    drawn_bit: Row[float]  # (C,) data of each cell now
    cell_bit: Row[float]  # (C,) the same, not yet claimed
    from_x_m: Row[float]  # (U,) where the running action began
    from_y_m: Row[float]
    x_m: Row[float]  # (U,) where it ends
    y_m: Row[float]
    from_s: Row[float]  # (U,) when it began
    end_s: Row[float]
    energy_left_j: Row[float]  # (U,) at its end
    action: Row[int]  # (U,) the running one; HOME: the last
    legal: Row[int]  # (N_ACTIONS,) scratch
    view_rows: ViewRows  # scratch
    value: Row[float]  # (N_ACTIONS + 1,) of each action in this future [bit/J]
    gain: Row[float]  # the same, over what the rule would do, summed over the futures
    gain_squared: Row[float]  # the same, of the squares


def new_contacts(briefing: Briefing) -> Contacts:
    """What a UAV remembers before it has heard anybody: all start with what everybody knows."""
    n_uavs, n_cells = briefing.n_uavs, len(briefing.is_open)
    contacts = Contacts(
        complete=new_map_table(n_uavs, n_cells),
        x_m=new_row(n_uavs, 0.0),
        y_m=new_row(n_uavs, 0.0),
        time_s=new_row(n_uavs, NEVER),
        heading=new_row(n_uavs, NONE),
    )
    for uav in range(n_uavs):
        contacts.x_m[uav], contacts.y_m[uav] = briefing.start_x_m[uav], briefing.start_y_m[uav]
        for cell in range(n_cells):
            contacts.complete[uav][cell] = briefing.known_complete[cell]
    return contacts


def new_future(briefing: Briefing) -> Future:
    """Room for a future of a briefing's fleet."""
    n_uavs, n_cells = briefing.n_uavs, len(briefing.is_open)
    return Future(
        beliefs=new_beliefs(briefing, n_uavs),
        memory=new_table(n_uavs, MEMORY_SIZE, 0),
        drawn_bit=new_row(n_cells, 0.0),
        cell_bit=new_row(n_cells, 0.0),
        from_x_m=new_row(n_uavs, 0.0),
        from_y_m=new_row(n_uavs, 0.0),
        x_m=new_row(n_uavs, 0.0),
        y_m=new_row(n_uavs, 0.0),
        from_s=new_row(n_uavs, 0.0),
        end_s=new_row(n_uavs, 0.0),
        energy_left_j=new_row(n_uavs, 0.0),
        action=new_row(n_uavs, NONE),
        legal=new_row(N_ACTIONS, 0),
        view_rows=new_view_rows(1),
        value=new_row(N_ACTIONS + 1, 0.0),
        gain=new_row(N_ACTIONS + 1, 0.0),
        gain_squared=new_row(N_ACTIONS + 1, 0.0),
    )


@kernel
def note_contacts(briefing: Briefing, contacts: Contacts, belief: Belief) -> None:
    """Take in what was heard since the decision before."""
    for peer in range(briefing.n_uavs):
        if belief.peer_s[peer] <= contacts.time_s[peer]:
            continue
        x_m, y_m = belief.peer_x_m[peer], belief.peer_y_m[peer]
        contacts.heading[peer] = _heading(x_m - contacts.x_m[peer], y_m - contacts.y_m[peer])
        contacts.x_m[peer], contacts.y_m[peer] = x_m, y_m
        contacts.time_s[peer] = belief.peer_s[peer]
        for cell in range(len(belief.complete)):
            contacts.complete[peer][cell] = belief.complete[cell]


@kernel
def _heading(east_m: float, north_m: float) -> int:
    """The move along the longer part of a way; NONE where there is no way."""
    if abs(east_m) > abs(north_m):
        return RIGHT if east_m > 0.0 else LEFT
    if north_m == 0.0:
        return NONE
    return FORWARD if north_m > 0.0 else BACKWARD


@kernel
def draw_future(
    briefing: Briefing, belief: Belief, future: Future, uav: int, time_s: float, number: int
) -> None:
    """Draw what the cells hold, by who decides, when, and the future's number.

    No UAV knows the seed of its mission; when it decides follows from that, and differs.
    """
    n_cells, seed = len(future.drawn_bit), int(time_s * 1e6)
    for cell in range(n_cells):
        future.drawn_bit[cell] = 0.0
        if belief.complete[cell] == 1:
            continue
        if belief.seen_bit[cell] > 0.0:
            future.drawn_bit[cell] = belief.seen_bit[cell]
        elif draw_uniform(seed, FUTURE, uav, number, cell) < briefing.data_chance:
            future.drawn_bit[cell] = briefing.cell_data_bit


@kernel
def begin_future(
    rule: int,
    briefing: Briefing,
    shares: Shares,
    uav: int,
    belief: Belief,
    view: LocalView,
    memory: Row[int],
    contacts: Contacts,
    future: Future,
) -> None:
    """Put a future back to now: the UAV decides, and the others fly since they were heard."""
    for cell in range(len(future.cell_bit)):
        future.cell_bit[cell] = future.drawn_bit[cell]
    for each in range(briefing.n_uavs):
        own = belief_of(future.beliefs, each)
        is_self, n_complete = each == uav, 0
        for cell in range(len(own.complete)):
            known = belief.complete[cell] if is_self else contacts.complete[each][cell]
            own.complete[cell] = known
            n_complete += known
            own.seen_bit[cell] = belief.seen_bit[cell] if is_self else 0.0
        own.n_complete[0] = n_complete
        for other in range(briefing.n_uavs):
            own.peer_x_m[other] = belief.peer_x_m[other]
            own.peer_y_m[other] = belief.peer_y_m[other]
            own.peer_s[other] = belief.peer_s[other]
            if not is_self:
                own.peer_s[other] = min(belief.peer_s[other], contacts.time_s[each])
        if is_self:
            _place(future, uav, view.x_m, view.y_m, view.time_s, view.previous_action)
            future.energy_left_j[uav] = view.energy_left_j
            for index in range(MEMORY_SIZE):
                future.memory[uav][index] = memory[index]
        else:
            own.peer_s[uav] = contacts.time_s[each]
            _place_other(rule, briefing, shares, contacts, each, future)


@kernel
def _place(future: Future, uav: int, x_m: float, y_m: float, time_s: float, action: int) -> None:
    future.from_x_m[uav], future.from_y_m[uav], future.from_s[uav] = x_m, y_m, time_s
    future.x_m[uav], future.y_m[uav], future.end_s[uav] = x_m, y_m, time_s
    future.action[uav] = action


@kernel
def _place_other(
    rule: int, briefing: Briefing, shares: Shares, contacts: Contacts, uav: int, future: Future
) -> None:
    """Let a UAV be on its way from where it was heard to the centre that it makes for.

    It was on the way from one cell's centre to the next, or at one; whither, its way before tells.
    """
    x_m, y_m, size_m = contacts.x_m[uav], contacts.y_m[uav], briefing.cell_size_m
    start_s = max(contacts.time_s[uav], 0.0)
    _place(future, uav, x_m, y_m, start_s, NONE)
    column = min(int(x_m / size_m), briefing.n_columns - 1)
    row = min(int(y_m / size_m), briefing.n_rows - 1)
    cell, action = row * briefing.n_columns + column, contacts.heading[uav]
    if action != NONE:
        east_m, north_m = x_m - (column + 0.5) * size_m, y_m - (row + 0.5) * size_m
        ahead_m = east_m * COLUMN_STEP[action] + north_m * ROW_STEP[action]
        following = actions.neighbour(briefing, cell, ROW_STEP[action], COLUMN_STEP[action])
        if ahead_m > 0.0 and following >= 0:
            cell = following
    future.action[uav] = action
    future.x_m[uav] = (cell % briefing.n_columns + 0.5) * size_m
    future.y_m[uav] = (cell // briefing.n_columns + 0.5) * size_m
    left_m = abs(future.x_m[uav] - x_m) + abs(future.y_m[uav] - y_m)
    future.end_s[uav] = start_s + left_m / briefing.speed_mps[uav]
    spent_j = briefing.flight_power_w[uav] * future.end_s[uav]
    future.energy_left_j[uav] = briefing.energy_budget_j[uav] - spent_j
    for index in range(MEMORY_SIZE):
        future.memory[uav][index] = likely_memory(rule, briefing, shares, uav, cell)


@kernel
def fly_future(
    rule: int,
    briefing: Briefing,
    shares: Shares,
    moves: Moves,
    uav: int,
    first_action: int,
    future: Future,
) -> float:
    """Fly a future to its end; each round is a UAV whose action ends, as in the world.

    Args:
        first_action: of the UAV that imagines it.

    Returns:
        The data of the whole mission, as far as can be guessed, over its energy [bit/J].
    """
    now_s, is_first = future.end_s[uav], True
    bit = _past_bit(briefing, belief_of(future.beliefs, uav))
    while True:
        deciding = _next(future)
        if deciding < 0:
            return bit / _spent_j(briefing, future)
        belief, view = belief_of(future.beliefs, deciding), _look(briefing, future, deciding)
        observe(belief, briefing, view)
        if deciding == uav and is_first:
            is_first = False
            bit += _start(briefing, future, deciding, view, first_action)
            continue
        if view.time_s >= now_s:  # before it nobody was near whom the UAV would not have heard
            _talk(briefing, future, deciding, view)
        action, legal = HOME, future.legal
        n_legal = actions.mark_legal(
            briefing,
            deciding,
            view.x_m,
            view.y_m,
            view.energy_left_j,
            view.previous_action,
            future.cell_bit[view.cell] / briefing.upload_bps,
            legal,
        )
        if belief.n_complete[0] < len(future.cell_bit) and n_legal > 0:
            memory = future.memory[deciding]
            action = choose(rule, briefing, shares, moves, deciding, belief, view, legal, memory)
        bit += _start(briefing, future, deciding, view, action)


@kernel
def _past_bit(briefing: Briefing, belief: Belief) -> float:
    """What the fleet has collected so far, as far as a map tells."""
    n_complete = belief.n_complete[0]
    for cell in range(len(belief.complete)):
        n_complete -= briefing.known_complete[cell]
    return n_complete * briefing.data_chance * briefing.cell_data_bit


@kernel
def _spent_j(briefing: Briefing, future: Future) -> float:
    spent_j = 0.0
    for uav in range(briefing.n_uavs):
        spent_j += briefing.energy_budget_j[uav] - future.energy_left_j[uav]
    return max(spent_j, 1.0)


@kernel
def _next(future: Future) -> int:
    """As `world.dynamics.next_uav`: earliest end, ties to the lowest index; -1: none decides."""
    chosen = -1
    for uav in range(len(future.end_s)):
        if future.action[uav] != HOME and (chosen < 0 or future.end_s[uav] < future.end_s[chosen]):
            chosen = uav
    return chosen


@kernel
def _look(briefing: Briefing, future: Future, uav: int) -> LocalView:
    rows, x_m, y_m = future.view_rows, future.x_m[uav], future.y_m[uav]
    cell = actions.cell_under(briefing, x_m, y_m)
    for index in range(VIEW_CELLS):
        seen = actions.neighbour(briefing, cell, index // 3 - 1, index % 3 - 1)
        rows.region_bit[index] = future.cell_bit[seen] if seen >= 0 else 0.0
    return LocalView(
        future.end_s[uav],
        x_m,
        y_m,
        cell,
        future.energy_left_j[uav],
        future.action[uav],
        rows.region_bit,
        0,  # sensors: rules do not look at them
        rows.sensor,
        rows.sensor_bit,
        rows.sensor_gain,
        rows.sensor_error_gain,
    )


@kernel
def _talk(briefing: Briefing, future: Future, uav: int, view: LocalView) -> None:
    """Let a UAV that decides and those in its range hear each other."""
    belief, time_s = belief_of(future.beliefs, uav), view.time_s
    for other in range(briefing.n_uavs):
        is_landed = future.action[other] == HOME and future.end_s[other] <= time_s
        if other == uav or is_landed:
            continue
        lasts_s, share = future.end_s[other] - future.from_s[other], 1.0
        if time_s < future.end_s[other] and lasts_s > 0.0:
            share = max(time_s - future.from_s[other], 0.0) / lasts_s
        x_m = future.from_x_m[other] + (future.x_m[other] - future.from_x_m[other]) * share
        y_m = future.from_y_m[other] + (future.y_m[other] - future.from_y_m[other]) * share
        east_m, north_m, range_m = x_m - view.x_m, y_m - view.y_m, briefing.contact_range_m
        if east_m * east_m + north_m * north_m <= range_m * range_m:
            theirs = belief_of(future.beliefs, other)
            hear(belief, other, theirs.complete, x_m, y_m, time_s)
            hear(theirs, uav, belief.complete, view.x_m, view.y_m, time_s)


@kernel
def _start(briefing: Briefing, future: Future, uav: int, view: LocalView, action: int) -> float:
    """Start a UAV's action; the data that it collects [bit]."""
    bit, power_w = 0.0, briefing.flight_power_w[uav]
    x_m, y_m = view.x_m, view.y_m
    if action == HOVER:
        bit, power_w = future.cell_bit[view.cell], briefing.hover_power_w[uav]
        future.cell_bit[view.cell] = 0.0
        lasts_s = bit / briefing.upload_bps
    elif action == HOME:
        lasts_s = actions.home_duration_s(briefing, uav, x_m, y_m)
        x_m, y_m = briefing.home_x_m[uav], briefing.home_y_m[uav]
    else:
        lasts_s = actions.move_duration_s(briefing, uav)
        x_m += COLUMN_STEP[action] * briefing.cell_size_m
        y_m += ROW_STEP[action] * briefing.cell_size_m
    future.from_x_m[uav], future.from_y_m[uav], future.from_s[uav] = (
        view.x_m,
        view.y_m,
        view.time_s,
    )
    future.x_m[uav], future.y_m[uav], future.end_s[uav] = x_m, y_m, view.time_s + lasts_s
    future.energy_left_j[uav] -= power_w * lasts_s
    future.action[uav] = action
    return bit

"""The policies that are rules: HERT, the paper's baseline; a stronger sweep; random legal actions.

All three decide on what one UAV knows, as a learned policy does: its belief, its local view and
the legal actions. What they make of the briefing, a tour and each UAV's share of it, is theirs
from the start. `memory` is what a rule remembers between decisions, zeros at the start.
"""

from dataclasses import dataclass, field
from enum import IntEnum
import math

from uav_collect.kernels.arrays import new_row, Row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.keyed_random import draw_uniform, EXPLORATION
from uav_collect.uav.action_codes import HOME, HOVER, N_ACTIONS
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.moves import measure, Moves, new_moves, NO_WAY, step
from uav_collect.uav.sharing import no_shares, Shares, shares_of
from uav_collect.uav.view import LocalView

MEMORY_SIZE = 1
_STOPS_DONE = 0  # HERT: stops of the sector behind it; random: draws made

_STAY, _LAND = -1, -2  # instead of a cell to make for: to hover, to fly home and land

_UNSEEN_CELLS = 2  # further away a cell counts whose demand is not known yet
_OTHERS = 1_000_000  # moves that a cell of another's piece seems further away
_PATIENCE = 1.5  # planned ends after which the sweep no longer waits for the others
_SILENCE = 1.2  # planned ends that whoever still comes home is silent for at most


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


@dataclass
class RulePolicy:
    """A heuristic behind the protocol `policy.Policy`."""

    heuristic: Heuristic
    _briefing: Briefing | None = field(default=None, init=False)
    _uav: int = field(default=0, init=False)
    _memory: Row[int] = field(default_factory=lambda: new_row(MEMORY_SIZE, 0), init=False)
    _shares: Shares = field(default_factory=no_shares, init=False)
    _moves: Moves | None = field(default=None, init=False)

    @property
    def name(self) -> str:
        """The heuristic's name."""
        return self.heuristic.label

    @property
    def version(self) -> str:
        """Rules do not change while they fly."""
        return 'rule'

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index."""
        if briefing is not self._briefing:
            self._shares, self._moves = shares_for(self.heuristic, briefing), new_moves(briefing)
        self._briefing = briefing
        self._uav = uav
        self._memory = new_row(MEMORY_SIZE, 0)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """One of the legal actions, or action_codes.HOME to end the mission."""
        if self._briefing is None or self._moves is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        ways = self._shares, self._moves
        return choose(
            self.heuristic, self._briefing, *ways, self._uav, belief, view, legal, self._memory
        )


def shares_for(heuristic: int, briefing: Briefing) -> Shares:
    """What a rule knows of the fleet's ways, nothing where it follows none."""
    if heuristic in (Heuristic.HERT, Heuristic.HERT_EQUAL, Heuristic.SWEEP):
        return shares_of(briefing)
    return no_shares()


@kernel
def choose(
    heuristic: int,
    briefing: Briefing,
    shares: Shares,
    moves: Moves,
    uav: int,
    belief: Belief,
    view: LocalView,
    legal: Row[int],
    memory: Row[int],
) -> int:
    """The action that a rule takes; HOME ends the UAV's mission.

    The sweep has no memory: what it does follows from what the UAV knows now.

    Args:
        shares: what `shares_for` gives.
        moves: scratch.
        legal: 1 for each legal action, shape (N_ACTIONS,), at least one.
        memory: read and written, shape (MEMORY_SIZE,).
    """
    if heuristic == Heuristic.RANDOM:
        return _choose_random(uav, view, legal, memory)
    if heuristic == Heuristic.SWEEP:
        target = _next_of_sweep(briefing, shares, moves, uav, belief, view, legal)
    elif legal[HOVER] == 1:
        return HOVER
    else:
        target = _next_of_hert(heuristic == Heuristic.HERT, briefing, shares, uav, view, memory)
    if target < 0:
        return HOME if target == _LAND else HOVER
    return step(briefing, view.cell, target, legal, moves)


@kernel
def likely_memory(heuristic: int, briefing: Briefing, shares: Shares, uav: int, cell: int) -> int:
    """What a rule most likely remembers, for who only knows over which cell its UAV is.

    Returns:
        What each place of its `memory` holds.
    """
    if heuristic != Heuristic.HERT and heuristic != Heuristic.HERT_EQUAL:
        return 0
    by_speed = heuristic == Heuristic.HERT
    start = sector_start(briefing, uav, len(shares.order), by_speed)
    for place in range(start, sector_start(briefing, uav + 1, len(shares.order), by_speed)):
        if shares.order[place] == cell:
            return place - start
    return 0


@kernel
def place_in_piece(shares: Shares, uav: int, cell: int) -> int:
    """Places of the tour between where a UAV begins and a cell, in the UAV's direction."""
    return shares.direction[uav] * (shares.place[cell] - shares.anchor[uav]) % shares.n_places


@kernel
def is_own_place(shares: Shares, uav: int, cell: int) -> bool:
    """Whether a cell that needs a visit lies in a UAV's own piece of the tour."""
    return place_in_piece(shares, uav, cell) < shares.n_own[uav]


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
def _choose_random(uav: int, view: LocalView, legal: Row[int], memory: Row[int]) -> int:
    n_legal = 0
    for action in range(N_ACTIONS):
        n_legal += legal[action]
    uniform = draw_uniform(0, EXPLORATION, uav, memory[_STOPS_DONE], int(view.time_s * 1000.0))
    memory[_STOPS_DONE] += 1
    chosen = int(uniform * n_legal)
    for action in range(N_ACTIONS):
        if legal[action] == 1:
            if chosen == 0:
                return action
            chosen -= 1
    return HOME


@kernel
def _next_of_hert(
    by_speed: bool, briefing: Briefing, shares: Shares, uav: int, view: LocalView, memory: Row[int]
) -> int:
    """The cell that HERT makes for in its sector, a share of the order of cells; _LAND: none."""
    start = sector_start(briefing, uav, len(shares.order), by_speed)
    stop = sector_start(briefing, uav + 1, len(shares.order), by_speed)
    place = start + memory[_STOPS_DONE]
    if place < stop and view.cell == shares.order[place]:
        memory[_STOPS_DONE] += 1
        place += 1
    return shares.order[place] if place < stop else _LAND


@kernel
def _next_of_sweep(
    briefing: Briefing,
    shares: Shares,
    moves: Moves,
    uav: int,
    belief: Belief,
    view: LocalView,
    legal: Row[int],
) -> int:
    """The cell that the sweep makes for, _STAY or _LAND.

    UAVs share a tour through all cells that need a visit: `uav.sharing` says how. From its
    incomplete cells a UAV picks the nearest, where the way counts as much as the order on the
    tour. In the others' pieces it goes once its own is complete, and only where it would be back
    by the planned end, else home: there they come by and tell what they know. If they are late, or
    silent for longer than their part takes and nobody else serves that, it looks for itself. Where
    UAVs part, or hear nothing at all, each trusts the others to do their parts, and lands.
    """
    target = _next_cell(briefing, shares, moves, uav, belief, view)
    if legal[HOVER] == 1:
        # On its way to a far piece it leaves to others what is theirs.
        is_own = is_own_place(shares, uav, view.cell)
        if is_own or target < 0 or not is_own_place(shares, uav, target):
            return _STAY
    if target >= 0:
        return target
    return _LAND if _trusts_others(briefing, shares) else briefing.home_cell[uav]


@kernel
def _trusts_others(briefing: Briefing, shares: Shares) -> bool:
    """Whether each UAV leaves to the others what is theirs, and lands once its own is done."""
    return briefing.contact_range_m <= 0.0 or shares.parts == 1


@kernel
def _next_cell(
    briefing: Briefing,
    shares: Shares,
    moves: Moves,
    uav: int,
    belief: Belief,
    view: LocalView,
) -> int:
    """The incomplete cell to make for; -1 when there is none but what the others will tell of."""
    n_columns, n_cells = briefing.n_columns, len(belief.complete)
    own_row, own_column = view.cell // n_columns, view.cell % n_columns
    reach = _reach(briefing, shares, uav, belief, view)
    measure(briefing, view.cell, moves)
    nearest, least = -1, 0
    for column in range(n_columns):
        columns = abs(column - own_column)
        for row in range(briefing.n_rows):
            cell = row * n_columns + column
            if belief.complete[cell] == 1 or cell == view.cell:
                continue
            way = abs(row - own_row) + columns
            if len(moves.n_moves) > 0:
                way = moves.n_moves[cell]
                if way == NO_WAY:
                    continue
            if belief.seen_bit[cell] <= 0.0:
                # It is seen from the cells around it, and may hold nothing.
                way += _UNSEEN_CELLS - (row != own_row) - (columns > 0)
            offset = place_in_piece(shares, uav, cell)
            is_far = offset >= shares.n_own[uav]
            rank = way + offset + (_OTHERS if is_far else 0)
            if nearest >= 0 and rank >= least:
                continue
            if is_far and way + shares.cells_home[uav * n_cells + cell] > reach:
                continue
            nearest = cell
            least = rank
    return nearest


@kernel
def _reach(briefing: Briefing, shares: Shares, uav: int, belief: Belief, view: LocalView) -> float:
    """Cells that a UAV may fly to serve in the others' pieces and be home; -1: none at all."""
    if _trusts_others(briefing, shares):
        return -1.0
    if not _awaits_news(shares, uav, belief, view):
        return math.inf
    left_s = shares.planned_s - view.time_s
    return left_s * briefing.speed_mps[uav] / briefing.cell_size_m


@kernel
def _awaits_news(shares: Shares, uav: int, belief: Belief, view: LocalView) -> bool:
    """Whether the others are still expected at home, to tell what they know."""
    if view.time_s >= _PATIENCE * shares.planned_s or shares.meets[uav] == 0:
        return False
    # The last piece may be that of a single UAV: if it is silent for longer than that takes,
    # nobody serves it. What one of a pair leaves, the other serves without having heard of it.
    alone = shares.alone
    if alone < 0 or alone == uav:
        return True
    return view.time_s - max(belief.peer_s[alone], 0.0) <= _SILENCE * shares.planned_s

"""The policies that are rules: HERT, the paper's baseline; a stronger sweep; random legal actions.

All three decide on what one UAV knows, as a learned policy does: its belief, its local view and
the legal actions. `memory` is what a rule remembers between decisions, zeros at the start.
"""

from dataclasses import dataclass, field
from enum import IntEnum
import math

from uav_collect.kernels.arrays import new_row, Row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.keyed_random import draw_uniform, EXPLORATION
from uav_collect.uav import actions
from uav_collect.uav.action_codes import COLUMN_STEP, FORWARD, HOME, HOVER, N_ACTIONS, ROW_STEP
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.view import LocalView

MEMORY_SIZE = 4
_STOPS_DONE = 0  # HERT: stops of the sector behind it; random: draws made

# The sweep's plan in its memory; places count stops of the tour from its beginning.
_PLANNED_S = 0  # when all shall be home [s]; 0 before there is a plan
_ANCHOR = 1  # the place where the UAV begins
_N_STOPS = 2  # of its piece of the tour; where UAVs hear nothing, of its own part of that
_DIRECTION = 3  # 1 along the tour, -1 against it

_LANE_WIDTH = 3  # columns that one flight along a lane's middle sees
_MOVES_PER_STOP = 2.0  # planned for a stop of the tour with its detours and hovers
_UNSEEN_CELLS = 2  # further away a cell counts whose demand is not known yet
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
        self._briefing = briefing
        self._uav = uav
        self._memory = new_row(MEMORY_SIZE, 0)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """One of the legal actions, or action_codes.HOME to end the mission."""
        if self._briefing is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        return choose(self.heuristic, self._briefing, self._uav, belief, view, legal, self._memory)


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
    if heuristic == Heuristic.SWEEP:
        return _choose_sweep(briefing, uav, belief, view, legal, memory)
    if legal[HOVER] == 1:
        return HOVER
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
    if start + memory[_STOPS_DONE] < stop and view.cell == _boustrophedon(
        briefing, start + memory[_STOPS_DONE]
    ):
        memory[_STOPS_DONE] += 1
    if start + memory[_STOPS_DONE] >= stop:
        return HOME
    return step_towards(
        briefing, view.cell, _boustrophedon(briefing, start + memory[_STOPS_DONE]), legal
    )


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
    """Fly a piece of a tour over the area, collect what it shows, then help the others.

    The tour goes up one lane of cells and down the next. The lanes are even in number, so that it
    ends on the side where it began, and at most as wide as a UAV sees. UAVs share the tour in
    pairs, the slowest first: one flies from each end of the pair's piece until they meet. From
    its incomplete cells a UAV picks the nearest, where the way counts as much as the order on the
    tour. In the others' pieces it goes only where it would be back by the planned end, else home:
    there they come by and tell what they know. If they are late, or silent for longer than their
    part takes and nobody else serves that, it looks for itself. Where UAVs hear nothing at all,
    each trusts the others to do their parts.
    """
    if memory[_PLANNED_S] == 0:
        _plan(briefing, uav, memory)
    target = _next_cell(briefing, uav, belief, view, memory)
    if legal[HOVER] == 1:
        # On its way to a far piece it leaves to others what is theirs.
        is_own = _offset(briefing, view.cell, memory) < memory[_N_STOPS]
        if is_own or target < 0 or _offset(briefing, target, memory) >= memory[_N_STOPS]:
            return HOVER
    if target < 0 and _is_deaf(briefing):
        return HOME
    if target < 0:
        target = actions.cell_at(briefing, briefing.home_x_m[uav], briefing.home_y_m[uav])
    return step_towards(briefing, view.cell, target, legal)


@kernel
def _next_cell(
    briefing: Briefing, uav: int, belief: Belief, view: LocalView, memory: Row[int]
) -> int:
    """The cell to make for; -1 when there is none but what the others will tell of."""
    side = briefing.cells_per_side
    n_stops = _n_lanes(briefing) * side
    own_row, own_column = view.cell // side, view.cell % side
    is_deaf = _is_deaf(briefing)
    waits = _awaits_news(briefing, uav, belief, view, memory)
    left_s = memory[_PLANNED_S] - view.time_s
    reach = left_s * briefing.speed_mps[uav] / briefing.cell_size_m
    home_x_m, home_y_m = briefing.home_x_m[uav], briefing.home_y_m[uav]
    nearest = -1
    least = 0
    for column in range(side):
        first, step = _lane_places(briefing, column)
        first = memory[_DIRECTION] * (first - memory[_ANCHOR])
        step = memory[_DIRECTION] * step
        columns = abs(column - own_column)
        for row in range(side):
            cell = row * side + column
            if belief.complete[cell] == 1 or cell == view.cell:
                continue
            way = abs(row - own_row) + columns
            if belief.seen_bit[cell] <= 0.0:
                # It is seen from the cells around it, and may hold nothing.
                way += _UNSEEN_CELLS - (row != own_row) - (columns > 0)
            offset = (first + step * row) % n_stops
            if nearest >= 0 and way + offset >= least:
                continue
            is_far = offset >= memory[_N_STOPS]
            if is_far and is_deaf:
                continue
            if is_far and waits and way + _cells_from(briefing, cell, home_x_m, home_y_m) > reach:
                continue
            nearest = cell
            least = way + offset
    return nearest


@kernel
def _is_deaf(briefing: Briefing) -> bool:
    """Whether no UAV of the fleet ever hears another one."""
    return briefing.contact_range_m <= 0.0


@kernel
def _awaits_news(
    briefing: Briefing, uav: int, belief: Belief, view: LocalView, memory: Row[int]
) -> bool:
    """Whether the others are still expected at home, to tell what they know."""
    planned_s = memory[_PLANNED_S]
    if view.time_s >= _PATIENCE * planned_s or not _meet_at_home(briefing, uav):
        return False
    if briefing.n_uavs % 2 == 0:
        return True
    # The last piece is that of a single UAV: if it is silent for longer than that takes, nobody
    # serves it. What one of a pair leaves, the other serves without having heard of it.
    alone = _next_faster(briefing, -1)
    while _next_faster(briefing, alone) >= 0:
        alone = _next_faster(briefing, alone)
    silent_s = view.time_s - max(belief.peer_s[alone], 0.0)
    return alone == uav or silent_s <= _SILENCE * planned_s


@kernel
def _meet_at_home(briefing: Briefing, uav: int) -> bool:
    """Whether a UAV that waits at its home hears all the others when they come home."""
    for other in range(briefing.n_uavs):
        east_m = briefing.home_x_m[other] - briefing.home_x_m[uav]
        north_m = briefing.home_y_m[other] - briefing.home_y_m[uav]
        if math.sqrt(east_m * east_m + north_m * north_m) >= briefing.contact_range_m:
            return False
    return True


@kernel
def _cells_from(briefing: Briefing, cell: int, x_m: float, y_m: float) -> float:
    """The straight way from a point to a cell, in cells."""
    rows = y_m / briefing.cell_size_m - (cell // briefing.cells_per_side + 0.5)
    columns = x_m / briefing.cell_size_m - (cell % briefing.cells_per_side + 0.5)
    return math.sqrt(rows * rows + columns * columns)


@kernel
def _n_lanes(briefing: Briefing) -> int:
    return 2 * ((briefing.cells_per_side + 2 * _LANE_WIDTH - 1) // (2 * _LANE_WIDTH))


@kernel
def _lane_places(briefing: Briefing, column: int) -> tuple[int, int]:
    """The tour's place at a column's southern end, and how it changes from row to row.

    The tour begins at the side of the first UAV's home.
    """
    side = briefing.cells_per_side
    middle_m = side * briefing.cell_size_m / 2.0
    if briefing.home_x_m[0] > middle_m:
        column = side - 1 - column
    lane = ((column + 1) * _n_lanes(briefing) - 1) // side
    if (lane % 2 == 0) == (briefing.home_y_m[0] <= middle_m):
        return lane * side, 1
    return lane * side + side - 1, -1


@kernel
def _offset(briefing: Briefing, cell: int, memory: Row[int]) -> int:
    """Stops of the tour between where a UAV begins and a cell, in the UAV's direction."""
    side = briefing.cells_per_side
    first, step = _lane_places(briefing, cell % side)
    place = first + step * (cell // side)
    return memory[_DIRECTION] * (place - memory[_ANCHOR]) % (_n_lanes(briefing) * side)


@kernel
def _stop_cell(briefing: Briefing, place: int) -> int:
    """The cell in the middle of a lane at a place of the tour."""
    side = briefing.cells_per_side
    column = (2 * (place // side) + 1) * side // (2 * _n_lanes(briefing))
    if 2.0 * briefing.home_x_m[0] > side * briefing.cell_size_m:
        column = side - 1 - column
    first, step = _lane_places(briefing, column)
    return (place - first) * step * side + column


@kernel
def _plan(briefing: Briefing, uav: int, memory: Row[int]) -> None:
    """Find the shortest time in which all could be home, and the UAV's piece of the tour."""
    n_stops = _n_lanes(briefing) * briefing.cells_per_side
    long_s = 1
    while _share_tour(briefing, uav, long_s, memory) < n_stops:
        long_s *= 2
    short_s = long_s // 2
    while long_s - short_s > 1:
        middle_s = (short_s + long_s) // 2
        if _share_tour(briefing, uav, middle_s, memory) < n_stops:
            short_s = middle_s
        else:
            long_s = middle_s
    _share_tour(briefing, uav, long_s, memory)
    memory[_PLANNED_S] = long_s


@kernel
def _share_tour(briefing: Briefing, uav: int, planned_s: int, memory: Row[int]) -> int:
    """Give each pair the stops it can serve in a time, and note the UAV's piece.

    Returns:
        How many stops all serve together.
    """
    begin, n_stops = 0, _n_lanes(briefing) * briefing.cells_per_side
    first = _next_faster(briefing, -1)
    while first >= 0:
        second = _next_faster(briefing, first)
        served = _stops_served(briefing, first, planned_s, begin)
        end = begin
        while end < n_stops:
            room = served + _stops_served(briefing, second, planned_s, end) - (end - begin)
            if room < 1.0:
                break
            # The place itself costs a stop and, further away, hardly more than three others.
            end = min(end + max(int(room / 4.0), 1), n_stops)
        if uav in (first, second):
            memory[_ANCHOR] = begin if uav == first else end - 1
            memory[_DIRECTION] = 1 if uav == first else -1
            memory[_N_STOPS] = end - begin
            if _is_deaf(briefing) and second >= 0:
                # They would not notice that they meet.
                n_first = 0
                if end > begin:
                    both = served + _stops_served(briefing, second, planned_s, end)
                    n_first = int((end - begin) * served / both + 0.5)
                memory[_N_STOPS] = n_first if uav == first else end - begin - n_first
        begin = end
        first = _next_faster(briefing, second) if second >= 0 else -1
    return begin


@kernel
def _next_faster(briefing: Briefing, uav: int) -> int:
    """The UAV next to another by speed, then index; -1 is before the first and after the last."""
    found = -1
    for other in range(briefing.n_uavs):
        speed_mps = briefing.speed_mps[other]
        if uav >= 0:
            ahead_mps = speed_mps - briefing.speed_mps[uav]
            if ahead_mps < 0.0 or (ahead_mps == 0.0 and other <= uav):
                continue
        if found < 0 or speed_mps < briefing.speed_mps[found]:
            found = other
    return found


@kernel
def _stops_served(briefing: Briefing, uav: int, planned_s: int, place: int) -> float:
    """How many stops about a place of the tour a UAV serves, if it is to be home in a time."""
    if uav < 0:
        return 0.0
    cell = _stop_cell(briefing, min(place, _n_lanes(briefing) * briefing.cells_per_side - 1))
    way = planned_s * briefing.speed_mps[uav] / briefing.cell_size_m
    way -= _cells_from(briefing, cell, briefing.start_x_m[uav], briefing.start_y_m[uav])
    way -= _cells_from(briefing, cell, briefing.home_x_m[uav], briefing.home_y_m[uav])
    return max(way / _MOVES_PER_STOP, 0.0)

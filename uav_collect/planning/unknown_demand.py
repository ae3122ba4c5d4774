"""The best that one UAV can do that does not know the demand, exactly, on tiny areas.

The cells must be alike: each has sensors, and how long a hover takes does not depend on when the
UAV comes. Then the chance that a cell not yet seen holds data follows from how many of those seen
did. Whatever the UAV does it hovers for the same cells, so the shortest way is the least time and
the least energy. Of all policies that collect everything it is the one of the shortest way on
average. A UAV over a cell with data hovers at once: where both were tried, on up to 3 x 3 cells,
it is never shorter to come back for it. Budgets are taken for large enough.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np
from uav_collect.kernels.arrays import Bools, Floats, Ints, new_row, Row, row_of
from uav_collect.planning.belief_search import (
    after_look,
    BeliefSearch,
    best_move,
    copy_states,
    count_cells,
    FREE,
    MAX_CELLS,
    solve,
    STACK_SIZE,
    state_of,
    UNKNOWN,
)
from uav_collect.scenario.area import mean_data_cells
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import COLUMN_STEP, HOVER, N_ACTIONS, NONE, ROW_STEP
from uav_collect.uav.actions import neighbour, opposite, start_cells
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.view import LocalView, VIEW_CELLS

_FIRST_BITS = 14  # of the table's size


def drawn_counts(scenario: Scenario) -> Floats:
    """How likely it is that so many cells hold data, as the world draws them, (C + 1,)."""
    n_cells, mean = scenario.n_cells, mean_data_cells(scenario)
    chances = np.zeros(n_cells + 1)
    if scenario.demand.cell_share == 'all':
        chances[n_cells] = 1.0
        return chances
    for count in range(n_cells):
        log_chance = count * math.log(mean) - mean - math.lgamma(count + 1)
        chances[max(count, 1)] += math.exp(log_chance)
    chances[n_cells] += 1.0 - chances.sum()
    return chances


def independent_counts(n_cells: int, share: float) -> Floats:
    """The same where each cell holds data with a chance of its own, (C + 1,)."""
    counts = range(n_cells + 1)
    return np.array(
        [math.comb(n_cells, k) * share**k * (1 - share) ** (n_cells - k) for k in counts]
    )


class UnknownDemand:
    """A UAV over a tiny area, and what is the best that it can do; lengths in sides of a cell."""

    def __init__(self, site: Site, counts: Floats, *, is_independent: bool = False) -> None:
        """Take the area and the law of its demand.

        Args:
            counts: how likely it is that so many cells hold data, whichever these are, (C + 1,).
            is_independent: whether each cell holds data with a chance of its own: what is known
                of the others is no news then.

        Raises:
            ValueError: more than one UAV or too many cells, or the cells are not alike.
        """
        briefing = briefing_of(site)
        check_alike(site, briefing, 1, MAX_CELLS)
        self.briefing = briefing
        [self._start] = start_cells(briefing)
        self._search = _new_search(briefing, self._start, counts, is_independent)

    @property
    def n_states(self) -> int:
        """How many states were valued so far."""
        return int(self._search.n_states[0])

    def expected_length(self) -> float:
        """The way that the best policy flies on average; no policy has a shorter one."""
        return self._length(NONE, 0, 0)

    def length_knowing(self, cells: Sequence[int], *, sees_all: bool) -> float:
        """The shortest way in a mission whose data cells are known beforehand.

        Args:
            cells: that hold data.
            sees_all: whether the UAV must see every cell all the same, as its mission ends no
                sooner.
        """
        truth = sum(1 << cell for cell in set(cells))
        every = (1 << self._search.n_cells) - 1
        return self._length(truth, *((0, 0) if sees_all else (every, truth)))

    def move(self, seen: int, waiting: int, n_found: int, cell: int, back: int) -> int:
        """The best move; arguments as of `belief_search.state_of`."""
        state = state_of(self._search, seen, waiting, n_found, cell, back)
        value, move = best_move(self._search, state)
        while value == UNKNOWN:
            self._solve()
            value, move = best_move(self._search, state)
        return move

    def _length(self, truth: int, seen: int, waiting: int) -> float:
        kept = self._search
        if truth != NONE:  # what is valued for one truth holds for no other, nor mirrored
            self._search = _with_table(kept, _FIRST_BITS)._replace(truth=row_of([truth]), side=0)
        value = UNKNOWN
        while value == UNKNOWN:
            value = after_look(self._search, seen, waiting, 0, self._start, 0)
            self._solve()
        if truth != NONE:
            self._search = kept
        return float(value)

    def _solve(self) -> None:
        while not solve(self._search):
            wider = _with_table(self._search, len(self._search.key).bit_length())
            copy_states(self._search, wider)
            wider.n_states[0] = self._search.n_states[0]
            for place in range(self._search.n_stacked[0]):
                wider.stack[place] = self._search.stack[place]
            wider.n_stacked[0] = self._search.n_stacked[0]
            self._search = wider


@dataclass
class BestPolicy:
    """Flies the best policy, by what its one UAV has seen."""

    best: UnknownDemand
    name: str = 'best of unknown demand'
    version: str = 'exact'
    _seen: int = field(default=0, init=False)
    _found: int = field(default=0, init=False)  # cells that held data when they were seen first

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission."""
        self._seen = self._found = 0

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """The best of the legal actions."""
        for index in range(VIEW_CELLS):
            row_step, column_step = index // 3 - 1, index % 3 - 1
            cell = neighbour(self.best.briefing, view.cell, row_step, column_step)
            if cell >= 0 and not self._seen >> cell & 1:
                self._seen |= 1 << cell
                self._found |= (view.region_bit[index] > 0.0) << cell
        if legal[HOVER] == 1:
            return HOVER
        waiting = sum(
            1 << cell
            for cell in range(len(belief.complete))
            if self._found >> cell & 1 and not belief.complete[cell]
        )
        back = max(opposite(view.previous_action), 0)
        n_found = int(count_cells(self._found))
        return int(self.best.move(self._seen, waiting, n_found, view.cell, back))


def check_alike(site: Site, briefing: Briefing, n_uavs: int, max_cells: int) -> None:
    """Refuse what is not searched.

    Raises:
        ValueError: other than so many UAVs, too many cells, or cells that are not alike.
    """
    n_cells = site.scenario.n_cells
    if briefing.n_uavs != n_uavs or n_cells > max_cells:
        what = f'{briefing.n_uavs} UAVs over {n_cells} cells'
        raise ValueError(f'{what}: must be {n_uavs} over {max_cells} cells at most')
    if sum(briefing.is_open) != n_cells or sum(briefing.known_complete) > 0:
        raise ValueError('some cells are closed, or known to be empty: all must be alike')


def _new_search(
    briefing: Briefing, start: int, counts: Floats, is_independent: bool
) -> BeliefSearch:
    n_cells, n_columns = briefing.n_rows * briefing.n_columns, briefing.n_columns
    cells = range(n_cells)
    neighbours = [
        neighbour(briefing, cell, ROW_STEP[action], COLUMN_STEP[action]) if action else NONE
        for cell in cells
        for action in range(N_ACTIONS)
    ]
    rows, columns = np.divmod(np.arange(n_cells), n_columns)
    apart = np.maximum(abs(rows[:, None] - rows), abs(columns[:, None] - columns))
    size_m = briefing.cell_size_m
    home_x, home_y = briefing.home_x_m[0] / size_m - 0.5, briefing.home_y_m[0] / size_m - 0.5
    home = np.hypot(columns - home_x, rows - home_y)
    is_alike = n_columns == briefing.n_rows and start % (n_columns + 1) == 0 and home_x == home_y
    side = n_columns if is_alike else 0
    mirrored = [
        sum((line >> place & 1) << place * side for place in range(side))
        for line in range(1 << side)
    ]
    return BeliefSearch(
        n_cells=n_cells,
        neighbour=row_of(neighbours),
        in_view=row_of([sum(1 << int(cell) for cell in np.flatnonzero(row < 2)) for row in apart]),
        home=row_of(home.tolist()),
        pair_home=row_of(_pair_ways(rows, columns, apart < 2, home).ravel().tolist()),
        likelihood=row_of(likelihoods(counts).ravel().tolist()),
        is_independent=int(is_independent),
        side=side,
        column=row_of(mirrored),
        truth=row_of([NONE]),
        key=new_row(1 << _FIRST_BITS, FREE),
        value=new_row(1 << _FIRST_BITS, 0.0),
        n_states=new_row(1, 0),
        stack=new_row(STACK_SIZE, 0),
        n_stacked=new_row(1, 0),
        task=new_row(2 * n_cells, 0),
        queue=new_row(n_cells * N_ACTIONS, 0),
        length=new_row(n_cells * N_ACTIONS, 0),
        first_move=new_row(n_cells * N_ACTIONS, 0),
    )


def _with_table(search: BeliefSearch, n_bits: int) -> BeliefSearch:
    """The search with an empty table."""
    return search._replace(
        key=new_row(1 << n_bits, FREE),
        value=new_row(1 << n_bits, 0.0),
        n_states=new_row(1, 0),
        stack=new_row(STACK_SIZE, 0),
        n_stacked=new_row(1, 0),
    )


def _pair_ways(rows: Ints, columns: Ints, is_seen: Bools, home: Floats) -> Floats:
    """The way from each cell over any two tasks home, (C, 2C, 2C)."""
    moves = abs(rows[:, None] - rows) + abs(columns[:, None] - columns)
    n_cells = len(moves)
    done_in = [*np.arange(n_cells)[:, None], *map(np.flatnonzero, is_seen)]
    over_last = np.stack([(moves + home)[:, cells].min(axis=1) for cells in done_in], axis=1)
    in_order = np.stack(
        [(moves[:, cells, None] + over_last[cells]).min(axis=1) for cells in done_in], axis=1
    )
    in_any_order: Floats = np.minimum(in_order, in_order.transpose(0, 2, 1))
    return in_any_order


def likelihoods(counts: Floats) -> Floats:
    """That of some cells those hold data that do, by how many there are and do, (C + 1, C + 1)."""
    n_cells = len(counts) - 1
    likelihoods = np.zeros((n_cells + 1, n_cells + 1))
    for n_seen in range(n_cells + 1):
        for n_found in range(n_seen + 1):
            likelihoods[n_seen, n_found] = sum(
                counts[count]
                * math.comb(n_cells - n_seen, count - n_found)
                / math.comb(n_cells, count)
                for count in range(n_found, n_cells - n_seen + n_found + 1)
            )
    return likelihoods

"""The best that two UAVs can do that do not know the demand but share all they see, exactly.

Whoever hears every message knows what any UAV has seen: a message says where its UAV is and which
cells are complete, so the others of its region hold data. The two are searched as one that knows
both; whose messages are lost or late can do no better. Areas are tiny, all cells alike as of
`unknown_demand`, and budgets large enough.

At an event one UAV decides, and knows what the other does and until when. What they know changes
as a UAV hovers or sees new cells; between two such changes they only move, so that how the ends of
their actions lie to each other repeats itself. The values of all places in one such stretch are
found together, those that it may lead to first. A UAV may hover or leave the data for later, and
may go home while the other goes on.

Sets of cells are the bits of an integer. Times are whole nanoseconds: which of two actions ends
first is not left to rounding.
"""

from collections.abc import Iterator
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np
from uav_collect.kernels.arrays import Bools, Floats, Ints
from uav_collect.physics.radio import uplink_rate_bps
from uav_collect.planning.belief_search import count_cells
from uav_collect.planning.search import Aim
from uav_collect.planning.unknown_demand import check_alike, likelihoods
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import (
    COLUMN_STEP,
    FORWARD,
    HOME,
    HOVER,
    N_ACTIONS,
    ROW_STEP,
)
from uav_collect.uav.actions import (
    cell_under,
    home_duration_s,
    move_duration_s,
    neighbour,
    opposite,
)
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.view import VIEW_CELLS
from uav_collect.world.sensor_field import lay_out

MAX_PAIR_CELLS = 12  # of more not even the values have room in memory
N_UAVS = 2
_NS = 1e9  # in a second
_SAME = 1e-9  # relative


class Known(NamedTuple):
    """What both know."""

    seen: int  # cells
    waiting: int  # those of them that still hold data
    n_found: int  # how many of them ever did


class PairTurn(NamedTuple):
    """Which UAV decides, and when the other's action ends."""

    uav: int
    other_ns: int  # from now


@dataclass(frozen=True, kw_only=True)
class PairPlaces:
    """A cell and the move from it that is not legal, straight back; P of them."""

    index: dict[tuple[int, int], int]  # by cell and move, 0 where all are legal
    cell: Ints  # (P,)
    after: Ints  # (A - 1, P) the place after a move; P where that is not legal
    is_dead_end: Bools  # (P,) the only move is the one back, legal where no data waits


class PairSearch:
    """Two UAVs over a tiny area, and what is the best that they can do."""

    def __init__(
        self, site: Site, counts: Floats, aim: Aim, *, is_independent: bool = False
    ) -> None:
        """Take the area and the law of its demand.

        Args:
            counts: how likely it is that so many cells hold data, whichever these are, (C + 1,).
            aim: what is to be small on average.
            is_independent: whether each cell holds data with a chance of its own: what is known
                of the others is no news then.

        Raises:
            ValueError: not two UAVs or too many cells, or the cells are not alike.
        """
        briefing = briefing_of(site)
        check_alike(site, briefing, N_UAVS, MAX_PAIR_CELLS)
        self.briefing, self.aim = briefing, aim
        self.every = (1 << site.scenario.n_cells) - 1
        self.places = _places_of(briefing)
        self._has_dead_ends = bool(self.places.is_dead_end.any())
        self.hover_ns = _hover_ns(site, briefing)
        self.move_ns = [round(move_duration_s(briefing, uav) * _NS) for uav in range(N_UAVS)]
        self.home_ns = [_home_ns(briefing, uav) for uav in range(N_UAVS)]
        self._near = [_near(briefing, cell) for cell in range(site.scenario.n_cells)]
        self._in_view = [sum(1 << cell for cell in near) for near in self._near]
        self._beside = [_beside(briefing, cell) for cell in range(site.scenario.n_cells)]
        self._start = [int(self.places.cell[place]) for place in self.start_places()]
        self._likelihood = likelihoods(counts)
        self._is_independent = is_independent
        self._values: dict[tuple[Known, PairTurn], Floats] = {}
        self._values_alone: dict[tuple[Known, int, int], Floats] = {}
        self._least_ns: dict[tuple[Known, int], int] = {}
        self._stretches: dict[PairTurn, tuple[PairTurn, ...]] = {}

    @property
    def n_states(self) -> int:
        """How many states were valued so far."""
        return sum(table.size for table in (*self._values.values(), *self._values_alone.values()))

    def expected(self) -> float:
        """What the best policy comes to on average, in seconds or joules; none comes to less."""
        return self._from_start(Known(0, 0, 0))

    def knowing(self, cells: int) -> float:
        """The same in a mission whose data cells are known, where no other must be seen."""
        return self._from_start(self.known(self.every, cells, 0))

    def known(self, seen: int, waiting: int, n_found: int) -> Known:
        """What is known, without what is of no more use."""
        is_useless = self._is_independent or seen == self.every
        return Known(seen, waiting, 0 if is_useless else n_found)

    def start_places(self) -> list[int]:
        """Where the UAVs begin, (U,)."""
        x_m, y_m = self.briefing.start_x_m, self.briefing.start_y_m
        cells = [cell_under(self.briefing, x_m[uav], y_m[uav]) for uav in range(N_UAVS)]
        return [self.places.index[cell, 0] for cell in cells]

    def best_action(self, known: Known, turn: PairTurn, place: int, other: int) -> int:
        """What the deciding UAV does best.

        Args:
            place: of the deciding UAV, which has looked.
            other: where the other's action will end.
        """
        values = {
            HOVER: self._by_hover(known, turn)[place, other],
            HOME: self._by_home(known, turn)[place, other],
        }
        following, _ = _next_turn(turn, self.move_ns[turn.uav])
        by_move = self._by_move(known, turn, self._values_of(known, following))
        values |= {FORWARD + move: by[place, other] for move, by in enumerate(by_move)}
        return min(values, key=values.__getitem__)

    def best_action_alone(self, known: Known, uav: int, gone_ns: int, place: int) -> int:
        """What a UAV does best that the other has left.

        Args:
            gone_ns: how long the other still flies home.
        """
        values = {HOVER: self._by_hover_alone(known, uav, gone_ns)[place]}
        then = self._alone(known, uav, gone_ns - self.move_ns[uav])
        by_move = self._by_move_alone(known, uav, then)
        values |= {FORWARD + move: by[place] for move, by in enumerate(by_move)}
        return min(values, key=values.__getitem__)

    def _from_start(self, known: Known) -> float:
        first, second = self.start_places()
        return float(self._values_of(known, PairTurn(0, 0))[first, second])

    def _values_of(self, known: Known, turn: PairTurn) -> Floats:
        """What is expected as the deciding UAV ends an action, before it looks, (P, P).

        By its place and where the other's action will end.
        """
        stretch = self._stretch(turn)
        key = known, stretch[0]
        if key not in self._values:
            self._values[key] = self._solved(known, stretch)
        table: Floats = self._values[key][stretch.index(turn)]
        return table

    def _stretch(self, turn: PairTurn) -> tuple[PairTurn, ...]:
        """The turns from one on while the UAVs only move, until they repeat themselves."""
        if turn not in self._stretches:
            turns: list[PairTurn] = []
            following = turn
            while following not in turns:
                turns.append(following)
                following, _ = _next_turn(following, self.move_ns[following.uav])
            self._stretches[turn] = tuple(turns)
            if following == turn:
                self._stretches |= dict.fromkeys(turns, tuple(turns))
        return self._stretches[turn]

    def _solved(self, known: Known, stretch: tuple[PairTurn, ...]) -> Floats:
        if self._is_done(known):
            return np.stack([self._when_done(turn) for turn in stretch])
        n_places = len(self.places.cell)
        values = np.full((len(stretch), n_places, n_places), math.inf)
        for rows, outcomes in self._looks(known):
            values[:, rows] = 0.0
            for table, turn in zip(values, stretch, strict=True):
                for then, chance in outcomes:
                    table[rows] += chance * self._values_of(then, turn)[rows]
        rows = self._showing_none(known)
        stays = np.stack(
            [
                np.minimum(self._by_home(known, turn), self._by_hover(known, turn))
                for turn in stretch
            ]
        )
        values[:, rows] = stays[:, rows]
        following = [_next_turn(turn, self.move_ns[turn.uav])[0] for turn in stretch]
        after = [stretch.index(turn) for turn in following]
        before = np.zeros_like(values)
        while not np.array_equal(values, before):
            before[:] = values
            for index in reversed(range(len(stretch))):
                by_move = self._by_move(known, stretch[index], values[after[index]])
                values[index, rows] = np.minimum(stays[index], by_move.min(axis=0))[rows]
        return values

    def _is_done(self, known: Known) -> bool:
        return known.seen == self.every and known.waiting == 0

    def _when_done(self, turn: PairTurn) -> Floats:
        uav, other = turn.uav, 1 - turn.uav
        own_s = self.home_ns[uav][self.places.cell] / _NS
        others_s = self.home_ns[other][self.places.cell] / _NS
        weights = self.aim.flight
        latest_s = np.maximum(own_s[:, None], others_s + turn.other_ns / _NS)
        flown: Floats = weights[uav] * own_s[:, None] + weights[other] * others_s
        return flown + self.aim.latest * latest_s

    def _looks(self, known: Known) -> Iterator[tuple[Bools, list[tuple[Known, float]]]]:
        """PairPlaces that show new cells, (P,), and what may be known then, how likely.

        A UAV comes to such a place from a cell that showed it none, if it does not begin there.
        """
        n_seen = int(count_cells(known.seen))
        before = self._likelihood[n_seen, known.n_found]
        for cell, in_view in enumerate(self._in_view):
            new = in_view & ~known.seen
            is_next = any(
                self._shows_none(known, beside) for beside in self._beside[cell].values()
            )
            if new == 0 or not (is_next or cell in self._start):
                continue
            after = self._likelihood[n_seen + int(count_cells(new)), known.n_found :] / before
            outcomes, held = [], new
            while True:  # over what the new cells may hold, the sets within them
                n_held = int(count_cells(held))
                if after[n_held] > 0.0:
                    n_found = known.n_found + n_held
                    then = self.known(known.seen | new, known.waiting | held, n_found)
                    outcomes.append((then, float(after[n_held])))
                if held == 0:
                    break
                held = (held - 1) & new
            yield self.places.cell == cell, outcomes

    def _by_hover(self, known: Known, turn: PairTurn) -> Floats:
        """What is expected if the deciding UAV hovers, (P, P); inf where no data waits."""
        following, passed_ns = _next_turn(turn, self.hover_ns)
        by_cell = np.full((len(self._in_view), len(self.places.cell)), math.inf)
        for cell, then in self._served(known):
            table, place = self._values_of(then, following), self.places.index[cell, 0]
            by_cell[cell] = table[place] if following.uav == turn.uav else table[:, place]
        by_cell += self.aim.hover[turn.uav] * self.hover_ns / _NS
        by_cell += self.aim.latest * passed_ns / _NS
        return by_cell[self.places.cell]

    def _by_home(self, known: Known, turn: PairTurn) -> Floats:
        """What is expected if it goes home and leaves all else to the other, (P, P)."""
        uav, other = turn.uav, 1 - turn.uav
        home_ns = self.home_ns[uav]
        by_cell = np.stack([self._alone(known, other, int(ns) - turn.other_ns) for ns in home_ns])
        by_cell += self.aim.flight[uav] * home_ns[:, None] / _NS
        by_cell += self.aim.latest * turn.other_ns / _NS
        return by_cell[self.places.cell]

    def _by_move(self, known: Known, turn: PairTurn, then: Floats) -> Floats:
        """What is expected after each move, (A - 1, P, P); `then` is of the turn that follows."""
        following, passed_ns = _next_turn(turn, self.move_ns[turn.uav])
        rows = _with_illegal(then if following.uav == turn.uav else then.T)
        flight = self.aim.flight[turn.uav] * self.move_ns[turn.uav]
        by_move: Floats = rows[self._after_moves(known)]
        return by_move + (flight + self.aim.latest * passed_ns) / _NS

    def _alone(self, known: Known, uav: int, gone_ns: int) -> Floats:
        """The same as `_values_of` for a UAV that the other has left, (P,).

        Args:
            gone_ns: how long the other still flies home.
        """
        gone_ns = self._counting(known, uav, gone_ns)
        key = known, uav, gone_ns
        if key not in self._values_alone:
            self._values_alone[key] = self._solved_alone(known, uav, gone_ns)
        return self._values_alone[key]

    def _counting(self, known: Known, uav: int, gone_ns: int) -> int:
        """How long the other flies home; 0 where it is home before this one can be."""
        if gone_ns <= 0 or self.aim.latest == 0.0:
            return 0
        least_ns = self._least_ns.get((known, uav))
        if least_ns is None:
            home_ns, least_ns = self.home_ns[uav], 0
            for cell, near in enumerate(self._near):
                if known.waiting >> cell & 1:
                    least_ns = max(least_ns, self.hover_ns + int(home_ns[cell]))
                elif not known.seen >> cell & 1:
                    least_ns = max(least_ns, int(home_ns[near].min()))
            self._least_ns[known, uav] = least_ns
        return gone_ns if gone_ns > least_ns else 0

    def _solved_alone(self, known: Known, uav: int, gone_ns: int) -> Floats:
        if self._is_done(known):
            home_ns = self.home_ns[uav][self.places.cell]
            latest_ns = np.maximum(home_ns, gone_ns)
            done: Floats = (self.aim.flight[uav] * home_ns + self.aim.latest * latest_ns) / _NS
            return done
        n_places = len(self.places.cell)
        values = np.full(n_places, math.inf)
        for rows, outcomes in self._looks(known):
            values[rows] = 0.0
            for then, chance in outcomes:
                values[rows] += chance * self._alone(then, uav, gone_ns)[rows]
        rows = self._showing_none(known)
        stays = self._by_hover_alone(known, uav, gone_ns)
        values[rows] = stays[rows]
        later = self._alone(known, uav, gone_ns - self.move_ns[uav]) if gone_ns > 0 else values
        before = np.zeros_like(values)
        while not np.array_equal(values, before):
            before[:] = values
            by_move = self._by_move_alone(known, uav, later)
            values[rows] = np.minimum(stays, by_move.min(axis=0))[rows]
        return values

    def _by_hover_alone(self, known: Known, uav: int, gone_ns: int) -> Floats:
        by_cell = np.full(len(self._in_view), math.inf)
        for cell, then in self._served(known):
            table = self._alone(then, uav, gone_ns - self.hover_ns)
            by_cell[cell] = table[self.places.index[cell, 0]]
        by_cell += (self.aim.hover[uav] + self.aim.latest) * self.hover_ns / _NS
        return by_cell[self.places.cell]

    def _by_move_alone(self, known: Known, uav: int, then: Floats) -> Floats:
        weight = self.aim.flight[uav] + self.aim.latest
        by_move: Floats = _with_illegal(then)[self._after_moves(known)]
        return by_move + weight * self.move_ns[uav] / _NS

    def _served(self, known: Known) -> Iterator[tuple[int, Known]]:
        """The cells where a UAV may hover now, and what is known once it does."""
        for cell in range(len(self._in_view)):
            if known.waiting >> cell & 1 and self._shows_none(known, cell):
                yield cell, known._replace(waiting=known.waiting & ~(1 << cell))

    def _shows_none(self, known: Known, cell: int) -> bool:
        """Whether all that is seen from a cell has been seen."""
        return self._in_view[cell] & ~known.seen == 0

    def _showing_none(self, known: Known) -> Bools:
        by_cell = [self._shows_none(known, cell) for cell in range(len(self._in_view))]
        return np.array(by_cell)[self.places.cell]

    def _after_moves(self, known: Known) -> Ints:
        """The place after each move, (A - 1, P); P where that is not legal."""
        if not self._has_dead_ends:
            return self.places.after
        is_kept = self.places.is_dead_end & (known.waiting >> self.places.cell & 1 == 1)
        return np.where(is_kept, len(is_kept), self.places.after)


def _next_turn(turn: PairTurn, used_ns: int) -> tuple[PairTurn, int]:
    """The turn that follows as a UAV starts an action, and the time until then [ns]."""
    other = 1 - turn.uav
    if (turn.other_ns, other) < (used_ns, turn.uav):  # who ends first; ties to the lowest index
        return PairTurn(other, used_ns - turn.other_ns), turn.other_ns
    return PairTurn(turn.uav, turn.other_ns - used_ns), used_ns


def _with_illegal(table: Floats) -> Floats:
    """A table by place, with a last row for a move that is not legal."""
    return np.concatenate([table, np.full((1, *table.shape[1:]), math.inf)])


def _beside(briefing: Briefing, cell: int) -> dict[int, int]:
    """The cells that moves lead to, by move."""
    moves = range(FORWARD, N_ACTIONS)
    to = {move: neighbour(briefing, cell, ROW_STEP[move], COLUMN_STEP[move]) for move in moves}
    return {move: other for move, other in to.items() if other >= 0}


def _places_of(briefing: Briefing) -> PairPlaces:
    there = [_beside(briefing, cell) for cell in range(len(briefing.is_open))]
    pairs = [(cell, back) for cell, moves in enumerate(there) for back in (0, *moves)]
    index = {pair: place for place, pair in enumerate(pairs)}
    after = np.full((N_ACTIONS - FORWARD, len(pairs)), len(pairs))
    for place, (cell, back) in enumerate(pairs):
        for action, near in there[cell].items():
            if action != back or len(there[cell]) == 1:
                after[action - FORWARD, place] = index[near, opposite(action)]
    return PairPlaces(
        index=index,
        cell=np.array([cell for cell, _ in pairs]),
        after=after,
        is_dead_end=np.array([back > 0 and len(there[cell]) == 1 for cell, back in pairs]),
    )


def _near(briefing: Briefing, cell: int) -> list[int]:
    """The cells that are seen from one, and from which it is seen."""
    near = (
        neighbour(briefing, cell, index // 3 - 1, index % 3 - 1) for index in range(VIEW_CELLS)
    )
    return [other for other in near if other >= 0]


def _home_ns(briefing: Briefing, uav: int) -> Ints:
    """The way home from each cell, (C,)."""
    rows, columns = np.divmod(np.arange(len(briefing.is_open)), briefing.n_columns)
    size_m = briefing.cell_size_m
    return np.array(
        [
            round(home_duration_s(briefing, uav, x_m, y_m) * _NS)
            for x_m, y_m in zip((columns + 0.5) * size_m, (rows + 0.5) * size_m, strict=True)
        ]
    )


def _hover_ns(site: Site, briefing: Briefing) -> int:
    field = lay_out(site)
    hovers_s = []
    for bit, gain in zip(field.given_bit, field.path_gain, strict=True):
        signal_w = briefing.tx_power_w * gain
        error_w = signal_w * field.csi_error_variance
        rate_bps = uplink_rate_bps(
            briefing.bandwidth_hz, signal_w, error_w, briefing.noise_w_per_hz
        )
        hovers_s.append(bit / rate_bps)
    is_one_each = [*field.first_sensor] == [*range(site.scenario.n_cells + 1)]
    if not (is_one_each and max(hovers_s) - min(hovers_s) < _SAME * min(hovers_s)):
        raise ValueError('hovers take unlike times: each cell must have the same one sensor')
    return round(hovers_s[0] * _NS)

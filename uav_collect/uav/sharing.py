"""How a fleet shares its ways: which piece of the tour each UAV flies, and by when all are home.

It depends on the briefing alone, so all UAVs find the same. It is found once in a process, in
plain Python.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from uav_collect.kernels.arrays import filled_row, Floats, Row
from uav_collect.uav.actions import start_cells
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.tour import Area, area_of, order_of, Tour, tour_of, TourKind

_LATE = 1.1  # times the planned one until UAVs that are done may help others
_PARTING = 0.95  # times the energy-delay product of UAVs that wait: from there on they part
_SPENT = 0.8  # of a UAV's energy, by plan, where nobody would help it out
_TRIED = 11  # of the times until then, for each of which a tour is shared
_LONGEST_S = 2**62  # planned: hovers over sensors that can hardly be heard may take any time
_MOVES_PER_PLACE = 2.0  # planned for a place of a tour from which cells are seen: detours, hovers


class Shares(NamedTuple):
    """The ways that rules follow, as kernels read them; places are those of a `tour.Tour`."""

    order: Row[int]  # (N,) the cells that need a visit, as HERT serves them
    place: Row[int]  # (C,) of each cell on the sweep's tour; NOWHERE
    n_places: int
    planned_s: int  # when all shall be home
    anchor: Row[int]  # (U,) the place where the UAV begins
    n_own: Row[int]  # (U,) places of its piece of the tour
    direction: Row[int]  # (U,) 1 along the tour, -1 against it
    alone: int  # the UAV that alone serves a piece that a pair might; -1: there is none
    meets: Row[int]  # (U,) 1 where it hears all the others once all are at their homes
    cells_home: Row[float]  # (U * C,) the way home from a cell's centre, in sides of a cell
    parts: int  # 1: each lands once its own piece is done; 0: once all are, as far as it knows


class FleetWays(NamedTuple):
    """What sharing depends on besides the tour; lists are by UAV."""

    speed_mps: tuple[float, ...]
    power_w: tuple[float, ...]  # in flight
    energy_j: tuple[float, ...]  # above the reserve
    from_start: list[list[float]]  # (U, C) the straight way to a cell, in sides of a cell
    moves_from_start: list[list[int]]  # (U, C)
    home: list[list[float]]  # (U, C) the way home
    cell_size_m: float
    visit_s: float  # that hovers are expected to take for each cell that needs a visit
    is_deaf: bool


class TourPiece(NamedTuple):
    """A UAV's part of the tour."""

    anchor: int
    n_own: int
    direction: int


class SharedTour(NamedTuple):
    """The tour, and who serves what of it."""

    tour: Tour
    fleet: FleetWays
    planned_s: int  # when all shall be home
    pieces: list[TourPiece]  # (U,)
    parts: bool  # whether each lands once its own piece is done


def no_shares() -> Shares:
    """What whoever flies by no rule gets."""
    ints, floats = filled_row([], 0), filled_row([], 0.0)
    return Shares(ints, ints, 0, 0, ints, ints, ints, -1, ints, floats, 0)


def shares_of(briefing: Briefing) -> Shares:
    """The ways of a fleet, found once for all UAVs of a process; not to be written."""
    rows: dict[str, Any] = {
        name: tuple(row)
        for name, row in briefing._asdict().items()
        if not isinstance(row, int | float)
    }
    return _shares_of(briefing._replace(**rows))


@lru_cache(maxsize=128)
def _shares_of(briefing: Briefing) -> Shares:
    tour, fleet, planned_s, pieces, parts = shared_tour(briefing)
    slowest_first = _slowest_first(fleet)
    is_odd = len(pieces) % 2 == 1 and tour.kind == TourKind.LANES
    return Shares(
        order=filled_row(_ways(area_of(briefing))[0], 0),
        place=filled_row(tour.place, 0),
        n_places=len(tour.stop),
        planned_s=min(planned_s, _LONGEST_S),
        anchor=filled_row([piece.anchor for piece in pieces], 0),
        n_own=filled_row([piece.n_own for piece in pieces], 0),
        direction=filled_row([piece.direction for piece in pieces], 0),
        alone=slowest_first[-1] if is_odd else -1,
        meets=filled_row(_meets(briefing), 0),
        cells_home=filled_row([cells for row in fleet.home for cells in row], 0.0),
        parts=int(parts),
    )


def shared_tour(briefing: Briefing) -> SharedTour:
    """The tour of a fleet, and each UAV's piece of it."""
    _, tour = _ways(area_of(briefing))
    fleet = _fleet_ways(briefing)
    if tour.kind == TourKind.LANES:
        long_s, pieces = _in_least_time(_in_pairs, fleet, tour)
        return SharedTour(tour, fleet, long_s, pieces, parts=False)
    long_s, pieces = _in_least_time(_one_by_one, fleet, tour)
    parted = None
    if tour.kind == TourKind.CELLS and briefing.may_fail == 0:
        parted = _parted(fleet, tour, long_s, pieces)
    return SharedTour(tour, fleet, int(long_s * _LATE), parted or pieces, parted is not None)


@lru_cache(maxsize=128)
def _ways(area: Area) -> tuple[list[int], Tour]:
    return order_of(area), tour_of(area)


def _fleet_ways(briefing: Briefing) -> FleetWays:
    starts = [*zip(briefing.start_x_m, briefing.start_y_m, strict=True)]
    homes = [*zip(briefing.home_x_m, briefing.home_y_m, strict=True)]
    n_cells = len(briefing.is_open)
    home = [_cells_from(briefing, *place_m).tolist() for place_m in homes]
    if len(briefing.home_m) > 0:
        way_m = np.array(briefing.home_m, dtype=np.float64).reshape(-1, n_cells)
        home = (way_m / briefing.cell_size_m).tolist()
    rows, columns = np.divmod(np.arange(n_cells), briefing.n_columns)
    start_places = [divmod(cell, briefing.n_columns) for cell in start_cells(briefing)]
    return FleetWays(
        speed_mps=tuple(float(speed_mps) for speed_mps in briefing.speed_mps),
        power_w=tuple(float(power_w) for power_w in briefing.flight_power_w),
        energy_j=tuple(
            float(budget_j - margin_j)
            for budget_j, margin_j in zip(
                briefing.energy_budget_j, briefing.energy_margin_j, strict=True
            )
        ),
        from_start=[_cells_from(briefing, *place_m).tolist() for place_m in starts],
        moves_from_start=[
            (np.abs(rows - row) + np.abs(columns - column)).tolist()
            for row, column in start_places
        ],
        home=home,
        cell_size_m=briefing.cell_size_m,
        visit_s=briefing.data_share * briefing.hover_s,
        is_deaf=briefing.contact_range_m <= 0.0,
    )


def _cells_from(briefing: Briefing, x_m: float, y_m: float) -> Floats:
    """The straight way from a point to each cell's centre, in sides of a cell, (C,)."""
    row, column = np.divmod(np.arange(len(briefing.is_open)), briefing.n_columns)
    rows = y_m / briefing.cell_size_m - (row + 0.5)
    columns = x_m / briefing.cell_size_m - (column + 0.5)
    away: Floats = np.sqrt(rows * rows + columns * columns)
    return away


def _meets(briefing: Briefing) -> list[int]:
    """1 for each UAV that hears all the others once they are home, (U,)."""
    x_m, y_m = np.array(briefing.home_x_m), np.array(briefing.home_y_m)
    east_m, north_m = x_m[:, None] - x_m, y_m[:, None] - y_m
    is_heard = np.sqrt(east_m * east_m + north_m * north_m) < briefing.contact_range_m
    return [int(is_all) for is_all in is_heard.all(axis=0)]


def _slowest_first(fleet: FleetWays) -> list[int]:
    return sorted(range(len(fleet.speed_mps)), key=fleet.speed_mps.__getitem__)


def _in_least_time(
    share: Callable[[FleetWays, Tour, int], tuple[int, list[TourPiece]]],
    fleet: FleetWays,
    tour: Tour,
) -> tuple[int, list[TourPiece]]:
    """The shortest time in which all could be home [s], and their pieces of the tour, (U,)."""
    n_places = len(tour.stop)
    long_s = 1
    while share(fleet, tour, long_s)[0] < n_places:
        long_s *= 2
    short_s = long_s // 2
    while long_s - short_s > 1:
        middle_s = (short_s + long_s) // 2
        if share(fleet, tour, middle_s)[0] < n_places:
            short_s = middle_s
        else:
            long_s = middle_s
    return long_s, share(fleet, tour, long_s)[1]


def _in_pairs(fleet: FleetWays, tour: Tour, planned_s: int) -> tuple[int, list[TourPiece]]:
    """Share a tour that shows cells: a pair flies from both ends of its piece until it meets.

    The slowest pair has the first piece, and each as many places as it can serve in a time.

    Returns:
        How many places all serve together, and their pieces.
    """
    begin, n_places = 0, len(tour.stop)
    pieces = [TourPiece(0, 0, 1)] * len(fleet.speed_mps)
    order = _slowest_first(fleet)
    for first, *others in (order[at : at + 2] for at in range(0, len(order), 2)):
        second = others[0] if others else None
        served = _places_served(fleet, tour, first, planned_s, begin)
        end = begin
        while end < n_places:
            room = served + _places_served(fleet, tour, second, planned_s, end) - (end - begin)
            if room < 1.0:
                break
            # The place itself costs a stop and, further away, hardly more than three others.
            end = min(end + max(int(room / 4.0), 1), n_places)
        pieces[first] = TourPiece(begin, end - begin, 1)
        if second is not None:
            pieces[second] = TourPiece(end - 1, end - begin, -1)
            if fleet.is_deaf:
                # They would not notice that they meet.
                both = served + _places_served(fleet, tour, second, planned_s, end)
                n_first = int((end - begin) * served / both + 0.5) if both > 0.0 else 0
                pieces[first] = TourPiece(begin, n_first, 1)
                pieces[second] = TourPiece(end - 1, end - begin - n_first, -1)
        begin = end
    return begin, pieces


def _places_served(
    fleet: FleetWays, tour: Tour, uav: int | None, planned_s: int, place: int
) -> float:
    """How many places about one of the tour a UAV serves, if it is to be home in a time."""
    if uav is None:
        return 0.0
    cell = tour.stop[min(place, len(tour.stop) - 1)]
    way = planned_s * fleet.speed_mps[uav] / fleet.cell_size_m
    way -= fleet.from_start[uav][cell]
    way -= fleet.home[uav][cell]
    return max(way / _MOVES_PER_PLACE, 0.0)


def _one_by_one(fleet: FleetWays, tour: Tour, planned_s: int) -> tuple[int, list[TourPiece]]:
    """Share any other tour: each UAV has the piece that it can serve and be home in a time.

    Neighbours fly towards each other, two by two, so that who is done finds what the other left.

    Returns:
        How many places all serve together, and their pieces.
    """
    begin, n_places = 0, len(tour.stop)
    pieces = [TourPiece(0, 0, 1)] * len(fleet.speed_mps)
    for number, uav in enumerate(_slowest_first(fleet)):
        direction = 1 if number % 2 == 0 else -1
        end, hover_s = begin, 0.0
        while end < n_places:
            hover_s += fleet.visit_s * (tour.place[tour.stop[end]] == end)
            ends = tour.stop[begin], tour.stop[end]
            flight_s = _flight_s(fleet, tour, uav, ends[::direction], end - begin)
            if flight_s + hover_s > planned_s:
                break
            end += 1
        pieces[uav] = TourPiece(begin if direction == 1 else end - 1, end - begin, direction)
        begin = end
    return begin, pieces


def _parted(
    fleet: FleetWays, tour: Tour, long_s: int, together: list[TourPiece]
) -> list[TourPiece] | None:
    """Pieces of a tour for a fleet whose UAVs land one by one, (U,); None: it gains too little.

    Where all that is to be done is known, whose piece is done need not wait for the others. That
    saves energy, the more so if the fast, to whom a cell costs less, have the larger pieces. But
    whoever has landed serves nothing that another leaves, should that be lost.

    Args:
        long_s: in which all could be home.
        together: the pieces with which they are.
    """
    together_s = [max(_homes_s(fleet, tour, together))] * len(together)
    least_js = _PARTING * _energy_delay_js(fleet, together_s)
    parted = None
    later_s = np.linspace(float(long_s), _LATE * long_s, _TRIED).tolist()
    for pieces in (together, *(_thriftily(fleet, tour, planned_s) for planned_s in later_s)):
        homes_s = _homes_s(fleet, tour, pieces)
        cost_js = _energy_delay_js(fleet, homes_s)
        if cost_js < least_js and _lasts(fleet, homes_s):
            least_js, parted = cost_js, pieces
    return parted


def _thriftily(fleet: FleetWays, tour: Tour, planned_s: float) -> list[TourPiece]:
    """Share a tour as `_one_by_one` does, but let the fast have all that time allows, (U,)."""
    end = len(tour.stop)
    pieces = [TourPiece(0, 0, 1)] * len(fleet.speed_mps)
    for number, uav in reversed([*enumerate(_slowest_first(fleet))]):
        direction = 1 if number % 2 == 0 else -1
        begin, hover_s = end, 0.0
        while begin > 0:
            hover_s += fleet.visit_s * (tour.place[tour.stop[begin - 1]] == begin - 1)
            ends = tour.stop[begin - 1], tour.stop[end - 1]
            flight_s = _flight_s(fleet, tour, uav, ends[::direction], end - begin)
            if number > 0 and flight_s + hover_s > planned_s:
                break
            begin -= 1
        pieces[uav] = TourPiece(begin if direction == 1 else end - 1, end - begin, direction)
        end = begin
    return pieces


def _homes_s(fleet: FleetWays, tour: Tour, pieces: Sequence[TourPiece]) -> list[float]:
    """When each UAV is home if it flies its piece of a tour and lands [s], (U,)."""
    homes_s = [0.0] * len(pieces)
    for uav, (anchor, n_own, direction) in enumerate(pieces):
        places = range(anchor, anchor + direction * n_own, direction)
        visits = [place for place in places if tour.place[tour.stop[place]] == place]
        if visits:  # else it has nothing to fly for
            ends = tour.stop[visits[0]], tour.stop[visits[-1]]
            flight_s = _flight_s(fleet, tour, uav, ends, abs(visits[-1] - visits[0]))
            homes_s[uav] = flight_s + fleet.visit_s * len(visits)
    return homes_s


def _energy_delay_js(fleet: FleetWays, homes_s: Sequence[float]) -> float:
    """The energy that a fleet spends until each UAV is home [J], times when all are [s].

    It is what to keep low where neither shall be had at any price of the other.
    """
    return float(np.dot(homes_s, fleet.power_w)) * max(homes_s)


def _lasts(fleet: FleetWays, homes_s: Sequence[float]) -> bool:
    """Whether each UAV's energy lasts until it is home, with some to spare."""
    return all(
        home_s * power_w <= _SPENT * energy_j
        for home_s, power_w, energy_j in zip(homes_s, fleet.power_w, fleet.energy_j, strict=True)
    )


def _flight_s(fleet: FleetWays, tour: Tour, uav: int, ends: Sequence[int], n_places: int) -> float:
    """How long a UAV flies to the first cell of a piece, along that, and home from the last."""
    n_moves = n_places if tour.kind == TourKind.CELLS else _MOVES_PER_PLACE * n_places
    cells = fleet.moves_from_start[uav][ends[0]] + n_moves + fleet.home[uav][ends[1]]
    return cells * fleet.cell_size_m / fleet.speed_mps[uav]

"""How far a fleet's energy reaches over its area: an estimate before take-off.

UAVs fly their pieces of the sweep's tour from where they begin, with detours to the cells that are
expected to hold data and hovers there, as far as their budgets last for that and the way home.
"""

from dataclasses import dataclass, replace

from uav_collect.errors import counted
from uav_collect.scenario.area import mean_data_cells
from uav_collect.scenario.load import with_uavs
from uav_collect.scenario.site import Site
from uav_collect.uav.briefing import Briefing, briefing_of, mean_hover_s
from uav_collect.uav.sharing import shared_tour, SharedTour
from uav_collect.uav.tour import NOWHERE, TourKind

_DETOUR = 0.5  # moves for a cell with data beside the tour, as flown missions have it
_NEARLY_ALL = 0.95  # a share of the cells that may as well be all, by so rough an estimate
_AMPLE = 0.5  # of a battery: what needs no more is done with it, by so rough an estimate
_MOST_TIMES = 64.0  # as much energy: beyond that no number is said


@dataclass(frozen=True, kw_only=True)
class _Work:
    """The tour of a fleet, and what each place of it takes."""

    briefing: Briefing
    shared: SharedTour
    moves: float  # between two places
    hover_s: float

    def share(self, times: float) -> float:
        """The share of the cells that need a visit which is reached with so much of the energy."""
        n_places = len(self.shared.tour.stop)
        is_reached = [False] * n_places
        for uav, piece in enumerate(self.shared.pieces):
            for number in range(self._n_reached(uav, times)):
                is_reached[(piece.anchor + piece.direction * number) % n_places] = True
        places = [place for place in self.shared.tour.place if place != NOWHERE]
        return sum(is_reached[place] for place in places) / len(places)

    def _n_reached(self, uav: int, times: float) -> int:
        """How many places of its piece a UAV serves before it must go home."""
        briefing, fleet = self.briefing, self.shared.fleet
        piece, stop = self.shared.pieces[uav], self.shared.tour.stop
        usable_j = times * briefing.energy_budget_j[uav] - briefing.energy_margin_j[uav]
        move_j = briefing.flight_power_w[uav] * briefing.cell_size_m / briefing.speed_mps[uav]
        hover_j = briefing.hover_power_w[uav] * self.hover_s
        for number in range(piece.n_own):
            cell = stop[(piece.anchor + piece.direction * number) % len(stop)]
            n_moves = fleet.moves_from_start[uav][stop[piece.anchor]] + number * self.moves
            if (n_moves + fleet.home[uav][cell]) * move_j + (number + 1) * hover_j > usable_j:
                return number
        return piece.n_own


def reach_of(site: Site) -> tuple[float, float]:
    """How far the energy of a fleet reaches, about.

    Returns:
        The share of the cells that need a visit which the UAVs can serve, 0..1; and how many times
        the budgets would be enough for all of them, 1 where they are, inf where none is.
    """
    work = _work_of(site)
    if not work.shared.tour.stop or work.share(1.0) == 1.0:
        return 1.0, 1.0
    low, high = 1.0, 2.0
    while work.share(high) < 1.0:
        low, high = high, 2.0 * high
        if high > _MOST_TIMES:
            return work.share(1.0), float('inf')
    while high - low > 0.01 * low:
        middle = (low + high) / 2.0
        low, high = (middle, high) if work.share(middle) < 1.0 else (low, middle)
    return work.share(1.0), high


def energy_remark(site: Site) -> str | None:
    """In one line, how far the energy of a fleet reaches; None where it reaches all cells."""
    share, times = reach_of(site)
    if share >= _NEARLY_ALL:
        return None
    reached = f"the fleet's energy reaches about {100.0 * share:.0f} % of the cells"
    remedy = f', {times:.1f} times as much all of them' if times <= _MOST_TIMES else ''
    return f'{reached} that may hold data{remedy}: give more energy, more UAVs or a smaller area'


def spare_remark(site: Site) -> str | None:
    """In one line, that one UAV of several has ample energy; None where it has not."""
    if site.scenario.n_uavs == 1:
        return None
    alone = replace(site, scenario=with_uavs(site.scenario, 1))
    if _work_of(alone).share(_AMPLE) < 1.0:
        return None
    return (
        f'1 UAV would do, by an estimate: with {100.0 * _AMPLE:.0f} % of its energy it reaches all'
        ' cells that may hold data; more UAVs save time'
    )


def take_off_lines(site: Site) -> list[str]:
    """What a world says of a fleet before it takes off."""
    scenario, remark = site.scenario, energy_remark(site)
    numbers = f'{counted(scenario.n_uavs, "UAV")}, {counted(site.n_sensors, "sensor")}'
    fleet = f'scenario {scenario.name}: {numbers}'
    return [fleet] if remark is None else [fleet, remark]


def _work_of(site: Site) -> _Work:
    scenario, briefing = site.scenario, briefing_of(site)
    shared = shared_tour(briefing)
    n_places = max(len(shared.tour.stop), 1)
    n_needed = sum(place != NOWHERE for place in shared.tour.place)
    n_sensor_cells = len(set(site.cell.tolist()))
    n_data = min(mean_data_cells(scenario), float(n_sensor_cells))
    n_moves = float(n_places)
    if shared.tour.kind != TourKind.CELLS:
        n_moves = min(n_places + _DETOUR * n_data, float(max(n_needed, n_places)))
    hover_s = mean_hover_s(scenario, site.n_sensors / n_sensor_cells)
    return _Work(
        briefing=briefing,
        shared=shared,
        moves=n_moves / n_places,
        hover_s=n_data * hover_s / n_places,
    )

"""The actions of a UAV: what they are, what they cost, which are legal, and who may take off."""

from collections.abc import Sequence
import math

from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import new_row, Row
from uav_collect.kernels.compile import kernel
from uav_collect.scenario.model import Point, Scenario
from uav_collect.uav.action_codes import (
    COLUMN_STEP,
    FORWARD,
    HOVER,
    LEFT,
    N_ACTIONS,
    NONE,
    ROW_STEP,
)
from uav_collect.uav.briefing import Briefing

# Of a UAV: a mission of more would not end in a day, were it flown as fast as can be.
_MAX_MOVES = 10_000_000
_MAX_BEACONS = 10_000_000
_MAX_NAMED = 2  # UAVs in one line


@kernel
def cell_under(briefing: Briefing, x_m: float, y_m: float) -> int:
    """The cell whose centre a UAV is over, or what is inside it.

    Of a place on a border, `scenario.area.cell_of` says which cell it belongs to.
    """
    column = int(x_m / briefing.cell_size_m)
    row = int(y_m / briefing.cell_size_m)
    return row * briefing.n_columns + column


def start_cells(briefing: Briefing) -> list[int]:
    """Where the UAVs start, (U,)."""
    places = zip(briefing.start_x_m, briefing.start_y_m, strict=True)
    size_m, n_columns = briefing.cell_size_m, briefing.n_columns
    # As `cell_under`, for briefings whose rows are plain sequences, too: no kernel takes these.
    return [int(y_m / size_m) * n_columns + int(x_m / size_m) for x_m, y_m in places]


@kernel
def neighbour(briefing: Briefing, cell: int, row_step: int, column_step: int) -> int:
    """The open cell some rows north and columns east of another; -1 if there is none."""
    row = cell // briefing.n_columns + row_step
    column = cell % briefing.n_columns + column_step
    if row < 0 or column < 0 or row >= briefing.n_rows or column >= briefing.n_columns:
        return -1
    near = row * briefing.n_columns + column
    return near if briefing.is_open[near] == 1 else -1


@kernel
def opposite(action: int) -> int:
    """The move straight back; NONE after a hover."""
    if action < FORWARD or action > LEFT:
        return NONE
    return (action + 1) % 4 + 1


@kernel
def move_duration_s(briefing: Briefing, uav: int) -> float:
    """Time to fly from one cell's centre to the next's."""
    return briefing.cell_size_m / briefing.speed_mps[uav]


@kernel
def home_duration_s(briefing: Briefing, uav: int, x_m: float, y_m: float) -> float:
    """Time to fly home from a cell's centre, straight where no closed cell is in the way."""
    if briefing.has_obstacles == 1:
        place = uav * len(briefing.is_open) + cell_under(briefing, x_m, y_m)
        return briefing.home_m[place] / briefing.speed_mps[uav]
    east_m = briefing.home_x_m[uav] - x_m
    north_m = briefing.home_y_m[uav] - y_m
    return math.sqrt(east_m * east_m + north_m * north_m) / briefing.speed_mps[uav]


@kernel
def home_energy_j(briefing: Briefing, uav: int, x_m: float, y_m: float) -> float:
    """Energy to fly home from a cell's centre: xi(x) below eq. (ctr_safe_energy_move)."""
    return briefing.flight_power_w[uav] * home_duration_s(briefing, uav, x_m, y_m)


@kernel
def on_way_home(
    briefing: Briefing, uav: int, x_m: float, y_m: float, share: float
) -> tuple[float, float, float, float, float]:
    """The straight part of a way home around closed cells on which a UAV is.

    Args:
        x_m: with `y_m` where the way begins, the centre of a cell.
        share: of the way that is done, 0..1.

    Returns:
        Where that part begins and where it ends, east and north of each [m], and the share of it
        that is done.
    """
    first, size_m = uav * len(briefing.is_open), briefing.cell_size_m
    cell = cell_under(briefing, x_m, y_m)
    left_m = (1.0 - share) * briefing.home_m[first + cell]
    via = briefing.home_via[first + cell]
    while via >= 0 and left_m <= briefing.home_m[first + via]:
        cell = via
        x_m = (cell % briefing.n_columns + 0.5) * size_m
        y_m = (cell // briefing.n_columns + 0.5) * size_m
        via = briefing.home_via[first + cell]
    end_x_m, end_y_m, after_m = briefing.home_x_m[uav], briefing.home_y_m[uav], 0.0
    if via >= 0:
        end_x_m = (via % briefing.n_columns + 0.5) * size_m
        end_y_m = (via // briefing.n_columns + 0.5) * size_m
        after_m = briefing.home_m[first + via]
    part_m = briefing.home_m[first + cell] - after_m
    done = 1.0 - (left_m - after_m) / part_m if part_m > 0.0 else 1.0
    return x_m, y_m, end_x_m, end_y_m, done


def home_way_m(briefing: Briefing, index: int, place_m: Point) -> tuple[Point, ...]:
    """The corners of a UAV's way home, both ends included.

    Args:
        index: of the UAV.
        place_m: where it turns home, the centre of a cell.
    """
    home_m = float(briefing.home_x_m[index]), float(briefing.home_y_m[index])
    corners_m = [place_m]
    if briefing.has_obstacles:
        first = index * len(briefing.is_open)
        cell = int(briefing.home_via[first + cell_under(briefing, *place_m)])
        while cell >= 0:
            row, column = divmod(cell, briefing.n_columns)
            size_m = briefing.cell_size_m
            corners_m.append(((column + 0.5) * size_m, (row + 0.5) * size_m))
            cell = int(briefing.home_via[first + cell])
    return *corners_m, home_m


@kernel
def reserve_j(briefing: Briefing, uav: int, x_m: float, y_m: float) -> float:
    """Energy that a UAV must keep at a cell's centre: for the way home, and the margin."""
    return home_energy_j(briefing, uav, x_m, y_m) + briefing.energy_margin_j[uav]


@kernel
def _keeps_reserve(
    briefing: Briefing, uav: int, x_m: float, y_m: float, energy_after_j: float
) -> bool:
    # Eqs (ctr_safe_energy_hover), (ctr_safe_energy_move) print E_max - E[k]; E[k] already is the
    # energy left, so it stands alone here.
    return energy_after_j >= reserve_j(briefing, uav, x_m, y_m)


@kernel
def may_hover(
    briefing: Briefing, uav: int, x_m: float, y_m: float, energy_left_j: float, hover_s: float
) -> bool:
    """Whether a hover of this duration leaves the way home and the margin."""
    after_j = energy_left_j - briefing.hover_power_w[uav] * hover_s
    return _keeps_reserve(briefing, uav, x_m, y_m, after_j)


@kernel
def may_move(
    briefing: Briefing, uav: int, x_m: float, y_m: float, energy_left_j: float, action: int
) -> bool:
    """Whether a move stays inside the area and leaves the way home and the margin."""
    if (
        neighbour(briefing, cell_under(briefing, x_m, y_m), ROW_STEP[action], COLUMN_STEP[action])
        < 0
    ):
        return False
    after_j = energy_left_j - briefing.flight_power_w[uav] * move_duration_s(briefing, uav)
    x_m += COLUMN_STEP[action] * briefing.cell_size_m
    y_m += ROW_STEP[action] * briefing.cell_size_m
    return _keeps_reserve(briefing, uav, x_m, y_m, after_j)


@kernel
def mark_legal(
    briefing: Briefing,
    uav: int,
    x_m: float,
    y_m: float,
    energy_left_j: float,
    previous_action: int,
    hover_s: float,
    legal: Row[int],
) -> int:
    """Mark the legal actions.

    Args:
        hover_s: duration of a hover here; 0 or less where no data waits [s].
        legal: written, 1 or 0 per action, shape (N_ACTIONS,).

    Returns:
        How many actions are legal.
    """
    legal[HOVER] = 0
    if hover_s > 0.0 and may_hover(briefing, uav, x_m, y_m, energy_left_j, hover_s):
        legal[HOVER] = 1
    back = opposite(previous_action)
    n_legal = legal[HOVER]
    for action in range(FORWARD, N_ACTIONS):
        legal[action] = 0
        if action != back and may_move(briefing, uav, x_m, y_m, energy_left_j, action):
            legal[action] = 1
            n_legal += 1
    if n_legal == 0 and back != NONE and may_move(briefing, uav, x_m, y_m, energy_left_j, back):
        legal[back] = 1
        n_legal = 1
    return n_legal


def check_can_start(scenario: Scenario, briefing: Briefing) -> None:
    """Refuse a fleet that has too little energy to do anything, or so much that it never lands.

    Raises:
        ConfigError: a UAV cannot land with its margin, none of them can do more, or one could fly
            so long that the mission would not end.
    """
    uavs = range(briefing.n_uavs)
    stranded = [uav for uav in uavs if briefing.energy_budget_j[uav] < _to_land_j(briefing, uav)]
    if stranded:
        needs = _needs(briefing, stranded)
        raise ConfigError(f'scenario {scenario.name}: too little energy for the way home: {needs}')
    for uav in uavs:
        _check_length(scenario, briefing, uav)
    # In an area of one open cell there is nowhere to move to; a UAV hovers there, or lands.
    if sum(briefing.is_open) == 1 or any(_can_move(briefing, uav) for uav in uavs):
        return
    needs = _needs(briefing, uavs)
    raise ConfigError(
        f'scenario {scenario.name}: no UAV has the energy for a single move: {needs}'
    )


def _check_length(scenario: Scenario, briefing: Briefing, uav: int) -> None:
    least_w = min(briefing.flight_power_w[uav], briefing.hover_power_w[uav])
    aloft_s = briefing.energy_budget_j[uav] / least_w
    n_moves = aloft_s / move_duration_s(briefing, uav)
    if n_moves > _MAX_MOVES:
        raise ConfigError(
            f'scenario {scenario.name}: fleet.uavs.{uav}.energy_budget_kj is '
            f'{briefing.energy_budget_j[uav] / 1e3:g}: must be less, as it is enough for '
            f'{n_moves:,.0f} moves, at most {_MAX_MOVES:,}'
        )
    period_s = scenario.radio.beacon_period_s
    if period_s is not None and aloft_s / period_s > _MAX_BEACONS:
        raise ConfigError(
            f'scenario {scenario.name}: radio.beacon_period_s is {period_s:g}: must be more, as '
            f'UAV {uav + 1}, which may fly for {aloft_s:,.0f} s, would send '
            f'{aloft_s / period_s:,.0f} beacons, at most {_MAX_BEACONS:,}'
        )


def _needs(briefing: Briefing, uavs: Sequence[int]) -> str:
    needs = [_start_needs(briefing, uav) for uav in uavs[:_MAX_NAMED]]
    n_more = len(uavs) - len(needs)
    return '; '.join([*needs, f'{n_more} more UAVs'] if n_more else needs)


def _to_land_j(briefing: Briefing, uav: int) -> float:
    x_m, y_m = briefing.start_x_m[uav], briefing.start_y_m[uav]
    return reserve_j(briefing, uav, x_m, y_m)


def _can_move(briefing: Briefing, uav: int) -> bool:
    x_m, y_m = briefing.start_x_m[uav], briefing.start_y_m[uav]
    budget_j, legal = briefing.energy_budget_j[uav], new_row(N_ACTIONS, 0)
    return mark_legal(briefing, uav, x_m, y_m, budget_j, NONE, 0.0, legal) > 0


def _start_needs(briefing: Briefing, uav: int) -> str:
    margin_j = briefing.energy_margin_j[uav]
    move_j = briefing.flight_power_w[uav] * move_duration_s(briefing, uav)
    return (
        f'UAV {uav + 1} has {briefing.energy_budget_j[uav] / 1e3:.4g} kJ; the way home from its '
        f'start costs {(_to_land_j(briefing, uav) - margin_j) / 1e3:.4g} kJ, a move '
        f'{move_j / 1e3:.4g} kJ, and {margin_j / 1e3:.4g} kJ must be left when it lands'
    )

"""What is proposed for a field: its cells, its fleet, its data; and why."""

from dataclasses import dataclass, replace
import math

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.fields.craft import Craft, crafts_of
from uav_collect.fields.grid import (
    best_grid,
    CellGrid,
    least_size_m,
    rounded_size_m,
    smaller_size_m,
)
from uav_collect.fields.ground import Ground
from uav_collect.fields.radio_reach import mean_rate_bps, reach_m
from uav_collect.fields.served import check_served
from uav_collect.fields.settings import FieldSettings, Wishes
from uav_collect.limits import MAX_CELLS_PER_SIDE
from uav_collect.scenario.model import Point, RadioConfig, Scenario
from uav_collect.scenario.shapes import check_zones
from uav_collect.scenario.ways import ways_home

_LARGEST_CELL_M = 10_000.0  # that a scenario may have


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """A field as it may be flown."""

    grid: CellGrid
    radio: RadioConfig
    crafts: tuple[Craft, ...]  # the fleet: one for each UAV
    is_data_asked: bool
    why_size: str  # one line
    corner_share: float  # rate of a sensor in a corner of its cell, over that right below a UAV
    energy_margin_kj: float
    contact_range_m: float
    data_mbit: Point | None  # of each sensor; None: the list says it
    scale_mbit: float
    discount_per_s: float
    move_penalty_per_s: float

    @property
    def round_trip_m(self) -> float:
        """From the base to the farthest cell with a sensor, and back, around closed cells [m]."""
        home = ways_home(self.grid.area, self.grid.centre_m(self.grid.base_cell))
        farthest_m: float = max(home.length_m[cell] for cell in self.grid.sensor_cell.tolist())
        return 2.0 * farthest_m

    @property
    def round_trip_kj(self) -> float:
        """What that flight takes of the UAV that uses most for a metre [kJ]."""
        return self.round_trip_m * max(it.energy_per_m_j for it in self.crafts) / 1e3


def propose(ground: Ground, wishes: Wishes, settings: FieldSettings, base: Scenario) -> Proposal:
    """Find cells and fleet for a field.

    Args:
        ground: the field.
        wishes: what is given.
        settings: what else is taken.
        base: the scenario that the new one extends: its radio, its craft.

    Raises:
        ConfigError: a wish cannot be met, or a sensor cannot be served; a line each.
    """
    check_zones('the field', ground.no_fly_m)
    altitude_m = settings.altitude_m if wishes.altitude_m is None else wishes.altitude_m
    bandwidth_hz = base.radio.system_bandwidth_hz / wishes.n_uavs
    heard_m = reach_m(base.radio, altitude_m, bandwidth_hz, settings.rate_share)
    size_m, why = _size(ground, wishes, settings, heard_m)
    grid = best_grid(ground, size_m, altitude_m, is_fixed=wishes.cell_size_m is not None)
    if grid.cell_size_m < size_m:
        why = 'small enough for all sensors to lie in open cells'
    if wishes.cell_size_m is None and not grid.unserved.size:
        grid, why = _shared(grid, why, wishes.n_uavs, settings)
    check_served(grid, settings.least_cell_size_m)
    crafts = crafts_of(wishes, settings)
    share = _time_share(base, grid.cell_size_m / max(it.speed_mps for it in crafts))
    amounts = _amounts(ground, wishes, settings)
    far_bps, near_bps = _corner_rates_bps(grid, base.radio, bandwidth_hz)
    heard = (
        f"a sensor in a cell's corner, {grid.corner_distance_m:.0f} m from the middle, sends"
        f' {far_bps / 1e6:.2g} Mbit/s, {100 * far_bps / near_bps:.0f} % of the rate of one in the'
        ' middle'
    )
    return Proposal(
        grid=grid,
        radio=base.radio,
        crafts=crafts,
        is_data_asked=wishes.data_mbit is not None,
        why_size=f'{why}; {heard}',
        corner_share=far_bps / near_bps,
        energy_margin_kj=round(settings.margin_share * crafts[0].energy_budget_kj, 1),
        contact_range_m=settings.contact_range_m,
        data_mbit=amounts,
        scale_mbit=max(filter(None, ground.data_mbit)) if amounts is None else amounts[1],
        discount_per_s=round(base.reward.discount_per_s**share, 5),
        move_penalty_per_s=round(base.reward.move_penalty_per_s * share, 5),
    )


def _size(
    ground: Ground, wishes: Wishes, settings: FieldSettings, heard_m: float
) -> tuple[float, str]:
    """The side of cells to begin with [m], and why."""
    least_m = least_size_m(ground)
    if least_m > _LARGEST_CELL_M:
        raise ConfigError(_too_far_apart(ground))
    if wishes.cell_size_m is not None:
        allowed_m = math.ceil(10.0 * least_m) / 10.0  # no less: what is named must do
        if wishes.cell_size_m < min(least_m, allowed_m):
            raise ConfigError(
                f'--cell-size is {wishes.cell_size_m:g}: must be at least {allowed_m:.1f} m here, '
                f'for an area has at most {MAX_CELLS_PER_SIDE} x {MAX_CELLS_PER_SIDE} cells'
            )
        return wishes.cell_size_m, 'as asked'
    size_m = rounded_size_m(math.sqrt(2) * heard_m)
    if size_m < least_m:
        most = f'at most {MAX_CELLS_PER_SIDE} x {MAX_CELLS_PER_SIDE} cells'
        return math.ceil(least_m), f'no smaller, as an area has {most}'
    return size_m, 'as large as the radio allows'


def _too_far_apart(ground: Ground) -> str:
    """What makes a field larger than any area may be."""
    without_base = replace(ground, base_m=None)
    without_both = replace(without_base, edge_m=None)
    if least_size_m(without_both) > _LARGEST_CELL_M:
        what, better = 'the sensors are', 'give the list in parts'
    elif least_size_m(without_base) > _LARGEST_CELL_M:
        what, better = 'the sensors and the area are', 'give another --area'
    else:
        what, better = 'the sensors and the base are', 'give another --base'
    (west, south), (east, north) = ground.extent_m
    size = f'{(east - west) / 1e3:,.0f} km x {(north - south) / 1e3:,.0f} km'
    most = f'{_LARGEST_CELL_M * (MAX_CELLS_PER_SIDE - 1) / 1e3:,.0f} km'
    return f'{what} on {size}: must be on at most {most} x {most}; {better}'


def _shared(
    grid: CellGrid, why: str, n_uavs: int, settings: FieldSettings
) -> tuple[CellGrid, str]:
    """The grid, or one of smaller cells, so that each UAV has some of them to go to."""
    n_places = len(np.unique(grid.position_m, axis=0))
    n_wanted = min(n_places, settings.data_cells_per_uav * n_uavs)
    least_m = max(least_size_m(grid.ground), settings.least_cell_size_m)
    shared = grid
    while shared.n_data_cells < n_wanted:
        size_m = smaller_size_m(shared.cell_size_m)
        if size_m < least_m:
            break
        smaller = best_grid(grid.ground, size_m, grid.altitude_m, is_fixed=True)
        if smaller.unserved.size > shared.unserved.size:
            break
        shared = smaller
    if shared is grid:
        return grid, why
    if n_wanted == n_places:
        return shared, 'small enough for few sensors to share a cell'
    shares = f'in {shared.n_data_cells} cells, for {n_uavs} UAVs to share'
    return shared, f'small enough for sensors to lie {shares}'


def _corner_rates_bps(grid: CellGrid, radio: RadioConfig, bandwidth_hz: float) -> Point:
    """Rates of sensors in a corner of a cell and below its middle."""
    far, near = (
        mean_rate_bps(radio, grid.altitude_m, bandwidth_hz, ground_m)
        for ground_m in (grid.corner_distance_m, 0.0)
    )
    return far, near


def _time_share(base: Scenario, move_s: float) -> float:
    """How much shorter moves take in the scenario that rewards were chosen for."""
    return base.area.cell_size_m / max(uav.speed_mps for uav in base.uavs) / move_s


def _amounts(ground: Ground, wishes: Wishes, settings: FieldSettings) -> Point | None:
    if wishes.data_mbit is not None:
        return wishes.data_mbit
    is_said = None not in ground.data_mbit and any(ground.data_mbit)
    return None if is_said else settings.data_mbit

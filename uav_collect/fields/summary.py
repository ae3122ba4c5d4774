"""A proposal in some lines for the screen."""

from collections.abc import Iterator
from dataclasses import replace

from uav_collect.fields.grid import CellGrid
from uav_collect.fields.proposal import Proposal
from uav_collect.limits import MAX_DATA_MBIT, MIN_DATA_MBIT
from uav_collect.scenario.area import open_cells

_LEAST_SHARE = 0.1  # of the rate right below a UAV, that a sensor in a corner should have


def summary(proposal: Proposal) -> Iterator[tuple[str, str]]:
    """What is proposed: a title and a text each."""
    grid, craft = proposal.grid, proposal.crafts[0]
    (west, south), (east, north) = grid.ground.extent_m
    n_sensors = len(grid.ground.sensor_ids)
    yield 'sensors', f'{n_sensors} on {east - west:,.0f} m x {north - south:,.0f} m'
    n_closed = grid.n_cells - int(grid.is_open.sum())
    closed = f', {n_closed} of them closed' if n_closed else ''
    size = f'{grid.n_rows} x {grid.n_columns} of {grid.cell_size_m:g} m (rows x columns)'
    yield 'cells', f'{size}{closed}; {grid.n_data_cells} with sensors'
    yield 'cell size', proposal.why_size
    row, column = divmod(grid.base_cell, grid.n_columns)
    x_m, y_m = grid.centre_m(grid.base_cell)
    yield 'base', f'cell [{row}, {column}], x = {x_m:,.0f} m, y = {y_m:,.0f} m'
    east_m, north_m = grid.corner_m
    if grid.ground.origin_deg is None and (east_m or north_m):
        at = f'x = {east_m:.2f} m, y = {north_m:.2f} m in the list'
        yield 'x and y', f"count from the area's south-west corner, which is at {at}"
    held = f'{craft.held_wh:g} Wh each, {craft.energy_budget_kj:,.0f} kJ of it to fly with'
    speeds = ' and '.join(dict.fromkeys(f'{it.speed_mps:g}' for it in proposal.crafts))
    flight = f'at {speeds} m/s and {grid.altitude_m:g} m'
    yield 'fleet', f'{len(proposal.crafts)} x {craft.airframe} {flight}, {held}'
    away_m, energy_kj = proposal.round_trip_m, proposal.round_trip_kj
    what = 'to the farthest cell with sensors and back'
    yield 'round trip', f'{away_m / 1e3:.2f} km {what}, {energy_kj:.1f} kJ'
    if grid.ground.origin_deg is None:
        yield (
            'on Earth',
            'not known, but waypoints need it: --crs EPSG:N names the map grid that these metres'
            ' are of',
        )
    else:
        lat_deg, lon_deg = grid.ground.origin_deg
        yield 'on Earth', f'around {lat_deg:.5f}, {lon_deg:.5f}'


def doubts(proposal: Proposal) -> Iterator[str]:
    """What may be flown as proposed, but hardly is what is wanted."""
    left_kj = proposal.crafts[0].energy_budget_kj - proposal.energy_margin_kj
    if proposal.round_trip_kj > left_kj:
        yield (
            f'the round trip takes more than the {left_kj:,.0f} kJ of a UAV: cells are out of'
            ' reach; give a nearer --base, a larger --battery-wh, or the list in parts'
        )
    if proposal.corner_share < _LEAST_SHARE:
        yield (
            f'sensors in corners of cells send {proposal.corner_share:.1%} of the rate right below'
            ' a UAV: hovers will be long; give the list in parts'
        )
    if proposal.data_mbit is not None and not proposal.is_data_asked:
        low, high = proposal.data_mbit
        yield (
            f'the list does not say how much data {_unsaid(proposal)} taken as {low:g} to'
            f' {high:g} Mbit each; --data-mbit LOW HIGH says it'
        )
    ground = proposal.grid.ground
    if ground.edge_m is not None and ground.widen_m:
        yield (
            f'--widen moves the boundary itself: {ground.widen_m:g} m outside of what was given,'
            ' in the scenario, on its map, and in the KML and GeoJSON that export writes'
        )
    yield from _far_zones(proposal.grid)


def _unsaid(proposal: Proposal) -> str:
    """The sensors of which the list says no amount of data that can be."""
    amounts = proposal.grid.ground.data_mbit
    n_unsaid = amounts.count(None)
    if n_unsaid in (0, len(amounts)):
        is_column_missing = n_unsaid > 0
        return 'sensors hold' + (', as a column data_mbit would:' if is_column_missing else ':')
    allowed = f'{MIN_DATA_MBIT:g} to {MAX_DATA_MBIT:,.0f} Mbit, or 0'
    return f'{n_unsaid} of {len(amounts)} sensors hold ({allowed}): of all,'


def _far_zones(grid: CellGrid) -> Iterator[str]:
    """Zones that close no cell, as if they were drawn for somewhere else."""
    zones = grid.area.no_fly or ()
    alone = replace(grid.area, boundary=None)
    for number, zone in enumerate(zones, start=1):
        if open_cells(replace(alone, no_fly=(zone,))).all():
            (x_m, y_m), *_ = zone
            yield (
                f'no-fly zone {number} of {len(zones)}, with a corner at x = {x_m:,.0f} m, y ='
                f' {y_m:,.0f} m, touches no cell'
            )

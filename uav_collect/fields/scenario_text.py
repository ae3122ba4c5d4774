"""The scenario of a field as YAML for people: each key with its unit, and why it has its value."""

from collections.abc import Iterator
import json

from uav_collect.fields.proposal import Proposal
from uav_collect.scenario.model import Point, Polygon

_COLUMNS = 99
_NOTE_AT = 42  # column at which comments begin, where there is room


def scenario_text(proposal: Proposal, base: str, source: str, crs: str) -> str:
    """The file of a proposal.

    Args:
        proposal: what it says.
        base: name of the scenario that it extends.
        source: what the sensors were read from, for people.
        crs: how places are written there, for people.
    """
    parts = (
        _head(proposal, base, source, crs),
        _area(proposal),
        _demand(proposal),
        _radio(proposal),
        _reward(proposal, base),
        _fleet(proposal),
        _sensors(proposal),  # last: it may be long
    )
    return '\n'.join('\n'.join(part) + '\n' for part in parts)


def _head(proposal: Proposal, base: str, source: str, crs: str) -> Iterator[str]:
    n_sensors = len(proposal.grid.ground.sensor_ids)
    about = (
        f'A field of {n_sensors} sensors, from {source} ({crs}). Metres count east (x), north (y)'
        " from the area's south-west corner; rows count from the south, columns from the west,"
        ' from 0. What this file does not say is as in the scenario that it extends.'
    )
    yield from _comment(about, '')
    yield ''
    yield f'extends: {base}'


def _area(proposal: Proposal) -> Iterator[str]:
    grid = proposal.grid
    ground = grid.ground
    yield 'area:'
    yield _noted(f'  rows: {grid.n_rows}', 'as many as cover the field')
    yield _noted(f'  columns: {grid.n_columns}', '')
    yield from _comment(f'm, {proposal.why_size}', '  ')
    yield f'  cell_size_m: {grid.cell_size_m}'
    why = 'm, above all obstacles? all UAVs fly at it'
    yield _noted(f'  altitude_m: {grid.altitude_m}', why)
    if ground.origin_deg is not None:
        lat_deg, lon_deg = ground.origin_deg
        yield '  # deg (WGS84): where on Earth this place of the area lies'
        [place] = grid.from_corner(((0.0, 0.0),))
        at = f'lat_deg: {lat_deg!r}, lon_deg: {lon_deg!r}, position_m: {_point(place)}'
        yield f'  reference: {{{at}}}'
    if ground.crs is not None:
        yield _noted(f'  crs: {ground.crs}', 'the grid of the list')
    if grid.area.boundary is not None:
        widened = f', {ground.widen_m:g} m outside of what was given' if ground.widen_m else ''
        yield f'  # m: cells whose middle lies beyond are closed{widened}'
        yield '  boundary:'
        yield from _corners(grid.area.boundary, '    ')
    if grid.area.no_fly:
        yield '  # m: cells that one of these zones touches are closed'
        yield '  no_fly:'
        for zone in grid.area.no_fly:
            yield '    -'
            yield from _corners(zone, '      ')


def _demand(proposal: Proposal) -> Iterator[str]:
    yield 'demand:'
    yield _noted('  cell_share: all', 'every sensor has data to fetch')
    if proposal.data_mbit is None:
        yield _noted('  data_mbit: csv', 'as the list says, of each sensor')
    else:
        why = 'Mbit of each sensor, drawn between these'
        wanted = '' if proposal.is_data_asked else '; what do yours hold?'
        yield _noted(f'  data_mbit: {_point(proposal.data_mbit)}', f'{why}{wanted}')
    yield _noted('  known_empty: sensors', 'cells without a sensor need no visit')


def _radio(proposal: Proposal) -> Iterator[str]:
    radio = proposal.radio
    yield 'radio:'
    yield '  # Of sensors and receivers; cells are as large as these allow.'
    yield _noted(f'  carrier_hz: {radio.carrier_hz!r}', 'Hz')
    yield _noted(f'  tx_power_dbm: {radio.tx_power_dbm!r}', 'dBm, of a sensor')
    yield _noted(
        f'  system_bandwidth_mhz: {radio.system_bandwidth_mhz!r}', 'MHz, shared by the UAVs'
    )
    yield _noted(
        f'  contact_range_m: {proposal.contact_range_m!r}', 'm between UAVs, a telemetry radio'
    )


def _reward(proposal: Proposal, base: str) -> Iterator[str]:
    yield f'# For policies that learn: a move counts for as much as one in {base}.'
    yield 'reward:'
    yield f'  discount_per_s: {proposal.discount_per_s!r}'
    yield f'  move_penalty_per_s: {proposal.move_penalty_per_s!r}'
    yield _noted(f'  scale_mbit: {proposal.scale_mbit!r}', 'Mbit, the most that a sensor holds')


def _fleet(proposal: Proposal) -> Iterator[str]:
    grid, craft = proposal.grid, proposal.crafts[0]
    place = '[{}, {}]'.format(*divmod(grid.base_cell, grid.n_columns))
    where = "open cell at the field's southern edge"
    if (moved_m := grid.base_moved_m) is not None:
        where = 'as asked' if moved_m < 0.5 else f'where asked; its middle is {moved_m:.0f} m off'
    battery, why = craft.battery_wh, f'{craft.held_wh:g} Wh, what comes with it'
    if craft.is_battery_asked:
        why = 'Wh, as asked'
    elif battery is not None:
        why = 'Wh, a guess, for no battery of this airframe is known; what do yours hold?'
    held = 'airframe' if battery is None else repr(battery)
    yield 'fleet:'
    yield '  default:'
    craft_note = f'{craft.mass_kg:.3g} kg; others are in config/airframes.yaml'
    yield _noted(f'    airframe: {craft.airframe}', craft_note)
    yield _noted(f'    battery_wh: {held}', why)
    budget = f'{craft.energy_budget_kj:,.0f} kJ to fly with'
    yield _noted(f'    battery_usable_share: {craft.usable_share!r}', budget)
    yield _noted(f'    energy_margin_kj: {proposal.energy_margin_kj!r}', 'kJ left when home')
    yield _noted(f'    start: {{cell: {place}}}', f'[row, column], {where}')
    yield f'    home: {{cell: {place}}}'
    yield '  uavs:'
    why = 'where a metre takes least energy' if craft.is_widest else 'as asked'
    before = None
    for each in proposal.crafts:
        note = '' if each == before else f'm/s, {why}, {each.energy_per_m_j:.1f} J/m'
        yield _noted(f'    - speed_mps: {each.speed_mps!r}', note)
        before = each


def _sensors(proposal: Proposal) -> Iterator[str]:
    ground = proposal.grid.ground
    yield 'sensors:'
    yield '  kind: listed'
    yield '  entries:'
    places = proposal.grid.position_m.tolist()
    for name, (x_m, y_m), data_mbit in zip(
        ground.sensor_ids, places, ground.data_mbit, strict=True
    ):
        amount = '' if data_mbit is None else f', data_mbit: {data_mbit!r}'
        quoted = json.dumps(name, ensure_ascii=False)
        yield f'    - {{id: {quoted}, x_m: {x_m!r}, y_m: {y_m!r}{amount}}}'


def _corners(polygon: Polygon, indent: str) -> Iterator[str]:
    return (f'{indent}- {_point(corner)}' for corner in polygon)


def _point(point: Point) -> str:
    return f'[{point[0]!r}, {point[1]!r}]'


def _noted(line: str, note: str) -> str:
    """A line with its comment behind it, or above it where there is no room."""
    if not note:
        return line
    behind = f'{line.ljust(_NOTE_AT)}  # {note}'
    if len(behind) <= _COLUMNS:
        return behind
    indent = line[: len(line) - len(line.lstrip())]
    return f'{indent}# {note}\n{line}'


def _comment(text: str, indent: str) -> Iterator[str]:
    """A comment of as many lines as it needs."""
    line = f'{indent}#'
    for word in text.split():
        if len(line) + 1 + len(word) > _COLUMNS:
            yield line
            line = f'{indent}#'
        line = f'{line} {word}'
    yield line

"""Sensors of a real site from CSV, placed in the area: x/y, UTM or latitude/longitude."""

from collections.abc import Iterator
from contextlib import suppress
import csv
from dataclasses import dataclass
import io
import math
from pathlib import Path
from typing import NamedTuple

from uav_collect.config.layers import read_text
from uav_collect.config.yaml_text import dotted, shown
from uav_collect.errors import ConfigError
from uav_collect.scenario.earth import east_north_m

_DIGITS = 6  # micrometres: drops the rounding noise of a difference of large coordinates
_ID_COLUMN = 'sensor_id'
_DATA_COLUMN = 'data_mbit'
MIN_DATA_MBIT = 1e-6  # one bit; or 0
MAX_DATA_MBIT = 10_000.0
MAX_ID_LENGTH = 64


_Line = tuple[int, list[str]]  # where it ends, from 1, and its fields


@dataclass(frozen=True, kw_only=True)
class _System:
    """One way to write a position in two columns."""

    columns: tuple[str, str]
    lows: tuple[float, float]
    highs: tuple[float, float]
    unit: str
    is_angular: bool


_SYSTEMS = (
    _System(
        columns=('x_m', 'y_m'), lows=(-1e7, -1e7), highs=(1e7, 1e7), unit='m', is_angular=False
    ),
    _System(  # UTM: no zone is wider than 834 km; a metre here is 0.9996 to 1.001 m on the ground
        columns=('easting_m', 'northing_m'),
        lows=(100_000.0, 0.0),
        highs=(900_000.0, 10_000_000.0),
        unit='m',
        is_angular=False,
    ),
    _System(  # east and north mean nothing at the poles
        columns=('lat', 'lon'),
        lows=(-89.0, -180.0),
        highs=(89.0, 180.0),
        unit='deg',
        is_angular=True,
    ),
)


@dataclass(frozen=True, kw_only=True)
class _Row:
    line: int
    sensor_id: str
    place: tuple[float, float]  # as written
    data_mbit: float | None


class SensorFile(NamedTuple):
    """What a file says of a site, as the keys and values of a scenario."""

    entries: tuple[dict[str, object], ...]  # `id`, `x_m`, `y_m` and, where given, `data_mbit`
    reference: dict[str, object] | None  # where on Earth the area lies, if latitudes are given


def read_sensors(path: Path, *, origin: tuple[float, float] | None, side_m: float) -> SensorFile:
    """Read the sensors of a site.

    Args:
        path: CSV file with a header: sensor_id, then x_m, y_m or easting_m, northing_m or
            lat, lon, and optionally data_mbit. Other columns are not looked at.
        origin: south-west corner of the area in the file's coordinates; None puts the middle of
            the sensors' bounding box in the middle of the area.
        side_m: side of the square area [m].

    Raises:
        ConfigError: naming file, line, column and value.
    """
    lines = _lines_of(path)
    system, has_data = _layout(path, lines)
    rows = tuple(_rows(path, lines, system, has_data=has_data))
    if not rows:
        raise ConfigError(f'{path}: has no sensors: must have at least one line below the header')
    _check_ids(path, rows)
    if origin is not None:
        _check_origin(path, origin, system)
    places, reference = _placed(path, rows, system, origin, side_m)
    _check_inside(path, rows, places, system, side_m)
    entries = tuple(
        {'id': row.sensor_id, 'x_m': x_m, 'y_m': y_m}
        | ({} if row.data_mbit is None else {'data_mbit': row.data_mbit})
        for row, (x_m, y_m) in zip(rows, places, strict=True)
    )
    return SensorFile(entries, reference)


def _lines_of(path: Path) -> list[_Line]:
    text = read_text(path)
    try:
        reader = csv.reader(io.StringIO(text, newline=''), strict=True)
        return [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    except csv.Error as error:
        raise ConfigError(f'{path}: is not valid CSV: {error}') from error


def _layout(path: Path, lines: list[_Line]) -> tuple[_System, bool]:
    if not lines or not any(lines[0][1]):
        raise ConfigError(f'{path}: is empty: must begin with a header line, {_headers()}')
    _, header = lines[0]
    for column in header:
        if header.count(column) > 1 and column:
            raise ConfigError(f'{path}:1: column {dotted((column,))} appears twice')
    if _ID_COLUMN not in header:
        raise ConfigError(
            f'{path}:1: column {_ID_COLUMN} is missing from {shown(",".join(header))}'
        )
    found = [system for system in _SYSTEMS if any(column in header for column in system.columns)]
    if len(found) > 1:
        both = ' and '.join(','.join(system.columns) for system in found)
        raise ConfigError(f'{path}:1: has {both}: must have one pair of coordinates only')
    if not found:
        raise ConfigError(f'{path}:1: has no coordinates: must have {_headers()}')
    for column in found[0].columns:
        if column not in header:
            raise ConfigError(f'{path}:1: column {column} is missing')
    return found[0], _DATA_COLUMN in header


def _headers() -> str:
    pairs = ' or '.join(','.join(system.columns) for system in _SYSTEMS)
    return f'{_ID_COLUMN} and {pairs}'


def _rows(path: Path, lines: list[_Line], system: _System, *, has_data: bool) -> Iterator[_Row]:
    _, header = lines[0]
    for number, cells in lines[1:]:
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise ConfigError(
                f'{path}:{number}: has {len(cells)} fields: must have {len(header)}, as the header'
            )
        fields = dict(zip(header, cells, strict=True))
        first, second = (
            _number(f'{path}:{number}', column, fields[column], low, high, system.unit)
            for column, low, high in zip(system.columns, system.lows, system.highs, strict=True)
        )
        data_mbit = None
        if has_data:
            text = fields[_DATA_COLUMN]
            data_mbit = _amount(f'{path}:{number}', text)
        yield _Row(
            line=number, sensor_id=fields[_ID_COLUMN], place=(first, second), data_mbit=data_mbit
        )


def _number(place: str, column: str, text: str, low: float, high: float, unit: str) -> float:
    try:
        number = float(text.replace('_', '?'))  # Python alone reads 1_000 as a number
    except ValueError:
        number = math.nan
    if not low <= number <= high:
        raise ConfigError(
            f'{place}: {column} is {shown(text)}: '
            f'must be a number from {low:.10g} to {high:.10g} {unit}'
        )
    return number


def _amount(place: str, text: str) -> float:
    with suppress(ValueError):
        if float(text) == 0:
            return 0.0
    return _number(place, _DATA_COLUMN, text, MIN_DATA_MBIT, MAX_DATA_MBIT, 'Mbit, or 0')


def _check_ids(path: Path, rows: tuple[_Row, ...]) -> None:
    lines: dict[str, int] = {}
    for row in rows:
        place = f'{path}:{row.line}: {_ID_COLUMN} is {shown(row.sensor_id)}'
        if not 1 <= len(row.sensor_id) <= MAX_ID_LENGTH or not row.sensor_id.isprintable():
            raise ConfigError(f'{place}: must be 1 to {MAX_ID_LENGTH} printable characters')
        if row.sensor_id in lines:
            raise ConfigError(
                f'{place}: must be unique, but line {lines[row.sensor_id]} has the same'
            )
        lines[row.sensor_id] = row.line


def _check_origin(path: Path, origin: tuple[float, float], system: _System) -> None:
    for column, value, low, high in zip(
        system.columns, origin, system.lows, system.highs, strict=True
    ):
        if not low <= value <= high:
            raise ConfigError(
                f'{path}: sensors.origin has {column} {shown(value)}: '
                f'must be a number from {low:.10g} to {high:.10g} {system.unit}'
            )


def _placed(
    path: Path,
    rows: tuple[_Row, ...],
    system: _System,
    origin: tuple[float, float] | None,
    side_m: float,
) -> tuple[list[tuple[float, float]], dict[str, object] | None]:
    places = [row.place for row in rows]
    anchor = None
    if system.is_angular:
        anchor = origin or _middle(_unwrapped(places))
        places = [
            east_north_m(lat, lon, origin_lat_deg=anchor[0], origin_lon_deg=anchor[1])
            for lat, lon in places
        ]
        origin = None if origin is None else (0.0, 0.0)
    if origin is None:
        _check_span(path, places, side_m)
        middle = _middle(places)
        origin = middle[0] - side_m / 2, middle[1] - side_m / 2
    placed = [(round(x - origin[0], _DIGITS), round(y - origin[1], _DIGITS)) for x, y in places]
    if anchor is None:
        return placed, None
    lat_deg, lon_deg = anchor[0], (anchor[1] + 180) % 360 - 180
    position_m = [round(0.0 - metres, _DIGITS) for metres in origin]
    return placed, {'lat_deg': lat_deg, 'lon_deg': lon_deg, 'position_m': position_m}


def _check_span(path: Path, places: list[tuple[float, float]], side_m: float) -> None:
    spans_m = [max(values) - min(values) for values in zip(*places, strict=True)]
    if max(spans_m) > side_m:
        raise ConfigError(
            f'{path}: sensors span {spans_m[0]:.1f} m x {spans_m[1]:.1f} m: '
            f'must fit into the area, {side_m:g} m x {side_m:g} m'
        )


def _unwrapped(places: list[tuple[float, float]]) -> list[tuple[float, float]]:
    # A site may lie on both sides of the 180th meridian.
    first = places[0][1]
    return [(lat, (lon - first + 180) % 360 - 180 + first) for lat, lon in places]


def _middle(places: list[tuple[float, float]]) -> tuple[float, float]:
    firsts, seconds = zip(*places, strict=True)
    return (min(firsts) + max(firsts)) / 2, (min(seconds) + max(seconds)) / 2


def _check_inside(
    path: Path,
    rows: tuple[_Row, ...],
    places: list[tuple[float, float]],
    system: _System,
    side_m: float,
) -> None:
    for row, (x_m, y_m) in zip(rows, places, strict=True):
        if not (0 <= x_m <= side_m and 0 <= y_m <= side_m):
            raise ConfigError(
                f'{path}:{row.line}: {",".join(system.columns)} of sensor {row.sensor_id} lies at '
                f'x = {x_m:.1f} m, y = {y_m:.1f} m in the area: must be from 0 to {side_m:g} m'
            )

"""The rows of a table as places: which columns count, what stands in them, what is wrong there."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
import math

from uav_collect.config.yaml_text import dotted, shown, shown_path
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_DATA_MBIT, MAX_SENSOR_ID, MAX_SENSORS, MIN_DATA_MBIT
from uav_collect.scenario.columns import (
    DATA,
    DEGREES,
    find_columns,
    Found,
    GRID,
    ID,
    pairs_of,
    PLAIN,
    System,
    SYSTEMS,
    ZONE,
)
from uav_collect.scenario.numerals import (
    decimal_mark,
    degrees_mark,
    degrees_of,
    is_measured,
    is_thousand_or_fraction,
    number_of,
)
from uav_collect.scenario.odd_places import SensorPlace
from uav_collect.scenario.place_cells import has_places_by_name
from uav_collect.scenario.tables import FOLDER, Sheet, SheetRow

# Bare x, y are degrees where all lie together, metres where they do not: no site is as small as
# 2 m, and no area as large as 10 degrees.
_MOST_DEGREES = 2.0
_LEAST_METRES = 10.0
_ANY_GRID = 1e8  # east or north in any grid's own unit
_ROWS_AT_ONCE = 0.5  # of all, with one fault, are one problem
_MOST_NAMED = 6  # of columns that are not read

_MAY_BE_EITHER = 'may be a thousand or a fraction'


@dataclass(frozen=True, kw_only=True)
class PlaceColumns:
    """Which columns of a table count."""

    system: System
    place: tuple[int, int]  # the columns of the system's two coordinates
    names: tuple[str, str]  # what the table calls them
    mark: str  # of decimals of places, as `numerals.decimal_mark` has it
    data_mark: str  # of those of data
    id: int | None  # None: rows have no names
    data: int | None
    zone: int | None
    notes: tuple[str, ...]


@dataclass(kw_only=True)
class ReadRows:
    """What the rows of a table say, and each line about what is wrong, by its row."""

    places: list[SensorPlace] = field(default_factory=list)
    zones: list[str] = field(default_factory=list)  # of each place, as written
    problems: list[tuple[int, str]] = field(default_factory=list)
    n_blank: int = 0  # rows without a place that are left out


def layout_of(
    sheet: Sheet, columns: Mapping[str, str], grid: str, *, is_angular: bool
) -> PlaceColumns:
    """Find the columns that count.

    Args:
        columns: by role, the name of its column: those that the user gives.
        grid: name of the system of coordinates that the user gives; '': none.
        is_angular: whether that grid has latitudes and longitudes.

    Raises:
        ConfigError: there are no coordinates, or more than one column of a name that counts.
    """
    found = find_columns(sheet.header.cells, columns)
    pairs = pairs_of(found)
    _check_there(sheet, found, pairs)
    system, roles = _chosen(sheet, found, pairs, grid, is_angular=is_angular)
    _check_doubled(sheet, found, (*roles, ID, DATA))
    place = found.by_role[roles[0]], found.by_role[roles[1]]
    notes = [*_said_of_places(sheet, found, roles, pairs)]
    named = found.by_role.get(ID)
    if named is None:
        named = _distinct_column(sheet, found.by_role.values())
        notes.append(_said_of_names(sheet, named))
    if system.is_angular and roles == ('y', 'x'):
        lat, lon = _named(sheet, found, roles)
        notes.append(
            f'{lon},{lat} are degrees: {lon} is taken for the longitude, {lat} for the latitude'
        )
    marks_of = degrees_mark if system.is_angular else decimal_mark
    mark = marks_of(_cells(sheet.lines, place))
    data = found.by_role.get(DATA)
    amounts = () if data is None else _cells(sheet.lines, (data,))
    if mark == ',':
        notes.append('numbers have decimal commas')
    read = {*(found.by_role[role] for pair in pairs for role in pair), named}
    read |= {found.by_role.get(role) for role in (DATA, ZONE)}
    notes += _said_of_unread(sheet, read)
    return PlaceColumns(
        system=system,
        place=place,
        names=_named(sheet, found, roles),
        mark=mark,
        data_mark=decimal_mark(amounts, mark),
        id=named,
        data=data,
        zone=found.by_role.get(ZONE),
        notes=tuple(notes),
    )


def _said_of_places(
    sheet: Sheet, found: Found, chosen: tuple[str, str], pairs: Sequence[tuple[str, str]]
) -> Iterator[str]:
    """That there are columns by which places do not go."""
    by = ','.join(_named(sheet, found, chosen))
    for pair in pairs:
        if pair not in (chosen, chosen[::-1]):
            yield f'places go by {by}, not by {",".join(_named(sheet, found, pair))}'


def _said_of_unread(sheet: Sheet, read: Collection[int | None]) -> Iterator[str]:
    """Which columns count for nothing, as one of them may be meant to."""
    unread = [
        shown(name)
        for at, name in enumerate(sheet.header.cells)
        if name and at not in read and not _is_of_places(sheet, name)
    ]
    if unread:
        more = len(unread) - _MOST_NAMED
        kind = 'properties' if sheet.is_map else 'columns'
        named = ', '.join(unread[:_MOST_NAMED])
        yield f'{kind} not read: {named}' + (f' and {more} more' if more > 0 else '')


def _is_of_places(sheet: Sheet, name: str) -> bool:
    """Whether a column was read already: for its places, or as the folders of a map."""
    return name == FOLDER if sheet.is_map else has_places_by_name(name)


def _check_there(sheet: Sheet, found: Found, pairs: Sequence[tuple[str, str]]) -> None:
    """Refuse a table without coordinates, or without columns that the user gives."""
    where, header = sheet.where(sheet.header.number), sheet.header.cells
    problems = [
        f'{where}: column {dotted((name,))} is missing, which columns gives as {role}: the header '
        f'is {shown(",".join(header))}'
        for role, name in found.missing.items()
    ]
    if not pairs and not problems:
        problems.append(f'{where}: {_no_places(header, found)}')
    if problems:
        raise ConfigError(*problems)


def _distinct_column(sheet: Sheet, known: Collection[int]) -> int | None:
    """The first column that may be the ids all the same, as no two rows have the same there.

    Args:
        known: columns that mean something else.
    """
    for column, name in enumerate(sheet.header.cells):
        if not name or column in known or _is_of_places(sheet, name):
            continue
        cells = [_cell(line, column) for line in sheet.lines]
        if _are_ids(cells, may_be_counted=column == 0):
            return column
    return None


def _are_ids(cells: Sequence[str], *, may_be_counted: bool) -> bool:
    """Whether each cell may name one sensor alone, and most of them are no measured values.

    Args:
        may_be_counted: whole numbers may be names; further right they are heights, say.
    """
    if len({*cells}) < len(cells) or not all(map(_is_id, cells)):
        return False
    names = (cell for cell in cells if may_be_counted and cell.isdecimal())
    return 2 * (sum(map(is_measured, cells)) - len([*names])) < len(cells)


def _said_of_names(sheet: Sheet, named: int | None) -> str:
    none = 'no column has a name of ids, as id or station: sensors are'
    return f'{none} numbered' if named is None else f'{none} called by {sheet.header.cells[named]}'


def _is_id(text: str) -> bool:
    return 1 <= len(text) <= MAX_SENSOR_ID and text.isprintable()


def _named(sheet: Sheet, found: Found, roles: tuple[str, str]) -> tuple[str, str]:
    """What the header calls two columns."""
    first, second = (sheet.header.cells[found.by_role[role]] for role in roles)
    return first, second


def _no_places(header: Sequence[str], found: Found) -> str:
    pairs = ' or '.join(','.join(system.roles) for system in SYSTEMS)
    half = [
        (header[found.by_role[here]], lacking)
        for system in SYSTEMS
        for here, lacking in (system.roles, system.roles[::-1])
        if here in found.by_role
    ]
    if half:
        return f'has {shown(half[0][0])} without a column {half[0][1]}: must have {pairs}'
    return (
        f'has no coordinates, but {shown(",".join(header))}: must have columns {pairs}, or be '
        'told which they are, as columns: {lat: Y, lon: X}'
    )


def _check_doubled(sheet: Sheet, found: Found, roles: tuple[str, ...]) -> None:
    where = sheet.where(sheet.header.number)
    for role, name in found.doubled.items():
        if role in roles:
            raise ConfigError(f'{where}: column {dotted((name,))} appears twice')


def _chosen(
    sheet: Sheet,
    found: Found,
    pairs: Sequence[tuple[str, str]],
    grid: str,
    *,
    is_angular: bool,
) -> tuple[System, tuple[str, str]]:
    """By which columns places go: the system, and the roles of its two columns."""
    if grid:
        return _of_grid(sheet, pairs, grid, is_angular=is_angular)
    known = [system for system in SYSTEMS if system.roles in pairs]
    if known:
        return known[0], known[0].roles
    columns = found.by_role['x'], found.by_role['y']
    is_degrees = _are_degrees(sheet, columns)
    return (DEGREES, ('y', 'x')) if is_degrees else (PLAIN, ('x', 'y'))


def _of_grid(
    sheet: Sheet, pairs: Sequence[tuple[str, str]], grid: str, *, is_angular: bool
) -> tuple[System, tuple[str, str]]:
    bare = [('y', 'x')] if is_angular else [('x', 'y')]
    wanted = [DEGREES.roles] if is_angular else [GRID.roles, PLAIN.roles]
    there = [pair for pair in [*wanted, *bare] if pair in pairs or pair[::-1] in pairs]
    if not there:
        written = ' and '.join(','.join(pair) for pair in pairs)
        needed = 'latitudes and longitudes' if is_angular else 'east and north in its own unit'
        raise ConfigError(
            f'{shown_path(sheet.path)}: crs is {grid}, which has {needed}: must be left out, as '
            f'the places are {written}'
        )
    if is_angular:
        return DEGREES, there[0]
    bounds = (-_ANY_GRID, -_ANY_GRID), (_ANY_GRID, _ANY_GRID)
    return GRID._replace(lows=bounds[0], highs=bounds[1]), there[0]


def _are_degrees(sheet: Sheet, columns: tuple[int, int]) -> bool:
    """Whether columns x and y hold longitudes and latitudes, and not metres."""
    mark = degrees_mark(_cells(sheet.lines, columns))
    rows = [[number_of(_cell(line, column), mark) for column in columns] for line in sheet.lines]
    numbers = [row for row in rows if not any(map(math.isnan, row))]
    inside = [x for x in numbers if abs(x[0]) <= 180.0 and abs(x[1]) <= 90.0]
    is_swapped = 2 * len(inside) < len(numbers)
    if is_swapped:
        inside = [x for x in numbers if abs(x[0]) <= 90.0 and abs(x[1]) <= 180.0]
    if not numbers or 2 * len(inside) < len(numbers):
        return False
    spread = max(_spread([row[axis] for row in inside]) for axis in (0, 1))
    if _MOST_DEGREES < spread < _LEAST_METRES and not is_swapped:
        raise ConfigError(
            f'{sheet.where(sheet.header.number)}: x,y may be degrees or metres: must be told, by '
            'columns: {lon: x, lat: y} or columns: {x_m: x, y_m: y}'
        )
    return spread <= _MOST_DEGREES


def _spread(values: Sequence[float]) -> float:
    """How far values lie apart, but for a few of them."""
    middle = sorted(values)[len(values) // 2]
    return 2 * sorted(abs(value - middle) for value in values)[len(values) // 2]


def _cells(lines: Sequence[SheetRow], columns: Sequence[int]) -> Iterator[str]:
    return (_cell(line, column) for line in lines for column in columns)


def _cell(line: SheetRow, column: int) -> str:
    return line.cells[column] if column < len(line.cells) else ''


def rows_of(
    sheet: Sheet, layout: PlaceColumns, *, needs_data: bool, skips_blanks: bool
) -> ReadRows:
    """The places of all rows, and what is wrong with the others.

    Args:
        needs_data: each row must have an amount of data; else what is no amount is not looked at.
        skips_blanks: rows without a place are left out.
    """
    rows = ReadRows()
    digits = len(str(len(sheet.lines)))
    for line in sheet.lines:
        where = sheet.where(line.number)
        wrong = [*_wrong_length(sheet, layout, line)]
        texts = [_cell(line, column) for column in layout.place]
        if not wrong and not any(texts):
            if skips_blanks:
                rows.n_blank += 1
                continue
            wrong = [f'{",".join(layout.names)} are empty: must be numbers, or blanks: skip']
        at, wrong_at = ((math.nan, math.nan), []) if wrong else _place(layout, texts)
        name, wrong_name = _name(layout, sheet, line, len(rows.places) + 1, digits)
        data_mbit, wrong_data = _amount(layout, sheet, line, needs_data=needs_data)
        wrong += [*wrong_at, *wrong_name, *wrong_data]
        rows.problems += [(line.number, f'{where}: {what}') for what in wrong]
        if not wrong:
            rows.places.append(SensorPlace(name, at, data_mbit, line.number, where))
            rows.zones.append('' if layout.zone is None else _cell(line, layout.zone))
    return _in_short(sheet, layout, rows)


def _wrong_length(sheet: Sheet, layout: PlaceColumns, line: SheetRow) -> Iterator[str]:
    """Fields beyond the header, or too few for the columns that count."""
    n_columns = len(sheet.header.cells)
    if sheet.unit != 'line':  # what is empty there has no field, either
        return
    if any(line.cells[n_columns:]) or max(layout.place) >= len(line.cells):
        yield f'has {len(line.cells)} fields: must have {n_columns}, as the header'


def _place(layout: PlaceColumns, texts: Sequence[str]) -> tuple[tuple[float, float], list[str]]:
    """The two coordinates of a row, and what is wrong with them."""
    system, numbers, wrong = layout.system, [], []
    for axis, text in enumerate(texts):
        low, high = system.lows[axis], system.highs[axis]
        if system.is_angular:
            number = degrees_of(text, layout.mark, 'EW' if axis else 'NS')
        else:
            number = number_of(text, layout.mark)
        numbers.append(number)
        if not (layout.mark or system.is_angular) and is_thousand_or_fraction(text):
            wrong.append(f'{_shown_name(layout, axis)} is {shown(text)}: {_MAY_BE_EITHER}')
        elif not low <= number <= high:
            allowed = f'must be a number from {low:.10g} to {high:.10g} {system.unit}'
            wrong.append(f'{_shown_name(layout, axis)} is {shown(text)}: {allowed}')
    return (numbers[0], numbers[1]), wrong


def _shown_name(layout: PlaceColumns, axis: int) -> str:
    return dotted((layout.names[axis],))


def _name(
    layout: PlaceColumns, sheet: Sheet, line: SheetRow, number: int, digits: int
) -> tuple[str, list[str]]:
    if layout.id is None:
        return f'S{number:0{digits}d}', []
    name = _cell(line, layout.id)
    if _is_id(name):
        return name, []
    column = dotted((sheet.header.cells[layout.id],))
    allowed = f'must be 1 to {MAX_SENSOR_ID} printable characters'
    return name, [f'{column} is {shown(name)}: {allowed}']


def _amount(
    layout: PlaceColumns, sheet: Sheet, line: SheetRow, *, needs_data: bool
) -> tuple[float | None, list[str]]:
    if layout.data is None:
        return None, []
    text = _cell(line, layout.data)
    amount = number_of(text, layout.data_mark)
    if amount == 0 or MIN_DATA_MBIT <= amount <= MAX_DATA_MBIT:
        return abs(amount), []
    if not needs_data:
        return None, []
    column = dotted((sheet.header.cells[layout.data],))
    allowed = f'must be a number from {MIN_DATA_MBIT:.10g} to {MAX_DATA_MBIT:.10g} Mbit, or 0'
    is_open = not layout.data_mark and is_thousand_or_fraction(text)
    return None, [f'{column} is {shown(text)}: {_MAY_BE_EITHER if is_open else allowed}']


def _in_short(sheet: Sheet, layout: PlaceColumns, rows: ReadRows) -> ReadRows:
    """The rows with one line for what is wrong with most of them: they are of another grid."""
    if 2 * len(rows.problems) <= len(sheet.lines):
        return rows
    numbers = [
        [number_of(_cell(line, column), layout.mark) for column in layout.place]
        for line in sheet.lines
    ]
    outside = [
        row for row in numbers if all(map(math.isfinite, row)) and not layout.system.has(row)
    ]
    if len(outside) < 2 or len(outside) <= _ROWS_AT_ONCE * len(sheet.lines):
        return rows
    what = _other_system(sheet, layout, outside)
    if not what:
        return rows
    spans = [
        f'{name} from {min(values):.10g} to {max(values):.10g}'
        for name, values in zip(layout.names, zip(*outside, strict=True), strict=True)
    ]
    line = f'{shown_path(sheet.path)}: has {" and ".join(spans)}, which {what}'
    return ReadRows(problems=[(0, line)])


def _other_system(sheet: Sheet, layout: PlaceColumns, outside: Sequence[Sequence[float]]) -> str:
    """What places are that are none of the table's own system; '': that is not known."""
    first, second = layout.names
    if layout.system == DEGREES and all(DEGREES.has(row[::-1]) for row in outside):
        given = f'columns: {{lat: {second}, lon: {first}}}'
        how = 'written longitude first' if sheet.is_map else f'swapped, by {given}'
        return f'are longitudes and latitudes: must be {how}'
    if layout.system == DEGREES and sheet.is_map:
        return (
            'are no degrees: must be read by the grid it is of, as crs: EPSG:2056, or as metres '
            'of no grid, of a CSV with the columns x_m, y_m'
        )
    if layout.system == GRID:
        return (
            'is no UTM: must be read by the grid it is of, as crs: EPSG:2056, or as plain metres, '
            f'by columns: {{x_m: {first}, y_m: {second}}}'
        )
    return ''


def check_number_of_rows(sheet: Sheet) -> None:
    """Refuse a table of too many rows, or of none.

    Raises:
        ConfigError: it has.
    """
    if not sheet.lines:
        what = f'{sheet.unit} with a point' if sheet.is_map else f'{sheet.unit} below the header'
        raise ConfigError(
            f'{shown_path(sheet.path)}: has no sensors: must have at least one {what}'
        )
    if len(sheet.lines) > MAX_SENSORS:
        raise ConfigError(
            f'{shown_path(sheet.path)}: has {len(sheet.lines):,} sensors: must have at most '
            f'{MAX_SENSORS:,}'
        )

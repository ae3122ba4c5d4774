"""Cells that a scenario file names by row and column: of starts, homes and no-fly zones."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import groupby
from typing import Any

from uav_collect.config.layers import Document
from uav_collect.config.rules import validated, whole
from uav_collect.config.yaml_text import Keys, shown
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_CELLS_PER_SIDE, MAX_NO_FLY_CORNERS
from uav_collect.scenario.model import AreaConfig, Polygon

_ZONES: Keys = ('area', 'no_fly')
_Cell = tuple[int, int]  # row, column


def area_of(document: Document) -> AreaConfig:
    """The area, as one of the two ways to say how many cells it has; its zones not too large.

    Raises:
        ConfigError: one line per problem.
    """
    area = validated(AreaConfig, document, ('area',))
    is_square = area.cells_per_side is not None
    given = [name for name in ('rows', 'columns') if getattr(area, name) is not None]
    if not is_square and not given:
        allowed = f'a whole number from 1 to {MAX_CELLS_PER_SIDE}, or rows and columns be given'
        what = f'is missing: must be {allowed}'
        raise ConfigError(document.problem(('area', 'cells_per_side'), what))
    if given and (is_square or len(given) == 1):
        other = 'columns' if given[0] == 'rows' else 'rows'
        wrong = 'beside cells_per_side' if is_square else f'without {other}'
        what = f'is given {wrong}: must be rows and columns, or cells_per_side'
        raise ConfigError(document.problem(('area', given[0]), what))
    n_corners = sum(map(len, area.no_fly or ()))
    if n_corners > MAX_NO_FLY_CORNERS:
        what = f'has {n_corners:,} corners in all: must have at most {MAX_NO_FLY_CORNERS:,}'
        raise ConfigError(document.problem(_ZONES, what))
    return area


def row_and_column(document: Document, keys: Keys, cell: object, area: AreaConfig) -> _Cell:
    """Row and column of a cell that stands at a path.

    Raises:
        ConfigError: the area has none such.
    """
    last = area.n_rows - 1, area.n_columns - 1
    try:
        if not isinstance(cell, list | tuple):
            raise ValueError
        row, column = (whole(0, most).parse(it) for it, most in zip(cell, last, strict=True))
    except ValueError:
        allowed = f'of whole numbers from 0 to {last[0]}'
        if last[1] != last[0]:
            allowed += f' and from 0 to {last[1]}'
        what = f'is {shown(cell)}: must be a list [row, column] {allowed}'
        raise ConfigError(document.problem(keys, what)) from None
    return row, column


def with_zones_of_cells(document: Document) -> Document:
    """Each no-fly zone that is given by cells, as rectangles.

    The first one stands where the cells stood, the others behind all zones: these keep their
    numbers.

    Raises:
        ConfigError: one line per problem.
    """
    zones = document.at(_ZONES)
    if not isinstance(zones, list | tuple) or not any(isinstance(it, dict) for it in zones):
        return document
    area = area_of(_with_zones(document, None))
    first: list[object] = []
    others: list[tuple[Polygon, Keys]] = []
    problems: list[str] = []
    for index, zone in enumerate(zones):
        if not isinstance(zone, dict):
            first.append(zone)
            continue
        try:
            polygon, *more = _rectangles(document, (*_ZONES, index), zone, area)
        except ConfigError as error:
            problems += error.problems
            continue
        first.append(polygon)
        others += [(each, (*_ZONES, index)) for each in more]
    if problems:
        raise ConfigError(*problems)
    written: dict[Keys, Keys] = {
        (*_ZONES, number): keys for number, (_, keys) in enumerate(others, start=len(first))
    }
    placed = _with_zones(document, (*first, *(polygon for polygon, _ in others)))
    return replace(placed, aliases={**document.aliases, **written})


def _with_zones(document: Document, zones: tuple[object, ...] | None) -> Document:
    area = {**document.at(('area',)), 'no_fly': zones}
    return replace(document, values={**document.values, 'area': area})


def _rectangles(
    document: Document, keys: Keys, zone: dict[Any, Any], area: AreaConfig
) -> list[Polygon]:
    """The rectangles that the cells of a zone make, at least one."""
    cells = zone.get('cells')
    if [*zone] != ['cells'] or not isinstance(cells, list | tuple) or not cells:
        what = f'is {shown(zone)}: must be a list of points, or {{cells: [[row, column], ...]}}'
        raise ConfigError(document.problem(keys, what))
    found: set[_Cell] = set()
    problems: list[str] = []
    for index, cell in enumerate(cells):
        try:
            found.add(row_and_column(document, (*keys, 'cells', index), cell, area))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(*problems)
    size_m = area.cell_size_m
    return [
        (
            (west * size_m, south * size_m),
            (east * size_m, south * size_m),
            (east * size_m, north * size_m),
            (west * size_m, north * size_m),
        )
        for west, south, east, north in _blocks(found)
    ]


def _blocks(cells: Iterable[_Cell]) -> Iterator[tuple[int, int, int, int]]:
    """Cells as blocks: of the same columns in rows that follow each other.

    Each by its first column and row, and one past the last ones.
    """
    growing: dict[tuple[int, int], tuple[int, int]] = {}  # first and next row by columns
    for row, of_row in groupby(sorted(cells), key=lambda cell: cell[0]):
        for columns in _runs([column for _, column in of_row]):
            first, after = growing.get(columns, (row, row))
            if after != row:
                yield columns[0], first, columns[1], after
                first = row
            growing[columns] = first, row + 1
    for (west, east), (south, north) in growing.items():
        yield west, south, east, north


def _runs(columns: list[int]) -> Iterator[tuple[int, int]]:
    """The first and one past the last of columns that lie side by side."""
    first = columns[0]
    for column, after in zip(columns, [*columns[1:], None], strict=True):
        if after != column + 1:
            yield first, column + 1
            first = after or 0

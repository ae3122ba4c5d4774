"""Places that a table has in one cell: `46.78, -117.09`, or `POINT (-117.09 46.78)`."""

import re

from uav_collect.scenario.columns import plain
from uav_collect.scenario.tables import Sheet, SheetRow

# As data portals and map programs call such columns.
_LAT_LON = frozenset(
    {'geo_point_2d', 'geo_point', 'geopoint', 'lat_lon', 'latlon', 'lat_long', 'latlong', 'latlng'}
    | {'lat_lng', 'gps', 'gps_coordinates', 'coordinates', 'coordonnees', 'koordinaten'}
    | {'coordenadas', 'coordinate', 'location', 'position', 'standort', 'geo'}
)
_WKT = frozenset({'wkt', 'wkt_geom', 'geom', 'geometry', 'the_geom', 'shape'})
_NUMBER = r'([+-]?[0-9]+(?:\.[0-9]+)?)'
_PAIR = re.compile(rf'[(\[]?\s*{_NUMBER}\s*[,; ]\s*{_NUMBER}\s*[)\]]?')
_POINT = re.compile(
    rf'(?:SRID=4326;)?\s*POINT\s*Z?M?\s*\(\s*{_NUMBER}\s+{_NUMBER}[^)]*\)', re.IGNORECASE
)
_FORMS = ((_LAT_LON, _PAIR, ('lat', 'lon')), (_WKT, _POINT, ('x', 'y')))


def has_places_by_name(name: str) -> bool:
    """Whether a column of this name may have its places in one cell each."""
    return any(plain(name) in known for known, _, _ in _FORMS)


def with_places_apart(sheet: Sheet) -> Sheet:
    """The table with two columns more, where a column has its places in one cell each.

    Of cells that hold none, both are empty but for what stands there, which is refused by that.
    """
    names = [plain(name) for name in sheet.header.cells]
    for at, name in enumerate(names):
        for known, pattern, roles in _FORMS:
            if name in known and _are_places(sheet, at, pattern):
                return _apart(sheet, at, pattern, roles)
    return sheet


def _are_places(sheet: Sheet, column: int, pattern: re.Pattern[str]) -> bool:
    """Whether most of what stands in a column is a place."""
    cells = [row.cells[column] for row in sheet.lines if column < len(row.cells)]
    filled = [cell for cell in cells if cell]
    return bool(filled) and 2 * sum(map(bool, map(pattern.fullmatch, filled))) > len(filled)


def _apart(sheet: Sheet, column: int, pattern: re.Pattern[str], roles: tuple[str, str]) -> Sheet:
    width = len(sheet.header.cells)
    rows = []
    for row in sheet.lines:
        cells = [*row.cells, *[''] * (width - len(row.cells))]
        found = pattern.fullmatch(cells[column])
        both = found.groups() if found else (cells[column], '')
        rows.append(SheetRow(row.number, [*cells[:width], *both, *cells[width:]]))
    names = [*sheet.header.cells, *roles]
    names[column] = ''  # it means nothing else: `location` would hold the ids
    header = SheetRow(sheet.header.number, names)
    name = sheet.header.cells[column]
    note = f'places stand in {name}, as {",".join(roles)}'
    return Sheet(
        path=sheet.path,
        unit=sheet.unit,
        header=header,
        lines=tuple(rows),
        notes=(*sheet.notes, note),
    )

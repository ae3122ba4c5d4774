"""Areas that are no open squares, for tests of whoever flies over them.

with_a_hole, 12 x 12 cells of 50 m:   pipeline(n), n x n cells of 100 m, n = 4:

. . . . . . # # # # # #               . . . .    a sensor in each column, S, by turns in one row
(6 rows of these)                     . S . S    and the next; the other cells are known to hold
. . . . . . . . . . . .               S . S .    no data
. . . # # . . . . . . .               . . . .
. . . # # . . . . . . .
(3 rows of the first kind)

maze(), 9 x 9 cells of 50 m: MAZE below, with dead ends, ways in a circle and a pocket.
"""

from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario

MAZE = (  # north above
    '. . . # . . . . .',
    '. # . # . # # # .',
    '. # . . . # . . .',
    '. # # # # # . # .',
    '. . . . . . . # .',
    '# # # # . # # # .',
    '. . . . . . . . .',
    '. # . . . # . # #',  # a zone like a U, whose inside is one way in and no way out
    '. # # # # # . . .',
)

_SPEEDS = [{'speed_mps': 10.0}, {'speed_mps': 18.0}]


def with_a_hole(**overrides: object) -> Scenario:
    """An L of open cells with a no-fly square, sensors drawn as in the paper."""
    corner = [[300.0, 300.0], [600.0, 300.0], [600.0, 600.0], [300.0, 600.0]]
    hole = [[150.0, 150.0], [250.0, 150.0], [250.0, 250.0], [150.0, 250.0]]
    return _area({'area.cells_per_side': 12, 'area.no_fly': [corner, hole]}, overrides)


def pipeline(n_cells: int, **overrides: object) -> Scenario:
    """Sensors along a line from the fleet's home in the west, all with data."""
    middle_m = n_cells // 2 * 100.0
    entries = [
        {
            'id': f'km{column / 10:.1f}',
            'x_m': column * 100.0 + 50.0,
            'y_m': middle_m + 40.0 * (-1) ** column,
        }
        for column in range(n_cells)
    ]
    home = {'cell': [n_cells // 2, 0]}
    values = {
        'area.cells_per_side': n_cells,
        'area.cell_size_m': 100.0,
        'sensors': {'kind': 'listed', 'entries': entries},
        'demand': {'cell_share': 'all', 'data_mbit': [0.5, 2.0], 'known_empty': 'sensors'},
        'fleet.default.start': home,
        'fleet.default.home': home,
        'fleet.uavs': _SPEEDS,
    }
    return _area(values, overrides)


def arms(n_uavs: int, **overrides: object) -> Scenario:
    """An L of 7 x 7 cells of 100 m, the middle of its foot closed; sensors in both arms."""
    cells = (0, 1, 4, 5, 11, 13, 17, 18, 20, 36, 37, 44)
    entries = [
        {'id': f's{cell}', 'x_m': cell % 7 * 100.0 + 40.0, 'y_m': cell // 7 * 100.0 + 40.0}
        for cell in cells
    ]
    corner = [[300.0, 300.0], [700.0, 300.0], [700.0, 700.0], [300.0, 700.0]]
    middle = [[100.0, 100.0], [300.0, 100.0], [300.0, 300.0], [100.0, 300.0]]
    home = {'cell': [0, 3]}
    values = {
        'area.cells_per_side': 7,
        'area.cell_size_m': 100.0,
        'area.no_fly': [corner, middle],
        'sensors': {'kind': 'listed', 'entries': entries},
        'demand': {'cell_share': 'all', 'data_mbit': [0.5, 1.0], 'known_empty': 'sensors'},
        'fleet.default.start': home,
        'fleet.default.home': home,
        'fleet.uavs': [{'speed_mps': 10.0}] * n_uavs,
    }
    return _area(values, overrides)


def maze(**overrides: object) -> Scenario:
    """The maze above, sensors drawn as in the paper."""
    closed = [
        (50.0 * column, 50.0 * row)
        for row, cells in enumerate(reversed(MAZE))
        for column, cell in enumerate(cells.split())
        if cell == '#'
    ]
    zones = [
        [[x_m + 9.0, y_m + 9.0], [x_m + 41.0, y_m + 9.0], [x_m + 25.0, y_m + 41.0]]
        for x_m, y_m in closed
    ]
    return _area({'area.cells_per_side': 9, 'area.no_fly': zones}, overrides)


def corridor(n_rows: int, n_columns: int, **overrides: object) -> Scenario:
    """An open rectangle, sensors drawn as in the paper."""
    return _area({'area.rows': n_rows, 'area.columns': n_columns}, overrides)


def _area(values: dict[str, object], overrides: dict[str, object]) -> Scenario:
    dotted = {key.replace('__', '.'): value for key, value in overrides.items()}
    fleet = {'fleet.default.energy_budget_kj': 1000.0}
    return load('paper_10x10', {**fleet, **values, **dotted})

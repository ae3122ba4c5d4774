"""Small fields of which nobody knows the demand, and all the demand that they may have."""

from collections.abc import Iterator
from itertools import product
import math

from tiny_world import tiny, uav
from uav_collect.planning.unknown_demand import drawn_counts
from uav_collect.scenario.model import Scenario

SHARE = 0.3  # of cells that have data
SIZE_M = 50.0  # of a cell
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))


def field(
    n_rows: int,
    n_columns: int,
    cells: tuple[int, ...] | None = None,
    speeds: tuple[float, ...] = (5.0,),
) -> Scenario:
    """Cells that may hold data, or some that do; a UAV of each speed [m/s], all in contact."""
    some = range(n_rows * n_columns) if cells is None else cells
    centres = [(SIZE_M * (c % n_columns + 0.5), SIZE_M * (c // n_columns + 0.5)) for c in some]
    return tiny(
        *map(uav, speeds),
        sensors=[(x_m, y_m, 3.0) for x_m, y_m in centres],
        area={'rows': n_rows, 'columns': n_columns, 'cell_size_m': SIZE_M, 'altitude_m': 100.0},
        demand={
            'cell_share': SHARE if cells is None else 'all',
            'data_mbit': 'csv',
            'known_empty': 'none',
        },
        radio__contact_range_m=math.inf,
    )


def demands(n_rows: int, n_columns: int) -> Iterator[tuple[tuple[int, ...], float]]:
    """All sets of data cells that the world may draw, and how likely it does."""
    n_cells = n_rows * n_columns
    counts = drawn_counts(field(n_rows, n_columns))
    for bits in product((0, 1), repeat=n_cells):
        cells = tuple(cell for cell in range(n_cells) if bits[cell])
        chance = counts[len(cells)] / math.comb(n_cells, len(cells))
        if chance > 0.0:
            yield cells, float(chance)

"""The map of a field: its cells, sensors, edge, no-fly zones and base."""

from io import BytesIO
import math
from warnings import catch_warnings, filterwarnings

import numpy as np
from uav_collect.analysis.area_picture import MOST_NAMES, write_name
from uav_collect.analysis.plotting import Axes, Figure, FigureCanvasAgg
from uav_collect.fields.grid import CellGrid
from uav_collect.kernels.arrays import Ints
from uav_collect.scenario.area import shown_box_m

_DPI = 150
_LONGEST_IN = 8.0  # longer side of the map
_MARGINS_IN = (0.75, 0.55, 0.2, 0.5)  # left, below, right and above of the map
_PANEL_IN = 1.9  # width of what stands beside it
_LEAST_IN = 2.6  # height of that
_BAR_IN = 1.5  # longest scale bar
_FONT_PT = 8

# Of Okabe and Ito, which colour-blind people tell apart; zones and closed cells are hatched, too.
_SENSOR, _EDGE, _ZONE, _BASE = '#1a1a1a', '#0072B2', '#D55E00', '#00684a'
_CLOSED, _GRID, _DATA_CELL = '#8a8f98', '#c9cdd3', '#dbeafe'


def map_picture(grid: CellGrid, title: str) -> bytes:
    """The map of a field's cells as PNG; the same cells give the same bytes."""
    west_m, south_m, east_m, north_m = shown_box_m(grid.area)
    inch_per_m = _LONGEST_IN / max(east_m - west_m, north_m - south_m)
    width_in, height_in = (east_m - west_m) * inch_per_m, (north_m - south_m) * inch_per_m
    left_in, below_in, right_in, above_in = _MARGINS_IN
    whole_in = (
        left_in + width_in + right_in + _PANEL_IN,
        max(height_in, _LEAST_IN) + below_in + above_in,
    )
    figure = Figure(figsize=whole_in, facecolor='white')
    FigureCanvasAgg(figure)
    foot_in = whole_in[1] - above_in - height_in
    axes = _axes(figure, left_in, foot_in, width_in, height_in)
    panel = _axes(figure, left_in + width_in + right_in, 0.0, _PANEL_IN, whole_in[1])
    panel.set_axis_off()
    axes.set(xlim=(west_m, east_m), ylim=(south_m, north_m))
    _draw_cells(axes, grid)
    _draw_outlines(axes, grid)
    _draw_sensors(axes, grid)
    axes.set_xlabel('east [m]', fontsize=_FONT_PT)
    axes.set_ylabel('north [m]', fontsize=_FONT_PT)
    axes.tick_params(labelsize=_FONT_PT - 1)
    axes.set_title(title, fontsize=_FONT_PT + 2, loc='left', parse_math=False)
    _draw_panel(panel, axes, inch_per_m, whole_in[1], whole_in[1] - above_in)
    file = BytesIO()
    with (
        catch_warnings()
    ):  # the fonts that come with Matplotlib do not have all of mankind's names
        filterwarnings('ignore', message='Glyph .* missing from')
        figure.savefig(file, dpi=_DPI, format='png', metadata={'Software': None})
    return file.getvalue()


def _axes(
    figure: Figure, left_in: float, below_in: float, width_in: float, height_in: float
) -> Axes:
    whole_in = figure.get_size_inches()
    return figure.add_axes(
        (
            left_in / whole_in[0],
            below_in / whole_in[1],
            width_in / whole_in[0],
            height_in / whole_in[1],
        )
    )


def _draw_cells(axes: Axes, grid: CellGrid) -> None:
    """Draw cells with sensors, closed ones, and the lines between all."""
    width_m, height_m = grid.area.width_m, grid.area.height_m
    easts_m = np.arange(grid.n_columns + 1) * grid.cell_size_m
    norths_m = np.arange(grid.n_rows + 1) * grid.cell_size_m
    axes.vlines(easts_m, 0.0, height_m, color=_GRID, linewidth=0.5, zorder=1)
    axes.hlines(norths_m, 0.0, width_m, color=_GRID, linewidth=0.5, zorder=1)
    holds = np.zeros(grid.n_cells, dtype=np.bool_)
    holds[grid.sensor_cell] = True
    _fill_cells(axes, grid, np.flatnonzero(holds), 'cell with sensors', facecolor=_DATA_CELL)
    closed = np.flatnonzero(~grid.is_open)
    _fill_cells(axes, grid, closed, 'closed cell', facecolor='#f1f2f4', hatch='////')


def _fill_cells(
    axes: Axes, grid: CellGrid, cells: Ints, label: str, *, facecolor: str, hatch: str = ''
) -> None:
    """Fill cells; those that lie beside each other in a row as one."""
    begins = (np.diff(cells) > 1) | (cells[1:] % grid.n_columns == 0)
    for number, run in enumerate(np.split(cells, np.flatnonzero(begins) + 1)):
        if run.size == 0:
            continue
        row, column = divmod(int(run[0]), grid.n_columns)
        west_m, south_m = column * grid.cell_size_m, row * grid.cell_size_m
        east_m, north_m = west_m + run.size * grid.cell_size_m, south_m + grid.cell_size_m
        axes.fill(
            [west_m, east_m, east_m, west_m], [south_m, south_m, north_m, north_m],
            linewidth=0, zorder=0, label='' if number else label, facecolor=facecolor,
            edgecolor=_CLOSED, hatch=hatch,
        )  # fmt: skip


def _draw_outlines(axes: Axes, grid: CellGrid) -> None:
    """Draw the area's edge and the no-fly zones."""
    if grid.area.boundary:
        ring = np.array([*grid.area.boundary, grid.area.boundary[0]])
        axes.plot(*ring.T, color=_EDGE, linewidth=1.6, zorder=3, label="area's edge")
    for number, zone in enumerate(grid.area.no_fly or ()):
        axes.fill(
            *np.array(zone).T, facecolor=f'{_ZONE}30', edgecolor=_ZONE, linestyle='--',
            linewidth=1.4, zorder=2, label='' if number else 'no-fly zone',
        )  # fmt: skip


def _draw_sensors(axes: Axes, grid: CellGrid) -> None:
    """Draw sensors, by name where there are few, and the base."""
    n_sensors = len(grid.position_m)
    is_few = n_sensors <= MOST_NAMES
    east_m, north_m = grid.position_m.T
    axes.scatter(
        east_m, north_m, 14.0 if is_few else 4.0, color=_SENSOR, linewidths=0, zorder=5,
        label='sensor',
    )  # fmt: skip
    for name, place in zip(grid.ground.sensor_ids, grid.position_m, strict=True):
        if is_few:
            write_name(axes, name, (float(place[0]), float(place[1])), _FONT_PT - 2)
    base_m = grid.centre_m(grid.base_cell)
    axes.scatter(
        base_m[0], base_m[1], 110, color=_BASE, marker='X', edgecolors='white',
        zorder=7, label='base',
    )  # fmt: skip


def _draw_panel(
    panel: Axes, axes: Axes, inch_per_m: float, whole_in: float, top_in: float
) -> None:
    """Draw what colours mean, where north is, and how long a length is; the panel is in inches."""
    panel.set(xlim=(0, _PANEL_IN), ylim=(0, whole_in))
    handles, labels = axes.get_legend_handles_labels()
    panel.legend(
        handles, labels, loc='upper left', bbox_to_anchor=(0, top_in / whole_in), frameon=False,
        fontsize=_FONT_PT, borderaxespad=0,
    )  # fmt: skip
    panel.annotate('N', (0.3, 0.98), ha='center', fontsize=_FONT_PT + 2, fontweight='bold')
    arrow = {'arrowstyle': '-|>', 'color': _SENSOR}
    panel.annotate('', (0.3, 0.98), (0.3, 0.5), arrowprops=arrow)
    bar_m = bar_length_m(_BAR_IN / inch_per_m)
    panel.plot(
        [0.1, 0.1 + bar_m * inch_per_m], [0.15, 0.15], color=_SENSOR, linewidth=3,
        solid_capstyle='butt',
    )  # fmt: skip
    text = f'{bar_m:g} m' if bar_m < 1000 else f'{bar_m / 1000:g} km'
    panel.annotate(text, (0.1, 0.22), fontsize=_FONT_PT)


def bar_length_m(most_m: float) -> float:
    """Length of a scale bar: 1, 2 or 5 times a power of ten, as long as it may be."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return next(factor * power for factor in (5.0, 2.0, 1.0) if factor * power <= most_m)

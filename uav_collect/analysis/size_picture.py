"""The picture of what batteries do: the share of missions that are complete, over the battery."""

from collections.abc import Sequence
from io import BytesIO
import math

import numpy as np
from uav_collect.analysis.area_picture import GREY, GRID
from uav_collect.analysis.plotting import Axes, Figure, FigureCanvasAgg
from uav_collect.analysis.sizing import Battery, needs_wh, Sized, Trial
from uav_collect.analysis.trajectories import COLOURS, DPI

_SIZE_IN = (7.2, 4.2)
_MARKERS = 'os^Dv'
_MARKER_SIZES = (9, 7, 5)  # by fleet, so that none hides another


def draw_sizes(
    trials: Sequence[Trial],
    found: Sequence[Sized],
    battery: Battery,
    wanted_share: float,
    title: str,
) -> bytes:
    """Draw a PNG: what was flown as points with intervals, and as a line what needs alone say.

    A line says how many missions need no more, each UAV flying to the end of its part. Where the
    points lie above it, UAVs did the part of others that had turned home.
    """
    figure = Figure(figsize=_SIZE_IN, facecolor='white', layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.axhline(100 * wanted_share, color=GREY, linewidth=1.0, linestyle='--', zorder=1)
    for index, one in enumerate(found):
        own = [trial for trial in trials if trial.n_uavs == one.n_uavs]
        _draw_fleet(axes, own, one, battery, index)
    axes.set_xlabel(f'battery of each UAV [Wh], {100 * battery.usable_share:g} % of it usable')
    axes.set_ylabel('missions complete [%]')
    axes.set_ylim(-2.0, 102.0)
    axes.set_title(title, loc='left', fontsize=10, parse_math=False)
    axes.grid(color=GRID, linewidth=0.6)
    axes.spines[['top', 'right']].set_visible(False)
    axes.legend(frameon=False, fontsize=8.5, loc='center left', bbox_to_anchor=(1.0, 0.5))
    drawn = BytesIO()
    # No software name in the file: the bytes are the trials'.
    figure.savefig(drawn, dpi=DPI, format='png', metadata={'Software': None})
    return drawn.getvalue()


def _draw_fleet(
    axes: Axes, trials: Sequence[Trial], found: Sized, battery: Battery, index: int
) -> None:
    colour, marker = COLOURS[index % len(COLOURS)], _MARKERS[index % len(_MARKERS)]
    needed = '' if math.isnan(found.needed_wh) else f': {found.needed_wh:g} Wh'
    fleet = f'{found.n_uavs} UAV{"s" if found.n_uavs > 1 else ""}'
    flown = sorted(
        (it for it in trials if math.isfinite(it.battery_wh)), key=lambda it: it.battery_wh
    )
    for free in (it for it in trials if math.isinf(it.battery_wh)):
        needs = np.sort(needs_wh(free, battery))
        needs = needs[np.isfinite(needs)]
        shares = 100 * (np.arange(len(needs)) + 1) / free.n_missions
        axes.step(
            needs,
            shares,
            where='post',
            color=colour,
            linewidth=1.2,
            alpha=0.7,
            label=f'{fleet}: what ample flights took',
        )
    points = [(it.battery_wh, 100 * it.complete_share, *it.interval) for it in flown]
    x_wh, y, low, high = np.array(points).reshape(-1, 4).T
    bars = (np.maximum(y - 100 * low, 0.0), np.maximum(100 * high - y, 0.0))
    axes.errorbar(
        x_wh,
        y,
        yerr=bars,
        capsize=2,
        elinewidth=1.0,
        label=f'{fleet}{needed}',
        color=colour,
        marker=marker,
        markersize=_MARKER_SIZES[min(index, len(_MARKER_SIZES) - 1)],
        markerfacecolor='none',  # what lies under others is seen through them
        linestyle='none',
    )
    if needed:
        axes.axvline(found.needed_wh, color=colour, linewidth=0.8, linestyle=':')

"""What lies still under a mission's picture: cells, outlines, names of sensors, places of UAVs."""

import math

import numpy as np
from uav_collect.analysis.plotting import Axes, Line2D, Rectangle, withStroke
from uav_collect.scenario.area import open_cells, shown_box_m
from uav_collect.scenario.model import AreaConfig, ListedSensors, Scenario
from uav_collect.scenario.site import Site

GREEN = '#1A9641'
BLACK = '#111111'
GREY = '#A9A9A9'
GRID = '#E2E2E2'
NO_FLY = '#B3261E'
FONT_PT = 9.0
MOST_NAMES = 80  # of sensors, so that they can be read
_LONGEST_NAME = 20  # characters
_NAME_PT = 6.5


def draw_area(axes: Axes, scenario: Scenario) -> None:
    """Draw the cells of an area and its outlines, and scales beside it, into axes."""
    area = scenario.area
    easts_m = np.arange(area.n_columns + 1) * area.cell_size_m
    norths_m = np.arange(area.n_rows + 1) * area.cell_size_m
    axes.vlines(easts_m, 0.0, area.height_m, color=GRID, linewidth=0.6, zorder=0)
    axes.hlines(norths_m, 0.0, area.width_m, color=GRID, linewidth=0.6, zorder=0)
    draw_closed(axes, area)
    _draw_outlines(axes, area)
    west_m, south_m, east_m, north_m = shown_box_m(area)
    axes.set(xlim=(west_m, east_m), ylim=(south_m, north_m), aspect='equal')
    axes.set_xlabel('east [m]', fontsize=FONT_PT)
    axes.set_ylabel('north [m]', fontsize=FONT_PT)
    every = _cells_per_tick(max(area.n_rows, area.n_columns))
    axes.set_xticks(easts_m[::every])
    axes.set_yticks(norths_m[::every])
    axes.tick_params(labelsize=FONT_PT - 1, color='#888888')
    axes.spines[:].set_color('#888888')


def draw_closed(axes: Axes, area: AreaConfig) -> None:
    """Hatch the cells that no UAV may fly over."""
    size_m = area.cell_size_m
    for cell in np.flatnonzero(open_cells(area) == 0).tolist():
        row, column = divmod(cell, area.n_columns)
        place_m = column * size_m, row * size_m
        axes.add_patch(_closed_square(place_m, size_m))


def _closed_square(place_m: tuple[float, float], size_m: float, label: str = '') -> Rectangle:
    return Rectangle(
        place_m, size_m, size_m, facecolor='#F4F4F4', edgecolor=GREY, hatch='////', linewidth=0.0,
        zorder=0.5, label=label,
    )  # fmt: skip


def _draw_outlines(axes: Axes, area: AreaConfig) -> None:
    """Draw what the boundary and the no-fly zones are as they were given."""
    lines_m = [(zone_m, NO_FLY, '--') for zone_m in area.no_fly or ()]
    lines_m += [(area.boundary, BLACK, '-')] if area.boundary else []
    for corners_m, colour, style in lines_m:
        east_m, north_m = zip(*corners_m, corners_m[0], strict=True)
        axes.plot(east_m, north_m, color=colour, lw=1.5, ls=style, zorder=2)


def _cells_per_tick(n_cells: int) -> int:
    least = math.ceil(n_cells / 8)
    whole = [every for every in range(least, 2 * least + 1) if n_cells % every == 0]
    return whole[0] if whole else least  # a tick on the far border where it can be


def draw_ends(axes: Axes, scenario: Scenario, cell_pt: float) -> None:
    """Draw a cross where UAVs start and land, into axes whose cells have a side of `cell_pt`."""
    starts = {tuple(uav.start_m) for uav in scenario.uavs}
    homes = {tuple(uav.home_m) for uav in scenario.uavs}
    area_pt2 = float(np.clip((0.5 * cell_pt) ** 2, 90.0, 190.0))
    for places, marker in ((starts - homes, 'P'), (homes, 'X')):
        for east_m, north_m in sorted(places):
            axes.scatter(
                east_m, north_m, area_pt2, color=GREEN, marker=marker, edgecolors='white',
                linewidths=1.0, zorder=8, clip_on=False,
            )  # fmt: skip


def draw_names(axes: Axes, site: Site) -> None:
    """Write the names of sensors that somebody named, where they are few."""
    is_named = isinstance(site.scenario.sensors, ListedSensors)
    if not is_named or site.n_sensors > MOST_NAMES:
        return
    for name, place_m in zip(site.sensor_ids, site.position_m, strict=True):
        write_name(axes, name, (float(place_m[0]), float(place_m[1])), _NAME_PT)


def write_name(axes: Axes, name: str, place_m: tuple[float, float], size_pt: float) -> None:
    """Write a sensor's name beside it, to the left where the right has no room."""
    low_m, high_m = axes.get_xlim()
    is_east = place_m[0] > low_m + 0.8 * (high_m - low_m)
    axes.annotate(
        name[:_LONGEST_NAME], place_m, (-4 if is_east else 4, 3), textcoords='offset points',
        ha='right' if is_east else 'left', fontsize=size_pt, color=BLACK, parse_math=False,
        zorder=7, path_effects=[withStroke(linewidth=1.5, foreground='white')],
        annotation_clip=False,
    )  # fmt: skip


def area_handles(area: AreaConfig) -> list[Line2D | Rectangle]:
    """What a legend says of closed cells and outlines, where there are some."""
    handles: list[Line2D | Rectangle] = []
    if area.boundary:
        handles.append(Line2D([], [], color=BLACK, lw=1.5, label="area's edge"))
    if area.no_fly:
        handles.append(Line2D([], [], color=NO_FLY, lw=1.5, ls='--', label='no-fly zone'))
    if not open_cells(area).all():
        handles.append(_closed_square((0.0, 0.0), 1.0, 'closed cell'))
    return handles


def place_handles(scenario: Scenario) -> list[Line2D]:
    """What a legend says of where UAVs start and land."""
    if any(uav.start_m != uav.home_m for uav in scenario.uavs):
        return [marker_handle('P', GREEN, 9, 'start'), marker_handle('X', GREEN, 9, 'home')]
    return [marker_handle('X', GREEN, 9, 'start and home')]


def marker_handle(
    marker: str, colour: str, size_pt: float, label: str, *, edge: str = 'none'
) -> Line2D:
    """A marker with what it means, for a legend."""
    return Line2D(
        [], [], linestyle='none', marker=marker, markersize=size_pt, markerfacecolor=colour,
        markeredgecolor=edge, markeredgewidth=0.8, label=label,
    )  # fmt: skip

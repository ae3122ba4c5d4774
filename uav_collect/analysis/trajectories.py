"""The picture of a mission: who flew where, hovered where, and which sensors had data.

After the paper's Fig. trajectories: a green cross for start and home, stars where a UAV hovered,
black and grey dots for sensors with and without data. A path that has the edge between two cells
for itself runs on it; paths that share one, or one path that passes it more than once, are spread
around it, each in a lane of its own.
"""

from collections import Counter
from dataclasses import dataclass
from io import BytesIO
from itertools import pairwise
import math
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from uav_collect.analysis.area_picture import (
    area_handles,
    BLACK,
    draw_area,
    draw_ends,
    draw_names,
    FONT_PT,
    GREY,
    marker_handle,
    place_handles,
)
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics, percent, UNKNOWN
from uav_collect.analysis.path_lanes import corners_m, lane_shifts, narrowest_lane, steps
from uav_collect.analysis.plotting import (
    Affine2D,
    Axes,
    Figure,
    FigureCanvasAgg,
    imread,
    Line2D,
    MarkerStyle,
    Normal,
    Rectangle,
    withStroke,
)
from uav_collect.analysis.readings import is_left
from uav_collect.analysis.short_names import short_names
from uav_collect.errors import in_one_line
from uav_collect.kernels.arrays import Bools, check_shape, Floats
from uav_collect.limits import MAX_NAME
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.area import shown_box_m
from uav_collect.scenario.model import AreaConfig, Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOME, HOVER
from uav_collect.uav.actions import home_way_m
from uav_collect.uav.briefing import brief

DPI = 150

# Of Okabe and Ito, and of Tol: distinct for any colour vision; the eight come again, dotted.
COLOURS = (
    '#0072B2', '#D55E00', '#CC79A7', '#56B4E9', '#E69F00', '#882255', '#999933', '#332288',
)  # fmt: skip
_SOLID = (0.0, ())
_DOTTED = (0.0, (1.2, 0.9))
_DASHES = (4.0, 2.5)
_RED = '#E31A1C'
_LEAST_IN = 3.0  # of a map's sides: room for title and legend


@dataclass(frozen=True, kw_only=True)
class _Path:
    """One UAV's way through the cells."""

    number: int  # its id
    place_m: Floats  # (T, 2) where it decided
    hover_m: Floats  # (K, 2) where it hovered
    hover_bit: Floats  # (K,) what it collected there
    home_way_m: Floats  # (K, 2) the corners of its way home; (0, 2) while it decides

    @property
    def colour(self) -> str:
        return COLOURS[(self.number - 1) % len(COLOURS)]

    @property
    def style(self) -> tuple[float, tuple[float, ...]]:
        return _DOTTED if (self.number - 1) // len(COLOURS) % 2 else _SOLID


def trajectories(
    log: MissionLog,
    site: Site,
    demand_bit: Floats,
    file: Path | BinaryIO,
) -> None:
    """Draw a mission into a PNG file.

    Args:
        log: the mission, finished or not.
        site: where it was flown.
        demand_bit: data waiting at each sensor at the start [bit], shape (S,).
        file: to be written; the same mission gives the same bytes.

    Raises:
        ValueError: the demand does not fit the site.
        OSError: the file cannot be written.
    """
    area = site.scenario.area
    side_in = float(np.clip(2.6 + 0.3 * max(area.n_rows, area.n_columns), 5.0, 8.6))
    figure, axes = _canvas(area, side_in)
    handles = draw_mission(axes, log, site, demand_bit, side_in)
    _write_title(axes, log, mission_metrics(log))
    _write_legend(axes, handles)
    # No software name in the file: the bytes are the mission's.
    figure.savefig(file, dpi=DPI, format='png', metadata={'Software': None})


def pixels(log: MissionLog, site: Site, demand_bit: Floats) -> NDArray[np.uint8]:
    """The picture that `trajectories` draws, as red, green and blue, (height, width, 3)."""
    file = BytesIO()
    trajectories(log, site, demand_bit, file)
    file.seek(0)
    return np.asarray(imread(file)[..., :3] * 255.0).round().astype(np.uint8)


def draw_mission(
    axes: Axes,
    log: MissionLog,
    site: Site,
    demand_bit: Floats,
    side_in: float,
) -> list[Line2D | Rectangle]:
    """Draw a mission into axes.

    Args:
        demand_bit: as for `trajectories`.
        side_in: the longer side in the axes of what is shown of the area [inch].

    Returns:
        What a legend needs.

    Raises:
        ValueError: the demand does not fit the site.
    """
    check_shape(demand_bit, (len(site.position_m),), 'demand_bit')
    scenario = site.scenario
    west_m, south_m, east_m, north_m = shown_box_m(scenario.area)
    longer_m = max(east_m - west_m, north_m - south_m)
    cell_pt = side_in * 72.0 * scenario.area.cell_size_m / longer_m
    paths = [_path_of(log, scenario, index) for index in range(len(log.header.uavs))]
    draw_area(axes, scenario)
    left = is_left(log, site, demand_bit)
    _draw_sensors(axes, site, demand_bit, left, cell_pt)
    _draw_paths(axes, paths, scenario.area.cell_size_m, cell_pt)
    _draw_hovers(axes, paths, cell_pt)
    draw_ends(axes, scenario, cell_pt)
    draw_names(axes, site)
    _draw_tags(axes, paths, scenario.area.cell_size_m, cell_pt)
    summary = mission_metrics(log)
    handles = _path_handles(paths, summary) + place_handles(scenario)
    return [*handles, *_sensor_handles(demand_bit, left), *area_handles(scenario.area)]


def _canvas(area: AreaConfig, side_in: float) -> tuple[Figure, Axes]:
    """A figure with room for a map whose longer side is given, and for what stands about it."""
    left_in, bottom_in, top_in, legend_in = 0.75, 0.6, 0.75, 2.35
    west_m, south_m, east_m, north_m = shown_box_m(area)
    sides_m = east_m - west_m, north_m - south_m
    map_in = [max(side_in * side_m / max(sides_m), _LEAST_IN) for side_m in sides_m]
    width_in, height_in = left_in + map_in[0] + legend_in, bottom_in + map_in[1] + top_in
    figure = Figure(figsize=(width_in, height_in), facecolor='white')
    FigureCanvasAgg(figure)
    axes = figure.add_axes(
        (left_in / width_in, bottom_in / height_in, map_in[0] / width_in, map_in[1] / height_in)
    )
    axes.set_anchor('NW')
    return figure, axes


def _path_of(log: MissionLog, scenario: Scenario, index: int) -> _Path:
    uav = log.header.uavs[index]
    own = log.events[log.events['uav'] == uav.id]
    place_m = np.column_stack((own['x_m'], own['y_m']))
    is_hover = own['action'] == HOVER
    home_m = []
    if HOME in own['action']:
        home_m = [*home_way_m(brief(scenario), index, (place_m[-1, 0], place_m[-1, 1]))]
    return _Path(
        number=uav.id,
        place_m=place_m,
        hover_m=place_m[is_hover],
        hover_bit=own['collected_bit'][is_hover],
        home_way_m=np.array(home_m).reshape(-1, 2),
    )


def _draw_sensors(
    axes: Axes,
    site: Site,
    demand_bit: Floats,
    is_left: Bools,
    cell_pt: float,
) -> None:
    has_data = demand_bit > 0
    area_pt2 = float(np.clip((0.085 * cell_pt) ** 2, 3.0, 14.0))
    for chosen, colour, order in ((~has_data, GREY, 2), (has_data, BLACK, 6)):
        east_m, north_m = site.position_m[chosen].T
        axes.scatter(east_m, north_m, area_pt2, color=colour, linewidths=0, zorder=order)
    east_m, north_m = site.position_m[is_left].T
    axes.scatter(
        east_m, north_m, 7 * area_pt2, facecolors='none', edgecolors=_RED, linewidths=1.2, zorder=7
    )


def _draw_paths(axes: Axes, paths: list[_Path], cell_size_m: float, cell_pt: float) -> None:
    ways_m = [path.place_m for path in paths]
    width_pt = float(np.clip(0.05 * cell_pt, 1.1, 2.0))
    # A white rim shows which way passes over; it must not cover the next lane.
    rim_pt = min(1.4, max(0.0, 2.0 * (narrowest_lane(ways_m) * cell_pt - width_pt)))
    rim = [withStroke(linewidth=width_pt + rim_pt, foreground='white'), Normal()]
    for path, lanes in zip(paths, lane_shifts(ways_m), strict=True):
        line_m = corners_m(path.place_m, lanes, cell_size_m)
        axes.plot(
            *line_m.T, color=path.colour, linewidth=width_pt, linestyle=path.style,
            path_effects=rim, solid_joinstyle='round', zorder=4,
        )  # fmt: skip
        area_pt2 = float(np.clip((0.17 * cell_pt) ** 2, 14.0, 45.0))
        for index, (here_m, there_m) in enumerate(steps(path.place_m)):
            if index % math.ceil(20.0 / cell_pt) == 0:
                way = (there_m - here_m) / cell_size_m
                aside_m = lanes[index] * np.abs(way[::-1]) * cell_size_m
                _draw_head(axes, path.colour, (here_m + there_m) / 2 + aside_m, way, area_pt2)
        if len(path.home_way_m) and (line_m[-1] != path.home_way_m[-1]).any():
            _draw_way_home(axes, path, line_m[-1], 0.75 * width_pt, area_pt2)


def _draw_way_home(
    axes: Axes, path: _Path, from_m: Floats, width_pt: float, area_pt2: float
) -> None:
    way_m = np.array([from_m, *path.home_way_m[1:]])
    dashes = (3.25 * path.number, _DASHES)  # out of step: of two on one line both show
    axes.plot(*way_m.T, color=path.colour, lw=width_pt, linestyle=dashes, zorder=3)
    for here_m, there_m in pairwise(way_m):
        _draw_head(axes, path.colour, (here_m + there_m) / 2, there_m - here_m, area_pt2)


def _draw_head(axes: Axes, colour: str, place_m: Floats, way: Floats, area_pt2: float) -> None:
    heading_rad = math.atan2(way[1], way[0])
    head = MarkerStyle('>', transform=Affine2D().rotate(heading_rad))
    axes.scatter(
        place_m[0], place_m[1], area_pt2, color=colour, marker=head, linewidths=0.3,
        edgecolors='white', zorder=5,
    )  # fmt: skip


def _draw_hovers(axes: Axes, paths: list[_Path], cell_pt: float) -> None:
    most_bit = max((path.hover_bit.max(initial=0.0) for path in paths), default=0.0)
    largest_pt2 = min(0.5 * cell_pt, 18.0) ** 2
    for path in paths:
        share = path.hover_bit / most_bit if most_bit > 0 else np.zeros(len(path.hover_bit))
        east_m, north_m = path.hover_m.T
        axes.scatter(
            east_m, north_m, (0.3 + 0.7 * share) * largest_pt2, color=path.colour, marker='*',
            edgecolors=BLACK, linewidths=0.5, zorder=5.5,
        )  # fmt: skip


def _draw_tags(axes: Axes, paths: list[_Path], cell_size_m: float, cell_pt: float) -> None:
    """Write each UAV's number where it turned home: colours alone do not distinguish 16."""
    size_pt = float(np.clip(0.22 * cell_pt, 6.0, 8.5))
    taken: Counter[tuple[float, ...]] = Counter()
    for path in paths:
        if len(path.place_m):
            place_m = path.place_m[-1]
            nth = taken[tuple(place_m.tolist())]
            taken[tuple(place_m.tolist())] += 1
            axes.annotate(
                str(path.number), place_m + np.array([0.3 - 0.3 * nth, 0.3]) * cell_size_m,
                color='white', fontsize=size_pt, fontweight='bold', ha='center', va='center',
                bbox={'boxstyle': 'circle,pad=0.18', 'fc': path.colour, 'ec': 'white', 'lw': 0.8},
                zorder=9,
            )  # fmt: skip


def _write_title(axes: Axes, log: MissionLog, summary: MissionMetrics) -> None:
    header = log.header
    policies = ', '.join(short_names([uav.policy for uav in header.uavs], MAX_NAME).values())
    title = (
        f'{in_one_line(header.scenario, MAX_NAME)}, mission seed {header.mission_seed}: {policies}'
    )
    time = f'{summary.completion_s:.0f} s' if summary.is_finished else _why_no_time(summary)
    merits = (
        f'{summary.collected_bit / 1e6:.2f} of {summary.total_bit / 1e6:.2f} Mbit'
        f' ({percent(summary.collected_share)}) · {summary.energy_kj:.1f} kJ · {time}'
        f' · {summary.efficiency_kbit_per_j:.3f} kbit/J'
    )
    for text, above_pt, size_pt, weight in (
        (title, 26, 11, 'bold'),
        (merits, 9, FONT_PT + 0.5, 'normal'),
    ):
        axes.annotate(
            text, (0, 1), (0, above_pt), xycoords='axes fraction', textcoords='offset points',
            fontsize=size_pt, fontweight=weight, parse_math=False,
        )  # fmt: skip


def _why_no_time(summary: MissionMetrics) -> str:
    is_known = all(uav.outcome != UNKNOWN for uav in summary.uavs)
    return 'not finished' if is_known else 'end not recorded'


def _write_legend(axes: Axes, handles: list[Line2D | Rectangle]) -> None:
    axes.legend(
        handles=handles, loc='upper left', bbox_to_anchor=(1.015, 1.01), frameon=False,
        fontsize=FONT_PT - 0.5, handlelength=2.2, labelspacing=0.65,
    )  # fmt: skip


def _path_handles(paths: list[_Path], summary: MissionMetrics) -> list[Line2D]:
    handles = [
        _line_handle(path, f'UAV {uav.id}: {uav.speed_mps:g} m/s, {uav.energy_j / 1e3:.1f} kJ')
        for path, uav in zip(paths, summary.uavs, strict=True)
    ]
    dashed = (0.0, _DASHES)
    home = Line2D([], [], color='#555555', ls=dashed, lw=1.2, label='home, from its number')
    return [
        *handles,
        home,
        marker_handle('*', '#777777', 11, 'hover (larger: more data)', edge=BLACK),
    ]


def _sensor_handles(demand_bit: Floats, is_left: Bools) -> list[Line2D]:
    handles = [marker_handle('o', BLACK, 4, 'sensor with data')]
    if (demand_bit == 0).any():
        handles.append(marker_handle('o', GREY, 4, 'sensor without data'))
    if is_left.any():
        handles.append(marker_handle('o', 'none', 7, 'data left behind', edge=_RED))
    return handles


def _line_handle(path: _Path, label: str) -> Line2D:
    return Line2D([], [], color=path.colour, linestyle=path.style, linewidth=2.0, label=label)

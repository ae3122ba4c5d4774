"""The picture of a mission: who flew where, hovered where, and which sensors had data.

After the paper's Fig. trajectories: a green cross for start and home, stars where a UAV hovered,
black and grey dots for sensors with and without data. A path that has the edge between two cells
for itself runs on it; paths that share one, or one path that passes it more than once, are spread
around it, each in a lane of its own.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import pairwise
import math
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics, percent
from uav_collect.analysis.plotting import (
    Affine2D,
    Axes,
    Figure,
    FigureCanvasAgg,
    imread,
    Line2D,
    MarkerStyle,
    Normal,
    withStroke,
)
from uav_collect.errors import in_one_line
from uav_collect.kernels.arrays import Bools, check_shape, Floats, Ints
from uav_collect.limits import MAX_NAME
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOME, HOVER

DPI = 150

# Of Okabe and Ito, and of Tol: distinct for any colour vision; the eight come again, dotted.
COLOURS = (
    '#0072B2', '#D55E00', '#CC79A7', '#56B4E9', '#E69F00', '#882255', '#999933', '#332288',
)  # fmt: skip
_SOLID = (0.0, ())
_DOTTED = (0.0, (1.2, 0.9))
_DASHES = (4.0, 2.5)
_GREEN = '#1A9641'
_RED = '#E31A1C'
_BLACK = '#111111'
GREY = '#A9A9A9'
GRID = '#E2E2E2'
_FONT_PT = 9.0
_LANE_SHARE = 0.13  # of a cell, between two lanes
_LANES_SHARE = 0.6  # of a cell, at most, for all lanes of an edge
_JOG_SHARE = 0.1  # of a cell, before and after its centre, where a way changes its lane

_Edge = tuple[float, ...]  # the centres of two neighbouring cells: east and north of each


@dataclass(frozen=True, kw_only=True)
class _Path:
    """One UAV's way through the cells."""

    number: int  # its id
    place_m: Floats  # (T, 2) where it decided
    hover_m: Floats  # (K, 2) where it hovered
    hover_bit: Floats  # (K,) what it collected there
    home_m: Floats | None  # (2,) where it landed; None while it flies

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
    side_in = float(np.clip(2.6 + 0.3 * site.scenario.area.cells_per_side, 5.0, 8.6))
    figure, axes = _canvas(side_in)
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
) -> list[Line2D]:
    """Draw a mission into axes.

    Args:
        demand_bit: as for `trajectories`.
        side_in: side of the square that the axes take [inch].

    Returns:
        What a legend needs.

    Raises:
        ValueError: the demand does not fit the site.
    """
    check_shape(demand_bit, (len(site.position_m),), 'demand_bit')
    scenario = site.scenario
    cell_pt = side_in * 72.0 / scenario.area.cells_per_side
    paths = [_path_of(log, scenario, index) for index in range(len(log.header.uavs))]
    _draw_area(axes, scenario)
    _draw_sensors(axes, site, demand_bit, _is_left(log, site, demand_bit), cell_pt)
    _draw_paths(axes, paths, scenario.area.cell_size_m, cell_pt)
    _draw_hovers(axes, paths, cell_pt)
    _draw_ends(axes, scenario, cell_pt)
    _draw_tags(axes, paths, scenario.area.cell_size_m, cell_pt)
    summary = mission_metrics(log)
    handles = _path_handles(paths, summary) + _place_handles(scenario)
    return handles + _sensor_handles(demand_bit, summary)


def _canvas(side_in: float) -> tuple[Figure, Axes]:
    left_in, bottom_in, top_in, legend_in = 0.75, 0.6, 0.75, 2.35
    width_in, height_in = left_in + side_in + legend_in, bottom_in + side_in + top_in
    figure = Figure(figsize=(width_in, height_in), facecolor='white')
    FigureCanvasAgg(figure)
    axes = figure.add_axes(
        (left_in / width_in, bottom_in / height_in, side_in / width_in, side_in / height_in)
    )
    return figure, axes


def _path_of(log: MissionLog, scenario: Scenario, index: int) -> _Path:
    uav = log.header.uavs[index]
    own = log.events[log.events['uav'] == uav.id]
    place_m = np.column_stack((own['x_m'], own['y_m']))
    is_hover = own['action'] == HOVER
    return _Path(
        number=uav.id,
        place_m=place_m,
        hover_m=place_m[is_hover],
        hover_bit=own['collected_bit'][is_hover],
        home_m=np.array(scenario.uavs[index].home_m) if HOME in own['action'] else None,
    )


def _is_left(log: MissionLog, site: Site, demand_bit: Floats) -> Bools:
    """Whether each sensor's data were left: nobody ever hovered in its cell."""
    hovers = log.events[log.events['action'] == HOVER]
    area = site.scenario.area
    column: Ints = (hovers['x_m'] // area.cell_size_m).astype(np.int64)
    row: Ints = (hovers['y_m'] // area.cell_size_m).astype(np.int64)
    served = np.isin(site.cell, row * area.cells_per_side + column)
    return (demand_bit > 0) & ~served


def _draw_area(axes: Axes, scenario: Scenario) -> None:
    n_cells, size_m = scenario.area.cells_per_side, scenario.area.cell_size_m
    side_m = n_cells * size_m
    for border in range(1, n_cells):
        axes.axhline(border * size_m, color=GRID, linewidth=0.6, zorder=0)
        axes.axvline(border * size_m, color=GRID, linewidth=0.6, zorder=0)
    axes.set(xlim=(0.0, side_m), ylim=(0.0, side_m), aspect='equal')
    axes.set_xlabel('east [m]', fontsize=_FONT_PT)
    axes.set_ylabel('north [m]', fontsize=_FONT_PT)
    ticks_m = np.arange(0, n_cells + 1, _cells_per_tick(n_cells)) * size_m
    axes.set_xticks(ticks_m)
    axes.set_yticks(ticks_m)
    axes.tick_params(labelsize=_FONT_PT - 1, color='#888888')
    axes.spines[:].set_color('#888888')


def _cells_per_tick(n_cells: int) -> int:
    least = math.ceil(n_cells / 8)
    whole = [every for every in range(least, 2 * least + 1) if n_cells % every == 0]
    return whole[0] if whole else least  # a tick on the far border where it can be


def _draw_sensors(
    axes: Axes,
    site: Site,
    demand_bit: Floats,
    is_left: Bools,
    cell_pt: float,
) -> None:
    has_data = demand_bit > 0
    area_pt2 = float(np.clip((0.085 * cell_pt) ** 2, 3.0, 14.0))
    for chosen, colour, order in ((~has_data, GREY, 2), (has_data, _BLACK, 6)):
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
        if path.home_m is not None and (line_m[-1] != path.home_m).any():
            _draw_way_home(axes, path, line_m[-1], 0.75 * width_pt, area_pt2)


def _draw_way_home(
    axes: Axes, path: _Path, from_m: Floats, width_pt: float, area_pt2: float
) -> None:
    to_m = np.asarray(path.home_m)
    dashes = (3.25 * path.number, _DASHES)  # out of step: of two on one line both show
    axes.plot(
        *np.array([from_m, to_m]).T, color=path.colour, lw=width_pt, linestyle=dashes, zorder=3
    )
    _draw_head(axes, path.colour, (from_m + to_m) / 2, to_m - from_m, area_pt2)


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
            edgecolors=_BLACK, linewidths=0.5, zorder=5.5,
        )  # fmt: skip


def _draw_ends(axes: Axes, scenario: Scenario, cell_pt: float) -> None:
    starts = {tuple(uav.start_m) for uav in scenario.uavs}
    homes = {tuple(uav.home_m) for uav in scenario.uavs}
    area_pt2 = float(np.clip((0.5 * cell_pt) ** 2, 90.0, 190.0))
    for places, marker in ((starts - homes, 'P'), (homes, 'X')):
        for east_m, north_m in sorted(places):
            axes.scatter(
                east_m, north_m, area_pt2, color=_GREEN, marker=marker, edgecolors='white',
                linewidths=1.0, zorder=8, clip_on=False,
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
    policies = ', '.join(dict.fromkeys(in_one_line(uav.policy, MAX_NAME) for uav in header.uavs))
    title = (
        f'{in_one_line(header.scenario, MAX_NAME)}, mission seed {header.mission_seed}: {policies}'
    )
    time = f'{summary.completion_s:.0f} s' if summary.is_finished else 'not finished'
    merits = (
        f'{summary.collected_bit / 1e6:.2f} of {summary.total_bit / 1e6:.2f} Mbit'
        f' ({percent(summary.collected_share)}) · {summary.energy_kj:.1f} kJ · {time}'
        f' · {summary.efficiency_kbit_per_j:.3f} kbit/J'
    )
    for text, above_pt, size_pt, weight in (
        (title, 26, 11, 'bold'),
        (merits, 9, _FONT_PT + 0.5, 'normal'),
    ):
        axes.annotate(
            text, (0, 1), (0, above_pt), xycoords='axes fraction', textcoords='offset points',
            fontsize=size_pt, fontweight=weight, parse_math=False,
        )  # fmt: skip


def _write_legend(axes: Axes, handles: list[Line2D]) -> None:
    axes.legend(
        handles=handles, loc='upper left', bbox_to_anchor=(1.015, 1.01), frameon=False,
        fontsize=_FONT_PT - 0.5, handlelength=2.2, labelspacing=0.65,
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
        _marker_handle('*', '#777777', 11, 'hover (larger: more data)', edge=_BLACK),
    ]


def _place_handles(scenario: Scenario) -> list[Line2D]:
    if any(uav.start_m != uav.home_m for uav in scenario.uavs):
        return [_marker_handle('P', _GREEN, 9, 'start'), _marker_handle('X', _GREEN, 9, 'home')]
    return [_marker_handle('X', _GREEN, 9, 'start and home')]


def _sensor_handles(demand_bit: Floats, summary: MissionMetrics) -> list[Line2D]:
    handles = [_marker_handle('o', _BLACK, 4, 'sensor with data')]
    if (demand_bit == 0).any():
        handles.append(_marker_handle('o', GREY, 4, 'sensor without data'))
    if not summary.is_complete:
        handles.append(_marker_handle('o', 'none', 7, 'data left behind', edge=_RED))
    return handles


def _line_handle(path: _Path, label: str) -> Line2D:
    return Line2D([], [], color=path.colour, linestyle=path.style, linewidth=2.0, label=label)


def _marker_handle(
    marker: str, colour: str, size_pt: float, label: str, *, edge: str = 'none'
) -> Line2D:
    return Line2D(
        [], [], linestyle='none', marker=marker, markersize=size_pt, markerfacecolor=colour,
        markeredgecolor=edge, markeredgewidth=0.8, label=label,
    )  # fmt: skip


def steps(place_m: Floats) -> Iterator[tuple[Floats, Floats]]:
    """The moves between the places where a UAV decided, shape (T, 2): from where to where."""
    for here_m, there_m in pairwise(place_m):
        if (here_m != there_m).any():
            yield here_m, there_m


def lane_shifts(ways_m: Sequence[Floats]) -> list[list[float]]:
    """How far each step of each way is shifted [cells]: north if it runs east or west, else east.

    Args:
        ways_m: one per UAV, the places where it decided [m], shape (T, 2).
    """
    n_lanes = _lane_counts(ways_m)
    taken: Counter[_Edge] = Counter()
    shifts: list[list[float]] = []
    for way_m in ways_m:
        shifts.append([])
        for step in steps(way_m):
            edge = _edge(*step)
            lane = taken[edge] - (n_lanes[edge] - 1) / 2
            shifts[-1].append(lane * _lane_width(n_lanes[edge]))
            taken[edge] += 1
    return shifts


def narrowest_lane(ways_m: Sequence[Floats]) -> float:
    """The least distance between two lanes [cells]."""
    return _lane_width(max(_lane_counts(ways_m).values(), default=1))


def _lane_counts(ways_m: Sequence[Floats]) -> Counter[_Edge]:
    return Counter(_edge(*step) for way_m in ways_m for step in steps(way_m))


def _lane_width(n_lanes: int) -> float:
    return min(_LANE_SHARE, _LANES_SHARE / n_lanes)


def _edge(here_m: Floats, there_m: Floats) -> _Edge:
    low, high = sorted([tuple(here_m.tolist()), tuple(there_m.tolist())])
    return (*low, *high)


def corners_m(way_m: Floats, shifts: Sequence[float], cell_size_m: float) -> Floats:
    """The corners of a way in its lanes [m], shape (K, 2)."""
    if not shifts:
        return way_m[:1]
    moves = list(steps(way_m))
    heads = [(there_m - here_m) / cell_size_m for here_m, there_m in moves]
    sides = [shift * np.abs(head[::-1]) for head, shift in zip(heads, shifts, strict=True)]
    corners = [moves[0][0] + sides[0] * cell_size_m]
    for index in range(1, len(moves)):
        joint = _corners_in_cell(heads[index - 1], sides[index - 1], heads[index], sides[index])
        corners += [moves[index][0] + shift * cell_size_m for shift in joint]
    corners.append(moves[-1][1] + sides[-1] * cell_size_m)
    return np.array(corners)


def _corners_in_cell(
    head_in: Floats, side_in: Floats, head_out: Floats, side_out: Floats
) -> list[Floats]:
    """The corners of a way within one cell, in cells from its centre."""
    if head_in @ head_out == 0:  # a turn: both lanes meet in one corner
        return [side_in + side_out]
    if (head_in != head_out).any() or (side_in == side_out).all():  # straight back, or straight on
        return [side_in, side_out]
    return [side_in - _JOG_SHARE * head_in, side_out + _JOG_SHARE * head_out]

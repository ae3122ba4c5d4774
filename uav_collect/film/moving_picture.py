"""A mission as a picture that moves: the ground, and on it what changes from time to time."""

from collections.abc import Iterator, Sequence
from itertools import combinations
import math
from typing import Any, NamedTuple

import numpy as np
from uav_collect.analysis.area_picture import (
    area_handles,
    BLACK,
    draw_area,
    draw_ends,
    draw_names,
    GREEN,
    GREY,
    marker_handle,
    NO_FLY,
    place_handles,
)
from uav_collect.analysis.legs import FlownLeg, HOME_LEG, HOVER_LEG, mission_legs, state_at
from uav_collect.analysis.plotting import Axes, Figure, FigureCanvasAgg, Line2D
from uav_collect.analysis.readings import mission_readings
from uav_collect.analysis.short_names import short_names
from uav_collect.analysis.trajectories import COLOURS
from uav_collect.errors import in_one_line
from uav_collect.kernels.arrays import Bools, check_shape, Floats
from uav_collect.limits import MAX_NAME
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.area import shown_box_m
from uav_collect.scenario.model import Point
from uav_collect.scenario.site import Site

_DPI = 100
_MAP_IN = 5.4  # the longer side of the area
_LEAST_IN = 1.6  # the shorter one
_LEFT_IN, _RIGHT_IN, _BOTTOM_IN, _TOP_IN = 0.7, 2.4, 0.5, 0.6
_UAV_IN = 0.24  # height of a UAV's bar, unless there are many
_NAME_IN = 0.14  # of its name
_LEGEND_IN = 1.9  # below the bars

MEANT = (*COLOURS, BLACK, GREY, GREEN, NO_FLY)  # colours that say something
_PALE = 0.45  # of what has landed

Pixels = Any  # (height, width, 4) of uint8, as the canvas holds them


class _State(NamedTuple):
    """One UAV at one time."""

    place_m: Point
    energy_left_j: float
    is_hovering: bool
    has_landed: bool


class MovingPicture:
    """A mission, finished or not, as it looks at any of its times."""

    def __init__(self, log: MissionLog, site: Site, demand_bit: Floats) -> None:
        """Draw what does not change.

        Args:
            log: the mission.
            site: where it was flown.
            demand_bit: data waiting at each sensor at the start [bit], shape (S,).
        """
        check_shape(demand_bit, (site.n_sensors,), 'demand_bit')
        self._legs = mission_legs(log, site.scenario)
        self._log, self._site = log, site
        self._has_data = demand_bit > 0
        self._read_s = _read_times(log, site, demand_bit)
        uavs = range(len(self._legs))
        self._figure, self._map, self._bars = _canvas(site, len(uavs))
        self._draw_ground()
        self._sensors = self._scatter_sensors()
        self._contacts = self._line(GREY, 1.2, 3, ':')
        self._trails = [self._line(_colour(uav), 1.6, 4) for uav in uavs]
        self._rings = [self._ring(_colour(uav)) for uav in uavs]
        self._craft = [self._tag(uav) for uav in uavs]
        self._energy = self._energy_bars()
        self._clock = self._map.annotate(
            *('', (0, 1), (0, 8)), xycoords='axes fraction', textcoords='offset points',
            fontsize=10, annotation_clip=False,
        )  # fmt: skip
        for artist in self._moving:
            artist.set_animated(True)
        canvas: Any = FigureCanvasAgg(self._figure)  # its methods have no types
        canvas.draw()
        self._canvas = canvas
        self._ground = canvas.copy_from_bbox(self._figure.bbox)

    @property
    def end_s(self) -> float:
        """When the last UAV has landed, or the last action that is known ends."""
        return max((legs[-1].end_s for legs in self._legs if legs), default=0.0)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels, both even, as MP4 wants them."""
        width, height = self._canvas.get_width_height()
        return int(width), int(height)

    def at(self, time_s: float) -> Pixels:
        """The picture at a simulated time, (height, width, 4); valid until the next one."""
        states = [self._state(uav, time_s) for uav in range(len(self._legs))]
        for uav, state in enumerate(states):
            self._place_uav(uav, state, time_s)
        self._place_contacts(states)
        is_read = self._read_s <= time_s
        self._sensors.set_facecolors(_sensor_colours(self._has_data, is_read))
        self._clock.set_text(self._status(time_s))
        self._canvas.restore_region(self._ground)
        for artist in self._moving:
            artist.axes.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())

    @property
    def _moving(self) -> list[Any]:
        flying = [self._contacts, self._sensors, *self._trails, *self._rings, *self._craft]
        return [*flying, *self._energy, self._clock]

    def _state(self, uav: int, time_s: float) -> _State | None:
        """Where a UAV is, None if not known; one that has not decided yet waits at its start."""
        legs = self._legs[uav]
        if legs and (time_s >= legs[0].start_s or legs[0].is_after_gap):
            state = state_at(legs, time_s)
            if state is None:
                return None
            is_hovering = state.leg is not None and state.leg.kind == HOVER_LEG
            has_landed = state.leg is None and legs[-1].kind == HOME_LEG
            return _State(state.place_m, state.energy_left_j, is_hovering, has_landed)
        header, start_m = self._log.header.uavs[uav], self._site.scenario.uavs[uav].start_m
        return _State(start_m, header.energy_budget_j, False, False)

    def _place_uav(self, uav: int, state: _State | None, time_s: float) -> None:
        corners_m = [*_corners_m(self._legs[uav], time_s)]
        corners_m += [] if state is None else [state.place_m]
        self._trails[uav].set_data(*(zip(*corners_m, strict=True) if corners_m else ([], [])))
        for artist in (self._craft[uav], self._rings[uav], self._energy[uav]):
            artist.set_visible(state is not None)
        if state is None:
            return
        self._craft[uav].set_position(state.place_m)
        self._craft[uav].set_alpha(_PALE if state.has_landed else 1.0)
        x_m, y_m = state.place_m
        self._rings[uav].set_data(([x_m], [y_m]) if state.is_hovering else ([], []))
        self._energy[uav].set_width(max(0.0, state.energy_left_j) / 1e3)

    def _place_contacts(self, states: Sequence[_State | None]) -> None:
        range_m = self._site.scenario.radio.contact_range_m
        flying_m = [state.place_m for state in states if state and not state.has_landed]
        line_m = [(math.nan, math.nan)]
        for here_m, there_m in combinations(flying_m, 2):
            if math.dist(here_m, there_m) <= range_m:
                line_m += [here_m, there_m, (math.nan, math.nan)]
        self._contacts.set_data(*zip(*line_m, strict=True))

    def _status(self, time_s: float) -> str:
        events = self._log.events
        is_over = events['time_s'] + events['duration_s'] <= time_s
        collected = events['collected_bit'][is_over].sum() / 1e6
        return f'{time_s:.0f} s · {collected:.2f} of {self._log.header.total_bit / 1e6:.2f} Mbit'

    def _draw_ground(self) -> None:
        header = self._log.header
        draw_area(self._map, self._site.scenario)
        draw_ends(self._map, self._site.scenario, 30.0)
        draw_names(self._map, self._site)
        _write_legend(self._bars, self._site)
        policies = ', '.join(short_names([uav.policy for uav in header.uavs], MAX_NAME).values())
        name = in_one_line(header.scenario, MAX_NAME)
        self._map.annotate(
            f'{name}, mission seed {header.mission_seed}: {policies}', (0, 1), (0, 26),
            xycoords='axes fraction', textcoords='offset points', fontsize=11,
            fontweight='bold', parse_math=False, annotation_clip=False,
        )  # fmt: skip

    def _scatter_sensors(self) -> Any:  # noqa: ANN401 - a collection of Matplotlib
        east_m, north_m = self._site.position_m.T
        size_pt2 = float(np.clip(3000.0 / max(1, len(east_m)), 3.0, 16.0))
        return self._map.scatter(east_m, north_m, size_pt2, linewidths=0, zorder=5)

    def _line(self, colour: str, width_pt: float, order: float, style: str = '-') -> Line2D:
        [line] = self._map.plot(
            [], [], color=colour, lw=width_pt, ls=style, zorder=order, solid_joinstyle='round'
        )
        return line

    def _ring(self, colour: str) -> Line2D:
        [ring] = self._map.plot(
            [], [], ls='none', marker='o', ms=24, mfc='none', mec=colour, mew=2.0, zorder=6
        )
        return ring

    def _tag(self, uav: int) -> Any:  # noqa: ANN401 - a text of Matplotlib
        return self._map.text(
            *self._site.scenario.uavs[uav].start_m, str(uav + 1), color='white', fontsize=8,
            fontweight='bold', ha='center', va='center', zorder=9,
            bbox={'boxstyle': 'circle,pad=0.2', 'fc': _colour(uav), 'ec': 'white', 'lw': 0.9},
        )  # fmt: skip

    def _energy_bars(self) -> list[Any]:
        kj = [uav.energy_budget_j / 1e3 for uav in self._log.header.uavs]
        self._bars.barh(range(len(kj)), kj, 0.6, color='#E6E6E6')
        colours = [_colour(uav) for uav in range(len(kj))]
        return [*self._bars.barh(range(len(kj)), kj, 0.6, color=colours)]


def _canvas(site: Site, n_uavs: int) -> tuple[Figure, Axes, Axes]:
    """A figure with room for the map and, to its right, for the energy of each UAV."""
    width_m, height_m = _extent_m(site)
    scale_in = _MAP_IN / max(width_m, height_m)
    map_in = np.maximum(np.array([width_m, height_m]) * scale_in, _LEAST_IN)
    row_in = min(_UAV_IN, _MAP_IN / n_uavs)
    bars_in = row_in * n_uavs + 0.3
    inner_in = max(float(map_in[1]), bars_in + _LEGEND_IN)
    size_px = np.array([_LEFT_IN + map_in[0] + _RIGHT_IN, _BOTTOM_IN + inner_in + _TOP_IN]) * _DPI
    size_in = 2.0 * np.ceil(size_px / 2.0) / _DPI
    figure = Figure(figsize=tuple(size_in), dpi=_DPI, facecolor='white')
    left, bottom = _LEFT_IN / size_in[0], 1.0 - (_TOP_IN + map_in[1]) / size_in[1]
    area = figure.add_axes((left, bottom, map_in[0] / size_in[0], map_in[1] / size_in[1]))
    bars = figure.add_axes((
        (_LEFT_IN + map_in[0] + 0.75) / size_in[0], 1.0 - (_TOP_IN + bars_in) / size_in[1],
        (_RIGHT_IN - 0.95) / size_in[0], bars_in / size_in[1],
    ))  # fmt: skip
    named = range(0, n_uavs, math.ceil(_NAME_IN / row_in))
    bars.set(ylim=(n_uavs - 0.4, -0.6), yticks=named)
    bars.set_yticklabels([f'UAV {uav + 1}' for uav in named])
    bars.set_title('energy left [kJ]', fontsize=8.5, loc='left')
    bars.tick_params(labelsize=8, length=0)
    bars.spines[:].set_visible(False)
    return figure, area, bars


def _extent_m(site: Site) -> tuple[float, float]:
    west_m, south_m, east_m, north_m = shown_box_m(site.scenario.area)
    return east_m - west_m, north_m - south_m


def _write_legend(bars: Axes, site: Site) -> None:
    """Write below the bars what dots, rings and lines on the map mean."""
    ring = marker_handle('o', 'none', 9, 'hovers', edge=COLOURS[0])
    handles = [
        marker_handle('o', BLACK, 4, 'sensor whose data waits'),
        marker_handle('o', GREY, 4, 'sensor without, or read'),
        ring,
        Line2D([], [], color=GREY, lw=1.2, ls=':', label='in radio contact'),
        *place_handles(site.scenario),
        *area_handles(site.scenario.area),
    ]
    bars.legend(
        handles=handles, loc='upper left', bbox_to_anchor=(-0.45, -0.02), frameon=False,
        fontsize=8, borderaxespad=2.5,
    )  # fmt: skip


def _colour(uav: int) -> str:
    return COLOURS[uav % len(COLOURS)]


def _read_times(log: MissionLog, site: Site, demand_bit: Floats) -> Floats:
    """When the data of each sensor was there, (S,); inf where nobody has read it."""
    read_s = np.full(site.n_sensors, math.inf)
    for reading in mission_readings(log, site, demand_bit):
        read_s[reading.sensor] = min(reading.end_s, read_s[reading.sensor])
    return read_s


def _corners_m(legs: Sequence[FlownLeg], time_s: float) -> Iterator[Point]:
    """Where the legs that a UAV has begun start; the line through them is broken at gaps."""
    for number, leg in enumerate(legs):
        if leg.is_after_gap and number and legs[number - 1].end_s <= time_s:
            yield from (legs[number - 1].end_m, (math.nan, math.nan))
        if leg.start_s <= time_s:
            yield leg.start_m


def _sensor_colours(has_data: Bools, is_read: Bools) -> list[str]:
    """Black while data waits, of the grey of those without once it is read."""
    return [BLACK if waits else GREY for waits in has_data & ~is_read]

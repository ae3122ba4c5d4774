"""Which sensor was read when, by whom and at which rate: derived from the log of a mission.

A log says how many sensors a hover serves. Which these are, how much data each of them had, and
how the bandwidth was shared follows from the scenario, the mission's seed and who shares bandwidth
how, so nothing of it needs to stand in the log. Where a hover took another time than that gives,
its agent has shared the bandwidth in a way of its own: the sensors and their data are known, rates
and bandwidth are not.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
import math

import numpy as np
from uav_collect import files
from uav_collect.kernels.arrays import Bools, Floats
from uav_collect.physics.radio import uplink_rate_bps
from uav_collect.recording.mission_log import MissionHeader, MissionLog
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOME, HOVER
from uav_collect.uav.actions import cell_under
from uav_collect.uav.agent import Allocator, allocator_named, new_workspace, Workspace
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.view import LocalView, new_view_rows, ViewRows
from uav_collect.world.dynamics import draw_channel
from uav_collect.world.sensor_field import lay_out, most_sensors, SensorField

READING_COLUMNS = (
    'mission_seed', 'sensor_id', 'uav', 'event', 'start_s', 'end_s', 'data_mbit', 'rate_bps',
    'bandwidth_hz', 'x_m', 'y_m', 'cell',
)  # fmt: skip
_TOLERANCE = 1e-9  # relative; what rounding may leave of a hover's duration


@dataclass(frozen=True, kw_only=True)
class Reading:
    """The data of one sensor, collected in one hover."""

    sensor_id: str
    sensor: int  # index in the site
    uav: int  # id, from 1
    event: int  # of the hover, as the log numbers it
    start_s: float  # when the hover began
    end_s: float  # when the sensor's data was up; the hover's end where its rate is not known
    data_bit: float
    rate_bps: float  # nan where it is not known, as the next one
    bandwidth_hz: float  # of this sensor
    x_m: float  # of the sensor, east and north
    y_m: float
    cell: int  # in which the UAV hovered


@dataclass(frozen=True, kw_only=True)
class _Radio:
    """What tells how a hover's bandwidth was shared."""

    site: Site
    mission_seed: int
    briefing: Briefing
    sensor_field: SensorField
    demand_bit: Sequence[float]  # (S,)
    rows: ViewRows
    workspace: Workspace


@dataclass(frozen=True, kw_only=True)
class _Hover:
    """A hover as the log tells it."""

    uav: int  # index
    event: int
    start_s: float
    duration_s: float
    cell: int
    visit: int | None  # times that the UAV came to the cell before; None: not known


@dataclass(kw_only=True)
class _Visits:
    """How often one UAV has come to which cell."""

    counts: Counter[int] = field(default_factory=Counter)  # by cell
    has_moved: bool = False  # by its latest action
    n_decisions: int = 0  # seen of it


class ReadingFinder:
    """Tells what hovers of a mission read, event by event, while it still flies."""

    def __init__(self, header: MissionHeader, site: Site, demand_bit: Floats) -> None:
        """Know the mission.

        Args:
            site: of its scenario.
            demand_bit: data at each sensor at the start [bit], shape (S,).
        """
        sensor_field = lay_out(site)
        size = most_sensors(sensor_field)
        self._radio = _Radio(
            site=site,
            mission_seed=header.mission_seed,
            briefing=briefing_of(site),
            sensor_field=sensor_field,
            demand_bit=demand_bit.tolist(),
            rows=new_view_rows(size),
            workspace=new_workspace(size),
        )
        self._allocators = [allocator_named(uav.allocator) for uav in header.uavs]
        self._visits = [_Visits() for _ in header.uavs]

    def readings(self, event: np.void) -> tuple[Reading, ...]:
        """What an event of the mission log reads: nothing unless it is a hover.

        Args:
            event: the one after that of the call before.
        """
        uav = int(event['uav']) - 1
        visits = self._visits[uav]
        cell = int(cell_under(self._radio.briefing, float(event['x_m']), float(event['y_m'])))
        visits.counts[cell] += visits.has_moved
        visits.has_moved = event['action'] not in (HOVER, HOME)
        visits.n_decisions += 1
        if event['action'] != HOVER:
            return ()
        # A recording that lacks earlier decisions does not tell how often it came.
        is_whole = event['decision'] == visits.n_decisions - 1
        hover = _Hover(
            uav=uav,
            event=int(event['event']),
            start_s=float(event['time_s']),
            duration_s=float(event['duration_s']),
            cell=cell,
            visit=visits.counts[cell] if is_whole else None,
        )
        return tuple(_readings_of(hover, self._radio, self._allocators[uav]))


def mission_readings(log: MissionLog, site: Site, demand_bit: Floats) -> tuple[Reading, ...]:
    """The readings of a mission in the order of its hovers, sensors of one as the site has them.

    Args:
        site: of the mission's scenario.
        demand_bit: data at each sensor at the start [bit], shape (S,).
    """
    finder = ReadingFinder(log.header, site, demand_bit)
    events = log.events[np.argsort(log.events['event'], kind='stable')]
    return tuple(reading for event in events for reading in finder.readings(event))


def is_left(log: MissionLog, site: Site, demand_bit: Floats) -> Bools:
    """Whether each sensor's data were left behind, (S,): nobody ever hovered in its cell.

    None is said to be where the log lacks events: they may have been read in one of these.

    Args:
        demand_bit: as for `mission_readings`.
    """
    if log.lacks_events:
        return np.zeros(site.n_sensors, dtype=np.bool_)
    hovers, briefing = log.events[log.events['action'] == HOVER], briefing_of(site)
    places_m = zip(hovers['x_m'].tolist(), hovers['y_m'].tolist(), strict=True)
    served = {int(cell_under(briefing, x_m, y_m)) for x_m, y_m in places_m}
    return (demand_bit > 0.0) & ~np.isin(site.cell, [*served])


def readings_csv(missions: Iterable[tuple[int, Sequence[Reading]]]) -> bytes:
    """The readings of missions as a CSV file, a line for each; what is not known is left empty.

    Args:
        missions: the seed of each, and its readings.
    """
    rows = ((seed, *_row(reading)) for seed, readings in missions for reading in readings)
    return files.csv_of([READING_COLUMNS, *rows])


def _row(reading: Reading) -> tuple[object, ...]:
    return (
        reading.sensor_id, reading.uav, reading.event, reading.start_s, reading.end_s,
        reading.data_bit / 1e6, files.blank_if_nan(reading.rate_bps),
        files.blank_if_nan(reading.bandwidth_hz), reading.x_m, reading.y_m, reading.cell,
    )  # fmt: skip


def _readings_of(hover: _Hover, radio: _Radio, allocator: Allocator) -> Iterator[Reading]:
    """What one hover reads: every sensor of the cell that has data, as nobody was there before."""
    first = radio.sensor_field.first_sensor
    cell_sensors = range(int(first[hover.cell]), int(first[hover.cell + 1]))
    sensors = [sensor for sensor in cell_sensors if radio.demand_bit[sensor] > 0.0]
    links = _links(hover, radio, allocator, sensors)
    for sensor, (rate_bps, bandwidth_hz) in zip(sensors, links, strict=True):
        data_bit = radio.demand_bit[sensor]
        upload_s = hover.duration_s if math.isnan(rate_bps) else data_bit / rate_bps
        x_m, y_m = radio.site.position_m[sensor].tolist()
        yield Reading(
            sensor_id=radio.site.sensor_ids[sensor],
            sensor=sensor,
            uav=hover.uav + 1,
            event=hover.event,
            start_s=hover.start_s,
            end_s=hover.start_s + upload_s,
            data_bit=data_bit,
            rate_bps=rate_bps,
            bandwidth_hz=bandwidth_hz,
            x_m=x_m,
            y_m=y_m,
            cell=hover.cell,
        )


def _links(
    hover: _Hover, radio: _Radio, allocator: Allocator, sensors: Sequence[int]
) -> list[tuple[float, float]]:
    """Rate [bit/s] and bandwidth [Hz] of each sensor in a hover; nan where they are not known."""
    unknown = [(math.nan, math.nan)] * len(sensors)
    if hover.visit is None:
        return unknown
    allocator(radio.briefing, _view(hover, radio, hover.visit, sensors), radio.workspace)
    links = []
    for index in range(len(sensors)):
        bandwidth_hz = float(radio.workspace.share_hz[index])
        rate_bps = uplink_rate_bps(
            bandwidth_hz,
            radio.briefing.tx_power_w * radio.rows.sensor_gain[index],
            radio.briefing.tx_power_w * radio.rows.sensor_error_gain[index],
            radio.briefing.noise_w_per_hz,
        )
        links.append((float(rate_bps), bandwidth_hz))
    uploads_s = [
        radio.demand_bit[sensor] / rate_bps if rate_bps > 0.0 else math.inf
        for sensor, (rate_bps, _) in zip(sensors, links, strict=True)
    ]
    is_known = math.isclose(max(uploads_s, default=0.0), hover.duration_s, rel_tol=_TOLERANCE)
    return links if is_known else unknown


def _view(hover: _Hover, radio: _Radio, visit: int, sensors: Sequence[int]) -> LocalView:
    """What the UAV saw of its own cell as it began to hover; what else it saw does not matter."""
    rows = radio.rows
    for index, sensor in enumerate(sensors):
        gain, error_gain = draw_channel(
            radio.sensor_field, radio.mission_seed, hover.uav, sensor, visit
        )
        rows.sensor[index] = sensor
        rows.sensor_bit[index] = radio.demand_bit[sensor]
        rows.sensor_gain[index] = gain
        rows.sensor_error_gain[index] = error_gain
    return LocalView(
        time_s=hover.start_s,
        x_m=math.nan,
        y_m=math.nan,
        cell=hover.cell,
        energy_left_j=math.nan,
        previous_action=HOVER,
        region_bit=rows.region_bit,
        n_sensors=len(sensors),
        sensor=rows.sensor,
        sensor_bit=rows.sensor_bit,
        sensor_gain=rows.sensor_gain,
        sensor_error_gain=rows.sensor_error_gain,
    )

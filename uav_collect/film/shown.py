"""What a page reads of a mission, value by value, whether it is over or still flies."""

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np
from uav_collect.analysis.readings import Reading
from uav_collect.kernels.arrays import Bools, Floats
from uav_collect.recording.mission_log import FaultRecord, MissionHeader
from uav_collect.scenario.area import open_cells, outlines_box_m
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOME, HOVER, REASON_NAMES
from uav_collect.uav.actions import home_way_m
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.messages import unpacked_map

FORMAT = 'uav_collect film'
FORMAT_VERSION = 1
_DECIMALS = 3  # of a sensor's place [m] and data [bit]
_DIGITS = 5  # of rates and bandwidths: nobody reads more
# Of the mission log, as they are there.
_EVENT_NAMES = (
    *('time_s', 'uav', 'x_m', 'y_m', 'action', 'reason', 'duration_s', 'energy_left_j'),
    *('energy_j', 'collected_bit', 'known_complete'),
)


Values = dict[str, object]  # of JSON
News = list[tuple[int, list[int]]]  # UAVs by index, each with runs of cells: first, how many, ...


def opening(header: MissionHeader, site: Site, demand_bit: Floats) -> Values:
    """What is known before a UAV has taken off: area, sensors, fleet."""
    scenario = site.scenario
    range_m = briefing_of(site).contact_range_m
    positions_m, cells, bits = site.position_m.tolist(), site.cell.tolist(), demand_bit.tolist()
    sensors = zip(site.sensor_ids, positions_m, cells, bits, strict=True)
    return {
        'format': FORMAT,
        'version': FORMAT_VERSION,
        'scenario': header.scenario,
        'fingerprint': header.scenario_fingerprint,
        'seed': header.mission_seed,
        'area': _area(site),
        'contact_range_m': range_m if math.isfinite(range_m) else None,
        'total_bit': header.total_bit,
        'sensors': [
            {
                'id': name,
                'x_m': round(x_m, _DECIMALS),
                'y_m': round(y_m, _DECIMALS),
                'cell': cell,
                'bit': round(bit, _DECIMALS),
            }
            for name, (x_m, y_m), cell, bit in sensors
        ],
        'uavs': [
            {
                'id': uav.id,
                'policy': uav.policy,
                'speed_mps': uav.speed_mps,
                'budget_j': uav.energy_budget_j,
                'margin_j': uav.energy_margin_j,
                'start_m': [*config.start_m],
                'home_m': [*config.home_m],
            }
            for uav, config in zip(header.uavs, scenario.uavs, strict=True)
        ],
    }


def _area(site: Site) -> Values:
    """The cells, and the lines that close some of them."""
    area = site.scenario.area
    is_open, is_within = open_cells(area), open_cells(replace(area, no_fly=None))
    is_known = site.known_complete()
    return {
        'rows': area.n_rows,
        'columns': area.n_columns,
        'cell_size_m': area.cell_size_m,
        'outside': np.flatnonzero(is_within == 0).tolist(),
        'closed': np.flatnonzero((is_open == 0) & (is_within == 1)).tolist(),
        'known_empty': np.flatnonzero((is_known == 1) & (is_open == 1)).tolist(),
        'boundary': area.boundary,
        'no_fly': area.no_fly or [],
        'outlines_m': outlines_box_m(area),
    }


def event_values(
    event: np.void, briefing: Briefing, readings: Sequence[Reading], news: News
) -> Values:
    """One event of a mission.

    Args:
        event: as the mission log has it.
        readings: what it reads.
        news: what UAVs have come to know by then.
    """
    values: Values = {name: event[name].item() for name in _EVENT_NAMES}
    values |= {'uav': int(event['uav']) - 1, 'reason': REASON_NAMES[event['reason']]}
    heard = int(event['heard'])
    if heard:
        values['heard'] = [bit for bit in range(heard.bit_length()) if heard >> bit & 1]
    if event['action'] == HOVER:
        values['reads'] = [_link(each) for each in readings]
    if event['action'] == HOME:
        here_m = float(event['x_m']), float(event['y_m'])
        values['way'] = home_way_m(briefing, int(event['uav']) - 1, here_m)[1:]
    if news:
        values['news'] = news
    return values


def fault_values(fault: FaultRecord) -> Values:
    """A fault that befell a UAV in a mission."""
    return {'time_s': fault.time_s, 'uav': fault.uav - 1, 'fault': fault.fault}


def _link(reading: Reading) -> list[float | None]:
    """A sensor that a hover reads, its bandwidth [Hz] and rate [bit/s], None if not known."""
    return [reading.sensor, _rounded(reading.bandwidth_hz), _rounded(reading.rate_bps)]


def _rounded(number: float) -> float | None:
    return None if math.isnan(number) else float(f'{number:.{_DIGITS}g}')


def unpacked_maps(packed: bytes, n_cells: int) -> Bools:
    """The completion maps of a fleet, one after the other, that `packed_maps` packed, (U, C)."""
    size = (n_cells + 7) // 8
    maps = [
        unpacked_map(packed[start : start + size], n_cells)
        for start in range(0, len(packed), size)
    ]
    return np.array(maps, dtype=np.bool_)


def new_runs(before: Bools, now: Bools) -> News:
    """The cells that are set on maps of UAVs, (U, C), and were not before."""
    new = now & ~before
    return [(uav, _runs(new[uav])) for uav in np.flatnonzero(new.any(axis=1)).tolist()]


def _runs(flags: Bools) -> list[int]:
    """Where flags are set, as runs: the first cell and how many of each."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    return np.column_stack([starts, ends - starts]).ravel().tolist()

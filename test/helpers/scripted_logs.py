"""Mission logs flown by script: every number known beforehand, no world needed."""

from collections.abc import Sequence

import numpy as np
from uav_collect.recording.log_model import EVENT_DTYPE
from uav_collect.recording.mission_log import MissionHeader, MissionLog, UavHeader
from uav_collect.uav.action_codes import ACTION_NAMES, REASON_NAMES

HOVER_W = 200.0
MOVE_W = 100.0
STEPS = {'forward': (0, 1), 'right': (1, 0), 'backward': (0, -1), 'left': (-1, 0)}


def uav(number: int, *, speed_mps: float = 10.0, budget_j: float = 50e3) -> UavHeader:
    return UavHeader(
        id=number,
        speed_mps=speed_mps,
        energy_budget_j=budget_j,
        energy_margin_j=1e3,
        policy='script',
        allocator='exact',
    )


def header(uavs: Sequence[UavHeader], *, total_bit: float = 1e6, cells: int = 4) -> MissionHeader:
    return MissionHeader(
        scenario='scripted',
        scenario_fingerprint='0123456789abcdef',
        mission_seed=3,
        n_rows=cells,
        n_columns=cells,
        cell_size_m=50.0,
        total_bit=total_bit,
        uavs=tuple(uavs),
    )


def fly(head: MissionHeader, scripts: Sequence[Sequence[str]]) -> MissionLog:
    """Fly one script per UAV from the south-west cell, which is home.

    An action is a name of ACTION_NAMES, with what it needs after it: `hover 4 0.5` hovers 4 s for
    0.5 Mbit, `home failsafe` says why.
    """
    rows = []
    for unit, script in zip(head.uavs, scripts, strict=True):
        rows += _fly_one(unit, script, head.cell_size_m)
    rows.sort(key=lambda row: (row['time_s'], row['uav']))
    events = np.zeros(len(rows), dtype=EVENT_DTYPE)
    ends = [row['time_s'] + row['duration_s'] for row in rows]
    for number, row in enumerate(rows):
        until_s = rows[number + 1]['time_s'] if number + 1 < len(rows) else max(ends)
        row |= {'event': number, 'interval_s': until_s - row['time_s']}
        events[number] = tuple(row[name] for name in EVENT_DTYPE.names)
    return MissionLog(header=head, events=events)


def _fly_one(unit: UavHeader, script: Sequence[str], cell_m: float) -> list[dict[str, float]]:
    rows = []
    time_s, x_m, y_m, left_j = 0.0, cell_m / 2, cell_m / 2, unit.energy_budget_j
    for decision, line in enumerate(script):
        action, *rest = line.split(' ', maxsplit=1)
        east, north = STEPS.get(action, (0, 0))
        duration_s, collected_bit, power_w, reason = cell_m / unit.speed_mps, 0.0, MOVE_W, 'policy'
        if action == 'hover':
            seconds, mbit = rest[0].split()
            duration_s, collected_bit, power_w = float(seconds), float(mbit) * 1e6, HOVER_W
        if action == 'home':
            duration_s = float(np.hypot(x_m - cell_m / 2, y_m - cell_m / 2)) / unit.speed_mps
            reason = rest[0] if rest else 'map complete'
        row = dict.fromkeys(EVENT_DTYPE.names or (), 0)
        row |= {'time_s': time_s, 'uav': unit.id, 'decision': decision, 'x_m': x_m, 'y_m': y_m}
        row |= {'action': ACTION_NAMES.index(action), 'reason': REASON_NAMES.index(reason)}
        row |= {
            'duration_s': duration_s,
            'energy_left_j': left_j,
            'energy_j': power_w * duration_s,
        }
        row |= {'energy_left_j': left_j, 'collected_bit': collected_bit}
        rows.append(row)
        time_s, left_j = time_s + duration_s, left_j - row['energy_j']
        x_m, y_m = x_m + east * cell_m, y_m + north * cell_m
    return rows

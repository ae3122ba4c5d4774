"""What is wrong with a message, before anything is done with it: lengths, indices, ranges.

Whether it is true is another matter: only the middleware's security can keep liars out.
"""

from collections.abc import Iterable
import math
from typing import Any

from uav_collect.limits import MAX_GUARD_AFTER, NO_AGENT
from uav_collect.uav.action_codes import HOME, NONE
from uav_collect.uav.actions import cell_under, neighbour
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.view import VIEW_CELLS

_PILOT_NAMES = ('agent_instance', 'host', 'policy', 'policy_version', 'allocator')
MOST_CHARACTERS = 200  # of a name that others choose
_ENERGY_TOLERANCE = 1e-9  # relative; what adding up may round
_PLACE_TOLERANCE_M = 1e-6  # the same


def name_problem(field: str, value: str) -> str | None:
    """What is wrong with a name that somebody else gave; None if nothing is."""
    if len(value) > MOST_CHARACTERS:
        return f'{field} has {len(value)} characters: must have at most {MOST_CHARACTERS}'
    if not value.isprintable():
        return f'{field} is {value!r}: must be printable'
    return None


def names_problem(message: Any, fields: Iterable[str]) -> str | None:
    """What is wrong with the names in a message; None if nothing is."""
    problems = (name_problem(field, getattr(message, field)) for field in fields)
    return next(filter(None, problems), None)


def join_problem(request: Any) -> str | None:
    """What is wrong with a request to fly a UAV; None if nothing is."""
    problem = names_problem(request, _PILOT_NAMES)
    if problem is None and not NONE <= request.guard_after <= MAX_GUARD_AFTER:
        return f'guard_after is {request.guard_after}: must be {NONE}..{MAX_GUARD_AFTER}'
    if problem is None and request.policy == NO_AGENT:
        return f'policy is {NO_AGENT!r}: must be another name, which stands for no agent'
    return problem


def radio_problem(msg: Any, briefing: Briefing, uav: int) -> str | None:
    """What is wrong with a message that a UAV, by index, heard of another; None if nothing is."""
    n_cells = briefing.n_rows * briefing.n_columns
    if not 1 <= msg.sender <= briefing.n_uavs or msg.sender == uav + 1:
        return f'sender is {msg.sender}: must be another UAV of 1..{briefing.n_uavs}'
    if len(msg.complete) != (n_cells + 7) // 8:
        return f'complete has {len(msg.complete)} bytes: must have {(n_cells + 7) // 8}'
    return _place_problem(msg, briefing)


def observation_problem(msg: Any, briefing: Briefing, uav: int, n_sensors: int) -> str | None:
    """What is wrong with what a UAV, by index, is told that it sees; None if nothing is.

    Args:
        n_sensors: of the site.
    """
    problem = _place_problem(msg, briefing)
    if problem is not None:
        return problem
    cell = cell_under(briefing, msg.x_m, msg.y_m)
    if msg.cell != cell or not (0 <= cell < len(briefing.is_open) and briefing.is_open[cell]):
        return f'cell is {msg.cell}: must be the one that the UAV is in'
    most_j = briefing.energy_budget_j[uav] * (1.0 + _ENERGY_TOLERANCE)
    if not 0.0 <= msg.energy_left_j <= most_j:
        return f'energy_left_j is {msg.energy_left_j}: must be 0 to {most_j:g}'
    if not NONE <= msg.previous_action < HOME:
        return f'previous_action is {msg.previous_action}: must be {NONE} to {HOME - 1}'
    return _region_problem(msg, briefing) or _sensors_problem(msg, n_sensors)


def _place_problem(msg: Any, briefing: Briefing) -> str | None:
    for name, value, n_cells in (
        ('x_m', msg.x_m, briefing.n_columns),
        ('y_m', msg.y_m, briefing.n_rows),
    ):
        size_m = n_cells * briefing.cell_size_m
        if not -_PLACE_TOLERANCE_M <= value <= size_m + _PLACE_TOLERANCE_M:
            return f'{name} is {value}: must be 0 to {size_m:g}'
    if not (math.isfinite(msg.time_s) and msg.time_s >= 0.0):
        return f'time_s is {msg.time_s}: must be finite and not negative'
    return None


def _region_problem(msg: Any, briefing: Briefing) -> str | None:
    if len(msg.region_demand_bit) != VIEW_CELLS:
        return f'region_demand_bit has {len(msg.region_demand_bit)} values: must have {VIEW_CELLS}'
    for index, bit in enumerate(msg.region_demand_bit):
        is_outside = neighbour(briefing, msg.cell, index // 3 - 1, index % 3 - 1) < 0
        if math.isnan(bit) != is_outside or not (is_outside or 0.0 <= bit < math.inf):
            what = 'nan, outside the area' if is_outside else 'finite and not negative'
            return f'region_demand_bit[{index}] is {bit}: must be {what}'
    return None


def _sensors_problem(msg: Any, n_sensors: int) -> str | None:
    sensor = msg.sensor
    for index, number in enumerate(sensor):
        if number >= n_sensors or (index > 0 and number <= sensor[index - 1]):
            return f'sensor[{index}] is {number}: must rise and stay below {n_sensors}'
    for name, is_zero_allowed in (
        ('sensor_demand_bit', False),
        ('sensor_gain', True),
        ('sensor_error_gain', True),
    ):
        values = getattr(msg, name)
        if len(values) != len(sensor):
            return f'{name} has {len(values)} values for {len(sensor)} sensors'
        for index, value in enumerate(values):
            if not 0.0 <= value < math.inf or (value == 0.0 and not is_zero_allowed):
                return f'{name}[{index}] is {value}: must be finite and not negative'
    return None

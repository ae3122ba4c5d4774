"""What must not lie in closed cells, and what they must not cut off from the UAVs."""

from collections.abc import Iterator, Sequence

import numpy as np
from uav_collect.config.yaml_text import Keys, shown
from uav_collect.kernels.arrays import Ints
from uav_collect.scenario.area import cell_of, cells_of, NO_ZONE, open_cells, zone_over_cells
from uav_collect.scenario.model import AreaConfig, ListedSensor, ListedSensors, Scenario
from uav_collect.scenario.ways import reached_cells

_MAX_NAMED = 3  # cells in one line


def wrong_closed_cells(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    """What is wrong, by its path: of a scenario in which all else is right."""
    if open_cells(scenario.area).all():
        return
    found = [*_in_closed_cells(scenario)]
    yield from found or _cut_off(scenario)


def _in_closed_cells(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    """Starts, homes and sensors where no UAV may fly."""
    area, whys = scenario.area, _whys_closed(scenario)
    for index, uav in enumerate(scenario.uavs):
        for key, place_m in (('start', uav.start_m), ('home', uav.home_m)):
            if (why := whys.get(cell_of(area, place_m))) is not None:
                what = f'is {shown(place_m)}: must be in an open cell, but {why}'
                yield ('fleet', 'uavs', index, key, 'position_m'), what
    if isinstance(scenario.sensors, ListedSensors):
        sensors = scenario.sensors.entries
        for index, (sensor, cell) in enumerate(zip(sensors, _cells(area, sensors), strict=True)):
            if (why := whys.get(cell)) is not None:
                place = f'sensor {sensor.id} at x = {sensor.x_m:.10g} m, y = {sensor.y_m:.10g} m'
                remedy = 'leave it out, or let the area have its cell'
                what = f'is {place}: must be in an open cell, but {why}; {remedy}'
                yield ('sensors', 'entries', index), what


def _cells(area: AreaConfig, sensors: Sequence[ListedSensor]) -> list[int]:
    places_m = np.array([(sensor.x_m, sensor.y_m) for sensor in sensors])
    return [int(cell) for cell in cells_of(area, places_m)]


def _whys_closed(scenario: Scenario) -> dict[int, str]:
    """Why each closed cell is one, in words.

    Of all at once: to look an area up takes as long as it has corners.
    """
    zones = zone_over_cells(scenario.area)
    return {
        cell: f'the centre of cell {_place(scenario, cell)} lies outside area.boundary'
        if zones[cell] == NO_ZONE
        else f'cell {_place(scenario, cell)} lies under area.no_fly.{zones[cell]}'
        for cell in np.flatnonzero(open_cells(scenario.area) == 0).tolist()
    }


def _cut_off(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    """Homes, and cells that may hold data, to which no moves lead from a UAV's start."""
    area, starts = scenario.area, set[int]()
    needed = np.flatnonzero(_may_hold_data(scenario)).tolist()
    for index, uav in enumerate(scenario.uavs):
        start, home = cell_of(area, uav.start_m), cell_of(area, uav.home_m)
        reached = reached_cells(area, start)
        if home not in reached:
            what = (
                f'is {shown(uav.home_m)}: must be where open cells lead from the start, but none '
                f'lead from cell {_place(scenario, start)} to cell {_place(scenario, home)}'
            )
            yield ('fleet', 'uavs', index, 'home', 'position_m'), what
        lost = [cell for cell in needed if cell not in reached]
        if lost and start not in starts:
            what = (
                f'cuts {_named(scenario, lost)} off from the start of UAV {index + 1}: must leave '
                'open cells that lead there, or close what they lead to'
            )
            yield ('area', 'no_fly' if area.no_fly else 'boundary'), what
        starts.add(start)


def _may_hold_data(scenario: Scenario) -> Ints:
    """1 for each cell that must be reached, (C,): open, and not known to be empty."""
    is_open = open_cells(scenario.area)
    if not scenario.demand.is_empty_known:
        return is_open
    if isinstance(scenario.sensors, ListedSensors):
        has_sensor = np.zeros_like(is_open)
        has_sensor[[*_listed_in_cells(scenario)]] = 1
        return is_open * has_sensor
    from uav_collect.scenario.site import known_complete_cells  # kernels, to draw them

    return 1 - known_complete_cells(scenario)


def _listed_in_cells(scenario: Scenario) -> dict[int, str]:
    """The first sensor of each cell that has one, if they are listed.

    Whoever loads a scenario must be free to choose how kernels run: none is imported for it.
    """
    if not isinstance(scenario.sensors, ListedSensors):
        return {}
    found: dict[int, str] = {}
    sensors = scenario.sensors.entries
    for sensor, cell in zip(sensors, _cells(scenario.area, sensors), strict=True):
        found.setdefault(cell, sensor.id)
    return found


def _named(scenario: Scenario, cells: list[int]) -> str:
    """Some cells and how many more there are, with a sensor of each if they are listed."""
    sensors, names = _listed_in_cells(scenario), []
    for cell in cells[:_MAX_NAMED]:
        with_sensor = f' with sensor {sensors[cell]}' if cell in sensors else ''
        names.append(f'{_place(scenario, cell)}{with_sensor}')
    n_more = len(cells) - len(names)
    words = ', '.join(names) + (f' and {n_more} more' if n_more else '')
    return f'cell {words}' if len(cells) == 1 else f'cells {words}'


def _place(scenario: Scenario, cell: int) -> str:
    return shown([*divmod(cell, scenario.area.n_columns)])

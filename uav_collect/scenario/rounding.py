"""Places that rounding has moved, by less than a micrometre: back to where they were meant to be.

A centre of cells of 20.1 m is at 30.150000000000002 m, and who writes it down writes 30.15.
"""

from dataclasses import replace
import math

from uav_collect.scenario.model import AreaConfig, ListedSensors, Point, Scenario, UavConfig

ROUNDING_M = 1e-6  # what lies as near to a line, or to a point, is there


def on_edge(place_m: Point, width_m: float, height_m: float) -> Point:
    """A place; where it lies just beyond an edge of the area, on that edge."""
    x_m, y_m = place_m
    return _at_most(x_m, width_m), _at_most(y_m, height_m)


def without_rounding(scenario: Scenario) -> Scenario:
    """The scenario with starts in the centres of cells, and homes and sensors in the area.

    Only what would not be there is moved, and only as far as rounding may have moved it.
    """
    area, sensors = scenario.area, scenario.sensors
    uavs = tuple(_uav(uav, area) for uav in scenario.uavs)
    if isinstance(sensors, ListedSensors):
        entries = []
        for sensor in sensors.entries:
            x_m, y_m = on_edge((sensor.x_m, sensor.y_m), area.width_m, area.height_m)
            is_there = (x_m, y_m) == (sensor.x_m, sensor.y_m)
            entries.append(sensor if is_there else replace(sensor, x_m=x_m, y_m=y_m))
        sensors = replace(sensors, entries=tuple(entries))
    return replace(scenario, sensors=sensors, fleet=replace(scenario.fleet, uavs=uavs))


def _uav(uav: UavConfig, area: AreaConfig) -> UavConfig:
    start_m = _at_centre(uav.start_m[0], area), _at_centre(uav.start_m[1], area)
    home_m = on_edge(uav.home_m, area.width_m, area.height_m)
    if uav.home_m == uav.start_m:  # it is to land where it starts
        home_m = start_m
    return replace(
        uav,
        start=replace(uav.start, position_m=start_m),
        home=replace(uav.home, position_m=home_m),
    )


def _at_centre(along_m: float, area: AreaConfig) -> float:
    """Where a row or column has its middle, if that is near [m]."""
    middle_m = (math.floor(along_m / area.cell_size_m) + 0.5) * area.cell_size_m
    return middle_m if abs(along_m - middle_m) <= ROUNDING_M else along_m


def _at_most(along_m: float, most_m: float) -> float:
    is_beyond = most_m < along_m <= most_m + ROUNDING_M
    is_before = -ROUNDING_M <= along_m < 0.0
    return most_m if is_beyond else 0.0 if is_before else along_m

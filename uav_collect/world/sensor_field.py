"""What only the world knows: the sensors, their channels and the laws their data is drawn by."""

import math
from typing import NamedTuple

import numpy as np
from uav_collect.kernels.arrays import Floats, new_row, Row, row_of
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.keyed_random import (
    DATA_AMOUNT,
    DATA_CELL,
    DATA_CELL_COUNT,
    draw_poisson,
    draw_uniform,
    shuffle_first,
)
from uav_collect.physics import radio
from uav_collect.scenario.area import cell_centres_m, mean_data_cells
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import Site


class SensorField(NamedTuple):
    """The site as kernels read it; rows are indexed by sensor unless said otherwise."""

    first_sensor: Row[int]  # by cell, and one past the last
    los_probability: Row[float]  # to a UAV over the centre of the sensor's cell
    path_gain: Row[float]  # with line of sight, linear
    rician_factor: Row[float]
    nlos_attenuation: float
    n_antennas: int
    csi_error_variance: float  # relative to the path gain
    mean_data_cells: float  # negative: all sensors have data
    low_bit: float
    high_bit: float
    given_bit: Row[float]  # amount of data that the site's file gives; nan: drawn
    candidates: Row[int]  # scratch: the cells that have sensors


def lay_out(site: Site) -> SensorField:
    """The sensor field of a site under its scenario's radio and demand."""
    scenario = site.scenario
    config = scenario.radio
    centre_m = cell_centres_m(scenario.area)[site.cell]
    horizontal_m = np.hypot(*(site.position_m - centre_m).T).tolist()
    altitude_m = scenario.area.altitude_m
    elevation_rad = [radio.elevation_rad(away_m, altitude_m) for away_m in horizontal_m]
    distance_m = [math.sqrt(away_m * away_m + altitude_m * altitude_m) for away_m in horizontal_m]
    reference_gain = radio.reference_gain(config.carrier_hz)
    low_mbit, high_mbit = _drawn_range_mbit(scenario)
    has_all = scenario.demand.cell_share == 'all'
    return SensorField(
        first_sensor=row_of(site.first_sensor.tolist()),
        los_probability=row_of(
            [
                radio.line_of_sight_probability(angle, config.los_a, config.los_b)
                for angle in elevation_rad
            ]
        ),
        path_gain=row_of(
            [
                radio.path_gain(away_m, reference_gain, config.path_loss_exponent)
                for away_m in distance_m
            ]
        ),
        rician_factor=row_of(
            [
                radio.rician_factor(angle, config.rician_a1, config.rician_a2)
                for angle in elevation_rad
            ]
        ),
        nlos_attenuation=config.nlos_attenuation,
        n_antennas=config.n_antennas,
        csi_error_variance=config.csi_error_variance,
        mean_data_cells=-1.0 if has_all else mean_data_cells(scenario),
        low_bit=low_mbit * 1e6,
        high_bit=high_mbit * 1e6,
        given_bit=row_of(site.data_bit.tolist()),
        candidates=new_row(scenario.n_cells, 0),
    )


def most_sensors(sensor_field: SensorField) -> int:
    """How many sensors the fullest cell has, 1 at least."""
    first = sensor_field.first_sensor
    return max(1, *(first[cell + 1] - first[cell] for cell in range(len(first) - 1)))


def demand_by_cell(first_sensor: Row[int], demand_bit: Row[float]) -> Floats:
    """The data of each cell's sensors, (C,)."""
    cells = range(len(first_sensor) - 1)
    # Summed one by one as missions do: the sum must be the same to the last bit.
    sums = [sum(demand_bit[first_sensor[cell] : first_sensor[cell + 1]], 0.0) for cell in cells]
    return np.array(sums)


def demand_of(site: Site, mission_seed: int) -> Floats:
    """The data that waits at each sensor at the start of a mission [bit], (S,)."""
    demand_bit = new_row(site.n_sensors, 0.0)
    draw_demand(lay_out(site), mission_seed, demand_bit)
    return np.asarray(demand_bit)


@kernel
def draw_demand(sensor_field: SensorField, mission_seed: int, demand_bit: Row[float]) -> None:
    """Draw the data that waits at the start of a mission.

    Args:
        demand_bit: written, data of each sensor [bit], shape (S,).

    Source: paper, section VII-A; data cells among those that have sensors.
    """
    n_cells = len(sensor_field.first_sensor) - 1
    n_candidates = 0
    for cell in range(n_cells):
        for sensor in range(sensor_field.first_sensor[cell], sensor_field.first_sensor[cell + 1]):
            demand_bit[sensor] = 0.0
        if sensor_field.first_sensor[cell + 1] > sensor_field.first_sensor[cell]:
            sensor_field.candidates[n_candidates] = cell
            n_candidates += 1
    n_data_cells = n_candidates
    if sensor_field.mean_data_cells >= 0.0:
        drawn = draw_poisson(sensor_field.mean_data_cells, mission_seed, DATA_CELL_COUNT, 0)
        n_data_cells = min(max(drawn, 1), n_candidates)
        shuffle_first(sensor_field.candidates, n_candidates, n_data_cells, mission_seed, DATA_CELL)
    for index in range(n_data_cells):
        cell = sensor_field.candidates[index]
        for sensor in range(sensor_field.first_sensor[cell], sensor_field.first_sensor[cell + 1]):
            demand_bit[sensor] = _amount_bit(sensor_field, mission_seed, sensor)


@kernel
def _amount_bit(sensor_field: SensorField, mission_seed: int, sensor: int) -> float:
    if not math.isnan(sensor_field.given_bit[sensor]):
        return sensor_field.given_bit[sensor]
    share = draw_uniform(mission_seed, DATA_AMOUNT, sensor, 0, 0)
    return sensor_field.low_bit + (sensor_field.high_bit - sensor_field.low_bit) * share


def _drawn_range_mbit(scenario: Scenario) -> tuple[float, float]:
    amounts = scenario.demand.data_mbit
    return (0.0, 0.0) if isinstance(amounts, str) else (amounts[0], amounts[1])

"""What one UAV sees when it decides, and the rows that it is written to."""

from typing import NamedTuple

from uav_collect.kernels.arrays import new_row, Row

VIEW_CELLS = 9  # the 3 x 3 region a UAV sees


class LocalView(NamedTuple):
    """What one UAV sees when it decides: itself, the 3 x 3 region and its own cell's sensors."""

    time_s: float
    x_m: float
    y_m: float
    cell: int
    energy_left_j: float
    previous_action: int  # NONE at the start
    region_bit: Row[
        float
    ]  # (9,) waiting data per cell, row by row from the south-west; nan outside
    n_sensors: int  # of the own cell that have data
    sensor: Row[int]  # (n_sensors,) or longer
    sensor_bit: Row[float]  # their data
    sensor_gain: Row[float]  # estimated channel gain ||h||^2, linear
    sensor_error_gain: Row[float]  # variance of its error, linear


class ViewRows(NamedTuple):
    """Rows that local views are written to."""

    region_bit: Row[float]
    sensor: Row[int]
    sensor_bit: Row[float]
    sensor_gain: Row[float]
    sensor_error_gain: Row[float]


def new_view_rows(max_sensors: int) -> ViewRows:
    """Rows for a local view of cells that hold at most so many sensors."""
    return ViewRows(
        region_bit=new_row(VIEW_CELLS, 0.0),
        sensor=new_row(max_sensors, 0),
        sensor_bit=new_row(max_sensors, 0.0),
        sensor_gain=new_row(max_sensors, 0.0),
        sensor_error_gain=new_row(max_sensors, 0.0),
    )

"""Frames: an area mirrored and turned, so that missions that mirror each other look alike.

A frame is one of the square's eight symmetries, as a sum of MIRROR_X, MIRROR_Y and TRANSPOSE: the
area is mirrored first, then rows and columns change places. In its own frame each UAV's home lies
in the south-west and the longer side of the area runs along x.
"""

import numpy as np
from uav_collect.kernels.arrays import Ints
from uav_collect.kernels.compile import kernel
from uav_collect.uav.briefing import Briefing

IDENTITY = 0  # the compass's own
MIRROR_X, MIRROR_Y, TRANSPOSE = 1, 2, 4

# By frame, then by action in it: which action that is by the compass.
TURNED = (
    (0, 1, 2, 3, 4),
    (0, 1, 4, 3, 2),
    (0, 3, 2, 1, 4),
    (0, 3, 4, 1, 2),
    (0, 2, 1, 4, 3),
    (0, 4, 1, 2, 3),
    (0, 2, 3, 4, 1),
    (0, 4, 3, 2, 1),
)
COMPASS_ACTIONS: Ints = np.array(TURNED)  # (8, N_ACTIONS), the same
FRAME_ACTIONS: Ints = np.argsort(COMPASS_ACTIONS, axis=1)  # (8, N_ACTIONS), its inverse

_SLACK_CELLS = 1e-6  # what rounding may make of two lengths that are equal


@kernel
def frame_of(briefing: Briefing, uav: int) -> int:
    """The frame of a UAV; where home lies alike on both sides of a line, nothing is turned."""
    size_m = briefing.cell_size_m
    east = briefing.home_x_m[uav] / size_m - 0.5 * briefing.n_columns
    north = briefing.home_y_m[uav] / size_m - 0.5 * briefing.n_rows
    frame = IDENTITY
    if east > _SLACK_CELLS:
        frame += MIRROR_X
    if north > _SLACK_CELLS:
        frame += MIRROR_Y
    is_square = briefing.n_rows == briefing.n_columns
    if briefing.n_rows > briefing.n_columns or (
        is_square and abs(north) > abs(east) + _SLACK_CELLS
    ):
        frame += TRANSPOSE
    return frame


@kernel
def to_frame(frame: int, north: float, east: float) -> tuple[float, float]:
    """An offset by the compass as one in a frame."""
    if frame & MIRROR_X:
        east = -east
    if frame & MIRROR_Y:
        north = -north
    return (east, north) if frame & TRANSPOSE else (north, east)


@kernel
def cells_to_frame(frame: int, north: int, east: int) -> tuple[int, int]:
    """The same, in whole cells."""
    if frame & MIRROR_X:
        east = -east
    if frame & MIRROR_Y:
        north = -north
    return (east, north) if frame & TRANSPOSE else (north, east)


@kernel
def cells_to_compass(frame: int, north: int, east: int) -> tuple[int, int]:
    """An offset in a frame as one by the compass, in whole cells."""
    if frame & TRANSPOSE:
        north, east = east, north
    if frame & MIRROR_X:
        east = -east
    if frame & MIRROR_Y:
        north = -north
    return north, east

"""Frames: a UAV's home in the south-west, the longer side along x, and actions turned with it."""

from itertools import product

import numpy as np
from odd_areas import corridor
import pytest
from uav_collect.uav.action_codes import COLUMN_STEP, N_ACTIONS, ROW_STEP
from uav_collect.uav.briefing import brief
from uav_collect.uav.frames import (
    cells_to_compass,
    cells_to_frame,
    COMPASS_ACTIONS,
    FRAME_ACTIONS,
    frame_of,
    IDENTITY,
    MIRROR_X,
    MIRROR_Y,
    to_frame,
    TRANSPOSE,
)

FRAMES = range(8)


def frame_with_home(n_rows: int, n_columns: int, row: int, column: int) -> int:
    home = {'cell': [row, column]}
    return frame_of(brief(corridor(n_rows, n_columns, fleet__default__home=home)), 0)


@pytest.mark.parametrize(
    ('home', 'frame'),
    [
        ((0, 0), IDENTITY),
        ((0, 8), MIRROR_X),
        ((5, 0), MIRROR_Y),
        ((5, 8), MIRROR_X + MIRROR_Y),
        ((2, 4), IDENTITY),  # in the middle from west to east
    ],
)
def test_an_area_is_mirrored_so_that_home_lies_south_west(
    home: tuple[int, int], frame: int
) -> None:
    assert frame_with_home(6, 9, *home) == frame


def test_an_area_that_is_higher_than_wide_is_turned_once_home_lies_south_west() -> None:
    assert frame_with_home(9, 6, 0, 0) == TRANSPOSE
    assert frame_with_home(9, 6, 8, 5) == MIRROR_X + MIRROR_Y + TRANSPOSE


def test_a_square_is_turned_so_that_home_is_further_from_the_middle_along_x() -> None:
    assert frame_with_home(8, 8, 1, 0) == IDENTITY
    assert frame_with_home(8, 8, 0, 1) == TRANSPOSE
    assert frame_with_home(8, 8, 7, 1) == MIRROR_Y + TRANSPOSE


@pytest.mark.parametrize('size_m', [50.0, 33.3, 0.7, 123.4])
def test_a_square_whose_home_lies_on_a_diagonal_is_not_turned(size_m: float) -> None:
    for row, column in ((0, 0), (2, 2), (2, 4), (6, 0), (3, 3)):
        overrides = {'area__cell_size_m': size_m, 'fleet__default__home': {'cell': [row, column]}}
        briefing = brief(corridor(7, 7, **overrides))
        assert frame_of(briefing, 0) < TRANSPOSE


def test_actions_turn_as_offsets_do() -> None:
    for frame, action in product(FRAMES, range(N_ACTIONS)):
        compass = COMPASS_ACTIONS[frame, action]
        turned = cells_to_compass(frame, ROW_STEP[action], COLUMN_STEP[action])
        assert turned == (ROW_STEP[compass], COLUMN_STEP[compass])
        assert FRAME_ACTIONS[frame, compass] == action


def test_each_frame_is_another_and_leads_back() -> None:
    assert len(np.unique(COMPASS_ACTIONS, axis=0)) == len(FRAMES)
    for frame in FRAMES:
        assert cells_to_compass(frame, *cells_to_frame(frame, 3, -7)) == (3, -7)
        assert cells_to_frame(frame, 3, -7) == to_frame(frame, 3.0, -7.0)

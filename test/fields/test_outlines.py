"""Polygons: made wider, and how far from their edges things are."""

import math

from fields import square
import numpy as np
import pytest
from uav_collect.fields.outlines import distance_m, widened


@pytest.mark.parametrize('turn', [1, -1])
def test_a_square_is_wider_by_as_much_on_each_side_whichever_way_round(turn: int) -> None:
    corners = square(100.0, 200.0, 50.0)[::turn]
    wide = widened(corners, 10.0)
    assert np.sort(wide, axis=0) == pytest.approx(np.sort(square(90.0, 190.0, 70.0), axis=0))


def test_the_inner_corner_of_an_l_moves_into_what_is_beyond_it() -> None:
    corners = ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0), (2.0, 4.0), (0.0, 4.0))
    wide = widened(corners, 1.0)
    assert wide[3] == pytest.approx((3.0, 3.0))
    assert wide[0] == pytest.approx((-1.0, -1.0))


def test_a_sharp_corner_is_cut_off_at_the_width() -> None:
    corners = ((0.0, 0.0), (100.0, 5.0), (0.0, 10.0))
    wide = widened(corners, 10.0)
    assert max(x for x, _ in wide) < 100.0 + 10.0
    assert len(wide) == 3 + 1


def test_corners_that_are_said_twice_count_once() -> None:
    corners = square(0.0, 0.0, 50.0)
    assert widened((corners[0], *corners), 5.0) == widened(corners, 5.0)


@pytest.mark.parametrize(
    ('place', 'away_m'), [((25.0, -7.0), 7.0), ((53.0, 54.0), 5.0), ((25.0, 20.0), 20.0)]
)
def test_a_distance_is_that_to_the_nearest_edge(place: tuple[float, float], away_m: float) -> None:
    assert distance_m(place, square(0.0, 0.0, 50.0)) == pytest.approx(away_m)
    assert math.isclose(distance_m((0.0, 10.0), square(0.0, 0.0, 50.0)), 0.0)

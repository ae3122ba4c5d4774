"""Lanes of paths that share an edge. Places are corners of a unit grid."""

import itertools

import numpy as np
import pytest
from uav_collect.analysis.path_lanes import corners_m, lane_shifts, narrowest_lane, steps
from uav_collect.kernels.arrays import Floats


def way(*places: tuple[int, int]) -> Floats:
    return np.array(places, dtype=np.float64)


EAST = way((0, 0), (1, 0), (2, 0))


def test_a_way_alone_runs_through_the_centres() -> None:
    assert lane_shifts([EAST]) == [[0.0, 0.0]]
    np.testing.assert_array_equal(corners_m(EAST, [0.0, 0.0], 1.0)[[0, -1]], EAST[[0, -1]])


def test_hovering_takes_no_step() -> None:
    hovering = way((0, 0), (0, 0), (1, 0), (1, 0), (1, 0))
    assert [tuple(there) for _, there in steps(hovering)] == [(1.0, 0.0)]
    assert lane_shifts([hovering]) == [[0.0]]


@pytest.mark.parametrize('n_ways', [2, 3, 16])
def test_ways_along_one_edge_get_lanes_of_their_own(n_ways: int) -> None:
    shifts = [shift for shift, _ in lane_shifts([EAST] * n_ways)]
    gaps = np.diff(sorted(shifts))
    np.testing.assert_allclose(gaps, narrowest_lane([EAST] * n_ways), rtol=1e-12)
    assert sum(shifts) == pytest.approx(0.0, abs=1e-12)
    assert max(shifts) < 0.5  # inside the cell


def test_a_way_there_and_back_gets_two_lanes() -> None:
    there_and_back = way((0, 0), (1, 0), (0, 0))
    ((out, back),) = lane_shifts([there_and_back])
    assert out == -back != 0.0


def test_ways_that_only_cross_keep_to_the_centres() -> None:
    north = way((1, -1), (1, 0), (1, 1))
    assert lane_shifts([EAST, north]) == [[0.0, 0.0], [0.0, 0.0]]


def test_a_turn_joins_both_lanes_in_one_corner() -> None:
    corner = corners_m(10 * way((0, 0), (1, 0), (1, 1)), [0.1, -0.2], 10.0)
    np.testing.assert_allclose(corner, [[0, 1], [8, 1], [8, 10]], atol=1e-12)


def test_a_changed_lane_is_a_jog_within_the_cell() -> None:
    corners = corners_m(EAST, [0.0, 0.2], 1.0)
    np.testing.assert_allclose(corners, [[0, 0], [0.9, 0], [1.1, 0.2], [2, 0.2]], atol=1e-12)


def test_a_uav_that_never_moved_has_one_corner() -> None:
    np.testing.assert_array_equal(corners_m(way((3, 4), (3, 4)), [], 1.0), [[3, 4]])
    assert corners_m(np.empty((0, 2)), [], 1.0).shape == (0, 2)


def test_lanes_stay_in_order_along_a_shared_corridor() -> None:
    others = [EAST, EAST + 0.0]
    for first, second in itertools.pairwise(zip(*lane_shifts(others), strict=True)):
        assert first == second

"""Tours get shorter, keep all their points, and come near the shortest one."""

from itertools import pairwise, permutations

import numpy as np
import pytest
from uav_collect.kernels.arrays import Ints
from uav_collect.uav.shortening import shortened


def ways(seed: int, n_points: int) -> Ints:
    """Moves between points of 20 x 20 cells."""
    points = np.random.default_rng(seed).integers(0, 20, (n_points, 2))
    between: Ints = np.abs(points[:, None] - points).sum(axis=-1)
    return between


def length(way: Ints, tour: list[int]) -> int:
    return int(sum(way[here, there] for here, there in pairwise([*tour, tour[0]])))


@pytest.mark.parametrize('n_points', [1, 2, 3, 4, 5, 30, 100])
def test_a_tour_keeps_its_points_and_its_first_one_and_is_not_longer(n_points: int) -> None:
    way = ways(n_points, n_points)
    tour = shortened(way)
    assert sorted(tour) == [*range(n_points)]
    assert tour[0] == 0
    assert length(way, tour) <= length(way, [*range(n_points)])


def test_tours_of_few_points_are_nearly_as_short_as_the_shortest_one() -> None:
    for seed in range(5):
        way = ways(seed, 7)
        least = min(length(way, [0, *order]) for order in permutations(range(1, 7)))
        assert length(way, shortened(way)) <= 1.1 * least


def test_tours_of_many_points_are_as_long_as_theory_has_it() -> None:
    # Of N points of a square of side a: 0.7124 sqrt(N) a straight on, 4 / pi of that by moves.
    for seed in range(2):
        way = ways(seed, 80)
        assert length(way, shortened(way)) < 1.15 * 0.7124 * 4 / np.pi * np.sqrt(80) * 20

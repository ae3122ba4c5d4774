"""The map of a field."""

from dataclasses import replace
from io import BytesIO

from fields import ground, proposed, square
import numpy as np
import pytest
from uav_collect.analysis.plotting import imread
from uav_collect.fields.map_picture import bar_length_m, map_picture

FIELD = ground(
    (0.0, 0.0), (900.0, 500.0), edge_m=square(-100.0, -100.0, 1200.0),
    no_fly_m=[square(300.0, 300.0, 100.0)],
)  # fmt: skip


def test_the_same_cells_give_the_same_bytes_and_others_give_others() -> None:
    grid = proposed(FIELD).grid
    picture = map_picture(grid, 'a field')
    assert picture == map_picture(grid, 'a field')
    assert picture != map_picture(proposed(FIELD, cell_size_m=100.0).grid, 'a field')


def test_names_that_the_font_does_not_have_are_no_matter() -> None:
    named = replace(FIELD, sensor_ids=('観測点 1', 'محطة'))
    assert map_picture(proposed(named).grid, 'a field').startswith(b'\x89PNG')


@pytest.mark.parametrize('places', [[(0.0, 0.0)], [(0.0, 0.0), (9000.0, 0.0)]])
def test_a_map_is_at_least_as_tall_as_what_stands_beside_it(
    places: list[tuple[float, float]],
) -> None:
    seen = imread(BytesIO(map_picture(proposed(ground(*places)).grid, '$not maths$')))
    height, width = seen.shape[:2]
    assert height > 450
    assert width > 450
    assert np.ptp(seen[..., :3]) == 1.0  # black on white


@pytest.mark.parametrize(
    ('most_m', 'bar_m'), [(999.0, 500.0), (1000.0, 1000.0), (260.0, 200.0), (14.0, 10.0)]
)
def test_a_scale_bar_has_a_round_length(most_m: float, bar_m: float) -> None:
    assert bar_length_m(most_m) == bar_m

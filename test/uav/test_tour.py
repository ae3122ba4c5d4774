"""The sweep's tour and HERT's order of the cells: all are served, by short ways, in any area."""

from collections.abc import Callable
from itertools import pairwise

import pytest
from uav_collect.uav.open_ways import OpenCells
from uav_collect.uav.tour import Area, NOWHERE, order_of, Tour, tour_of, TourKind


def area(
    n_rows: int,
    n_columns: int,
    is_closed: Callable[[int, int], bool] = lambda _row, _column: False,
    is_needed: Callable[[int, int], bool] = lambda _row, _column: True,
    data_share: float = 0.0,
    first: int = 0,
) -> Area:
    places = [divmod(cell, n_columns) for cell in range(n_rows * n_columns)]
    is_open = tuple(int(not is_closed(*place)) for place in places)
    return Area(
        n_rows=n_rows,
        n_columns=n_columns,
        is_open=is_open,
        is_needed=tuple(is_open[cell] * is_needed(*at) for cell, at in enumerate(places)),
        data_share=data_share,
        first=first,
        is_right=False,
        is_low=True,
    )


def is_in_the_corner_or_the_hole(row: int, column: int) -> bool:
    return (row >= 10 and column >= 10) or (4 <= row < 7 and 4 <= column < 7)


# . an open cell, # a closed one: an L of 20 x 20 cells with a hole of 3 x 3.
L_SHAPED = area(20, 20, is_in_the_corner_or_the_hole)
PIPELINE = area(
    51, 51, is_needed=lambda row, column: row == 24 + column % 2, data_share=1.0, first=25 * 51
)
SCATTERED = area(
    30, 24, is_in_the_corner_or_the_hole, lambda row, column: (7 * row + 11 * column) % 5 == 0
)
# A cell that nobody comes to would see all four that need a visit.
WALLED_IN = area(
    5,
    5,
    lambda row, column: (row, column) in {(1, 2), (2, 1), (2, 3), (3, 2)},
    lambda row, column: row in (1, 3) and column in (1, 3),
)
AREAS = {
    'square': area(10, 10),
    'rectangle': area(7, 12),
    'corridor': area(1, 30),
    'L': L_SHAPED,
    'pipeline': PIPELINE,
    'scattered': SCATTERED,
    'scattered, with data': SCATTERED._replace(data_share=1.0),
    'walled in': WALLED_IN,
    'one cell': area(9, 9, is_needed=lambda row, column: row == column == 4),
}


def needed(of: Area) -> list[int]:
    return [cell for cell, is_needed in enumerate(of.is_needed) if is_needed]


def grid_of(of: Area) -> OpenCells:
    return OpenCells(of.n_rows, of.n_columns, of.is_open)


def length(of: Area, tour: Tour) -> int:
    """Moves along the tour, from the first UAV's start and back there."""
    grid, stops = grid_of(of), [of.first, *tour.stop, of.first]
    return sum(grid.moves(cell, following) for cell, following in pairwise(stops))


@pytest.mark.parametrize('of', AREAS.values(), ids=AREAS)
def test_the_order_has_each_cell_that_needs_a_visit_once(of: Area) -> None:
    assert sorted(order_of(of)) == needed(of)


@pytest.mark.parametrize(('n_rows', 'n_columns'), [(1, 1), (10, 10), (5, 8), (8, 5), (15, 15)])
def test_the_order_of_an_open_area_is_up_one_column_and_down_the_next(
    n_rows: int, n_columns: int
) -> None:
    upwards = range(n_rows)
    assert order_of(area(n_rows, n_columns)) == [
        row * n_columns + column
        for column in range(n_columns)
        for row in (upwards if column % 2 == 0 else reversed(upwards))
    ]


def test_the_order_goes_from_cell_to_neighbour_where_the_area_lets_it() -> None:
    grid, order = grid_of(L_SHAPED), order_of(L_SHAPED)
    steps = [grid.moves(cell, following) for cell, following in pairwise(order)]
    assert steps.count(1) >= len(steps) - 4  # it leaves what lies behind the hole for later
    assert sum(steps) < 1.1 * len(order)


@pytest.mark.parametrize('of', AREAS.values(), ids=AREAS)
def test_each_cell_that_needs_a_visit_has_a_place_and_no_other_has(of: Area) -> None:
    tour = tour_of(of)
    assert [cell for cell, place in enumerate(tour.place) if place != NOWHERE] == needed(of)
    assert max(tour.place) < len(tour.stop)


@pytest.mark.parametrize('of', AREAS.values(), ids=AREAS)
def test_a_tour_comes_to_each_cell_or_near_enough_to_see_it(of: Area) -> None:
    tour, grid = tour_of(of), grid_of(of)
    seen = {cell for stop in tour.stop for cell in grid.region(stop)}
    assert seen.issuperset(needed(of))
    if tour.kind == TourKind.CELLS:
        assert set(tour.stop).issuperset(needed(of))
        assert all(tour.stop[tour.place[cell]] == cell for cell in needed(of))
    else:
        seen_at = [grid.region(tour.stop[tour.place[cell]]) for cell in needed(of)]
        assert all(cell in near for cell, near in zip(needed(of), seen_at, strict=True))


@pytest.mark.parametrize('of', AREAS.values(), ids=AREAS)
def test_a_place_is_a_move_of_the_tour(of: Area) -> None:
    tour = tour_of(of)
    if tour.kind != TourKind.LANES:
        assert length(of, tour) - len(tour.stop) + 1 == sum(
            grid_of(of).moves(of.first, cell) for cell in (tour.stop[0], tour.stop[-1])
        )


def test_a_tour_along_a_pipeline_goes_out_on_one_side_and_back_on_the_other() -> None:
    tour = tour_of(PIPELINE)
    assert tour.kind == TourKind.CELLS
    assert length(PIPELINE, tour) == 102  # 50 columns there and back, and one row


def test_a_tour_that_only_sees_is_about_a_third_of_one_that_comes_to_all_cells() -> None:
    seeing = tour_of(L_SHAPED)
    coming = tour_of(L_SHAPED._replace(data_share=1.0))
    assert (seeing.kind, coming.kind) == (TourKind.LOOKOUTS, TourKind.CELLS)
    assert length(L_SHAPED, coming) <= 1.02 * len(needed(L_SHAPED))
    assert length(L_SHAPED, seeing) < 0.45 * len(needed(L_SHAPED))


def test_lanes_are_even_in_number_and_end_on_the_side_where_they_began() -> None:
    for n_rows, n_columns in ((10, 10), (8, 13), (3, 30), (20, 2)):
        tour = tour_of(area(n_rows, n_columns))
        assert tour.kind == TourKind.LANES
        assert len(tour.stop) % (2 * n_rows) == 0
        assert tour.stop[0] // n_columns == tour.stop[-1] // n_columns == 0


@pytest.mark.parametrize('data_share', [0.0, 1.0])
def test_cells_that_no_way_leads_to_are_on_no_tour(data_share: float) -> None:
    split = area(5, 9, lambda _row, column: column == 4, data_share=data_share)
    tour, reached = tour_of(split), [cell for cell in needed(split) if cell % 9 < 4]
    assert [cell for cell, place in enumerate(tour.place) if place != NOWHERE] == reached
    assert set(tour.stop) <= {*reached}
    assert max(cell % 9 for cell in order_of(split)) == 3

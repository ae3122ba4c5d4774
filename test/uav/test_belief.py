from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_world import tiny, uav
from uav_collect.kernels.arrays import new_row, row_of
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.belief import (
    Belief,
    belief_of,
    forget,
    hear,
    merge,
    NEVER,
    new_beliefs,
    observe,
)
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.view import LocalView

N_CELLS = 16
OUTSIDE = float('nan')

by_the_same_cases = settings(deadline=None, derandomize=True, database=None, max_examples=60)
maps = st.lists(st.integers(0, 1), min_size=N_CELLS, max_size=N_CELLS)

BRIEFING = brief(tiny(uav(5.0), uav(10.0), uav(5.0)))


def belief_with(complete: list[int] | None = None) -> Belief:
    belief = belief_of(new_beliefs(BRIEFING, 1), 0)
    if complete is not None:
        merge(belief, row_of(complete))
    return belief


def held(belief: Belief) -> list[int]:
    known = [int(belief.complete[cell]) for cell in range(N_CELLS)]
    assert belief.n_complete[0] == sum(known)
    return known


def view_at(briefing: Briefing, cell: int, region_bit: list[float]) -> LocalView:
    nothing, none = new_row(1, 0.0), new_row(1, 0)
    x_m, y_m = 25.0 + 50.0 * (cell % 4), 25.0 + 50.0 * (cell // 4)
    region = row_of(region_bit)
    return LocalView(0.0, x_m, y_m, cell, 1e6, NONE, region, 0, none, nothing, nothing, nothing)


@by_the_same_cases
@given(maps, maps)
def test_merging_is_commutative(first: list[int], second: list[int]) -> None:
    one, other = belief_with(first), belief_with(second)
    merge(one, row_of(second))
    merge(other, row_of(first))
    assert held(one) == held(other)


@by_the_same_cases
@given(maps, maps, maps)
def test_merging_is_associative(first: list[int], second: list[int], third: list[int]) -> None:
    left, inner, right = belief_with(first), belief_with(second), belief_with(first)
    merge(left, row_of(second))
    merge(left, row_of(third))
    merge(inner, row_of(third))
    merge(right, inner.complete)
    assert held(left) == held(right)


@by_the_same_cases
@given(maps, maps)
def test_merging_twice_is_merging_once(first: list[int], second: list[int]) -> None:
    belief = belief_with(first)
    merge(belief, row_of(second))
    once = held(belief)
    merge(belief, row_of(second))
    assert held(belief) == once
    merge(belief, belief.complete)
    assert held(belief) == once


@by_the_same_cases
@given(st.lists(maps, max_size=5))
def test_a_map_only_grows(heard: list[list[int]]) -> None:
    belief = belief_with()
    for complete in heard:
        before = held(belief)
        merge(belief, row_of(complete))
        after = held(belief)
        assert all(new >= old for new, old in zip(after, before, strict=True))
        assert all(new >= said for new, said in zip(after, complete, strict=True))


@by_the_same_cases
@given(maps, st.lists(st.sampled_from([0.0, 1e6]), min_size=9, max_size=9))
def test_what_is_seen_later_never_takes_a_cell_out_of_the_map(
    complete: list[int], region_bit: list[float]
) -> None:
    belief = belief_with(complete)
    observe(belief, BRIEFING, view_at(BRIEFING, 5, region_bit))
    assert all(new >= old for new, old in zip(held(belief), complete, strict=True))


def test_a_message_is_left_as_it_was() -> None:
    message = row_of([0] * 15 + [1])
    merge(belief_with([1] + [0] * 15), message)
    assert [int(message[cell]) for cell in range(N_CELLS)] == [0] * 15 + [1]


def test_at_first_nothing_is_known() -> None:
    belief = belief_with()
    assert held(belief) == [0] * N_CELLS
    assert [belief.peer_s[unit] for unit in range(3)] == [NEVER] * 3


def test_seen_cells_with_nothing_to_collect_are_complete() -> None:
    #   0 2 0        8  9 10
    #   0 0 1  Mbit  4  5  6  cells
    #   0 0 3        0  1  2
    belief = belief_with()
    region_bit = [0.0, 0.0, 3e6, 0.0, 0.0, 1e6, 0.0, 2e6, 0.0]
    observe(belief, BRIEFING, view_at(BRIEFING, 5, region_bit))
    assert [cell for cell in range(N_CELLS) if belief.complete[cell]] == [0, 1, 4, 5, 8, 10]
    assert belief.n_complete[0] == 6
    assert (belief.seen_bit[2], belief.seen_bit[6], belief.seen_bit[9]) == (3e6, 1e6, 2e6)


def test_what_lies_outside_the_area_is_not_known() -> None:
    belief = belief_with()
    region_bit = [OUTSIDE, OUTSIDE, OUTSIDE, OUTSIDE, 1e6, 0.0, OUTSIDE, 0.0, 0.0]
    observe(belief, BRIEFING, view_at(BRIEFING, 0, region_bit))
    assert [cell for cell in range(N_CELLS) if belief.complete[cell]] == [1, 4, 5]


def test_demand_is_remembered_as_seen_last() -> None:
    belief = belief_with()
    observe(belief, BRIEFING, view_at(BRIEFING, 5, [1e6] * 9))
    observe(belief, BRIEFING, view_at(BRIEFING, 6, [0.0] * 9))
    assert (belief.seen_bit[0], belief.seen_bit[4]) == (1e6, 1e6)
    assert (belief.seen_bit[1], belief.seen_bit[5]) == (0.0, 0.0)
    assert belief.n_complete[0] == 9


def test_hearing_merges_the_map_and_places_the_sender() -> None:
    belief = belief_with()
    hear(belief, 2, row_of([1, 1] + [0] * 14), 75.0, 125.0, 8.0)
    assert held(belief) == [1, 1] + [0] * 14
    assert (belief.peer_x_m[2], belief.peer_y_m[2], belief.peer_s[2]) == (75.0, 125.0, 8.0)
    assert belief.peer_s[1] == NEVER


def test_the_newest_position_wins_in_whatever_order_messages_come() -> None:
    for times_s in ([1.0, 2.0, 3.0], [3.0, 1.0, 2.0], [2.0, 3.0, 1.0]):
        belief = belief_with()
        for time_s in times_s:
            hear(belief, 1, row_of([0] * N_CELLS), 10.0 * time_s, 0.0, time_s)
        assert (belief.peer_x_m[1], belief.peer_s[1]) == (30.0, 3.0)


def test_an_old_message_still_brings_its_map() -> None:
    belief = belief_with()
    hear(belief, 1, row_of([0] * N_CELLS), 0.0, 0.0, 9.0)
    hear(belief, 1, row_of([1] * N_CELLS), 50.0, 50.0, 2.0)
    assert belief.n_complete[0] == N_CELLS
    assert belief.peer_s[1] == 9.0


def test_a_new_mission_starts_with_nothing_known() -> None:
    belief = belief_with([1] * N_CELLS)
    observe(belief, BRIEFING, view_at(BRIEFING, 5, [1e6] * 9))
    hear(belief, 1, row_of([1] * N_CELLS), 75.0, 125.0, 8.0)
    forget(belief, BRIEFING)
    fresh = belief_with()
    for row, fresh_row in zip(belief, fresh, strict=True):
        assert [*row] == [*fresh_row]


def test_the_beliefs_of_a_batch_do_not_touch_each_other() -> None:
    beliefs = new_beliefs(BRIEFING, 2)
    merge(belief_of(beliefs, 0), row_of([1] * N_CELLS))
    assert beliefs.n_complete[0][0] == N_CELLS
    assert held(belief_of(beliefs, 1)) == [0] * N_CELLS

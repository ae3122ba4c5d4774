"""Lines and rings at the 180th meridian: parts on either side that add up to the whole."""

from itertools import pairwise

import pytest
from uav_collect.handover.date_line import line_parts, Part, ring_parts

SQUARE = ((179.0, -1.0), (-179.0, -1.0), (-179.0, 1.0), (179.0, 1.0), (179.0, -1.0))


def area_deg2(ring: Part) -> float:
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring)) / 2


def test_what_crosses_nothing_is_one_part() -> None:
    line = ((1.0, 2.0), (3.0, 4.0))
    assert line_parts(line) == (line,)
    ring = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0))
    assert ring_parts(ring) == (ring,)


@pytest.mark.parametrize('is_back', [False, True])
def test_a_line_is_cut_where_it_crosses(is_back: bool) -> None:
    line = ((179.5, 10.0), (-179.5, 12.0))
    parts = (((179.5, 10.0), (180.0, 11.0)), ((-180.0, 11.0), (-179.5, 12.0)))
    if is_back:
        assert line_parts(line[::-1]) == tuple(part[::-1] for part in parts[::-1])
    else:
        assert line_parts(line) == parts


def test_a_line_up_to_the_meridian_is_one_part() -> None:
    line = ((179.5, 10.0), (180.0, 12.0))
    assert line_parts(line) == (line,)
    assert line_parts(((179.5, 10.0), (-180.0, 12.0))) == (line,)


def test_a_ring_is_cut_in_two_that_are_closed_and_go_round_as_it_does() -> None:
    west, east = ring_parts(SQUARE)
    assert {lon_deg for lon_deg, _ in west} == {179.0, 180.0}
    assert {lon_deg for lon_deg, _ in east} == {-180.0, -179.0}
    for part in (west, east):
        assert part[0] == part[-1]
        assert area_deg2(part) == pytest.approx(2.0)


def test_a_ring_that_begins_beyond_the_meridian_is_cut_alike() -> None:
    turned = (*SQUARE[1:], SQUARE[1])
    assert {frozenset(part) for part in ring_parts(turned)} == {
        frozenset(part) for part in ring_parts(SQUARE)
    }

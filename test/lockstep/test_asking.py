"""How often a world is asked, and what is said when it does not answer."""

import pytest
from uav_collect.lockstep.asking import Asking, PATIENCE_S

PLACE = 'ROS domain 0'
THERE = f' in {PLACE}: is one started there, with the same key (UAV_COLLECT_KEY_FILE)?'
TIMES_S = [step / 20 for step in range(200)]


def n_asked(asking: Asking, world: str) -> int:
    return sum(asking.asks(world, now_s) for now_s in TIMES_S)


def test_a_world_is_asked_once_and_another_one_too() -> None:
    asking = Asking(is_repeatable=False, begun_s=0.0, place=PLACE)
    assert [n_asked(asking, world) for world in ('', 'a', 'a', 'b')] == [0, 1, 0, 1]


def test_what_may_be_asked_again_is_asked_again_but_not_at_once() -> None:
    asking = Asking(is_repeatable=True, begun_s=0.0, place=PLACE)
    assert n_asked(asking, 'a') == 5  # every two of ten seconds


def test_an_answer_that_is_refused_is_no_reason_to_ask_at_once() -> None:
    asking = Asking(is_repeatable=True, begun_s=0.0, place=PLACE)
    assert asking.asks('a', 0.0)
    asking.refusal = 'it has no seal'
    assert not asking.asks('a', 0.05)


@pytest.mark.parametrize(
    ('world', 'refusal', 'complaint'),
    [
        ('', '', f'no world was found within 10 s{THERE}'),
        ('a', '', 'a world was asked and has not answered within 10 s; it may have done it'),
        ('a', 'it has no seal', 'no answer counts, the latest one is refused: it has no seal'),
    ],
)
def test_in_the_end_it_is_said_what_was_missing(world: str, refusal: str, complaint: str) -> None:
    asking = Asking(is_repeatable=False, begun_s=1.0, place=PLACE)
    asking.asks(world, 1.0)
    asking.refusal = refusal
    assert asking.complaint(1.0 + PATIENCE_S) is None
    assert asking.complaint(1.1 + PATIENCE_S) == complaint


def test_patience_may_be_longer() -> None:
    asking = Asking(is_repeatable=False, begun_s=1.0, place=PLACE, patience_s=300.0)
    assert asking.complaint(301.0) is None
    assert asking.complaint(301.1) == f'no world was found within 300 s{THERE}'

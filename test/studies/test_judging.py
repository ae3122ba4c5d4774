"""Statements are judged by paired values and intervals."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from uav_collect.studies.claims import judging
from uav_collect.studies.claims.judging import ClaimStatus, Samples


def missions(*values: float) -> Samples:
    return Samples(value=np.array(values), noun='mission')


def seeds(*values: float) -> Samples:
    return Samples(value=np.array(values), noun='seed')


def test_a_paired_difference_decides_where_the_means_alone_could_not() -> None:
    low = np.array([1.0, 5.0, 9.0, 2.0, 7.0, 3.0])
    above = judging.is_above('it', 's', missions(*(low + 0.1)), missions(*low))
    assert (above.status, above.n) == (ClaimStatus.HOLDS, 6)
    assert above.estimate is not None
    assert above.estimate.mean == pytest.approx(0.1)


def test_what_differs_by_rounding_alone_decides_nothing() -> None:
    whole = missions(*[100.0] * 6)
    above = judging.is_above('data', '%', whole, missions(*[100.0 - 1.4e-14] * 6))
    assert above.status is ClaimStatus.OPEN
    assert above.estimate is not None
    assert (above.estimate.low, above.estimate.high) == (0.0, 0.0)


def test_a_difference_of_the_other_sign_does_not_hold() -> None:
    assert judging.is_above('it', 's', missions(1, 2), missions(2, 3)).status is ClaimStatus.FAILS


def test_a_difference_whose_interval_has_both_signs_is_open() -> None:
    evidence = judging.is_above('it', 's', missions(1, 2, 3), missions(3, 2, 1))
    assert evidence.status is ClaimStatus.OPEN


@pytest.mark.parametrize(('n_seeds', 'status'), [(5, ClaimStatus.OPEN), (6, ClaimStatus.HOLDS)])
def test_few_seeds_decide_nothing(n_seeds: int, status: ClaimStatus) -> None:
    high, low = seeds(*range(1, n_seeds + 1)), seeds(*range(n_seeds))
    assert judging.is_above('it', '1', high, low).status is status


def test_what_is_not_known_is_left_out_in_pairs() -> None:
    evidence = judging.is_above('it', 's', missions(2, np.nan, 4), missions(1, 1, np.nan))
    assert evidence.n == 1


@pytest.mark.parametrize(
    ('low', 'high', 'status'),
    [(0.0, 5.0, ClaimStatus.HOLDS), (5.0, 9.0, ClaimStatus.FAILS), (2.0, 9.0, ClaimStatus.OPEN)],
)
def test_a_mean_lies_in_a_span_with_its_whole_interval(
    low: float, high: float, status: ClaimStatus
) -> None:
    assert judging.is_within('it', '%', missions(1, 2, 3), low, high).status is status


def test_a_change_in_per_cent_is_the_ratio_of_the_means() -> None:
    changed = judging.changed_percent(missions(1, 2, 6), missions(4, 4, 4))
    assert changed.value.mean() == pytest.approx(100.0 * (3.0 / 4.0 - 1.0))


def test_a_ratio_that_is_the_same_in_every_mission_has_no_spread() -> None:
    changed = judging.changed_percent(missions(1, 2, 3), missions(2, 4, 6))
    assert changed.value == pytest.approx([-50.0] * 3)


@pytest.mark.parametrize(
    ('statuses', 'status'),
    [
        ((), ClaimStatus.NOT_RUN),
        ((ClaimStatus.HOLDS, ClaimStatus.HOLDS), ClaimStatus.HOLDS),
        ((ClaimStatus.HOLDS, ClaimStatus.OPEN), ClaimStatus.OPEN),
        ((ClaimStatus.OPEN, ClaimStatus.FAILS, ClaimStatus.HOLDS), ClaimStatus.FAILS),
    ],
)
def test_a_statement_holds_if_all_its_parts_do(
    statuses: Sequence[ClaimStatus], status: ClaimStatus
) -> None:
    part = judging.is_above('it', 's', missions(1, 2), missions(0, 1))
    assert judging.combined_status([replace(part, status=it) for it in statuses]) is status

"""Statements are judged by what is paired, by resampled trainings and missions, and by margins."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from uav_collect.studies.claims import judging
from uav_collect.studies.claims.judging import ClaimStatus, Evidence, Samples
from uav_collect.studies.study import TrainedPolicies


def missions(*values: float) -> Samples:
    """Of a rule."""
    return Samples(value=np.array([values]))


def trained(*rows: Sequence[float], name: str = 'a') -> Samples:
    """Of a policy of each training."""
    names = tuple(f'{name}{number}' for number in range(len(rows)))
    return Samples(value=np.array(rows, dtype=np.float64), trainings=names)


def within(samples: Samples, low: float, high: float) -> Evidence:
    return judging.is_within('it', '%', judging.mean_of, samples, low=low, high=high)


def test_a_paired_difference_decides_where_the_means_alone_could_not() -> None:
    low = np.array([1.0, 5.0, 9.0, 2.0, 7.0, 3.0])
    above = judging.is_above('it', 's', missions(*(low + 0.1)), missions(*low))
    assert (above.status, above.n_missions, above.n_trainings) == (ClaimStatus.HOLDS, 6, 0)
    assert above.estimate is not None
    assert above.estimate.mean == pytest.approx(0.1)
    assert above.margin_percent == pytest.approx(100.0 * 0.1 / 4.6)


def test_what_differs_by_rounding_alone_is_a_tie() -> None:
    whole = missions(*[100.0] * 6)
    above = judging.is_above('data', '%', whole, missions(*[100.0 - 1.4e-14] * 6))
    assert above.status is ClaimStatus.TIE
    assert above.estimate is not None
    assert (above.estimate.low, above.estimate.high) == (0.0, 0.0)


def test_a_difference_within_two_per_cent_either_way_is_a_tie_and_a_wider_one_is_open() -> None:
    even, odd = [100.0, 101.0] * 50, [101.0, 100.0] * 50
    assert judging.is_above('it', 's', missions(*even), missions(*odd)).status is ClaimStatus.TIE
    wide = judging.is_above('it', 's', missions(1, 2, 3), missions(3, 2, 1))
    assert wide.status is ClaimStatus.OPEN


def test_a_difference_of_the_other_sign_does_not_hold() -> None:
    high, low = missions(1, 2, 3), missions(2, 3, 4)
    assert judging.is_above('it', 's', high, low).status is ClaimStatus.FAILS


def test_one_lucky_training_decides_nothing() -> None:
    rival = trained(*[[1.0, 1.1]] * 4, name='b')
    lucky = trained([1.0, 1.1], [1.0, 1.1], [1.0, 1.1], [3.0, 3.1])
    assert judging.is_above('it', 's', lucky, rival).status is ClaimStatus.OPEN
    better = trained(*[[1.2, 1.3]] * 4)
    assert judging.is_above('it', 's', better, rival).status is ClaimStatus.HOLDS


@pytest.mark.parametrize(('n_trainings', 'status'), [(2, 'OPEN'), (3, 'HOLDS')])
def test_few_trainings_decide_nothing(n_trainings: int, status: str) -> None:
    high = trained(*[[it + 9.0] for it in range(n_trainings)])
    low = trained(*[[it] for it in range(n_trainings)], name='b')
    evidence = judging.is_above('it', '1', high, low)
    assert evidence.status is ClaimStatus[status]
    assert evidence.count == f'{n_trainings} trainings'


def varies_more(high: Sequence[float], low: Sequence[float]) -> Evidence:
    samples = (
        replace(trained(*[[it] for it in values], name=name), is_spread=True)
        for values, name in ((high, 'a'), (low, 'b'))
    )
    return judging.is_positive('it', '1', lambda one, other: one - other, *samples)


def test_how_far_three_trainings_lie_apart_can_be_decided() -> None:
    near, far = (5.0, 5.1, 5.3), (1.0, 6.0, 9.0)
    evidence = varies_more(far, near)
    assert evidence.status is ClaimStatus.HOLDS
    assert evidence.estimate is not None
    assert evidence.estimate.mean == pytest.approx(np.std(far, ddof=1) - np.std(near, ddof=1))
    assert varies_more(near, far).status is ClaimStatus.FAILS
    assert varies_more(far, (2.0, 5.0, 8.5)).status is ClaimStatus.OPEN


def test_of_one_training_nobody_knows_how_far_it_would_lie_from_others() -> None:
    evidence = varies_more((1.0,), (1.0, 2.0, 3.0))
    assert (evidence.status, evidence.estimate) == (ClaimStatus.OPEN, None)


def test_trainings_that_serve_both_sides_are_drawn_once_for_both() -> None:
    before = trained([1.0, 2.0], [9.0, 10.0], [20.0, 21.0])
    after = replace(before, value=before.value + 0.5)
    assert judging.is_above('it', 's', after, before).status is ClaimStatus.HOLDS


def test_a_thing_beside_itself_is_not_judged() -> None:
    it = replace(missions(1, 2, 3), source=('completion_s', 'job'))
    assert judging.is_above('it', 's', it, it).status is ClaimStatus.SAME
    change = judging.is_within('it', '%', judging.change_percent, it, it, low=-2.0, high=2.0)
    assert change.status is ClaimStatus.SAME


def test_what_is_not_known_is_left_out_in_pairs() -> None:
    evidence = judging.is_above('it', 's', missions(2, np.nan, 4), missions(1, 1, np.nan))
    assert evidence.n_missions == 1


def test_what_is_not_known_changes_no_margin_and_no_tie() -> None:
    even, odd = [100.0, 101.0] * 50, [101.0, 100.0] * 50
    whole = judging.is_above('it', 's', missions(*even), missions(*odd))
    less = judging.is_above('it', 's', missions(*even, np.nan), missions(*odd, 1.0))
    assert whole.status is ClaimStatus.TIE
    assert less == whole


def test_ranks_are_of_missions_that_all_finish_and_who_finishes_none_is_the_slowest() -> None:
    samples = {
        'AQMIX': trained([3.0, 1.0], [2.0, np.nan]),
        'QMIX': trained([1.0, 9.0], [np.nan, np.nan]),
    }
    assert judging.ranked(samples).value[:, 0].tolist() == [2.0, 1.0, 0.0, 3.0]


def test_a_training_that_failed_leaves_a_statement_of_learning_open() -> None:
    def of(label: str, *values: float) -> Samples:
        digests = tuple(f'{label}{number}' for number in range(len(values)))
        trained = TrainedPolicies(label=label, algorithm=label.lower(), digests=digests)
        return judging.by_training(trained, np.array(values), 'reward')

    low = of('QMIX', 1.0, 1.1, 1.2)
    assert judging.is_above('it', '1', of('AQMIX', 2.0, 2.1, 2.2), low).status is ClaimStatus.HOLDS
    failed = judging.is_above('it', '1', of('AQMIX', 2.0, 2.1, np.nan), low)
    assert (failed.status, failed.estimate) == (ClaimStatus.OPEN, None)


@pytest.mark.parametrize(
    ('low', 'high', 'status', 'margin'),
    [
        (0.0, 5.0, ClaimStatus.HOLDS, 2.0),
        (5.0, 9.0, ClaimStatus.FAILS, -3.0),
        (1.9, 9.0, ClaimStatus.OPEN, 0.1),
    ],
)
def test_a_mean_lies_in_a_span_with_its_whole_interval_and_says_how_near_it_was(
    low: float, high: float, status: ClaimStatus, margin: float
) -> None:
    evidence = within(missions(1, 2, 3), low, high)
    assert evidence.status is status
    assert evidence.margin_percent == pytest.approx(margin)


@pytest.mark.parametrize(('value', 'status'), [(100.0, 'HOLDS'), (99.0, 'FAILS')])
def test_a_share_is_held_against_the_end_at_which_the_statement_turns_alone(
    value: float, status: str
) -> None:
    # The means of what is drawn are 100 but for rounding: 99.99999999999996 to 100.00000000000009.
    samples = trained(*[[value] * 300] * 6)
    evidence = judging.is_within('it', '%', judging.mean_of, samples, low=99.9)
    assert (evidence.what, evidence.status) == ('it (at least 99.9)', ClaimStatus[status])
    assert evidence.margin_percent == pytest.approx(value - 99.9)
    below = judging.is_within('it', '%', judging.mean_of, samples, high=99.9)
    assert below.what == 'it (at most 99.9)'
    assert {evidence.status, below.status} == {ClaimStatus.HOLDS, ClaimStatus.FAILS}


def test_a_ratio_that_is_the_same_in_every_mission_has_no_spread() -> None:
    two = missions(1, 2, 3), missions(2, 4, 6)
    change = judging.is_within('it', '%', judging.change_percent, *two, low=-51.0, high=-49.0)
    assert change.status is ClaimStatus.HOLDS
    assert change.estimate is not None
    assert change.estimate.high - change.estimate.low == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ('statuses', 'status'),
    [
        ('', ClaimStatus.NOT_RUN),
        ('HOLDS HOLDS', ClaimStatus.HOLDS),
        ('HOLDS SAME', ClaimStatus.HOLDS),
        ('SAME', ClaimStatus.SAME),
        ('HOLDS TIE', ClaimStatus.TIE),
        ('TIE OPEN', ClaimStatus.OPEN),
        ('OPEN FAILS HOLDS TIE', ClaimStatus.FAILS),
    ],
)
def test_a_statement_holds_if_all_its_parts_do(statuses: str, status: ClaimStatus) -> None:
    part = within(missions(1, 2), 0.0, 5.0)
    part = replace(part, n_least=9, errors_beside=9.0)
    parts = [replace(part, status=ClaimStatus[it]) for it in statuses.split()]
    assert judging.combined_status(parts) is status


def test_the_number_that_decides_is_the_nearest_of_those_with_the_verdict() -> None:
    far, near, other = (within(missions(1, 2, 3), low, 9.0) for low in (0.0, 0.5, 5.0))
    assert judging.deciding([far, near]) is near
    assert judging.deciding([far, near, other]) is other


def test_one_of_many_numbers_that_fails_by_chance_leaves_a_statement_open() -> None:
    def number(status: ClaimStatus, errors_beside: float = 0.0) -> Evidence:
        part = within(missions(1, 2, 3), 0.0, 9.0)
        return replace(part, status=status, n_least=6, errors_beside=errors_beside)

    # Student's t of five: 2.57 at 95 %, 4.77 at 99.5 %.
    beside = number(ClaimStatus.FAILS, 3.0)
    held = [number(ClaimStatus.HOLDS)] * 9
    assert judging.combined_status([beside]) is ClaimStatus.FAILS
    assert judging.combined_status([beside, *held]) is ClaimStatus.OPEN
    assert judging.deciding([*held, beside]) == beside
    assert judging.combined_status([number(ClaimStatus.FAILS, 5.0), *held]) is ClaimStatus.FAILS


def test_a_number_says_by_how_many_errors_it_lies_beside() -> None:
    low, high = missions(1, 2, 3, 4), missions(2, 3, 4, 8)
    difference = np.array([1.0, 1.0, 1.0, 4.0])
    error = difference.std(ddof=1) / 2.0
    above = judging.is_above('it', 's', low, high)
    assert above.errors_beside == pytest.approx(1.75 / error, rel=0.1)
    assert above.n_least == 4
    inside = within(missions(1, 2, 3), 0.0, 9.0)
    assert inside.errors_beside < 0.0
    assert within(missions(4, 4, 4), 5.0, 9.0).errors_beside == np.inf

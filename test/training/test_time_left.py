"""An estimate of the time left is one, or is not given."""

from collections.abc import Iterable

from hypothesis import given
from hypothesis import strategies as st
import pytest
from uav_collect.training.time_left import minutes_text, TimeLeft


def estimates(progress: Iterable[tuple[float, float]]) -> list[float | None]:
    left = TimeLeft()
    return [left.after(share_done, now_s) for now_s, share_done in progress]


def steadily(first_s: int, last_s: int, share_per_s: float) -> list[tuple[float, float]]:
    return [(float(now_s), (now_s - first_s) * share_per_s) for now_s in range(first_s, last_s)]


def test_nothing_is_said_within_the_first_ten_seconds() -> None:
    assert estimates(steadily(0, 10, 0.01)) == [None] * 10


def test_steady_progress_gives_what_is_left_at_its_speed() -> None:
    assert estimates(steadily(0, 41, 0.01))[-1] == pytest.approx(60.0)


def test_the_time_before_the_first_progress_does_not_count() -> None:
    compiling = [(float(now_s), 0.0) for now_s in range(100)]
    assert estimates([*compiling, *steadily(100, 141, 0.01)])[-1] == pytest.approx(60.0, rel=0.05)


def test_a_speed_that_changes_gives_no_estimate_until_it_is_steady_again() -> None:
    quick = steadily(0, 20, 0.02)
    slow = [(20.0 + second, 0.38 + 0.001 * second) for second in range(1, 60)]
    said = estimates([*quick, *slow])
    assert said[22:28] == [None] * 6
    assert said[-1] == pytest.approx((1.0 - slow[-1][1]) / 0.001, rel=0.01)


def test_what_stands_still_gives_no_estimate() -> None:
    assert estimates([*steadily(0, 30, 0.01), (60.0, 0.3), (90.0, 0.3)])[-1] is None


def test_two_large_steps_are_no_speed() -> None:
    assert estimates([(0.0, 0.0), (30.0, 0.3), (60.0, 0.6)]) == [None] * 3


@given(
    st.lists(st.floats(0.2, 5.0), min_size=5, max_size=200),
    st.floats(1e-5, 2e-3),
    st.floats(0.0, 900.0),
)
def test_no_estimate_is_wildly_wrong_while_the_speed_stays(
    pauses_s: list[float], share_per_s: float, compiled_s: float
) -> None:
    now_s, progress = compiled_s, [(0.0, 0.0), (compiled_s, 0.0)]
    for pause_s in pauses_s:
        now_s += pause_s
        progress.append((now_s, min(0.999, (now_s - compiled_s) * share_per_s)))
    for (_, share_done), left_s in zip(progress, estimates(progress), strict=True):
        if left_s is not None and share_done < 0.999:
            assert 0.5 <= left_s / ((1.0 - share_done) / share_per_s) <= 2.0


def test_long_times_are_in_hours() -> None:
    assert [*map(minutes_text, (47.2, 754.0, 7260.0))] == ['0:47 min', '12:34 min', '2:01 h']

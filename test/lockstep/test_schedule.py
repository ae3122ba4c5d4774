"""Which mission comes next, and at what pace."""

import pytest
from uav_collect.limits import MAX_SEED
from uav_collect.lockstep.schedule import Pace, Schedule


def test_missions_in_a_row_count_their_seeds_up_and_end() -> None:
    schedule = Schedule(n_missions=3, next_seed=5)
    seeds = []
    while not schedule.is_over:
        seeds.append(schedule.begin())
        schedule.go_on(seeds[-1])
    assert seeds == [5, 6, 7]
    assert schedule.next_seed is None


def test_on_request_a_world_never_ends() -> None:
    schedule = Schedule(n_missions=0, next_seed=None)
    assert schedule.ask_for(9, is_flying=False)[0]
    assert schedule.begin() == 9
    schedule.go_on(9)
    assert schedule.next_seed is None
    assert not schedule.is_over


def test_one_mission_at_a_time() -> None:
    schedule = Schedule(n_missions=0, next_seed=None)
    assert not schedule.ask_for(1, is_flying=True)[0]
    assert schedule.ask_for(1, is_flying=False)[0]
    assert not schedule.ask_for(2, is_flying=False)[0]
    assert schedule.next_seed == 1


@pytest.mark.parametrize(('seed', 'fits'), [(0, True), (MAX_SEED, True), (MAX_SEED + 1, False)])
def test_a_seed_on_request_stays_within_bounds(seed: int, fits: bool) -> None:
    assert Schedule(n_missions=0, next_seed=None).ask_for(seed, is_flying=False)[0] is fits


def test_there_is_something_to_abort_in_flight_or_just_before() -> None:
    schedule = Schedule(n_missions=0, next_seed=None)
    assert not schedule.call_off(is_flying=False)[0]
    assert schedule.call_off(is_flying=True)[0]
    schedule.ask_for(1, is_flying=False)
    assert schedule.call_off(is_flying=False)[0]
    assert schedule.next_seed is None


# Pace


def test_simulated_time_passes_so_many_times_as_fast() -> None:
    now_s = [100.0]
    pace = Pace(4.0, lambda: now_s[0])
    pace.begin()
    assert pace.is_due(0.0)
    now_s[0] = 102.5
    assert pace.time_s == 10.0
    assert pace.is_due(10.0)
    assert not pace.is_due(10.1)


def test_without_a_pace_everything_is_due() -> None:
    pace = Pace(0.0, lambda: 0.0)
    pace.begin()
    assert pace.is_free
    assert pace.is_due(1e9)

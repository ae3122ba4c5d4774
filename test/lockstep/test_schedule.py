"""Which mission comes next, and at what pace."""

import pytest
from uav_collect.limits import MAX_SEED
from uav_collect.lockstep.schedule import MissionSchedule, SimulationPacer


def test_missions_in_a_row_count_their_seeds_up_and_end() -> None:
    schedule = MissionSchedule(n_missions=3, next_seed=5)
    seeds = []
    while not schedule.is_over:
        seeds.append(schedule.start_next())
        schedule.plan_after(seeds[-1])
    assert seeds == [5, 6, 7]
    assert schedule.next_seed is None


def test_on_request_a_world_never_ends() -> None:
    schedule = MissionSchedule(n_missions=0, next_seed=None)
    assert schedule.request(9, is_flying=False)[0]
    assert schedule.start_next() == 9
    schedule.plan_after(9)
    assert schedule.next_seed is None
    assert not schedule.is_over


def test_one_mission_at_a_time() -> None:
    schedule = MissionSchedule(n_missions=0, next_seed=None)
    assert not schedule.request(1, is_flying=True)[0]
    assert schedule.request(1, is_flying=False)[0]
    assert not schedule.request(2, is_flying=False)[0]
    assert schedule.next_seed == 1


@pytest.mark.parametrize(('seed', 'fits'), [(0, True), (MAX_SEED, True), (MAX_SEED + 1, False)])
def test_a_seed_on_request_stays_within_bounds(seed: int, fits: bool) -> None:
    assert MissionSchedule(n_missions=0, next_seed=None).request(seed, is_flying=False)[0] is fits


def test_there_is_something_to_abort_in_flight_or_just_before() -> None:
    schedule = MissionSchedule(n_missions=0, next_seed=None)
    assert not schedule.cancel(is_flying=False)[0]
    assert schedule.cancel(is_flying=True)[0]
    schedule.request(1, is_flying=False)
    assert schedule.cancel(is_flying=False)[0]
    assert schedule.next_seed is None


# SimulationPacer


def test_simulated_time_passes_so_many_times_as_fast() -> None:
    now_s = [100.0]
    pacer = SimulationPacer(4.0, lambda: now_s[0])
    pacer.restart()
    assert pacer.is_due(0.0)
    now_s[0] = 102.5
    assert pacer.time_s == 10.0
    assert pacer.is_due(10.0)
    assert not pacer.is_due(10.1)


def test_without_a_pace_everything_is_due() -> None:
    pacer = SimulationPacer(0.0, lambda: 0.0)
    pacer.restart()
    assert pacer.is_unlimited
    assert pacer.is_due(1e9)

"""Which mission comes next, and at what pace."""

import pytest
from uav_collect.limits import MAX_SEED
from uav_collect.lockstep.schedule import ClockRate, MissionSchedule, SimulationPacer


def test_missions_in_a_row_count_their_seeds_up_and_end() -> None:
    schedule = MissionSchedule(n_missions=3, next_seed=5)
    seeds = []
    while not schedule.is_over:
        seeds.append(schedule.start_next())
        schedule.plan_after(seeds[-1])
    assert seeds == [5, 6, 7]
    assert schedule.next_seed is None


@pytest.mark.parametrize('n_missions', [-1, 9])
def test_missions_in_a_row_end_with_the_last_seed_of_all(n_missions: int) -> None:
    schedule = MissionSchedule(n_missions=n_missions, next_seed=MAX_SEED - 1)
    seeds = []
    while not schedule.is_over:
        seeds.append(schedule.start_next())
        schedule.plan_after(seeds[-1])
    assert seeds == [MAX_SEED - 1, MAX_SEED]
    assert schedule.next_seed is None


def test_after_the_last_seed_of_all_others_are_flown_on_request() -> None:
    schedule = MissionSchedule(n_missions=0, next_seed=None)
    assert schedule.request(MAX_SEED, is_flying=False)[0]
    schedule.plan_after(schedule.start_next())
    assert not schedule.is_over
    assert schedule.request(0, is_flying=False)[0]


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


def test_in_a_row_none_is_planned_on_request_for_no_abort_would_help() -> None:
    schedule = MissionSchedule(n_missions=2, next_seed=5)
    in_a_row = (False, 'this world flies its missions in a row: start it with missions:=0')
    assert schedule.request(1, is_flying=False) == in_a_row
    schedule.start_next()
    assert schedule.request(1, is_flying=True) == in_a_row


def test_none_is_planned_as_the_world_ends() -> None:
    schedule = MissionSchedule(n_missions=0, next_seed=None, is_closed=True)
    assert schedule.request(1, is_flying=False) == (False, 'the world is being stopped')
    assert schedule.next_seed is None


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


def test_in_a_row_only_the_mission_in_flight_can_be_aborted() -> None:
    schedule = MissionSchedule(n_missions=-1, next_seed=5)
    assert schedule.cancel(is_flying=False) == (
        False,
        'no mission is in flight; the next one starts when the fleet is complete',
    )
    assert schedule.next_seed == 5
    schedule.start_next()
    assert schedule.cancel(is_flying=True)[0]
    schedule.plan_after(5)
    assert schedule.next_seed == 6


# SimulationPacer

FACTOR = 4.0


class Watch:
    """A clock that the test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def passed(pacer: SimulationPacer, watch: Watch, wall_s: float, event_s: float) -> float:
    """Simulated time after looking at the pacer every 5 ms for a while."""
    time_s = pacer.pass_until(event_s)
    for _ in range(round(wall_s / 0.005)):
        watch.now_s += 0.005
        time_s = pacer.pass_until(event_s)
    return time_s


def test_simulated_time_passes_so_many_times_as_fast() -> None:
    watch = Watch()
    pacer = SimulationPacer(FACTOR, watch)
    pacer.restart()
    assert pacer.is_due(0.0)
    assert passed(pacer, watch, 2.5, 1000.0) == pytest.approx(10.0)
    assert pacer.is_due(9.999)
    assert not pacer.is_due(10.1)


def test_time_does_not_pass_an_event_that_waits_for_its_decision() -> None:
    watch = Watch()
    pacer = SimulationPacer(FACTOR, watch)
    pacer.restart()
    assert passed(pacer, watch, 10.0, 7.0) == 7.0


@pytest.mark.parametrize('stalled', ['the world', 'an agent'])
def test_after_a_stall_time_slips_and_does_not_race(stalled: str) -> None:
    watch = Watch()
    pacer = SimulationPacer(FACTOR, watch)
    pacer.restart()
    before_s = passed(pacer, watch, 5.0, 20.0)
    if stalled == 'an agent':
        passed(pacer, watch, 15.0, 20.0)
    else:
        watch.now_s += 15.0
    after_s = passed(pacer, watch, 10.0, 1000.0)
    assert 1.0 <= (after_s - before_s) / (10.0 * FACTOR) <= 1.05


def test_short_waits_for_decisions_are_made_up_for() -> None:
    watch = Watch()
    pacer = SimulationPacer(FACTOR, watch)
    pacer.restart()
    event_s = 0.0
    for _ in range(100):  # each decision takes 10 ms of the 250 ms to the next event
        event_s += 1.0
        while not pacer.is_due(event_s):
            watch.now_s += 0.005
        watch.now_s += 0.01
    assert event_s / (watch.now_s - 100.0) == pytest.approx(FACTOR, rel=0.05)


def test_without_a_pace_everything_is_due() -> None:
    pacer = SimulationPacer(0.0, lambda: 0.0)
    pacer.restart()
    assert pacer.is_unlimited
    assert pacer.is_due(1e9)


def test_the_clock_is_published_at_most_fifty_times_per_second_of_simulated_time() -> None:
    rate = ClockRate(clock_s=lambda: 0.0)
    times_s = [number * 0.005 for number in range(401)]
    assert sum(rate.is_due(time_s, is_event=True) for time_s in times_s) <= 101


def test_the_clock_is_published_at_each_event_however_fast_they_come() -> None:
    rate = ClockRate(clock_s=lambda: 0.0)
    assert [rate.is_due(time_s, is_event=True) for time_s in (0.0, 0.5, 0.51, 0.53)] == [
        *(True, True, False, True)
    ]


def test_between_events_the_clock_is_published_at_most_fifty_times_per_second_of_wall_time() -> (
    None
):
    now_s = [0.0]
    rate = ClockRate(clock_s=lambda: now_s[0])
    published = []
    for tick in range(201):  # of 5 ms, at ten times the wall clock's pace
        now_s[0] = tick * 0.005
        published.append(rate.is_due(tick * 0.05, is_event=False))
    assert 40 <= published.count(True) <= 51


def test_a_pacer_that_is_held_lets_no_time_pass_and_makes_up_for_none() -> None:
    watch = Watch()
    pacer = SimulationPacer(FACTOR, watch)
    pacer.restart()
    before_s = passed(pacer, watch, 1.0, 1000.0)
    pacer.hold(True)
    assert passed(pacer, watch, 20.0, 1000.0) == before_s
    pacer.hold(False)
    assert passed(pacer, watch, 1.0, 1000.0) == pytest.approx(before_s + FACTOR)


def test_a_new_pace_counts_from_now_on() -> None:
    watch = Watch()
    pacer = SimulationPacer(FACTOR, watch)
    pacer.restart()
    before_s = passed(pacer, watch, 1.0, 1000.0)
    watch.now_s += 0.1
    pacer.change(10.0 * FACTOR)
    assert passed(pacer, watch, 1.0, 1000.0) == pytest.approx(before_s + 10.0 * FACTOR)


def test_a_pace_that_is_set_late_goes_on_where_the_mission_is() -> None:
    watch = Watch()
    pacer = SimulationPacer(0.0, watch)
    pacer.restart()
    assert pacer.is_due(500.0)
    watch.now_s += 30.0
    pacer.change(FACTOR)
    assert not pacer.is_due(500.0 + FACTOR)
    assert passed(pacer, watch, 1.0, 1000.0) == pytest.approx(500.0 + FACTOR)


def test_a_step_brings_the_time_of_its_event() -> None:
    watch = Watch()
    pacer = SimulationPacer(FACTOR, watch)
    pacer.restart()
    pacer.hold(True)
    pacer.skip_to(70.0)
    assert pacer.is_due(70.0)
    assert not pacer.is_due(70.1)

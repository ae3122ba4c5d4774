"""A mission waits until its recorders hear everything, but not for ever."""

from uav_collect.lockstep.recorders import (
    RecorderReport,
    RecorderWatch,
    SILENT_S,
    TakeOff,
    world_key,
)

WORLD = 'this world'
TIMEOUT_S = 10.0
AWAITED = ('/world/epoch', '/uav_1/observation', '/uav_1/command')
CLEAR = TakeOff(is_clear=True, unready=())


def watch(n_expected: int = 0, timeout_s: float = TIMEOUT_S) -> RecorderWatch:
    return RecorderWatch(WORLD, n_expected=n_expected, timeout_s=timeout_s)


def report(*waits_for: str, world: str = WORLD, recorder: str = 'one') -> RecorderReport:
    return RecorderReport(
        recorder=recorder,
        bag=f'bag_{recorder}',
        worlds=frozenset({world}),
        waits_for=frozenset(waits_for),
    )


def test_without_recorders_nothing_waits() -> None:
    assert watch().take_off(0.0, AWAITED) == CLEAR


def test_a_recorder_is_awaited_until_it_hears_everything() -> None:
    recorders = watch()
    recorders.add(report('/world/epoch', '/uav_1/command'), 0.0)
    answer = recorders.take_off(0.0, AWAITED)
    assert not answer.is_clear
    assert answer.unready == (
        'the recorder of bag_one, which does not hear /uav_1/command, /world/epoch',
    )
    recorders.add(report(), 0.1)
    assert recorders.take_off(0.1, AWAITED) == CLEAR


def test_of_many_topics_a_few_are_named() -> None:
    recorders = watch()
    topics = [f'/uav_{uav}/command' for uav in range(1, 10)]
    recorders.add(report(*topics), 0.0)
    (text,) = recorders.take_off(0.0, topics).unready
    assert text.endswith('/uav_1/command, /uav_2/command, /uav_3/command and 6 more')


def test_topics_that_nobody_publishes_are_not_awaited() -> None:
    recorders = watch()
    recorders.add(report('/uav_2/command'), 0.0)
    assert recorders.take_off(0.0, AWAITED) == CLEAR


def test_a_recorder_that_has_heard_of_another_world_alone_is_not_ready() -> None:
    recorders = watch()
    recorders.add(report(world='another'), 0.0)
    assert recorders.take_off(0.0, AWAITED).unready == (
        'the recorder of bag_one, which does not hear this world',
    )


def test_a_recorder_that_does_not_know_the_new_scenario_is_not_ready() -> None:
    recorders = watch()
    recorders.world = world_key('w', 'new')
    recorders.add(report(world=world_key('w', 'old')), 0.0)
    assert not recorders.take_off(0.0, AWAITED).is_clear
    recorders.add(report(world=world_key('w', 'new')), 0.1)
    assert recorders.take_off(0.1, AWAITED) == CLEAR


def test_after_a_while_a_mission_starts_without_and_the_next_one_does_not_wait_again() -> None:
    recorders = watch()
    recorders.add(report('/world/epoch'), 0.0)
    assert not recorders.take_off(0.0, AWAITED).is_clear
    recorders.add(report('/world/epoch'), TIMEOUT_S)
    assert not recorders.take_off(TIMEOUT_S, AWAITED).is_clear
    late = recorders.take_off(TIMEOUT_S + 0.1, AWAITED)
    assert late.is_clear
    assert late.unready
    recorders.add(report('/world/epoch'), TIMEOUT_S + 1.0)
    assert recorders.take_off(TIMEOUT_S + 1.0, AWAITED) == CLEAR
    recorders.add(report(), TIMEOUT_S + 2.0)
    assert recorders.take_off(TIMEOUT_S + 2.0, AWAITED) == CLEAR
    recorders.add(report('/world/epoch'), TIMEOUT_S + 3.0)  # it was ready since
    assert not recorders.take_off(TIMEOUT_S + 3.0, AWAITED).is_clear


def test_a_recorder_that_falls_silent_while_it_waits_is_gone() -> None:
    recorders = watch()
    recorders.add(report('/world/epoch'), 0.0)
    assert not recorders.take_off(SILENT_S, AWAITED).is_clear
    assert recorders.take_off(SILENT_S + 0.1, AWAITED) == CLEAR


def test_a_recorder_that_was_ready_and_falls_silent_is_awaited_again() -> None:
    recorders = watch(n_expected=1)
    recorders.add(report(), 0.0)
    assert recorders.take_off(SILENT_S, AWAITED) == CLEAR
    gone = recorders.take_off(SILENT_S + 0.1, AWAITED)
    assert (gone.is_clear, gone.unready) == (False, ('a recorder that is not there yet',))


def test_a_mission_that_did_not_take_off_takes_no_time_from_the_next() -> None:
    recorders = watch(n_expected=1)
    assert not recorders.take_off(0.0, AWAITED).is_clear
    recorders.rest()
    assert not recorders.take_off(TIMEOUT_S + 1.0, AWAITED).is_clear
    assert recorders.take_off(2 * TIMEOUT_S + 1.1, AWAITED).is_clear


def test_expected_recorders_are_awaited_before_they_are_heard_of() -> None:
    recorders = watch(n_expected=2)
    recorders.add(report(), 0.0)
    assert recorders.take_off(0.0, AWAITED).unready == ('a recorder that is not there yet',)
    recorders.add(report('/world/epoch', recorder='two'), 1.0)
    (text,) = recorders.take_off(1.0, AWAITED).unready
    assert text.startswith('the recorder of bag_two')
    recorders.add(report(recorder='two'), 2.0)
    assert recorders.take_off(2.0, AWAITED) == CLEAR


def test_expected_recorders_that_never_come_are_awaited_once() -> None:
    recorders = watch(n_expected=2)
    assert recorders.take_off(0.0, AWAITED).unready == ('2 recorders that are not there yet',)
    assert recorders.take_off(TIMEOUT_S + 0.1, AWAITED).is_clear
    assert recorders.take_off(TIMEOUT_S + 1.0, AWAITED) == CLEAR


def test_a_flood_of_recorders_is_forgotten() -> None:
    recorders = watch()
    for number in range(10_000):
        recorders.add(report('/world/epoch', recorder=str(number)), 0.0)
    assert len(recorders.take_off(0.0, AWAITED).unready) == 64
    assert recorders.take_off(TIMEOUT_S + 1.0, AWAITED).is_clear

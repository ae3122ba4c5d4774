"""What people ask of a world, and which events happen then."""

import pytest
from uav_collect.lockstep.schedule import MissionSchedule, SimulationPacer
from uav_collect.lockstep.steering import Steering

TIMEOUT_S, SHORTEST_S = 10.0, 0.1
LOOK_S = 0.005


def steering(n_missions: int = 0, factor: float = 0.0) -> Steering:
    schedule = MissionSchedule(n_missions=n_missions, next_seed=None)
    return Steering(schedule, SimulationPacer(factor, lambda: 0.0), TIMEOUT_S)


def wait(asked: Steering, duration_s: float) -> None:
    """Look at the clock often, as a world does, while an agent does not answer."""
    asked.look(0.0)
    asked.ask()
    for number in range(1, round(duration_s / LOOK_S) + 1):
        asked.look(number * LOOK_S)


def n_events(asked: Steering, at_most: int = 9) -> int:
    """How many events may happen now, one after the other."""
    return sum(asked.lets_pass(float(event)) for event in range(at_most))


def test_unpaused_everything_happens() -> None:
    assert n_events(steering()) == 9


def test_paused_nothing_happens_until_it_is_resumed() -> None:
    asked = steering()
    assert asked.pause(is_flying=True, awaited=None) == (True, 'paused')
    assert n_events(asked) == 0
    assert asked.resume(is_flying=True) == (True, 'the mission goes on')
    assert n_events(asked) == 9


@pytest.mark.parametrize('n_steps', [1, 3])
def test_each_step_is_one_event_whatever_the_pace(n_steps: int) -> None:
    asked = steering(factor=1.0)
    asked.pause(is_flying=True, awaited=None)
    for _ in range(n_steps):
        assert asked.step(is_flying=True, awaited=None) == (True, 'one event more')
    assert n_events(asked) == n_steps


@pytest.mark.parametrize('then', ['pause', 'abort', 'end'])
def test_steps_that_were_not_taken_are_forgotten(then: str) -> None:
    asked = steering()
    asked.pause(is_flying=True, awaited=None)
    asked.step(is_flying=True, awaited=None)
    if then == 'pause':
        asked.pause(is_flying=True, awaited=None)
    elif then == 'abort':
        asked.abort(is_flying=True)
    else:
        asked.begin()  # the next mission
    assert n_events(asked) == 0


def test_only_a_paused_mission_can_be_stepped() -> None:
    asked = steering()
    unpaused = (False, 'the world is not paused: pause it first')
    assert asked.step(is_flying=True, awaited=None) == unpaused
    asked.pause(is_flying=False, awaited=None)
    assert asked.step(is_flying=False, awaited=None) == (False, 'no mission is in flight')


def test_answers_name_the_uav_that_is_waited_for() -> None:
    asked = steering()
    assert 'UAV 2' in asked.pause(is_flying=True, awaited=2)[1]
    assert asked.step(is_flying=True, awaited=2) == (
        True,
        'one event more, when UAV 2 has answered',
    )


def test_a_pause_outlives_missions_and_answers_say_so() -> None:
    asked = steering()
    assert asked.pause(is_flying=False, awaited=None)[1].startswith('paused: the next mission')
    assert asked.start(3, is_flying=False)[1].endswith('the world is paused')
    assert asked.abort(is_flying=True)[1].endswith('the world stays paused')
    assert asked.is_paused
    assert asked.resume(is_flying=False) == (True, 'the next mission starts unpaused')
    assert asked.resume(is_flying=False) == (True, 'the world is not paused')


def test_while_paused_no_agent_is_late() -> None:
    asked = steering()
    wait(asked, TIMEOUT_S + 1.0)
    assert asked.is_overdue()
    asked.pause(is_flying=True, awaited=1)
    assert not asked.is_overdue()


def test_an_agent_that_is_asked_anew_has_its_whole_time() -> None:
    asked = steering()
    wait(asked, TIMEOUT_S + 1.0)
    asked.ask()
    assert not asked.is_overdue()


@pytest.mark.parametrize('still_s', [0.5 * SHORTEST_S, 2.0 * SHORTEST_S, 2.0 * TIMEOUT_S])
def test_what_the_world_itself_stood_still_counts_against_no_agent(still_s: float) -> None:
    asked = steering()
    asked.change_timeout(SHORTEST_S)
    wait(asked, 0.6 * SHORTEST_S)
    asked.look(0.6 * SHORTEST_S + still_s)
    asked.look(0.6 * SHORTEST_S + still_s + LOOK_S)
    assert not asked.is_overdue()


def test_an_answer_that_came_while_the_world_stood_still_is_heard_before_it_is_late() -> None:
    asked = steering()
    wait(asked, TIMEOUT_S)
    assert not asked.is_overdue()
    asked.look(2.0 * TIMEOUT_S)
    assert not asked.is_overdue()
    asked.look(2.0 * TIMEOUT_S + LOOK_S)
    assert asked.is_overdue()


def test_agents_get_as_long_as_was_said_last() -> None:
    asked = steering()
    asked.change_timeout(2.0 * TIMEOUT_S)
    wait(asked, TIMEOUT_S + 1.0)
    assert not asked.is_overdue()

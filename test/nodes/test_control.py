"""A world that is paused, stepped and paced while it flies: what happens, and what does not.

The test plays the one agent. Nothing happens: the world has had time for it, for its diagnostics
came twice, longer than the agent has to answer.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Fleet, logs, parameters, scenario_of
from processes import DEADLINE_S, Processes
from scripted_agent_node import scripted_agents, ScriptedAgents
from uav_collect.nodes import topics
from uav_collect_msgs.msg import Mission
from uav_collect_msgs.srv import ControlMission

pytestmark = pytest.mark.ros

SEED = 6
ASKED = ControlMission.Request


@pytest.fixture
def pilot(ros_domain: int) -> Iterator[ScriptedAgents]:
    with scripted_agents() as there:
        yield there


@pytest.fixture
def fleet(processes: Processes, tmp_path: Path) -> Fleet:
    return Fleet(processes=processes, scenario=scenario_of(1), folder=tmp_path / 'run')


def let_time_pass(pilot: ScriptedAgents) -> None:
    """Wait for two diagnostics: more than a second."""
    said = pilot.heard[topics.DIAGNOSTICS.name]
    n_before = len(said)
    pilot.wait_until(lambda: len(said) >= n_before + 2)


def answer_next(pilot: ScriptedAgents, decision: int) -> None:
    turn = pilot.next_turn()
    assert turn is not None
    assert turn.observation.decision == decision
    pilot.answer(turn)


def test_a_paused_world_does_what_it_is_asked_for_and_flies_the_same_mission(
    fleet: Fleet, pilot: ScriptedAgents
) -> None:
    world = fleet.start_world(missions=0, decision_timeout_s=0.5, real_time_factor=1000)
    epochs, missions = pilot.heard[topics.EPOCH.name], pilot.heard[topics.MISSION.name]
    clock = pilot.heard[topics.CLOCK.name]
    assert pilot.control(ASKED.STEP).message == 'the world is not paused: pause it first'
    assert pilot.control(ASKED.RESUME).message == 'the world is not paused'
    assert pilot.control(ASKED.PAUSE).message == 'paused: the next mission waits at its start'
    started = pilot.control(ASKED.START, SEED)
    assert started.success
    assert started.message.endswith('and waits at its start: the world is paused')
    pilot.join(1)
    observations = pilot.heard[topics.uav_topics(1).observation.name]

    # At its start it waits.
    pilot.wait_until(lambda: len(missions) == 1)
    let_time_pass(pilot)
    assert observations == epochs == []

    # A step asks one UAV, which has all the time in the world, and an answer is an event.
    assert pilot.control(ASKED.STEP).message == 'one event more'
    pilot.wait_until(lambda: len(observations) == 1)
    let_time_pass(pilot)
    assert pilot.control(ASKED.STEP).message == 'one event more, when UAV 1 has answered'
    answer_next(pilot, 0)
    answer_next(pilot, 1)
    pilot.wait_until(lambda: len(epochs) == 2)
    let_time_pass(pilot)
    del clock[:-1]
    let_time_pass(pilot)
    assert (len(observations), len(epochs), fleet.n_events(SEED)) == (2, 2, 2)
    assert len({(it.clock.sec, it.clock.nanosec) for it in clock}) <= 1  # some may be lost

    # Paused while an agent decides: its answer counts.
    pilot.steered.change('decision_timeout_s', DEADLINE_S)
    assert pilot.control(ASKED.RESUME).message == 'the mission goes on'
    turn = pilot.next_turn()
    assert turn is not None
    assert pilot.control(ASKED.PAUSE).message == (
        'paused; UAV 1, which was asked before, may still answer'
    )
    pilot.answer(turn)
    pilot.wait_until(lambda: len(epochs) == 3)
    assert len(observations) == 3

    # Aborted in a pause, the next one waits too; both logs are kept.
    assert pilot.control(ASKED.ABORT).message == 'the mission is aborted; the world stays paused'
    assert pilot.control(ASKED.STEP).message == 'no mission is in flight'
    pilot.wait_until(lambda: len(missions) == 2)
    assert pilot.control(ASKED.START, SEED).success
    pilot.wait_until(lambda: len(missions) == 3)
    assert pilot.control(ASKED.RESUME).success
    result = pilot.fly_on()
    assert (result.phase, result.failsafe_used) == (Mission.ENDED, False)
    assert world.is_running
    (whole,) = logs(fleet.scenario, [SEED])
    assert fleet.folder.joinpath(f'mission_{SEED}_1.jsonl').read_bytes() == whole
    assert fleet.log(SEED).splitlines() == whole.splitlines()[:4]


def test_pace_and_patience_change_in_flight(fleet: Fleet, pilot: ScriptedAgents) -> None:
    world = fleet.start_world(seed=SEED - 1, missions=2, real_time_factor=0.01)
    missions, steered = pilot.heard[topics.MISSION.name], pilot.steered
    pilot.join(1)
    answer_next(pilot, 0)
    in_a_row = 'this world flies its missions in a row: start it with missions:=0'
    assert pilot.control(ASKED.START, SEED).message == in_a_row
    assert pilot.control(ASKED.ABORT).success  # long before the next event
    pilot.wait_until(lambda: len(missions) == 3)
    assert fleet.n_events(SEED - 1) == missions[1].n_decisions
    answer_next(pilot, 0)
    assert steered.refusal_of('real_time_factor', -1) == (
        'real_time_factor is -1: must be a number from 0.0 to 1,000.0'
    )
    assert 'real_time_factor' in steered.refusal_of('real_time_factor', 2000.0)
    assert steered.refusal_of('decision_timeout_s', 'long').startswith("decision_timeout_s is 'l")
    assert 'read-only' in steered.refusal_of('seed', 3)
    assert steered.refusal_of('real_time_factor', 1000) == ''  # a whole number is one
    world.wait_for('real_time_factor is 1000 from now on')
    answer_next(pilot, 1)
    assert steered.refusal_of('real_time_factor', 0.0) == ''
    turn = pilot.next_turn()
    while turn is not None and turn.observation.decision < 5:
        pilot.answer(turn)
        turn = pilot.next_turn()
    assert steered.refusal_of('decision_timeout_s', 0.5) == ''
    late = 'no answer to decision 5 within 0.5 s; the failsafe flies it home'
    # To go on without a pause is no reason to wait for longer.
    pilot.wait_until(lambda: pilot.control(ASKED.RESUME).success and late in world.output)
    pilot.wait_until(lambda: len(missions) == 4)
    (whole,) = logs(fleet.scenario, [SEED])
    assert fleet.log(SEED).splitlines()[:6] == whole.splitlines()[:6]
    assert world.wait_for_exit() == 0


def test_parameters_that_there_are_not_earn_a_warning_and_whole_numbers_will_do(
    processes: Processes, tmp_path: Path
) -> None:
    file = tmp_path / 'nodes.yaml'
    file.write_text(
        '/**:\n  ros__parameters:\n    policy: hert\n'
        '/**/world_sim:\n  ros__parameters:\n    real_time_factor: 10\n'
    )
    wrong = parameters(real_time_facto=1.0, viewer_rate_hz=2)
    world = processes.start('world_sim', *wrong, '--params-file', str(file))
    unknown = 'is none of this node and changes nothing'
    world.wait_for(f'parameter policy {unknown}: --help lists those that are')
    world.wait_for(f'parameter real_time_facto {unknown}: real_time_factor is the nearest one')
    world.wait_for('waiting for UAV 1')
    assert world.output.count(unknown) == 2

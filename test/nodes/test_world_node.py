"""The world node as a process: how it starts, for whom it waits, how it ends."""

from collections.abc import Iterator
from pathlib import Path
import time
from typing import Any

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Fleet, logs, parameters, scenario_of
from node_starts import refusal
from processes import complaints, Processes
from scripted_agent_node import scripted_agents, ScriptedAgents
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.limits import MAX_SEED
from uav_collect.nodes import topics
from uav_collect.nodes.topics import publisher
from uav_collect.recording.mission_log import read
from uav_collect_msgs.msg import Mission, Scenario, UavFigures
from uav_collect_msgs.srv import ControlMission, Vouch

pytestmark = pytest.mark.ros

SEED = 6
START, ABORT = ControlMission.Request.START, ControlMission.Request.ABORT


@pytest.fixture
def pilot(ros_domain: int) -> Iterator[ScriptedAgents]:
    with scripted_agents() as there:
        yield there


@pytest.fixture
def fleet(processes: Processes, tmp_path: Path) -> Fleet:
    return Fleet(processes=processes, scenario=scenario_of(1), folder=tmp_path / 'run')


# How it starts


@pytest.mark.parametrize(
    ('values', 'complaint'),
    [
        ({'scenario': 'no_such'}, 'no_such'),
        ({'seed': -1}, 'seed'),
        ({'seed': 'seven'}, 'seed'),
        ({'missions': -2}, 'missions'),
        ({'missions': 3, 'seed': MAX_SEED - 1}, f'must be at most {MAX_SEED - 2} for 3 missions'),
        ({'viewer_rate_hz': 100.0}, 'viewer_rate_hz'),
        ({'real_time_factor': -1.0}, 'real_time_factor'),
        ({'decision_timeout_s': 0.0}, 'decision_timeout_s'),
        ({'output_dir': '/dev/null/run'}, 'output_dir'),
    ],
    ids=lambda value: '_'.join(value) if isinstance(value, dict) else '',
)
def test_a_parameter_that_does_not_fit_is_refused_in_one_line(
    values: dict[str, object],
    complaint: str,
    ros_domain: int,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (line,) = refusal('world', parameters(**values), capsys)
    assert line.startswith('error: ')
    assert complaint in line


def test_a_parameter_file_that_is_no_yaml_is_refused(
    ros_domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'nodes.yaml'
    file.write_text('world_sim: [')
    *_, line = refusal('world', ['--ros-args', '--params-file', str(file)], capsys)
    assert line.startswith('error: ')


def test_a_fleet_that_cannot_start_is_refused_before_anybody_waits(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(2, fleet__default__energy_budget_kj=1.1)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    world = fleet.start_world()
    assert world.wait_for_exit() == 2
    (line,) = complaints(world.output)
    assert 'UAV 1 has 1.1 kJ' in line


@pytest.mark.parametrize('came', ['later', 'earlier'])
def test_of_two_worlds_the_later_one_gives_way(
    came: str, fleet: Fleet, pilot: ScriptedAgents
) -> None:
    def vouch(request: Any, response: Any) -> Any:  # noqa: ANN401
        response.world_instance = 'rival'
        return response

    world = fleet.start_world()
    world.wait_for('waiting for UAV 1')
    scenarios = pilot.heard[topics.SCENARIO.name]
    pilot.wait_until(lambda: bool(scenarios))
    service = '/world/vouch_rival'
    pilot.node.create_service(Vouch, service, vouch)
    rival = Scenario(
        stamp=scenarios[0].stamp,
        world_instance='rival',
        vouch_service=service,
        yaml='name: other\n',
    )
    rival.stamp.sec += 1 if came == 'later' else -1
    publisher(pilot.node, topics.SCENARIO).publish(rival)
    if came == 'later':
        pilot.wait_until(lambda: pilot.has_warned('came later and has to give way'))
        assert int(pilot.diagnostic('second world')) == 1
        pilot.join(1)
        assert pilot.fly_on().phase == Mission.ENDED
        assert world.wait_for_exit() == 0
    else:
        pilot.wait_until(lambda: pilot.has_warned('this one gives way'))
        assert world.wait_for_exit() == 1
    assert 'another world_sim flies scenario other in this ROS domain' in world.output


def test_a_world_that_was_too_busy_to_answer_is_asked_again(
    fleet: Fleet, pilot: ScriptedAgents
) -> None:
    def vouch(request: Any, response: Any) -> Any:  # noqa: ANN401
        response.world_instance = 'rival'
        return response

    world = fleet.start_world()
    world.wait_for('waiting for UAV 1')
    rival = Scenario(world_instance='rival', vouch_service='/world/vouch_rival')
    publisher(pilot.node, topics.SCENARIO).publish(rival)
    pilot.wait_until(lambda: pilot.has_warned('its world does not answer'))
    pilot.node.create_service(Vouch, rival.vouch_service, vouch)
    pilot.wait_until(lambda: pilot.has_warned('this one gives way'))
    assert world.wait_for_exit() == 1


def test_it_says_for_whom_it_waits_and_starts_once_all_are_there(
    processes: Processes, tmp_path: Path, pilot: ScriptedAgents
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(3), folder=tmp_path / 'run')
    world = fleet.start_world(viewer_rate_hz=0.0)
    world.wait_for('waiting for UAV 1, UAV 2, UAV 3')
    pilot.join(2)
    world.wait_for('waiting for UAV 1, UAV 3')
    pilot.join(1)
    pilot.join(3)
    world.wait_for('mission .* starts, seed 0')


# Who does not answer


def test_uavs_without_an_agent_fly_home_at_once_if_the_world_need_not_wait(
    processes: Processes, tmp_path: Path, pilot: ScriptedAgents
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(2), folder=tmp_path / 'run')
    # It waits a few seconds for them from its own start: that is over before one is asked for.
    world = fleet.start_world(wait_for_agents=False, missions=0)
    pilot.join(1)
    world.wait_for('UAV 1: .* joined')
    pilot.steered.start(0)
    result = pilot.fly_on()
    assert result.failsafe_used
    assert result.note == 'the failsafe flew home: UAV 2'
    outcomes = [(uav.outcome, uav.decisions) for uav in result.uavs]
    assert outcomes[1] == (UavFigures.FAILSAFE, 0)
    assert outcomes[0][0] != UavFigures.FAILSAFE
    absent = read(fleet.log_file(0)).header.uavs[1]
    assert (absent.policy, absent.allocator) == ('none', 'none')


def test_a_uav_whose_agent_does_not_answer_in_time_is_flown_home_and_notified(
    fleet: Fleet, pilot: ScriptedAgents
) -> None:
    world = fleet.start_world(seed=SEED)
    pilot.join(1)
    for _ in range(3):
        turn = pilot.next_turn()
        assert turn is not None
        pilot.answer(turn)
    last = pilot.next_turn()
    assert last is not None
    pilot.steered.change('decision_timeout_s', 2.0)
    world.wait_for('UAV 1: no answer to decision 3 within 2 s; the failsafe flies it home')
    missions = pilot.heard[topics.MISSION.name]
    pilot.wait_until(lambda: len(missions) == 2)
    observations = pilot.heard[topics.uav_topics(1).observation.name]
    pilot.wait_until(lambda: observations[-1].terminated)
    assert missions[-1].failsafe_used
    assert missions[-1].uavs[0].decisions == 3
    assert world.wait_for_exit() == 0
    assert mission_metrics(read(fleet.log_file(SEED))).failsafe_used


def test_a_log_that_cannot_be_written_is_said_once_and_the_mission_goes_on(
    fleet: Fleet, pilot: ScriptedAgents
) -> None:
    world = fleet.start_world(seed=SEED, missions=2)
    world.wait_for('waiting for UAV 1')
    fleet.log_file(SEED).write_text('of somebody else')
    pilot.join(1)
    while (turn := pilot.next_turn()) is not None and turn.observation.decision < 3:
        pilot.answer(turn)
    pilot.wait_until(lambda: pilot.has_warned('the mission log cannot be written'))
    assert turn is not None
    pilot.answer(turn)
    assert pilot.fly_on().phase == Mission.ENDED
    missions = pilot.heard[topics.MISSION.name]
    pilot.wait_until(lambda: len(missions) == 3)
    assert pilot.fly_on().phase == Mission.ENDED
    assert world.wait_for_exit() == 0
    assert world.output.count('the mission log cannot be written') == 1
    assert fleet.log(SEED) == b'of somebody else'
    assert [fleet.log(SEED + 1)] == logs(fleet.scenario, [SEED + 1])


# On request


def test_missions_start_and_are_aborted_on_request(fleet: Fleet, pilot: ScriptedAgents) -> None:
    world = fleet.start_world(missions=0)
    missions = pilot.heard[topics.MISSION.name]
    assert pilot.control(ABORT).message == 'no mission is in flight or about to start'
    assert pilot.control(START, MAX_SEED + 1).message.startswith('the seed must be at most')
    assert pilot.control(7).message == 'command 7 is none of START, ABORT, PAUSE, RESUME, STEP'
    assert pilot.control(START, SEED).success
    refused = pilot.control(START, SEED)
    assert not refused.success
    assert refused.message == 'a mission is in flight or about to start: abort it first'
    assert pilot.control(ABORT).message == 'the mission that was about to start is called off'
    pilot.join(1)
    assert missions == []

    assert pilot.control(START, SEED).success
    first = pilot.next_turn()
    assert first is not None
    assert not pilot.control(START, SEED).success
    assert pilot.control(ABORT).message == 'the mission is aborted'
    pilot.wait_until(lambda: len(missions) == 2)
    assert (missions[1].phase, missions[1].note) == (Mission.ABORTED, 'aborted by request')
    assert [uav.outcome for uav in missions[1].uavs] == [UavFigures.ABORTED]
    pilot.answer(first)  # too late
    pilot.wait_until(lambda: pilot.has_warned('which is not in flight'))

    assert pilot.control(START, SEED + 1).success
    pilot.wait_until(lambda: len(missions) == 3)
    assert pilot.fly_on().phase == Mission.ENDED
    assert world.is_running
    assert fleet.logs([SEED + 1]) == logs(fleet.scenario, [SEED + 1])


def test_a_paced_mission_takes_its_time_to_the_last_landing(
    fleet: Fleet, pilot: ScriptedAgents
) -> None:
    factor = 500.0
    world = fleet.start_world(seed=SEED, real_time_factor=factor)
    pilot.join(1)
    first = pilot.next_turn()
    assert first is not None
    start_s = time.monotonic() - 1.0  # generous: to make up for stalls it may hurry for 0.05 s
    pilot.answer(first)
    result = pilot.fly_on()
    assert time.monotonic() - start_s >= result.completion_s / factor
    assert world.wait_for_exit() == 0
    assert [fleet.log(SEED)] == logs(fleet.scenario, [SEED])


def test_a_mission_is_cut_off_where_a_learner_has_enough_of_it(
    fleet: Fleet, pilot: ScriptedAgents
) -> None:
    world = fleet.start_world(seed=SEED, missions=2, max_decisions=7)
    pilot.join(1)
    epochs, missions = pilot.heard[topics.EPOCH.name], pilot.heard[topics.MISSION.name]
    for n_messages in (1, 3):
        pilot.wait_until(lambda n_messages=n_messages: len(missions) == n_messages)
        pilot.fly_on()
    assert world.wait_for_exit() == 0
    pilot.wait_until(lambda: len(epochs) == 16)
    assert [epoch.event for epoch in epochs] == 2 * [*range(8)]
    assert not any(epoch.terminal for epoch in epochs)
    assert [(it.phase, it.note) for it in missions[1::2]] == 2 * [
        (Mission.ABORTED, 'cut off by max_decisions')
    ]
    whole = logs(fleet.scenario, [SEED, SEED + 1])
    assert [log.splitlines()[:9] for log in whole] == [
        log.splitlines() for log in fleet.logs([SEED, SEED + 1])
    ]

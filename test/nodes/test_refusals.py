"""What nobody may send or start: refused, named in log and diagnostics, and the mission goes on.

One mission of two UAVs: the test plays the agent of the first one and, between its decisions,
sends everything that is wrong; a process flies the second.
"""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
import math
from pathlib import Path
from typing import Any

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Fleet, logs, scenario_of
from node_starts import refusal
from processes import Processes, ros_environment, RunningProcess
from ros_domains import own_domain
from scripted_agent_node import scripted_agents, ScriptedAgents, Turn
from uav_collect.nodes import topics
from uav_collect.uav import action_codes
from uav_collect_msgs.msg import Mission

pytestmark = pytest.mark.ros

SEED = 4
FOREIGN = '0badf00d-0'

Change = Callable[[Any, Turn], None]


def given(**values: object) -> Change:
    """Set fields of a message."""

    def change(message: Any, turn: Turn) -> None:  # noqa: ANN401
        for name, value in values.items():
            setattr(message, name, value)

    return change


def moved(name: str, by: int) -> Change:
    """Count a field up or down."""
    return lambda message, turn: setattr(message, name, getattr(message, name) + by)


def first_share(share_hz: float) -> Change:
    def change(message: Any, turn: Turn) -> None:  # noqa: ANN401
        message.bandwidth_hz[0] = share_hz

    return change


def scaled_shares(factor: float) -> Change:
    def change(message: Any, turn: Turn) -> None:  # noqa: ANN401
        message.bandwidth_hz = [share_hz * factor for share_hz in message.bandwidth_hz]

    return change


def cut(*names: str) -> Change:
    """Drop the last entry of arrays."""

    def change(message: Any, turn: Turn) -> None:  # noqa: ANN401
        for name in names:
            setattr(message, name, getattr(message, name)[:-1])

    return change


def other_mission_of_this_world(message: Any, turn: Turn) -> None:  # noqa: ANN401
    message.mission_id = turn.observation.mission_id.replace('-0', '-99')


def illegal_move(message: Any, turn: Turn) -> None:  # noqa: ANN401
    message.action = next(move for move in range(1, 5) if not turn.legal[move])
    message.sensor, message.bandwidth_hz = [], []


def other_sensors(message: Any, turn: Turn) -> None:  # noqa: ANN401
    message.sensor = [sensor + 1 for sensor in message.sensor]


ALWAYS = {
    'stale decision': (moved('decision', -1), 'stale decision'),
    'future decision': (moved('decision', 1), 'future decision'),
    'foreign mission': (given(mission_id=FOREIGN), f"mission '{FOREIGN}' is not of this world"),
    'no mission': (given(mission_id=''), "mission '' is not of this world"),
    'other mission': (other_mission_of_this_world, '-99, which is not in flight'),
    'foreign agent': (given(agent_instance='x'), 'not from the agent that flies this UAV'),
    'unknown action': (given(action=17), 'action 17 is none of 0..5'),
    'no action': (given(action=-1), 'action -1 is none of 0..5'),
    'illegal action': (illegal_move, 'is illegal at'),
    'failsafe claimed': (
        given(action=action_codes.HOME, reason=action_codes.FAILSAFE),
        'reason 3 is none',
    ),
}
HOVERING = {
    'NaN bandwidth': (first_share(math.nan), 'a bandwidth share of nan Hz'),
    'endless bandwidth': (first_share(math.inf), 'a bandwidth share of inf Hz'),
    'negative bandwidth': (first_share(-1.0), 'a bandwidth share of -1.0 Hz'),
    'no bandwidth': (first_share(0.0), 'a bandwidth share of 0.0 Hz'),
    'too much bandwidth': (scaled_shares(1.01), 'bandwidth shares sum to'),
    'huge bandwidth': (scaled_shares(1e300), 'bandwidth shares sum to'),
    'hardly any bandwidth': (scaled_shares(1e-12), 'too little energy for the way home'),
    'missing bandwidth': (cut('bandwidth_hz'), 'bandwidth shares for'),
    'missing sensor': (cut('sensor', 'bandwidth_hz'), 'bandwidth for the sensors'),
    'wrong sensors': (other_sensors, 'bandwidth for the sensors'),
}
RADIO = {
    'small map': (cut('complete'), 'a map of 12 bytes for 100 cells'),
    'stale message': (moved('sequence', -1), 'stale decision'),
    'future message': (moved('sequence', 1), 'future decision'),
    'wrong sender': (given(sender=2), 'it names UAV 2 as its sender'),
    'message of a foreign mission': (given(mission_id=FOREIGN), 'is not of this world'),
}


@dataclass(kw_only=True)
class Story:
    """What happened while the mission flew."""

    fleet: Fleet
    world: RunningProcess
    second_world: RunningProcess | None = None
    unknown: RunningProcess | None = None
    duplicate: RunningProcess | None = None
    joins: dict[str, Any] = field(default_factory=dict)  # answers of the world
    lines: dict[str, str] = field(default_factory=dict)  # of the world's log, by what was wrong
    missions: list[Any] = field(default_factory=list)


def send_wrongly(pilot: ScriptedAgents, turn: Turn, wrongs: dict[str, Any], story: Story) -> None:
    """Send one wrong thing after the other; each must be named in log and diagnostics."""
    is_radio = wrongs is RADIO
    publisher = (pilot.radio if is_radio else pilot.commands)[turn.uav]
    what = 'radio message' if is_radio else 'command'
    for name, (change, complaint) in wrongs.items():
        # The world that had to give way may have counted refusals, too.
        asked = f'{what} refused', turn.observation.mission_id
        n_before = int(pilot.diagnostic(*asked) or 0)
        message = deepcopy(turn.radio if is_radio else turn.command)
        change(message, turn)
        publisher.publish(message)
        pilot.wait_until(lambda n=n_before, c=complaint, a=asked: (
            int(pilot.diagnostic(*a) or 0) > n and pilot.has_warned(c)
        ), f'{name} of UAV {turn.uav} is refused')  # fmt: skip
        story.lines[name] = story.world.wait_for(f'UAV 1: {what} refused: .*').group()


def make_trouble(pilot: ScriptedAgents, story: Story) -> None:
    """Start what may not join, while the world waits for an answer."""
    processes = story.fleet.processes
    story.joins['unknown'] = pilot.ask_to_join(9, instance='x')
    # Now: what is refused next takes its place in the reports.
    pilot.wait_until(lambda: pilot.has_warned('UAV 9 is unknown'))
    story.duplicate = story.fleet.start_agent(1)
    story.unknown = story.fleet.start_agent(9)
    # On a busy machine it may open before it hears of the first, but its third UAV never comes.
    scenario_file = story.fleet.folder.with_name('second.yaml')
    scenario_file.write_text(scenario_of(n_uavs=3).to_yaml(), encoding='utf-8')
    story.second_world = processes.start(
        'world_sim', '--ros-args', '-p', f'scenario:={scenario_file}'
    )
    story.joins['taken'] = pilot.ask_to_join(2, instance='x')
    for process in (story.second_world, story.unknown, story.duplicate):
        process.wait_for_exit()


@pytest.fixture(scope='module')
def story(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Story]:
    """The mission, flown to its end."""
    folder: Path = tmp_path_factory.mktemp('refusals')
    with own_domain() as domain, pytest.MonkeyPatch.context() as patch:
        for name, value in ros_environment(domain, folder / 'ros_log').items():
            patch.setenv(name, value)
        processes = Processes(folder, {'ROS_DOMAIN_ID': str(domain)})
        fleet = Fleet(processes=processes, scenario=scenario_of(), folder=folder / 'run')
        try:
            with scripted_agents() as pilot:
                world = fleet.start_world(seed=SEED)
                happened = Story(fleet=fleet, world=world)
                fleet.start_agent(2)
                pilot.join(1)
                fly_with_all_that(pilot, happened)
                assert world.wait_for_exit() == 0
            yield happened
        finally:
            processes.close()


def fly_with_all_that(pilot: ScriptedAgents, story: Story) -> None:
    todo = [ALWAYS, HOVERING, RADIO]
    while (turn := pilot.next_turn()) is not None:
        if turn.observation.decision == 1:
            make_trouble(pilot, story)
        is_hover = turn.command.action == action_codes.HOVER
        if turn.observation.decision > 1:
            for wrongs in [w for w in todo if is_hover == (w is HOVERING)]:
                send_wrongly(pilot, turn, wrongs, story)
                todo.remove(wrongs)
        pilot.answer(turn)
    assert not todo
    story.missions = pilot.heard[topics.MISSION.name]


@pytest.mark.parametrize('name', [*ALWAYS, *HOVERING])
def test_a_command_that_may_not_be_carried_out_is_named(name: str, story: Story) -> None:
    _, complaint = (ALWAYS | HOVERING)[name]
    assert complaint in story.lines[name]


@pytest.mark.parametrize('name', RADIO)
def test_a_radio_message_that_makes_no_sense_is_named(name: str, story: Story) -> None:
    _, complaint = RADIO[name]
    assert complaint in story.lines[name]


def test_a_second_agent_of_a_uav_gives_up_and_the_first_flies_on(story: Story) -> None:
    assert story.duplicate is not None
    assert story.duplicate.wait_for_exit() == 2
    story.duplicate.wait_for('UAV 1 is flown by another agent, process 1 on test')
    assert 'Traceback' not in story.duplicate.output
    assert not story.joins['taken'].accepted
    assert story.joins['taken'].retry
    assert 'UAV 2 is flown by another agent' in story.joins['taken'].reason


def test_an_agent_of_an_unknown_uav_is_sent_away(story: Story) -> None:
    assert story.unknown is not None
    assert story.unknown.wait_for_exit() == 2
    story.unknown.wait_for('UAV 9 is unknown')
    assert 'Traceback' not in story.unknown.output
    assert not story.joins['unknown'].accepted
    assert not story.joins['unknown'].retry
    assert story.joins['unknown'].reason == 'UAV 9 is unknown: the scenario has UAVs 1..2'


def test_a_second_world_gives_way(story: Story) -> None:
    assert story.second_world is not None
    assert story.second_world.wait_for_exit() == 1
    story.second_world.wait_for(
        'another world_sim flies scenario paper_10x10 in this ROS domain: this one gives way'
    )
    assert 'Traceback' not in story.second_world.output


def test_all_that_was_refused_changes_nothing(story: Story) -> None:
    assert [mission.phase for mission in story.missions] == [Mission.STARTED, Mission.ENDED]
    assert [story.fleet.log(SEED)] == logs(story.fleet.scenario, [SEED])
    assert 'Traceback' not in story.world.output


def test_a_refusal_that_repeats_is_counted_but_said_once(story: Story) -> None:
    assert story.world.output.count(f"command refused: mission '{FOREIGN}'") == 1
    assert story.world.output.count('UAV 1 is flown by another agent') == 1


@pytest.mark.parametrize('room', ['world', 'agent', 'trainer', 'recorder'])
def test_a_broken_argument_for_ros_is_refused_in_one_line(
    room: str, capsys: pytest.CaptureFixture[str]
) -> None:
    *_, line = refusal(room, ['--ros-args', '-p', 'a'], capsys)
    assert "override rule: '-p a'" in line

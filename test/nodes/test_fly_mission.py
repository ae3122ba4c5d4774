"""Missions as goals of an action, by a plain client: with feedback, cancelled, of other scenarios.

One world and the agents of its UAVs as processes fly all of them, one after the other.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
import signal
from typing import Any

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from action_msgs.msg import GoalStatus
from fleets import Fleet, Listener, listener, logs, scenario_of
from processes import Processes, ros_environment, RunningProcess
from rclpy.action import ActionClient
from ros_domains import own_domain
from steered_world import SteeredWorld
from uav_collect.analysis.proof import Verdict
from uav_collect.analysis.recording_proof import Given, prove_recording
from uav_collect.nodes import topics
from uav_collect.recording.bag_reader import read_missions
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import Scenario
from uav_collect_msgs.action import FlyMission
from uav_collect_msgs.msg import Mission

pytestmark = pytest.mark.ros

SEED = 6
N_RECORDED = 5  # missions, one of them aborted; the last one is not recorded
PHASES = FlyMission.Feedback
# Simulated over wall-clock time: with some time for feedback, and so slow that it takes hours.
QUICKLY, HARDLY = 600.0, 0.001
NOT_NEEDED = 'UAV 2 is unknown: scenario smaller has UAVs 1..1'


@dataclass(kw_only=True)
class Goal:
    """A goal that was accepted, and what its client was sent."""

    handle: Any
    asked: Any  # future of the result
    feedback: list[Any]
    result: Any = None  # with its status

    @property
    def mission(self) -> Any:  # noqa: ANN401
        """The end of the mission in the result."""
        return self.result.result.mission


@dataclass(kw_only=True)
class Client:
    """A client of the action in the test."""

    listening: Listener
    action: Any
    sent: list[Goal] = field(default_factory=list)

    def send(self, seed: int, scenario: str = '') -> Goal | None:
        """Send a goal; None if it is rejected."""
        feedback: list[Any] = []
        self.listening.wait_until(self.action.server_is_ready)
        future = self.action.send_goal_async(
            FlyMission.Goal(seed=seed, scenario=scenario),
            feedback_callback=lambda msg: feedback.append(msg.feedback),
        )
        self.listening.wait_until(future.done)
        handle = future.result()
        if not handle.accepted:
            return None
        return Goal(handle=handle, asked=handle.get_result_async(), feedback=feedback)

    def fly(self, seed: int, scenario: str = '') -> Goal:
        """Send a goal and wait for its result."""
        goal = self.send(seed, scenario)
        assert goal is not None
        self.wait_for_result(goal)
        return goal

    def wait_for_result(self, goal: Goal) -> None:
        self.listening.wait_until(goal.asked.done)
        goal.result = goal.asked.result()

    def wait_until(self, condition: Callable[[], bool]) -> None:
        self.listening.wait_until(condition)


@contextmanager
def client() -> Iterator[Client]:
    heard = (topics.MISSION, topics.SCENARIO)
    with listener(*heard) as listening:
        action = ActionClient(listening.node, FlyMission, topics.FLY_MISSION_ACTION)
        try:
            yield Client(listening=listening, action=action)
        finally:
            action.destroy()


@dataclass(kw_only=True)
class Story:
    """What happened."""

    fleet: Fleet
    others: dict[str, Scenario]  # scenarios that missions were flown over later
    world: RunningProcess
    recorder: RunningProcess
    goals: dict[str, Goal | None] = field(default_factory=dict)
    missions: list[Any] = field(default_factory=list)
    scenarios: list[Any] = field(default_factory=list)


def fly_all(story: Story, here: Client) -> None:
    """Goal after goal: to its end, cancelled, forgotten, over other scenarios, interrupted.

    A mission that is to be cut off takes hours, unless it is.
    """
    fleet, goals, missions = story.fleet, story.goals, here.listening.heard[topics.MISSION.name]
    steered = SteeredWorld(here.listening.node, here.wait_until)
    first = here.send(SEED)
    assert first is not None
    here.wait_until(lambda: bool(first.feedback))
    goals['second'] = here.send(SEED)
    agents = fleet.start_agents()
    here.wait_for_result(first)
    goals['whole'] = first

    steered.change('real_time_factor', HARDLY)
    cancelled = here.send(SEED)
    assert cancelled is not None
    here.wait_until(lambda: any(it.n_decisions for it in cancelled.feedback))
    answer = cancelled.handle.cancel_goal_async()
    here.wait_until(answer.done)
    here.wait_for_result(cancelled)
    goals['cancelled'] = cancelled
    steered.change('real_time_factor', QUICKLY)

    with client() as passing:
        assert passing.send(SEED + 1) is not None
    n_before = len(missions)
    here.wait_until(lambda: len(missions) >= n_before + 2 and missions[-1].phase > 0)

    goals['unknown scenario'] = here.send(SEED, 'no_such')
    goals['smaller'] = here.fly(SEED + 2, story.others['smaller'].to_yaml())
    agents[1].wait_for(f'UAV 2: waiting for another scenario: {NOT_NEEDED}')
    fleet.start_agent(3)
    goals['larger'] = here.fly(SEED + 3, story.others['larger'].to_yaml())

    assert story.recorder.wait_for_exit() == 0
    steered.change('real_time_factor', HARDLY)
    last = here.send(SEED + 4)
    assert last is not None
    here.wait_until(lambda: any(it.n_decisions for it in last.feedback))
    story.world.send(signal.SIGINT)
    here.wait_for_result(last)
    goals['interrupted'] = last


@pytest.fixture(scope='module')
def story(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Story]:
    folder: Path = tmp_path_factory.mktemp('fly_mission')
    others = {
        'smaller': scenario_of(1, area__cells_per_side=8, name='smaller'),
        'larger': scenario_of(3, name='larger'),
    }
    with own_domain() as domain, pytest.MonkeyPatch.context() as patch:
        for name, value in ros_environment(domain, folder / 'ros_log').items():
            patch.setenv(name, value)
        processes = Processes(folder, {'ROS_DOMAIN_ID': str(domain)})
        fleet = Fleet(processes=processes, scenario=scenario_of(), folder=folder / 'run')
        try:
            recorder = fleet.start_recorder(stop_after_missions=N_RECORDED)
            world = fleet.start_world(missions=0, real_time_factor=QUICKLY)
            happened = Story(fleet=fleet, others=others, world=world, recorder=recorder)
            with client() as here:
                fly_all(happened, here)
                happened.missions = here.listening.heard[topics.MISSION.name]
                happened.scenarios = here.listening.heard[topics.SCENARIO.name]
                assert world.wait_for_exit() == 0
            yield happened
        except AssertionError as error:
            raise AssertionError(f'{error}\n{processes.outputs()}') from None
        finally:
            processes.close()


def goal_of(story: Story, name: str) -> Goal:
    goal = story.goals[name]
    assert goal is not None
    return goal


def test_a_goal_is_reached_when_its_mission_ends_and_the_log_is_that_of_any(story: Story) -> None:
    goal = goal_of(story, 'whole')
    assert goal.result.status == GoalStatus.STATUS_SUCCEEDED
    assert goal.mission == story.missions[1]
    assert goal.mission.phase == Mission.ENDED
    assert [story.fleet.log(SEED)] == logs(story.fleet.scenario, [SEED])


def test_feedback_only_grows(story: Story) -> None:
    reports = goal_of(story, 'whole').feedback
    assert reports[0].phase == PHASES.GATHERING
    assert list(reports[0].waiting_for) == [1, 2]
    flown = [it for it in reports if it.phase == PHASES.FLYING]
    assert flown
    for name in ('time_s', 'collected_share', 'energy_j', 'n_decisions'):
        values = [getattr(it, name) for it in flown]
        assert values == sorted(values)
    result = goal_of(story, 'whole').mission
    assert flown[-1].collected_share <= result.collected_bit / result.total_bit
    assert flown[-1].n_decisions <= result.n_decisions


def test_a_second_goal_is_rejected_and_the_log_says_why(story: Story) -> None:
    assert story.goals['second'] is None
    said = f'goal of seed {SEED} rejected: a mission is in flight or about to start'
    assert said in story.world.output


def test_a_cancelled_goal_aborts_its_mission_and_both_logs_are_kept(story: Story) -> None:
    goal = goal_of(story, 'cancelled')
    assert goal.result.status == GoalStatus.STATUS_CANCELED
    assert (goal.mission.phase, goal.mission.note) == (Mission.ABORTED, 'the client cancelled it')
    cut = story.fleet.folder.joinpath(f'mission_{SEED}_1.jsonl').read_bytes()
    assert story.fleet.log(SEED).startswith(cut)


def test_a_client_that_goes_away_leaves_its_mission_flying(story: Story) -> None:
    assert [story.fleet.log(SEED + 1)] == logs(story.fleet.scenario, [SEED + 1])


def test_a_scenario_that_there_is_not_is_refused(story: Story) -> None:
    assert story.goals['unknown scenario'] is None
    assert "rejected: scenario 'no_such' is unknown: must be one of" in story.world.output


@pytest.mark.parametrize(('name', 'seed'), [('smaller', SEED + 2), ('larger', SEED + 3)])
def test_the_fleet_of_another_scenario_joins_by_itself(name: str, seed: int, story: Story) -> None:
    goal, scenario = goal_of(story, name), story.others[name]
    assert goal.result.status == GoalStatus.STATUS_SUCCEEDED
    assert not goal.mission.failsafe_used
    assert goal.mission.scenario_fingerprint == fingerprint(scenario)
    assert [story.fleet.log(seed)] == logs(scenario, [seed])
    file = story.fleet.folder / f'scenario_{fingerprint(scenario)}.yaml'
    assert file.read_text() == scenario.to_yaml()


def test_an_agent_of_a_uav_that_is_not_needed_waits(story: Story) -> None:
    assert f'UAV 2: waiting for another scenario: {NOT_NEEDED}' in story.fleet.processes.outputs()


def test_a_recording_holds_the_missions_of_all_scenarios(story: Story) -> None:
    recorded = {it.log.header.mission_seed: it for it in read_missions(story.fleet.bag)}
    for seed in (SEED + 1, SEED + 2, SEED + 3):
        assert recorded[seed].is_complete
        assert recorded[seed].log.to_jsonl() == story.fleet.log(seed)


def test_logs_and_recording_are_proved_each_by_its_scenario(story: Story) -> None:
    whole = [it for it in prove_recording(story.fleet.bag, Given()) if 'seed' in it.mission]
    logs_alone = [*prove_recording(story.fleet.folder, Given())]
    assert (len(whole), len(logs_alone)) == (N_RECORDED, N_RECORDED + 1)
    assert [it for it in (*whole, *logs_alone) if it.verdict != Verdict.PROVED] == []


def test_a_world_that_is_interrupted_aborts_its_goal(story: Story) -> None:
    goal = goal_of(story, 'interrupted')
    assert goal.result.status == GoalStatus.STATUS_ABORTED
    assert goal.mission.note == 'the world was stopped'
    assert 'Traceback' not in story.world.output

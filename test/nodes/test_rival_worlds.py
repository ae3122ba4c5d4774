"""Two worlds in one ROS domain: the later one gives way, the fleet flies for the earlier one."""

from collections.abc import Callable, Iterator
import sys
import time
from types import SimpleNamespace
from typing import Any

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import scenario_of
from processes import Processes, RunningProcess
from rclpy.duration import Duration
from scripted_agent_node import scripted_agents, ScriptedAgents
from uav_collect.limits import FAILED
from uav_collect.nodes import topics
from uav_collect.nodes.agent import node as agent_node
from uav_collect.nodes.agent.node import AgentNode
from uav_collect.nodes.agent.settings import argument_parser
from uav_collect.nodes.identity import scenario_msg, WorldIdentity
from uav_collect.nodes.process import make_executor
from uav_collect.nodes.topics import publisher
from uav_collect.nodes.world import node
from uav_collect.scenario.site import build_site
from uav_collect_msgs.msg import Scenario
from uav_collect_msgs.srv import Join, Vouch

pytestmark = pytest.mark.ros

DOUBTER = """
import sys
from uav_collect.nodes import topics
from uav_collect.nodes.process import ProcessNode, run_node
from uav_collect.nodes.topics import publisher
from uav_collect.nodes.agent.world_choice import WorldChoice
from uav_collect_msgs.msg import Scenario
from uav_collect_msgs.srv import Vouch

class Doubter(ProcessNode):
    def __init__(self):
        super().__init__('doubter')
        self.world, self.heard = None, []
        self.create_service(Vouch, '/world/vouch', self.vouch)
        self.choice = WorldChoice(self, topics.SCENARIO, self.heard.append)
        self.create_timer(0.01, self.tick)

    def vouch(self, request, response):
        response.world_instance = self.said
        return response

    def tick(self):
        if self.world is None:
            self.world = publisher(self, topics.SCENARIO)
            while self.world.get_subscription_count() == 0:
                pass
            self.said = str(len(self.heard))
            self.world.publish(Scenario(world_instance=self.said, vouch_service='/world/vouch'))
        elif self.choice.instance == self.said:
            self.destroy_publisher(self.world)
            self.world = None
        self.choice.tick()  # may look anew while what was just said waits to be heard
        if len(self.heard) == 10:
            self.end()

sys.exit(run_node(Doubter, sys.argv[1:]))
"""

ENOUGH = Duration(seconds=60)


@pytest.fixture
def agents(ros_domain: int) -> Iterator[ScriptedAgents]:
    with scripted_agents() as there:
        yield there


class FakeWorld:
    """What agents meet of a world: its scenario, and answers to those who join."""

    n_taken = 0  # answers, until it lets somebody in, that the UAV has an agent

    def __init__(
        self, agents: ScriptedAgents, instance: str, started_s: float, joined: list[str]
    ) -> None:
        self._node = agents.node
        self._instance = instance
        self._joined = joined  # instances of all worlds, as agents turned to them
        self.n_others_asked = 0
        self._scenarios = publisher(agents.node, topics.SCENARIO)
        scenario = scenario_of(1)
        identity = WorldIdentity(started_s=started_s, instance=instance)
        service = f'/world/vouch_{instance}'
        agents.node.create_service(Vouch, service, self._on_vouch)
        self._scenarios.publish(scenario_msg(identity, build_site(scenario), service))

    def serve(self) -> 'FakeWorld':
        """Answer agents from now on."""
        self._node.create_service(Join, topics.JOIN_SERVICE, self._on_join)
        return self

    def wait_until_heard(self) -> None:
        """Wait until the agents have the scenario."""
        assert self._scenarios.wait_for_all_acked(ENOUGH)

    def end(self) -> None:
        """Be gone, as agents notice it."""
        self._node.destroy_publisher(self._scenarios)

    def _on_vouch(self, request: Any, response: Any) -> Any:  # noqa: ANN401
        response.world_instance = self._instance
        return response

    def _on_join(self, request: Any, response: Any) -> Any:  # noqa: ANN401
        response.world_instance = self._instance
        if request.world_instance == self._instance and self.n_taken > 0:
            self.n_taken -= 1
            response.retry, response.reason = True, 'its agent may be dying'
        elif request.world_instance == self._instance:
            response.accepted = True
            response.mission_id = f'{self._instance}-0'
            if self._joined[-1:] != [self._instance]:  # it asks again if an answer was lost
                self._joined.append(self._instance)
        else:
            response.reason = 'not this world'
            self.n_others_asked += 1
        return response


def n_flown_for(agent: RunningProcess) -> int:
    """How many worlds have let an agent fly."""
    return agent.output.count('UAV 1 flies')


def test_who_looks_anew_while_worlds_come_and_go_goes_on(processes: Processes) -> None:
    process = processes.run('doubter', sys.executable, '-c', DOUBTER)
    assert process.wait_for_exit() == 0, process.output


def test_who_takes_late_hears_each_of_two_worlds(agents: ScriptedAgents) -> None:
    worlds = [publisher(agents.node, topics.SCENARIO) for _ in 'ab']
    for instance, world in zip('ab', worlds, strict=True):
        world.publish(Scenario(world_instance=instance))
    heard = agents.heard[topics.SCENARIO.name]
    agents.wait_until(lambda: bool(heard) and heard[-1].world_instance == 'b')
    assert [scenario.world_instance for scenario in heard] == ['a', 'b']


def test_a_world_gives_way_to_an_earlier_one_that_it_hears_while_it_opens(
    agents: ScriptedAgents, monkeypatch: pytest.MonkeyPatch
) -> None:
    earlier, make_display = publisher(agents.node, topics.SCENARIO), node.ViewerPublisher

    def display_of_a_busy_world(*arguments: Any) -> Any:  # noqa: ANN401
        earlier.publish(Scenario(world_instance='earlier', vouch_service='/world/vouch'))
        return make_display(*arguments)

    def vouch(request: Any, response: Any) -> Any:  # noqa: ANN401
        response.world_instance = 'earlier'
        return response

    agents.node.create_service(Vouch, '/world/vouch', vouch)
    monkeypatch.setattr(node, 'ViewerPublisher', display_of_a_busy_world)
    monkeypatch.setattr(node, 'check_can_start', lambda *_: None)  # compiles for long
    world, executor = node.WorldNode(), make_executor()
    executor.add_node(world)

    def has_ended() -> bool:
        executor.spin_once(timeout_sec=0.01)
        return world.end_status is not None

    agents.wait_until(has_ended)
    executor.shutdown()
    world.destroy_node()
    assert world.end_status == FAILED


def test_an_agent_flies_for_the_earliest_world_that_it_hears(
    agents: ScriptedAgents, processes: Processes
) -> None:
    joined: list[str] = []
    agent = processes.start('uav_agent', '--id', '1')
    FakeWorld(agents, 'middle', 2.0, joined).serve()
    agents.wait_until(lambda: n_flown_for(agent) == 1)
    late = FakeWorld(agents, 'late', 3.0, joined).serve()
    late.wait_until_heard()
    early = FakeWorld(agents, 'early', 1.0, joined).serve()
    # If that took long, it has looked around meanwhile, and may have found the late one first.
    agents.wait_until(lambda: n_flown_for(agent) >= 2 and joined[-1] == 'early')
    assert joined[0] == 'middle'
    late.end()
    early.end()
    agents.wait_until(lambda: n_flown_for(agent) > 2 and joined[-1] == 'middle')


def test_the_answer_of_a_world_that_was_not_asked_is_none(
    agents: ScriptedAgents, processes: Processes
) -> None:
    joined: list[str] = []
    early = FakeWorld(agents, 'early', 1.0, joined)
    late = FakeWorld(agents, 'late', 2.0, joined).serve()
    agent = processes.start('uav_agent', '--id', '1')
    agents.wait_until(lambda: late.n_others_asked >= 2)
    early.serve()
    agents.wait_until(lambda: 'early' in joined and n_flown_for(agent) > 0)


def test_an_agent_outlasts_a_world_that_was_held_up_before_it_noticed_a_death(
    agents: ScriptedAgents, monkeypatch: pytest.MonkeyPatch
) -> None:
    joined: list[str] = []
    world = FakeWorld(agents, 'only', 1.0, joined)
    agent, executor = AgentNode(argument_parser().parse_args(['--id', '1'])), make_executor()
    executor.add_node(agent)

    def wait_until(condition: Callable[[], bool]) -> None:
        agents.wait_until(lambda: executor.spin_once(timeout_sec=0.01) or condition())

    wait_until(lambda: agent._inbox is not None)
    later = SimpleNamespace(monotonic=lambda: time.monotonic() + 60.0)
    monkeypatch.setattr(agent_node, 'time', later)
    world.n_taken = 2
    world.serve()
    wait_until(lambda: bool(joined) or agent.end_status is not None)
    executor.shutdown()
    agent.destroy_node()
    assert (joined, agent.end_status) == (['only'], None)


def test_a_world_accepts_nobody_who_asks_for_another_one(
    agents: ScriptedAgents, processes: Processes
) -> None:
    processes.start('world_sim')
    own = agents.scenario().world_instance
    client = agents.node.create_client(Join, topics.JOIN_SERVICE)
    answer = agents.call(client, Join.Request(world_instance='other', uav=1, agent_instance='x'))
    assert (answer.accepted, answer.world_instance) == (False, own)
    assert agents.ask_to_join(1).accepted  # the UAV is free

"""The agent node of one UAV: on board, it knows only what it saw and what others told it."""

import argparse
from collections.abc import Sequence
import os
import socket
import time
from typing import Any
import uuid

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from uav_collect.agent import Agent, ALLOCATOR_NAMES, allocator_named
from uav_collect.briefing import brief
from uav_collect.nodes import convert, topics
from uav_collect.nodes.parameters import declare, help_text, Parameter
from uav_collect.nodes.spin import MISUSED, NodeError, ProcessNode, run_node
from uav_collect.nodes.topics import publisher, subscription
from uav_collect.policy import policy_named
from uav_collect.scenario import ConfigError, fingerprint, from_yaml
from uav_collect_msgs.srv import Join

_DESCRIPTION = """
Flies one UAV: decides by a policy what it does next, from what it sees and hears, and shares its
bandwidth among the sensors it serves. Learns the scenario from the world; start it in any order
with the world and the other agents.
"""
_ASK_PERIOD_S = 0.25  # between two requests to join
_PATIENCE_S = 6.0  # how long a UAV's last agent may take to be noticed dead
_TOLD_PERIOD_S = 10.0  # between two lines that say what the agent waits for

PARAMETERS = (
    Parameter(name='uav', default=0, description='id of the UAV (--id)', low=0, high=64),
    Parameter(
        name='policy', default='sweep', description='hert, hert-equal, sweep or random (--policy)'
    ),
    Parameter(
        name='bandwidth',
        default='exact',
        description='how bandwidth is shared: exact, equal or cvxpy (--bandwidth)',
    ),
)


class AgentNode(ProcessNode):
    """Connects one UAV's topics to its `Agent`."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Check id, policy and allocator, then wait for a world."""
        namespace = f'uav_{arguments.id}' if arguments.id else ''
        super().__init__('uav_agent', namespace=namespace)
        declare(self, PARAMETERS)
        self._uav = arguments.id or self._value('uav')
        self._policy = arguments.policy or self._value('policy')
        self._allocator = arguments.bandwidth or self._value('bandwidth')
        if not self._uav:
            raise NodeError('the id of the UAV is missing: --id N, from 1')
        try:
            policy_named(self._policy)
            allocator_named(self._allocator)
        except ValueError as error:
            raise NodeError(str(error)) from error
        self._instance = str(uuid.uuid4())
        self._cockpit: _Cockpit | None = None
        self._joining: Future | None = None
        self._is_member = False
        self._world = ''  # the instance whose fleet this agent is in, or wants to be in
        self._since_s = self._told_s = time.monotonic()
        watch = SubscriptionEventCallbacks(liveliness=self._on_world_liveliness)
        self._own = topics.uav_topics(self._uav)
        subscription(self, topics.SCENARIO, self._on_scenario, on_event=watch)
        subscription(self, self._own.radio_rx, self._on_radio)
        subscription(self, self._own.observation, self._on_observation)
        self._client = self.create_client(Join, topics.JOIN_SERVICE)
        self._command: Any = None
        self._radio: Any = None
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_ASK_PERIOD_S, self._ask, clock=steady)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    # Joining a world's fleet.

    def _on_scenario(self, msg: Any) -> None:
        if msg.world_instance == self._world:
            return
        try:
            scenario = from_yaml(msg.yaml)
        except ConfigError as error:
            self._give_up(f'the scenario of the world is not valid here: {error}')
            return
        if fingerprint(scenario) != msg.fingerprint:
            self._give_up(
                f'scenario {scenario.name} reads as {fingerprint(scenario)} here and as '
                f'{msg.fingerprint} in the world: the versions of uav_collect differ'
            )
            return
        if self._uav > scenario.n_uavs:
            self._give_up(
                f'UAV {self._uav} is unknown: scenario {scenario.name} has UAVs '
                f'1..{scenario.n_uavs}'
            )
            return
        briefing = brief(scenario)
        agent = Agent(
            briefing,
            self._uav - 1,
            policy_named(self._policy),
            allocator_named(self._allocator),
        )
        self._cockpit = _Cockpit(agent, scenario.n_cells)
        self._world = msg.world_instance
        self._is_member = False
        self._joining = None
        self._since_s = time.monotonic()
        self._ask()

    def _ask(self) -> None:
        if self._is_member or self._joining is not None or self.end_status is not None:
            return
        if self._cockpit is None or not self._client.service_is_ready():
            self._tell_waiting()
            return
        self._joining = self._client.call_async(
            Join.Request(
                uav=self._uav,
                agent_instance=self._instance,
                host=socket.gethostname(),
                pid=os.getpid(),
                policy=self._policy,
                policy_version=self._cockpit.agent.policy.version,
                allocator=self._allocator,
            )
        )
        self._joining.add_done_callback(self._on_answer)

    def _on_answer(self, future: Future) -> None:
        if future is not self._joining or self._cockpit is None:
            return
        self._joining = None
        answer = future.result()
        if not answer.accepted:
            if not answer.retry or time.monotonic() - self._since_s > _PATIENCE_S:
                self._give_up(answer.reason)
            return
        self._is_member = True
        self._renew_publishers()
        self.get_logger().info(f'UAV {self._uav} flies, policy {self._policy}')
        self._cockpit.rebuild(answer)
        self._answer_observations()

    def _renew_publishers(self) -> None:
        """Start without a history: what was latched for a world that is gone confuses the next."""
        for stale in (self._command, self._radio):
            if stale is not None:
                self.destroy_publisher(stale)
        self._command = publisher(self, self._own.command)
        self._radio = publisher(self, self._own.radio_tx)

    def _on_world_liveliness(self, event: Any) -> None:
        if event.alive_count == 0 and self._is_member:
            self.get_logger().info('the world is gone; waiting for the next one')
            self._cockpit, self._world, self._is_member = None, '', False

    def _tell_waiting(self) -> None:
        if time.monotonic() - self._told_s > _TOLD_PERIOD_S:
            self._told_s = time.monotonic()
            domain = os.environ.get('ROS_DOMAIN_ID', '0')
            self.get_logger().info(f'waiting for a world_sim in ROS domain {domain}')

    def _give_up(self, why: str) -> None:
        self.get_logger().error(why)
        self.end(MISUSED)

    # Flying.

    def _on_radio(self, msg: Any) -> None:
        if self._cockpit is not None:
            self._cockpit.note_radio(msg)
            self._answer_observations()

    def _on_observation(self, msg: Any) -> None:
        if self._cockpit is not None:
            self._cockpit.note_observation(msg)
            self._answer_observations()

    def _answer_observations(self) -> None:
        if not self._is_member or self._cockpit is None:
            return
        agent = self._cockpit.agent
        while (observation := self._cockpit.next_observation()) is not None:
            start_s = time.perf_counter()
            view = self._cockpit.take_in(observation)
            self._radio.publish(
                convert.radio_msg(
                    agent.message(view), observation.mission_id, sequence=observation.decision
                )
            )
            command = convert.command_msg(agent.decide(view), observation)
            command.agent_instance = self._instance
            command.policy_version = agent.policy.version
            command.compute_time_s = time.perf_counter() - start_s
            self._command.publish(command)


class _Cockpit:
    """Puts a UAV's messages in the order in which the world meant them.

    Two topics are not ordered against each other: an observation says how many radio messages
    came before it, and waits for them.
    """

    def __init__(self, agent: Agent, n_cells: int) -> None:
        self.agent = agent
        self._n_cells = n_cells
        self._mission_id = ''
        self._decision = 0  # the next one
        self._n_heard = 0  # radio messages taken in
        self._observations: dict[int, Any] = {}  # of this mission, by decision
        self._radio: dict[str, dict[int, Any]] = {}  # by mission, then number of the delivery

    def rebuild(self, answer: Any) -> None:
        """Live through the mission in flight again, as far as it was answered."""
        for message in answer.radio:
            self.note_radio(message)
        self._begin(answer.mission_id)
        answered = len(answer.observations) - (1 if answer.decision_pending else 0)
        for observation in answer.observations[:answered]:
            self.agent.decide(self.take_in(observation))
        for observation in answer.observations[answered:]:
            self.note_observation(observation)

    def note_radio(self, msg: Any) -> None:
        """Keep a radio message until the observation that it came before."""
        if _number(msg.mission_id) >= _number(self._mission_id):
            self._radio.setdefault(msg.mission_id, {})[msg.delivery] = msg

    def note_observation(self, msg: Any) -> None:
        """Keep an observation until its turn."""
        if msg.mission_id != self._mission_id:
            if _number(msg.mission_id) <= _number(self._mission_id) or msg.decision != 0:
                return
            self._begin(msg.mission_id)
        if not msg.terminated:
            self._observations[msg.decision] = msg

    def next_observation(self) -> Any | None:
        """The observation to answer next, if it and all that came before it are here."""
        msg = self._observations.get(self._decision)
        if msg is None:
            return None
        radio = self._radio.get(self._mission_id, {})
        waited = range(self._n_heard + 1, msg.n_radio_delivered + 1)
        return msg if all(number in radio for number in waited) else None

    def take_in(self, observation: Any) -> Any:
        """Hear what came before an observation, then see it; the local view."""
        radio = self._radio.get(self._mission_id, {})
        for number in range(self._n_heard + 1, observation.n_radio_delivered + 1):
            self.agent.hear(convert.radio_from_msg(radio.pop(number), self._n_cells))
        self._n_heard = observation.n_radio_delivered
        self._observations.pop(observation.decision, None)
        self._decision = observation.decision + 1
        view = convert.view_from_msg(observation)
        self.agent.observe(view)
        return view

    def _begin(self, mission_id: str) -> None:
        self._mission_id = mission_id
        self._decision = self._n_heard = 0
        self._observations = {}
        self._radio = {key: kept for key, kept in self._radio.items() if key == mission_id}
        self.agent.begin()


def _number(mission_id: str) -> int:
    """Running number of a mission in its world; before the first, -1."""
    return int(mission_id.rpartition('-')[2] or -1)


def main(argv: Sequence[str]) -> int:
    """Run the agent of one UAV; the exit status."""
    parser = argparse.ArgumentParser(
        prog='uav_agent',
        description=_DESCRIPTION,
        epilog=help_text(PARAMETERS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--id', type=_uav_id, metavar='N', help='id of the UAV, from 1')
    parser.add_argument('--policy', metavar='NAME', help='hert, hert-equal, sweep or random')
    parser.add_argument(
        '--bandwidth', choices=ALLOCATOR_NAMES, help='how bandwidth is shared among sensors'
    )
    arguments = parser.parse_args(remove_ros_args(list(argv)))
    return run_node(lambda: AgentNode(arguments), argv)


def _uav_id(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 64:
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number from 1 to 64')
    return int(text)

"""A node of the test that flies UAVs: it decides as agents do, and sends what it likes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from fleets import Pilots
import numpy as np
from processes import wait_until
import rclpy
from steered_world import SteeredWorld
from uav_collect.lockstep.inbox import Inbox
from uav_collect.nodes import convert, topics
from uav_collect.nodes.identity import identity_of
from uav_collect.nodes.middleware import use_quick_discovery
from uav_collect.nodes.topics import publisher
from uav_collect.scenario.load import from_yaml
from uav_collect.scenario.model import Scenario
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.briefing import brief
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.policy import policy_named
from uav_collect.uav.view import LocalView
from uav_collect_msgs.srv import Join

INSTANCE = 'scripted-agents'
_WAIT_S = 0.002


@dataclass(frozen=True, kw_only=True)
class Turn:
    """A decision that the world waits for, and the answer that an agent would give."""

    uav: int  # id
    observation: Any
    view: LocalView
    legal: list[int]
    radio: Any
    command: Any


class _Agent(Agent):
    """Hands kernels the types that they are compiled for anyway; compiling others takes long."""

    def hear(self, message: RadioMessage) -> None:
        super().hear(replace(message, complete=np.array(message.complete, dtype=np.uint8)))

    def observe(self, view: LocalView) -> None:
        super().observe(_typed(view))

    def decide(self, view: LocalView) -> Decision:
        return super().decide(_typed(view))


def _typed(view: LocalView) -> LocalView:
    return view._replace(sensor=np.array(view.sensor, dtype=np.int64))


def _compile(scenario: Scenario, policy: str) -> None:
    """Compile what an agent needs before the world waits for its answers."""
    pilots = Pilots(scenario, 0, policy)
    for _ in range(scenario.n_uavs):
        event = pilots.simulation.next_event()
        assert event is not None
        pilots.simulation.start(event, pilots.decide(event))


class ScriptedAgents:
    """Keeps what the world publishes; plays the agents of the UAVs that joined."""

    def __init__(self, node: Any, executor: Any) -> None:  # noqa: ANN401
        self.node = node
        self._executor = executor
        self.heard: dict[str, list[Any]] = {}  # messages by topic, in order
        self._inboxes: dict[int, Inbox] = {}
        self.commands: dict[int, Any] = {}  # publishers
        self.radio: dict[int, Any] = {}
        self._join = node.create_client(Join, topics.JOIN_SERVICE)
        self.steered = SteeredWorld(node, self.wait_until)
        for topic in (*topics.world_topics().recorded()[:4], topics.DIAGNOSTICS):
            self.listen(topic)

    def listen(self, topic: Any) -> None:  # noqa: ANN401
        """Keep what comes on a topic of the table."""
        self.heard[topic.name] = []
        self._subscribe(topic, self.heard[topic.name].append)

    def _subscribe(self, topic: Any, callback: Callable[[Any], None]) -> None:  # noqa: ANN401
        self.node.create_subscription(topic.message, topic.name, callback, topic.qos)

    def wait_until(self, condition: Callable[[], bool], what: str = '') -> None:
        """Listen until something holds; a failure says what, and the latest diagnostics."""
        try:
            wait_until(condition, meanwhile=lambda: self._executor.spin_once(timeout_sec=_WAIT_S))
        except AssertionError as late:
            last = self.heard[topics.DIAGNOSTICS.name][-1:]
            raise AssertionError(f'{what}: {late}; {last}') from None

    def call(self, client: Any, request: Any) -> Any:  # noqa: ANN401
        """The answer of a service."""
        return self.steered.call(client, request)

    def control(self, command: int, seed: int = 0) -> Any:  # noqa: ANN401
        """Ask the world to start or abort a mission."""
        return self.steered.control(command, seed)

    def ask_to_join(self, uav: int, policy: str = 'sweep', instance: str = INSTANCE) -> Any:  # noqa: ANN401
        """What the world heard first answers to an agent; another world may be faster."""
        world = self.scenario().world_instance
        request = Join.Request(
            world_instance=world,
            uav=uav,
            agent_instance=instance,
            host='test',
            pid=1,
            policy=policy,
            policy_version='1',
            allocator='exact',
        )
        answers: list[Any] = []

        def has_answered() -> bool:
            answers.append(self.call(self._join, request))
            return bool(answers[-1].world_instance == world)

        self.wait_until(has_answered)
        return answers[-1]

    def scenario(self) -> Any:  # noqa: ANN401
        """The scenario of the world that was heard first; waits for it."""
        scenarios = self.heard[topics.SCENARIO.name]
        self.wait_until(lambda: bool(scenarios))
        return scenarios[0]

    def join(self, uav: int, policy: str = 'sweep') -> None:
        """Fly a UAV from now on."""
        world = self.scenario()
        scenario, own = from_yaml(world.yaml), topics.uav_topics(uav)
        _compile(scenario, policy)
        agent = _Agent(brief(scenario), uav - 1, policy_named(policy), allocator_named('exact'))
        inbox = Inbox(
            agent,
            identity_of(world).short,
            view_from=convert.view_from_msg,
            radio_from=partial(convert.radio_from_msg, n_cells=scenario.n_cells),
        )
        for topic, note in (
            (own.radio_rx, inbox.add_radio),
            (own.observation, inbox.add_observation),
        ):
            self.heard[topic.name] = []
            self._subscribe(topic, _both(self.heard[topic.name].append, note))
        self.commands[uav] = publisher(self.node, own.command)
        self.radio[uav] = publisher(self.node, own.radio_tx)
        self._inboxes[uav] = inbox
        answer = self.ask_to_join(uav, policy)
        assert answer.accepted, answer.reason
        self.commands[uav].publish(convert.greeting_msg(INSTANCE))
        inbox.replay(answer)

    def next_turn(self) -> Turn | None:
        """The next decision to take; None once the latest mission that started is over."""
        found: list[tuple[int, Any]] = []
        missions = self.heard[topics.MISSION.name]

        def is_asked() -> bool:
            for uav, inbox in self._inboxes.items():
                if inbox.doubts_mission:
                    inbox.replay(self.ask_to_join(uav, inbox.agent.policy.name))
                observation = inbox.next_observation()
                if observation is not None:
                    found.append((uav, observation))
            return bool(found)

        self.wait_until(lambda: is_asked() or bool(missions and missions[-1].phase))
        if not found:
            return None
        uav, observation = found[0]
        inbox = self._inboxes[uav]
        view = inbox.deliver(observation)
        decision = inbox.agent.decide(view)
        command = convert.command_msg(decision, observation)
        command.agent_instance, command.policy_version = INSTANCE, '1'
        message = inbox.agent.message(view)
        return Turn(
            uav=uav,
            observation=observation,
            view=view,
            legal=[int(flag) for flag in inbox.agent.legal],  # type: ignore[attr-defined]
            radio=convert.radio_msg(
                message, observation.mission_id, sequence=observation.decision
            ),
            command=command,
        )

    def answer(self, turn: Turn) -> None:
        """Send what an agent sends."""
        self.radio[turn.uav].publish(turn.radio)
        self.commands[turn.uav].publish(turn.command)

    def fly_on(self) -> Any:  # noqa: ANN401
        """Answer until the mission is over; what the world says of it."""
        while (turn := self.next_turn()) is not None:
            self.answer(turn)
        return self.heard[topics.MISSION.name][-1]

    def diagnostic(self, key: str, mission_id: str = '') -> str:
        """The latest value that a world's diagnostics give for a key; empty if none.

        Args:
            mission_id: that the world flies, where others in the domain share the topic.
        """
        for message in reversed(self.heard[topics.DIAGNOSTICS.name]):
            for status in message.status:
                for value in status.values:
                    if value.key == key and mission_id in status.message:
                        return str(value.value)
        return ''

    def has_warned(self, text: str) -> bool:
        """Whether diagnostics have warned of an incident that reads so."""
        return any(
            status.level == status.WARN and text in value.value
            for message in self.heard[topics.DIAGNOSTICS.name]
            for status in message.status
            for value in status.values
        )


def _both(first: Callable[[Any], None], second: Callable[[Any], None]) -> Callable[[Any], None]:
    def call(message: Any) -> None:  # noqa: ANN401
        first(message)
        second(message)

    return call


@contextmanager
def scripted_agents() -> Iterator[ScriptedAgents]:
    """A node in the ROS domain of the test."""
    from uav_collect.nodes.process import make_executor

    use_quick_discovery()
    rclpy.init()
    node = rclpy.create_node('scripted_agents')
    executor = make_executor()
    executor.add_node(node)
    try:
        yield ScriptedAgents(node, executor)
    finally:  # else a test that fails would publish on, in a domain that another one takes
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()

"""The agent node of one UAV: on board, it knows only what it saw and what it heard of others."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial, wraps
import math
import os
import socket
import time
from typing import Any
import uuid

from rclpy.clock import Clock, ClockType
from uav_collect.errors import AllocationError, ConfigError, NodeError, PolicyMismatchError
from uav_collect.limits import BEST, UNUSABLE
from uav_collect.lockstep.checks import observation_problem, radio_problem
from uav_collect.lockstep.inbox import Inbox
from uav_collect.lockstep.published_policy import PolicyStore, TopicPolicy
from uav_collect.nodes import convert, topics
from uav_collect.nodes.agent.policy_choice import check_choices, PolicyChoice
from uav_collect.nodes.agent.settings import argument_parser, PARAMETERS
from uav_collect.nodes.agent.transitions import TransitionBuilder
from uav_collect.nodes.agent.world_choice import WorldChoice
from uav_collect.nodes.identity import identity_of, place_of
from uav_collect.nodes.parameters import declare
from uav_collect.nodes.process import parse_arguments, ProcessNode, run_node
from uav_collect.nodes.sealing import SealedClient
from uav_collect.nodes.topics import publisher, subscription
from uav_collect.nodes.trainer_listener import subscribe_to_trainers
from uav_collect.scenario.load import fingerprint, from_yaml
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.observation import AnyLayout, Layout
from uav_collect.uav.own_observation import layout_named
from uav_collect.uav.policy import guard_for, remarks, TOPIC
from uav_collect.uav.user_code import UserCodeError
from uav_collect_msgs.srv import Join

_ASK_PERIOD_S = 0.25  # between two requests to join
_ANSWER_S = 1.5  # a request to a world that died since it was found is never answered
_MOST_REFUSALS = 40  # in ten seconds: a UAV's last agent may take a while to be noticed dead
_WAITING_PERIOD_S = 10.0  # between two lines that say what the agent waits for


def _gives_up_on_error(callback: Callable[..., None]) -> Callable[..., None]:
    """Let a callback end the agent, with one line, when it cannot fly or go on flying."""

    @wraps(callback)
    def guarded(agent: 'AgentNode', *arguments: Any) -> None:
        try:
            callback(agent, *arguments)
        except (AllocationError, ConfigError, PolicyMismatchError) as error:
            agent._give_up(str(error))

    return guarded


class AgentNode(ProcessNode):
    """Connects one UAV's topics to its `Agent`."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Check id, policy and allocator, then wait for a world."""
        own = f'uav_{arguments.id}' if arguments.id else ''
        super().__init__('uav_agent', namespace='/'.join(filter(None, (arguments.world, own))))
        declare(self, PARAMETERS)
        self._uav = arguments.id or self._value('uav')
        self._policy = arguments.policy or self._value('policy')
        self._allocator = arguments.bandwidth or self._value('bandwidth')
        given = arguments.guard_after
        self._guard_after = self._value('guard_after') if given is None else given
        if not self._uav:
            raise NodeError('the id of the UAV is missing: --id N, from 1')
        candidates = arguments.candidates or self._value('candidates')
        check_choices(self._policy, candidates, self._allocator)
        self._choice = PolicyChoice(
            self._policy,
            candidates=candidates,
            allocator=self._allocator,
            guard_after=self._guard_after,
            log=self.get_logger().info,
        )
        self._scenario_msg: Any = None  # of the world that is flown for
        self._own_policy: Any = None  # refined for that, see `PolicyChoice.policy_for`
        self._instance = str(uuid.uuid4())
        self._layout = _layout_named(self._value('observation_layout'))
        self._inbox: Inbox | None = None
        self._guard = NONE  # of the inbox's agent
        self._transitions: TransitionBuilder | None = None
        self._policies: PolicyStore | None = None
        self._asked_s = -math.inf
        self._is_member = False
        self._unfit = ''  # why the world's scenario cannot be flown
        self._published_for = ''  # the instance that the publishers were made for
        self._n_refusals = 0  # since it began to ask
        self._logged, self._logged_s = '', -math.inf
        self._names = topics.world_topics(topics.world_of(self.get_namespace(), self._uav))
        self._own = self._names.uav(self._uav)
        self._briefing: Briefing | None = None
        self._n_sensors = 0
        self._world = WorldChoice(self, self._names.scenario, self._on_world)
        subscription(self, self._own.radio_rx, self._on_radio)
        subscription(self, self._own.observation, self._on_observation)
        subscription(self, self._own.refusal, self._on_refusal)
        self._joining = SealedClient(self, Join, self._names.join_service)
        self._command_pub: Any = None  # there once the agent flies, as the other publishers
        self._radio_pub: Any = None
        self._transition_pub: Any = None  # None unless wanted
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_ASK_PERIOD_S, self._tick, clock=steady)
        self._log_waiting()

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    # Joining a world's fleet.

    def _tick(self) -> None:
        self._world.tick()
        if self._choice.is_open:
            self._prepare(self._choice.go_on)
            return
        if self._inbox is not None and self._inbox.lacks_policy:
            self._join_anew()  # the world has the policy, and answers with it
        self._ask_to_join()

    def _join_anew(self) -> None:
        """Ask the world how things stand: its answer has all that the UAV was sent."""
        if self._is_member:
            self._is_member = False
            self._n_refusals = 0

    @_gives_up_on_error
    def _on_world(self, msg: Any) -> None:
        """Try to join the fleet of a world, by its scenario."""
        self._inbox, self._is_member, self._unfit = None, False, ''
        self._scenario_msg, self._own_policy = msg, None
        self._asked_s, self._n_refusals = -math.inf, 0
        self._prepare(lambda: True)

    @_gives_up_on_error
    def _prepare(self, is_ready: Callable[[], bool]) -> None:
        """Get ready to fly a scenario as soon as it is known by which policy.

        An agent that a world had waits for the scenario after this one, if it cannot fly this.
        """
        try:
            if is_ready():
                self._join_fleet(self._scenario_msg)
        except (ConfigError, PolicyMismatchError) as error:
            if self._published_for != self._scenario_msg.world_instance:
                raise
            self._unfit = str(error)
            self._log_waiting()

    def _join_fleet(self, msg: Any) -> None:
        """Get ready to fly its scenario, and ask for the UAV."""
        scenario = self._checked_scenario(msg)
        briefing, uav = brief(scenario), self._uav - 1
        self._briefing, self._n_sensors = briefing, len(msg.sensor_id)
        policy = self._topic_policy(briefing) or self._choice.policy_for(
            scenario, self._own_policy
        )
        if policy is None:
            self._ask_to_join()  # the world says what else may be chosen, unless that is known
            return
        for line in remarks(policy, scenario):
            self.get_logger().warning(line)
        topic_policy = policy if isinstance(policy, TopicPolicy) else None
        # A learner is to see what its own policy does.
        self._guard = NONE if topic_policy else guard_for(policy, self._guard_after, briefing)
        allocator = allocator_named(self._allocator)
        agent = Agent(briefing, uav, policy, allocator, guard_after=self._guard)
        self._inbox = Inbox(
            agent,
            identity_of(msg).short,
            view_from=convert.view_from_msg,
            radio_from=partial(convert.radio_from_msg, n_cells=scenario.n_cells),
            topic_policy=topic_policy,
        )
        if self._layout is not None or topic_policy is not None:
            self._transitions = TransitionBuilder(self._layout, briefing, uav, msg.fingerprint)
        self._asked_s = -math.inf
        self._n_refusals = 0
        self._ask_to_join()

    def _topic_policy(self, briefing: Briefing) -> TopicPolicy | None:
        """The policy that flies what trainers publish, if that is wanted."""
        if self._policy != TOPIC:
            return None
        refused = self.get_logger().error
        if self._policies is None:
            self._policies = PolicyStore(briefing)
            subscribe_to_trainers(self, self._policies, refused, self._answer_observations)
        else:
            for refusal in self._policies.recheck(briefing):
                refused(refusal)
        return TopicPolicy(self._policies)

    def _checked_scenario(self, msg: Any) -> Scenario:
        """The scenario of a world.

        Raises:
            ConfigError: it reads otherwise here, or has no such UAV.
        """
        try:
            scenario = from_yaml(msg.yaml)
        except ConfigError as error:
            what = 'the scenario of the world is not valid here'
            raise ConfigError(f'{what}: {error.summary}') from error
        if fingerprint(scenario) != msg.fingerprint:
            raise ConfigError(
                f'scenario {scenario.name} reads as {fingerprint(scenario)} here and as '
                f'{msg.fingerprint} in the world: the versions of uav_collect differ'
            )
        if self._uav > scenario.n_uavs:
            raise ConfigError(
                f'UAV {self._uav} is unknown: scenario {scenario.name} has UAVs '
                f'1..{scenario.n_uavs}'
            )
        return scenario

    @property
    def _is_to_choose(self) -> bool:
        """Whether the world is to say first what was refined for its scenario."""
        is_open = self._scenario_msg is not None and self._own_policy is None
        return is_open and self._choice.is_by_missions and not self._unfit

    def _ask_to_join(self) -> None:
        """Ask the world to join its fleet, unless that is done or just was.

        Who is to choose a policy asks as BEST, and again with what it has chosen.
        """
        now_s = time.monotonic()
        if self._is_member or now_s - self._asked_s < _ANSWER_S or self.end_status is not None:
            return
        policy = None if self._inbox is None else self._inbox.agent.policy
        if not (policy or self._is_to_choose) or not self._joining.client.service_is_ready():
            self._log_waiting()
            return
        self._asked_s = now_s
        request = Join.Request(
            world_instance=self._world.instance,
            scenario_fingerprint=self._world.scenario_fingerprint,
            uav=self._uav,
            agent_instance=self._instance,
            host=socket.gethostname(),
            pid=os.getpid(),
            policy=BEST if policy is None else policy.name,
            policy_version='' if policy is None else policy.version,
            allocator=self._allocator,
            guard_after=self._guard,
        )
        take = partial(self._on_own_policy, request) if policy is None else self._on_answer
        self._joining.call(request, take)

    @_gives_up_on_error
    def _on_own_policy(self, request: Any, answer: Any) -> None:
        """Choose, now that the world says what was refined for its scenario; else ask again."""
        asked = request.world_instance, request.scenario_fingerprint
        is_late = asked != (self._world.instance, self._world.scenario_fingerprint)
        if is_late or not self._is_to_choose:
            return
        self._asked_s = -math.inf
        if answer is None or answer.world_instance != request.world_instance:
            return
        if answer.waits_for_policy:
            self._own_policy = answer.policy
            self._prepare(lambda: True)
        elif not answer.retry:
            self._give_up(answer.reason)

    @_gives_up_on_error
    def _on_answer(self, answer: Any) -> None:
        """Fly if the world agrees; else wait, ask again or give up."""
        if self._is_member or self._inbox is None:
            return
        self._asked_s = -math.inf
        if answer is None or answer.world_instance != self._world.instance:
            return  # of somebody who was faster than the one asked for
        if answer.waits_for_policy:
            self._n_refusals = 0
            self._log_waiting(f'the first policy of a trainer on {topics.POLICY.name}')
            return
        if not answer.accepted:
            self._n_refusals += 1
            if not answer.retry or self._n_refusals >= _MOST_REFUSALS:
                self._give_up(answer.reason)
            return
        if self._policies is not None:
            self._policies.add(answer.policy)  # the world has checked it
        self._is_member = True
        self._renew_publishers()
        self._command_pub.publish(convert.greeting_msg(self._instance))
        self.get_logger().info(f'UAV {self._uav} flies, policy {self._inbox.agent.policy.name}')
        self._inbox.replay(answer)
        if self._inbox.doubts_mission:
            self._join_anew()
        self._answer_observations()

    def _renew_publishers(self) -> None:
        """Start without a history: what was latched for a world that is gone confuses the next."""
        if self._published_for == self._world.instance:
            return
        self._published_for = self._world.instance
        for stale in filter(None, (self._command_pub, self._radio_pub, self._transition_pub)):
            self.destroy_publisher(stale)
        self._command_pub = publisher(self, self._own.command)
        self._radio_pub = publisher(self, self._own.radio_tx)
        if self._transitions is not None:
            self._transition_pub = publisher(self, self._own.transition)

    def _log_waiting(self, what: str = '') -> None:
        """Log what the agent waits for, a world unless it says what, but not too often."""
        what = what or (self._unfit and f'another scenario: {self._unfit}')
        if what != self._logged or time.monotonic() - self._logged_s > _WAITING_PERIOD_S:
            self._logged, self._logged_s = what, time.monotonic()
            self.get_logger().info(f'UAV {self._uav}: waiting for {what or self._any_world()}')

    def _any_world(self) -> str:
        """What of all worlds it waits for, for people."""
        return f'a world_sim in {place_of(self._names.namespace)}'

    def _give_up(self, why: str) -> None:
        self.get_logger().error(why)
        self.end(UNUSABLE)

    # Flying.

    @_gives_up_on_error
    def _on_radio(self, msg: Any) -> None:
        if self._inbox is None or self._briefing is None:
            return
        problem = radio_problem(msg, self._briefing, self._uav - 1)
        if problem is None:
            self._inbox.add_radio(msg)
            self._answer_observations()
        else:
            self.warn('radio message refused', f'a radio message is refused: {problem}')

    @_gives_up_on_error
    def _on_observation(self, msg: Any) -> None:
        if self._inbox is None or self._briefing is None:
            return
        problem = observation_problem(msg, self._briefing, self._uav - 1, self._n_sensors)
        problem = problem or self._inbox.add_observation(msg)
        if problem is not None:
            self.warn('observation refused', f'an observation is refused: {problem}')
        elif self._inbox.doubts_mission:
            self._join_anew()
            self._ask_to_join()
        else:
            self._answer_observations()

    def _on_refusal(self, msg: Any) -> None:
        """Say why the world did not do what this agent sent, and make sure to be its agent."""
        if msg.agent_instance == self._instance:
            self.warn('refused by the world', f'{msg.what} refused: {msg.reason}')
            if msg.what == convert.GREETING and self._inbox is not None:
                self._inbox.lose_step()
            self._join_anew()

    @_gives_up_on_error
    def _answer_observations(self) -> None:
        """Decide for each observation that is due, and publish what follows from it."""
        if not self._is_member or self._inbox is None:
            return
        agent = self._inbox.agent
        while (observation := self._inbox.next_observation()) is not None:
            start_s = time.perf_counter()
            view = self._inbox.deliver(observation)
            radio = convert.radio_msg(
                agent.message(view), observation.mission_id, sequence=observation.decision
            )
            radio.stamp = observation.stamp
            self._radio_pub.publish(radio)
            decision = agent.decide(view)
            self._inbox.note(decision)
            if self._transitions is not None:  # before it can be carried out
                transition = self._transitions.transition(observation, view, agent, decision)
                self._transition_pub.publish(transition)
            command = convert.command_msg(decision, observation)
            command.agent_instance = self._instance
            command.policy_version = agent.policy.version
            command.compute_time_s = time.perf_counter() - start_s
            self._command_pub.publish(command)


def _layout_named(name: str) -> AnyLayout | None:
    """The layout that a parameter names; None if it is empty.

    Raises:
        NodeError: there is none of that name.
    """
    if not name:
        return None
    try:
        return layout_named(name)
    except KeyError:
        known = ', '.join(layout.name.lower() for layout in Layout)
        what = f'is unknown; there are {known} and module:Name'
        raise NodeError(f'observation_layout {name!r} {what}') from None
    except UserCodeError as error:
        raise NodeError(f'observation_layout {name!r}: {error}') from error


def main(argv: Sequence[str]) -> int:
    """Run the agent of one UAV; the exit status."""
    arguments = parse_arguments(argument_parser(), argv)
    return run_node(lambda: AgentNode(arguments), argv)

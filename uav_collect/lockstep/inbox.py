"""A UAV's messages in the order in which the world meant them, whatever order they arrive in.

Topics and services are not ordered against each other: an observation says how many radio
messages came before it, and waits for them; the history that a restarted agent gets may be
overtaken by what follows it. What cannot come next in lockstep is refused, and of a mission that
begins before the one in flight is over for this UAV only the world knows whether it is one.
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from uav_collect.lockstep.published_policy import TopicPolicy
from uav_collect.uav.action_codes import HOME
from uav_collect.uav.agent import Agent
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.view import LocalView

_NONE_YET = -1  # number of the mission before the first
_DIGITS = 9  # of a mission's number
_MOST_MISSIONS = 4  # of which messages are kept
_MOST_MESSAGES = 4_000  # of a kind and mission that wait; a topic's history is not as deep


@dataclass
class _MissionMessages:
    """What came of one mission and was not delivered to the agent yet."""

    observations: dict[int, Any] = field(default_factory=dict)  # by decision
    radio: dict[int, Any] = field(default_factory=dict)  # by delivery


class Inbox:
    """Hands an agent one message after the other, mission after mission of one world."""

    def __init__(
        self,
        agent: Agent,
        world: str,
        *,
        view_from: Callable[[Any], LocalView],
        radio_from: Callable[[Any], RadioMessage],
        topic_policy: TopicPolicy | None = None,
    ) -> None:
        """Wait for the first mission of a world.

        Args:
            world: what the ids of its missions begin with, before a dash and a number.
            view_from: the local view in an observation as it was received.
            radio_from: the radio message in what was received as one.
            topic_policy: the agent's policy, if each mission names what is flown.
        """
        self.agent = agent
        self._view_from, self._radio_from = view_from, radio_from
        self._topic_policy = topic_policy
        self._world = world
        self._mission = _NONE_YET  # number of the one that is flown
        self._decision = 0  # the next one
        self._n_heard = 0  # radio messages delivered to the agent
        self._is_in_step = False  # since the world has told what came before
        self._is_over = False  # whether the mission is, for this UAV
        self.doubts_mission = False  # one began that only the world can know of: ask it
        self._messages: defaultdict[int, _MissionMessages] = defaultdict(_MissionMessages)

    def replay(self, answer: Any) -> None:
        """Let the agent live through the mission in flight again, as far as it was answered.

        Args:
            answer: of the world to the request to join.
        """
        mission = self._number(answer.mission_id)
        has_asked_again, self.doubts_mission = self.doubts_mission, False
        if mission < self._mission and (self._is_in_step or not has_asked_again):
            # The next one's first observation overtook the answer, or it was none of the world's.
            self.doubts_mission = not self._is_in_step
            return
        was_in_step, self._is_in_step = self._is_in_step, False
        if mission != self._mission or not was_in_step:
            self._begin(mission)
        heard = {message.delivery: message for message in answer.radio}
        self._kept(mission).radio.update(
            {number: heard[number] for number in heard if number > self._n_heard}
        )
        answered = len(answer.observations) - (1 if answer.decision_pending else 0)
        for observation in answer.observations[self._decision : answered]:
            self.note(self.agent.decide(self.deliver(observation)))
        for observation in answer.observations[answered:]:
            self.add_observation(observation)
        self._is_in_step = True

    def lose_step(self) -> None:
        """Live through the mission anew with the next answer: what was sent did not count."""
        self._is_in_step = False

    def note(self, decision: Decision) -> None:
        """Take note of what the agent decided on what was delivered last."""
        self._is_over = decision.action == HOME

    def add_radio(self, msg: Any) -> None:
        """Keep a radio message until the observation that it came before."""
        mission = self._number(msg.mission_id)
        if mission < self._mission or mission < 0:
            return
        if self._is_in_step and mission > self._mission + 1:
            return
        n_heard = self._n_heard if mission == self._mission else 0
        if 0 < msg.delivery - n_heard <= _MOST_MESSAGES:
            self._kept(mission).radio[msg.delivery] = msg

    def add_observation(self, msg: Any) -> str | None:
        """Keep an observation until its turn; the first of a later mission begins that one.

        Returns:
            Why it is refused; None if it is kept, or is of the past.
        """
        mission = self._number(msg.mission_id)
        if mission < max(self._mission, 0):
            return None
        decision = self._decision if mission == self._mission else 0
        if msg.decision < decision:
            return None
        if msg.terminated:
            self._is_over |= mission == self._mission
            return None
        if msg.decision > decision + (0 if self._is_in_step else _MOST_MESSAGES):
            return f'decision {msg.decision} does not come next, but decision {decision}'
        is_next = mission == self._mission + 1 and self._is_over
        if self._is_in_step and mission > self._mission and not is_next:
            self.doubts_mission = True  # if it is one, the world's answer has what is dropped here
            return None
        self._kept(mission).observations[msg.decision] = msg
        if mission > self._mission and msg.decision == 0:
            self._begin(mission)
        return None

    def next_observation(self) -> Any | None:
        """The observation to answer next, if it and all that came before it are here."""
        messages = self._messages[self._mission]
        msg = messages.observations.get(self._decision)
        if msg is None or self.lacks_policy:
            return None
        awaited = range(self._n_heard + 1, msg.n_radio_delivered + 1)
        return msg if all(number in messages.radio for number in awaited) else None

    @property
    def lacks_policy(self) -> bool:
        """Whether the mission's first observation waits for the policy that it names."""
        msg = self._messages[self._mission].observations.get(self._decision)
        policy = self._topic_policy
        return msg is not None and policy is not None and not policy.is_ready_for(msg)

    def deliver(self, observation: Any) -> LocalView:
        """Let the agent hear what came before an observation, then see it."""
        messages = self._messages[self._mission]
        for number in range(self._n_heard + 1, observation.n_radio_delivered + 1):
            self.agent.hear(self._radio_from(messages.radio.pop(number)))
        self._n_heard = observation.n_radio_delivered
        messages.observations.pop(observation.decision, None)
        self._decision = observation.decision + 1
        view = self._view_from(observation)
        if self._topic_policy is not None and observation.decision == 0:
            self._topic_policy.select(observation)
        self.agent.observe(view)
        return view

    def _begin(self, mission: int) -> None:
        """Go on to a mission; what is left of those before it is of no more use."""
        self._mission = mission
        self._decision = self._n_heard = 0
        self._is_over = False
        for past in [number for number in self._messages if number < mission]:
            del self._messages[past]
        self.agent.begin()

    def _kept(self, mission: int) -> _MissionMessages:
        """The messages of a mission, which may take the room of those of an earlier one."""
        if mission not in self._messages and len(self._messages) >= _MOST_MISSIONS:
            del self._messages[min(self._messages)]
        return self._messages[mission]

    def _number(self, mission_id: str) -> int:
        """Running number of a mission of this world; of another world, one before them all."""
        world, _, number = mission_id.rpartition('-')
        is_number = number.isdecimal() and number.isascii() and len(number) <= _DIGITS
        return int(number) if world == self._world and is_number else _NONE_YET - 1

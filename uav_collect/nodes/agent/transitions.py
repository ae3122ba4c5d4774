"""Reports to learners what an agent decided, and from what."""

from typing import Any

from uav_collect.kernels.arrays import Row
from uav_collect.lockstep.published_policy import TopicPolicy
from uav_collect.nodes import convert
from uav_collect.uav.action_codes import BY_POLICY, HOME
from uav_collect.uav.agent import Agent
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.messages import Decision
from uav_collect.uav.observation import AnyLayout, Observer
from uav_collect.uav.view import LocalView


class TransitionBuilder:
    """Builds the messages about one UAV's decisions."""

    def __init__(
        self, layout: AnyLayout | None, briefing: Briefing, uav: int, scenario_fingerprint: str
    ) -> None:
        """Build the transitions of a UAV, by index.

        Args:
            layout: that learners asked for; None for that of the policy which is followed.
        """
        self._layout = layout
        self._briefing = briefing
        self._uav = uav
        self._scenario = scenario_fingerprint
        self._observers: dict[AnyLayout, Observer] = {}

    def transition(
        self, observation: Any, view: LocalView, agent: Agent, decision: Decision
    ) -> Any:
        """The message about a decision just taken."""
        layout = self._layout_of(agent)
        encoded = self._chosen_from(layout, agent, decision)
        if encoded is None:
            encoded = self._observer(layout).observe(agent.belief, view, agent.legal)
        return convert.transition_msg(
            observation,
            uav=self._uav,
            layout=layout.label,
            scenario_fingerprint=self._scenario,
            policy_version=agent.policy.version,
            belief=agent.belief,
            encoded=encoded,
            legal=agent.legal,
            action=decision.action,
        )

    def _layout_of(self, agent: Agent) -> AnyLayout:
        """The layout that learners asked for, or that of the policy which flies."""
        if self._layout is not None:
            return self._layout
        if not isinstance(agent.policy, TopicPolicy) or agent.policy.current is None:
            raise RuntimeError('a layout is only implied by the policy of a trainer')
        return agent.policy.current.learned.frozen.header.layout

    def _chosen_from(
        self, layout: AnyLayout, agent: Agent, decision: Decision
    ) -> Row[float] | None:
        """The observation as the policy has encoded it, if it did: that takes a while."""
        policy = agent.policy
        if decision.reason != BY_POLICY or decision.action == HOME:  # that it may not have to see
            return None
        if not isinstance(policy, TopicPolicy):
            return None
        learned = None if policy.current is None else policy.current.learned
        if learned is None or learned.frozen.header.layout != layout:
            return None
        return learned.observation

    def _observer(self, layout: AnyLayout) -> Observer:
        """What encodes observations in a layout; the same one for all decisions."""
        if layout not in self._observers:
            self._observers[layout] = Observer(layout, self._briefing, self._uav)
        return self._observers[layout]

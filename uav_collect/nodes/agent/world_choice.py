"""Which world an agent flies for: the earliest of those that vouch for themselves."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import math
import time
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.subscription import Subscription
from uav_collect.lockstep.flown_scenario import FlownScenario
from uav_collect.nodes.identity import identity_of, NO_WORLD, other_world, silent_world
from uav_collect.nodes.parameters import world_instance_of
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.topics import subscription, Topic
from uav_collect.nodes.vouching import Vouching

_GIVES_WAY_S = 10.0  # a later world is gone by then, or else it is the earlier one that is gone


class WorldChoice:
    """Sees worlds come and go; a later one, which has to give way, is ignored."""

    def __init__(self, node: ProcessNode, topic: Topic, fly_for: Callable[[Any], None]) -> None:
        """Subscribe to the scenarios of worlds.

        Args:
            node: that chooses; by its parameter `world_instance`, if it has that and it is given,
                only the world with that instance may be chosen.
            topic: on which worlds publish their scenarios.
            fly_for: gets the scenario of a world that is chosen.

        Raises:
            NodeError: the parameter is no UUID.
        """
        self._node = node
        self._topic = topic
        self._fly_for = fly_for
        self._wanted = world_instance_of(node)
        self._world = NO_WORLD
        self._flown = FlownScenario()
        self._vouching = Vouching(node)
        self._look_at_s = math.inf
        self._again: Subscription | None = None
        watch = SubscriptionEventCallbacks(liveliness=self._on_liveliness)
        subscription(node, topic, self._on_scenario, on_event=watch)

    @property
    def scenario_fingerprint(self) -> str:
        """Of the scenario that the world has."""
        return self._flown.fingerprint

    @property
    def instance(self) -> str:
        """The world's; empty before the first one. It stays when the world is gone."""
        return self._world.instance

    @property
    def is_there(self) -> bool:
        """Whether there is a world, as far as is known."""
        return math.isfinite(self._world.started_s)

    def tick(self) -> None:
        """Look whether the world is still there, if that is in doubt; call it often."""
        if time.monotonic() < self._look_at_s:
            return
        self._look_at_s = math.inf
        self._world = replace(self._world, started_s=math.inf)  # until it is heard again, if it is
        if self._again is not None:
            self._node.retire(self._again)
        self._again = subscription(self._node, self._topic, self._on_scenario)

    def _on_scenario(self, msg: Any) -> None:
        world, before = identity_of(msg), self._world
        if self._wanted not in ('', world.instance):
            self._node.warn('other world', other_world(msg))
        elif world.gives_way_to(before):
            self._look_within(_GIVES_WAY_S)
        elif self._flown.is_news(world.instance, msg.fingerprint) or world != before:
            answered = partial(self._on_answer, msg)
            self._vouching.ask(
                msg.vouch_service,
                world.instance,
                '',
                answered,
                scenario_fingerprint=msg.fingerprint,
            )

    def _on_answer(self, msg: Any, is_there: bool) -> None:
        """Fly for a world that answers, unless a better one has come meanwhile."""
        world, before = identity_of(msg), self._world
        if not is_there:
            self._node.warn('no world', silent_world(msg))
            self._look_within(_GIVES_WAY_S)  # it may only have been too busy to answer
        elif not world.gives_way_to(before):
            self._world = world
            if self._flown.take(world.instance, msg.fingerprint):
                self._fly_for(msg)

    def _on_liveliness(self, event: Any) -> None:
        """Look again: a world is gone, or only too slow to be heard; its instance says which."""
        if self._world == NO_WORLD:
            return
        if event.alive_count_change < 0:
            self._look_within(0.0)
            self._node.get_logger().info('a world is gone; looking for the one to fly for')
        elif event.alive_count_change == 0:  # perhaps one died while another came
            self._look_within(_GIVES_WAY_S)

    def _look_within(self, time_s: float) -> None:
        self._look_at_s = min(self._look_at_s, time.monotonic() + time_s)

"""Receives what trainers publish."""

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from uav_collect.lockstep.published_policy import PolicyStore
from uav_collect.nodes import topics


def subscribe_to_trainers(
    node: Node,
    store: PolicyStore,
    on_refusal: Callable[[str], None],
    on_policy: Callable[[], None] | None = None,
) -> None:
    """Keep in a store what trainers publish.

    Args:
        node: that subscribes.
        store: to keep policies in.
        on_refusal: gets why a policy is not kept.
        on_policy: called after each message.
    """

    def on_message(msg: Any) -> None:
        refusal = store.add(msg)
        if refusal is not None:
            on_refusal(refusal)
        if on_policy is not None:
            on_policy()

    def on_liveliness(event: Any) -> None:
        if event.alive_count == 0:
            store.mark_trainer_gone()

    events = SubscriptionEventCallbacks(liveliness=on_liveliness)
    topics.subscription(node, topics.POLICY, on_message, on_event=events)

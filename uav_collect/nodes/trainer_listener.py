"""Hearing what trainers publish."""

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from uav_collect.lockstep.published_policy import Shelf
from uav_collect.nodes import topics


def follow_trainers(
    node: Node,
    shelf: Shelf,
    on_refusal: Callable[[str], None],
    on_policy: Callable[[], None] | None = None,
) -> None:
    """Put what trainers publish on a shelf.

    Args:
        node: that listens.
        shelf: to keep policies on.
        on_refusal: told why a policy is not kept.
        on_policy: called after each message.
    """

    def note(msg: Any) -> None:
        refusal = shelf.note(msg)
        if refusal is not None:
            on_refusal(refusal)
        if on_policy is not None:
            on_policy()

    def watch(event: Any) -> None:
        if event.alive_count == 0:
            shelf.abandon()

    events = SubscriptionEventCallbacks(liveliness=watch)
    topics.subscription(node, topics.POLICY, note, on_event=events)

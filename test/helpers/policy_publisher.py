"""The trainer's side of /trainer/policy, and the same missions in this process."""

from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import hashlib
from typing import Any

import numpy as np
from processes import DEADLINE_S
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.policy_file import policy_bytes
from uav_collect.uav.policy_network import flown_version, FrozenPolicy

HOVER_SHARE = 0.6


def explored_logs(
    scenario: Scenario,
    seeds: Sequence[int],
    frozen: FrozenPolicy,
    epsilon: float,
    allocator: str = 'exact',
    advice_share: float = 0.0,
) -> list[bytes]:
    """The logs of missions flown at once in this process, with exploration."""
    rules = VectorEnvConfig(layout=frozen.header.layout, allocator=allocator, is_logged=True)
    env = VectorEnv(build_site(scenario), seeds, rules)
    n_uavs = scenario.n_uavs
    hidden = frozen.new_hidden(len(seeds) * n_uavs)
    chosen = np.zeros(len(seeds), dtype=np.int64)
    decisions = env.decisions
    while len(waiting := np.flatnonzero(decisions.uav != NONE)):
        rows = waiting * n_uavs + decisions.uav[waiting]
        values, hidden[rows] = frozen.step(decisions.observation[waiting], hidden[rows])
        of = decisions.legal[waiting], decisions.frame[waiting], decisions.advice[waiting]
        chosen[waiting] = frozen.actions(values, *of)
        explored = env.explore(epsilon, HOVER_SHARE, advice_share)
        decisions = env.step(np.where(explored == NONE, chosen, explored))
    name = flown_version(frozen.header.version, epsilon)
    return [env.mission_log(world, name).to_jsonl() for world in range(len(seeds))]


def policy_fields(frozen: FrozenPolicy, sequence: int, epsilon: float) -> dict[str, Any]:
    """What a trainer publishes of a policy, by field, but for the time."""
    content = policy_bytes(frozen)
    return {
        'version': frozen.header.version,
        'trainer_instance': 'test-trainer',
        'sequence': sequence,
        'content': array('B', content),
        'sha256': hashlib.sha256(content).hexdigest(),
        'epsilon': epsilon,
        'hover_share': HOVER_SHARE,
    }


class PolicyPublisher:
    """Publishes policies as a trainer does."""

    def __init__(self, node: Any) -> None:  # noqa: ANN401
        from uav_collect.nodes import topics
        from uav_collect.nodes.topics import publisher
        from uav_collect_msgs.msg import Policy

        self._message = Policy
        self._node = node
        self._publisher = publisher(node, topics.POLICY)
        self._sequence = 0

    def publish(self, frozen: FrozenPolicy, epsilon: float = 0.0, **values: object) -> None:
        """Publish a policy, or a message with other values."""
        self._sequence += 1
        fields = policy_fields(frozen, self._sequence, epsilon) | values
        stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(self._message(stamp=stamp, **fields))

    def wait_until_heard(self) -> None:
        """Wait until all who listen have what was published."""
        from rclpy.duration import Duration

        assert self._publisher.wait_for_all_acked(Duration(seconds=DEADLINE_S))

    def vanish(self) -> None:
        """Be gone, with all that was latched."""
        self._node.destroy_publisher(self._publisher)


@contextmanager
def policy_publisher(*topics: Any) -> Iterator[tuple[PolicyPublisher, Any]]:  # noqa: ANN401
    """A trainer in the ROS domain of the test, and a listener to topics of the table."""
    from fleets import listener

    with listener(*topics) as listening:
        yield PolicyPublisher(listening.node), listening

"""A bad channel between a fleet and a learner, as a process: world a comes out of it as b.

Of epochs and transitions it drops 5 %, doubles 10 %, and holds 10 % back behind up to 200 others.
Ends with SIGINT and writes what it has done as one line of JSON.
"""

from collections import Counter
from functools import partial
import json
import sys
from typing import Any

import numpy as np
from uav_collect.nodes import topics
from uav_collect.nodes.process import ProcessNode, run_node
from uav_collect.nodes.topics import publisher, subscription, Topic

_DROPPED, _DOUBLED, _HELD = 0.05, 0.1, 0.1
_MOST_HELD = 200  # messages that come before one that is held


class Relay(ProcessNode):
    """Publishes what one world does as another."""

    def __init__(self, n_uavs: int, seed: int) -> None:
        super().__init__('relay')
        self._rng = np.random.default_rng(seed)
        self._n_heard = 0
        self._held: list[tuple[float, Any, Any]] = []  # until when, publisher, message
        self._counts: Counter[str] = Counter()
        heard, said = (topics.world_topics(namespace) for namespace in ('/a', '/b'))
        for source, sink in ((heard.scenario, said.scenario), (heard.mission, said.mission)):
            subscription(self, source, publisher(self, sink).publish)
        for uav in range(1, n_uavs + 1):
            self._pass_on(heard.uav(uav).transition, said.uav(uav).transition)
        self._pass_on(heard.epoch, said.epoch)
        self.get_logger().info('relaying')

    def on_stop(self) -> None:
        """Say what was done."""
        sys.stdout.write(json.dumps(self._counts) + '\n')
        sys.stdout.flush()

    def _pass_on(self, heard: Topic, said: Topic) -> None:
        subscription(self, heard, partial(self._on_message, publisher(self, said)))

    def _on_message(self, said: Any, message: Any) -> None:  # noqa: ANN401
        self._n_heard += 1
        self._counts['heard'] += 1
        if self._rng.random() < _DROPPED:
            self._counts['dropped'] += 1
        else:
            is_doubled = self._rng.random() < _DOUBLED
            self._counts['doubled'] += is_doubled
            for _ in range(1 + is_doubled):
                self._send_or_hold(said, message)
        due = [each for each in self._held if each[0] <= self._n_heard]
        self._held = [each for each in self._held if each[0] > self._n_heard]
        for _, late, held in due:
            late.publish(held)

    def _send_or_hold(self, said: Any, message: Any) -> None:  # noqa: ANN401
        if self._rng.random() < _HELD:
            self._counts['held'] += 1
            until = self._n_heard + self._rng.uniform(0.0, _MOST_HELD)
            self._held.append((until, said, message))
        else:
            said.publish(message)


if __name__ == '__main__':
    sys.exit(run_node(lambda: Relay(int(sys.argv[1]), int(sys.argv[2])), sys.argv[3:]))

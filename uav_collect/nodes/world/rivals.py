"""Other worlds of the same name in the ROS domain: of two, the later one gives way."""

from collections import Counter
from functools import partial
from typing import Any

from uav_collect.nodes.identity import identity_of, rival_warning, silent_world, WorldIdentity
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.topics import subscription, Topic
from uav_collect.nodes.vouching import Vouching

_MOST_ASKED = 12  # times, of a world that does not answer: a minute
_MOST_SILENT = 8  # worlds that are asked again


class RivalWatch:
    """Hears the scenarios of other worlds, and asks them whether they are there.

    A recording that is played back publishes a scenario too, and nobody gives way to it.
    """

    def __init__(self, node: ProcessNode, topic: Topic, identity: WorldIdentity) -> None:
        """Listen to scenarios on behalf of the world with an identity."""
        self._node = node
        self._identity = identity
        self._vouching = Vouching(node)
        self._n_asked = 0
        self._silent: Counter[str] = Counter()  # how often which world did not answer
        self.is_open = False  # whether this world has opened
        self.gives_way = False
        subscription(node, topic, self._on_scenario)

    @property
    def is_waiting(self) -> bool:
        """Whether a world was heard that has not answered yet."""
        return self._n_asked > 0

    def _on_scenario(self, msg: Any) -> None:
        if identity_of(msg).instance != self._identity.instance:
            self._ask(msg)

    def _ask(self, msg: Any) -> None:
        """Ask a world; one that is silent, as a recording played back, is waited for once."""
        instance = identity_of(msg).instance
        is_awaited = not self.is_open and instance not in self._silent
        self._n_asked += is_awaited
        answered = partial(self._on_answer, msg, is_awaited)
        self._vouching.ask(msg.vouch_service, instance, '', answered)

    def _on_answer(self, msg: Any, is_awaited: bool, is_there: bool) -> None:
        self._n_asked -= is_awaited
        if not is_there:
            instance = identity_of(msg).instance
            self._silent[instance] += 1
            self._node.warn('no world', silent_world(msg))
            if self._silent[instance] < _MOST_ASKED and len(self._silent) <= _MOST_SILENT:
                self._ask(msg)  # it may only have been too busy
            return
        gives_way = not self.is_open or self._identity.gives_way_to(identity_of(msg))
        self._node.warn('second world', rival_warning(msg, gives_way=gives_way))
        self.gives_way |= gives_way

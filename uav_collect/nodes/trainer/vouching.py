"""Asks worlds which of the missions that a trainer hears of are their own."""

from collections import defaultdict, deque, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from uav_collect.ingest.reports import MissionReport
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.vouching import Vouching

_MOST_WORLDS = 64  # that are remembered, the latest ones
_MOST_CHARACTERS = 64  # of an instance; one is a UUID
_ANSWER_S = 15.0  # a world that flies on a busy machine may be slow to answer; nobody waits for it
_PATIENCE = 300  # looks until a mission is given up whose world says nothing of itself


@dataclass(eq=False)
class _Asked:
    """A question that a world was asked."""

    on_answer: Callable[[bool], None]
    answer: bool | None = None  # once it is known


@dataclass(eq=False)
class _Unasked:
    """A mission whose world has not said yet where it vouches for itself."""

    report: MissionReport
    on_answer: Callable[[bool], None]
    looks_left: int = _PATIENCE


class MissionVouching:
    """Knows where worlds vouch for their missions, and asks them there."""

    def __init__(self, node: ProcessNode) -> None:
        """Ask on behalf of a node."""
        self._vouching = Vouching(node)
        self._services: OrderedDict[str, str] = OrderedDict()  # by instance of the world
        self._vouched: OrderedDict[str, None] = OrderedDict()  # worlds that have for a mission
        self._asked: defaultdict[str, deque[_Asked]] = defaultdict(deque)  # by instance, in order
        self._unasked: list[_Unasked] = []

    def note_world(self, msg: Any) -> None:
        """Keep where the world of a Scenario message vouches, and ask what waits for that."""
        instance: str = msg.world_instance
        if len(instance) > _MOST_CHARACTERS:
            return
        self._services[instance] = msg.vouch_service
        self._services.move_to_end(instance)
        if len(self._services) > _MOST_WORLDS:
            self._services.popitem(last=False)
        for each in [it for it in self._unasked if it.report.world_instance == instance]:
            self._unasked.remove(each)
            self.ask(each.report, each.on_answer)

    def ask(self, report: MissionReport, on_answer: Callable[[bool], None]) -> None:
        """Ask the world that a mission names whether it is its own; the answer comes later.

        Those of one world come in the order of the questions, whatever packets were lost: what is
        learned depends on the order of missions. Where no answer comes, a mission is the world's
        own if the same process has vouched for one before.
        """
        instance = report.world_instance
        service = self._services.get(instance)
        if service is not None:
            self._services.move_to_end(instance)
        if service is None:
            self._unasked.append(_Unasked(report, on_answer))
            return
        asked = _Asked(on_answer)
        self._asked[instance].append(asked)
        self._vouching.ask(
            service,
            instance,
            report.mission_id,
            partial(self._on_answer, instance, asked),
            lambda: self._on_answer(instance, asked, instance in self._vouched),
            answer_s=_ANSWER_S,
        )

    def _on_answer(self, instance: str, asked: _Asked, is_own: bool) -> None:
        """Keep in mind who has vouched: one that dies has no time for its last missions."""
        if is_own:
            self._vouched[instance] = None
            self._vouched.move_to_end(instance)
            if len(self._vouched) > _MOST_WORLDS:
                self._vouched.popitem(last=False)
        asked.answer = is_own
        queue = self._asked[instance]
        while queue and queue[0].answer is not None:
            first = queue.popleft()
            first.on_answer(bool(first.answer))
        if not queue:
            self._asked.pop(instance, None)

    def look(self) -> None:
        """Give up missions whose world has been silent for many looks."""
        for each in [*self._unasked]:
            each.looks_left -= 1
            if each.looks_left <= 0:
                self._unasked.remove(each)
                each.on_answer(False)

"""Asks worlds whether they live and a mission is theirs: a recording played back cannot answer."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidServiceNameException
from rclpy.task import Future
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.sealing import SealedClient
from uav_collect_msgs.srv import Vouch

ANSWER_S = 5.0  # DDS repeats lost packets every 3 s
_LOOK_S = 0.02
_MOST_CLIENTS = 64
_MOST_QUESTIONS = 10_000


@dataclass(eq=False)
class _Question:
    service: str
    world_instance: str
    mission_id: str
    scenario_fingerprint: str
    on_answer: Callable[[bool], None]
    on_silence: Callable[[], None]
    looks_left: int  # and no time: a node that is busy itself does not look either
    future: Future | None = None


class Vouching:
    """The questions of one node that worlds have not answered yet."""

    def __init__(self, node: ProcessNode) -> None:
        """Ask on behalf of a node."""
        self._node = node
        self._clients: OrderedDict[str, SealedClient] = OrderedDict()  # by service, latest last
        self._open: list[_Question] = []
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        # It never stops: one that is cancelled in its own callback may not be started again.
        node.create_timer(_LOOK_S, self._look, clock=steady)

    def ask(
        self,
        service: str,
        world_instance: str,
        mission_id: str,
        on_answer: Callable[[bool], None],
        on_silence: Callable[[], None] | None = None,
        *,
        scenario_fingerprint: str = '',
        answer_s: float = ANSWER_S,
    ) -> None:
        """Ask a world whether it lives and, unless `mission_id` is empty, whether that is its own.

        Args:
            service: as the world's Scenario message names it.
            world_instance: of that message.
            on_answer: called once, later: with False if nobody answers in time.
            on_silence: called instead if nobody answers in time.
            scenario_fingerprint: the world is to have this scenario now; empty: any.
            answer_s: how long to wait for the answer [s].
        """
        silent = partial(on_answer, False) if on_silence is None else on_silence
        asked = (service, world_instance, mission_id, scenario_fingerprint)
        question = _Question(*asked, on_answer, silent, round(answer_s / _LOOK_S))
        if len(self._open) >= _MOST_QUESTIONS:
            question.looks_left = 0
        self._open.append(question)

    def _look(self) -> None:
        """Ask what can be asked by now, and give up what was not answered."""
        for question in [*self._open]:
            if question.looks_left <= 0:
                self._open.remove(question)
                client = self._clients.get(question.service)
                if client is not None and question.future is not None:
                    client.client.remove_pending_request(question.future)
                question.on_silence()
            elif question.future is None:
                self._send(question)
            question.looks_left -= 1

    def _send(self, question: _Question) -> None:
        client = self._client(question.service)
        if client is None:
            self._answer(question, is_vouched=False)
        elif client.client.service_is_ready():
            request = Vouch.Request(mission_id=question.mission_id)
            question.future = client.call(request, partial(self._on_done, question))

    def _on_done(self, question: _Question, answer: Any) -> None:
        if question not in self._open:
            return
        if answer is None:  # of somebody else: ask again, as long as there is time
            question.future = None
        else:
            self._answer(question, _is_confirmed(question, answer))

    def _client(self, service: str) -> SealedClient | None:
        """The client of a service; None if there cannot be one of that name."""
        if service not in self._clients:
            try:
                self._clients[service] = SealedClient(self._node, Vouch, service)
            except (InvalidServiceNameException, ValueError):
                return None
            if len(self._clients) > _MOST_CLIENTS:
                _, oldest = self._clients.popitem(last=False)
                self._node.destroy_client(oldest.client)
        self._clients.move_to_end(service)
        return self._clients[service]

    def _answer(self, question: _Question, is_vouched: bool) -> None:
        self._open.remove(question)
        question.on_answer(is_vouched)


def _is_confirmed(question: _Question, answer: Any) -> bool:
    if answer.world_instance != question.world_instance:
        return False
    if '' != question.scenario_fingerprint != answer.scenario_fingerprint != '':
        return False  # a recording of this world is played back, from before it changed
    return bool(answer.is_own) or not question.mission_id

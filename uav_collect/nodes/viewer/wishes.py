"""What pages ask of the world, from the thread that serves them to the world and back."""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Empty, Full, Queue
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from uav_collect.film.server import Page
from uav_collect.film.steering import Wish
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.sealing import SealedClient
from uav_collect.nodes.topics import WorldTopics
from uav_collect_msgs.srv import ControlMission

_ASKED = ControlMission.Request
_COMMANDS = {
    **{'start': _ASKED.START, 'abort': _ASKED.ABORT},
    **{'pause': _ASKED.PAUSE, 'resume': _ASKED.RESUME, 'step': _ASKED.STEP},
}
_PACE = 'real_time_factor'  # parameter of the world
_MOST_WAITING = 64
_MOST_LOOKS = 100  # for a world to be there: some seconds

Tell = Callable[[Page, str], None]


class PageWishes:
    """Those that wait to be handed on."""

    def __init__(self, node: ProcessNode, names: WorldTopics, *, may_steer: bool) -> None:
        """Ask on behalf of a node, if pages may steer."""
        self.may_steer = may_steer
        self._waiting: Queue[tuple[Wish, Page]] = Queue(_MOST_WAITING)
        self._open: deque[tuple[Wish, Page]] = deque()
        self._n_looks = 0  # in vain, for the first of them
        self._control: SealedClient | None = None
        self._parameters: Any = None
        if may_steer:
            self._control = SealedClient(node, ControlMission, names.control_service)
            service = f'{names.namespace}/world_sim/set_parameters'
            self._parameters = node.create_client(SetParameters, service)

    def put(self, wish: Wish, page: Page) -> str:
        """Take a wish, from any thread; what to say at once, or nothing."""
        if not self.may_steer:
            return 'this page only looks: start the viewer with --control to steer'
        try:
            self._waiting.put_nowait((wish, page))
        except Full:
            return 'too much is asked at once'
        return ''

    def hand_on(self, world: str, tell: Tell) -> None:
        """Ask a world, by its instance, for all that waits; what it answers is told later."""
        with suppress(Empty):
            while len(self._open) < _MOST_WAITING:
                self._open.append(self._waiting.get_nowait())
        while self._open:
            wish, page = self._open[0]
            if not self._ask(wish, world, partial(tell, page)):
                self._n_looks += 1
                if self._n_looks < _MOST_LOOKS:
                    return  # its services may not be known yet
                for _, waiting in self._open:
                    tell(waiting, 'no world is there to do it')
                self._open.clear()
                self._n_looks = 0
                return
            self._open.popleft()
            self._n_looks = 0

    def _ask(self, wish: Wish, world: str, tell: Callable[[str], None]) -> bool:
        if wish.command == 'pace':
            return self._set_pace(wish.pace, tell)
        if self._control is None or not (world and self._control.client.service_is_ready()):
            return False
        request = _ASKED(command=_COMMANDS[wish.command], seed=wish.seed)
        self._control.call(request, partial(self._on_answer, tell), world)
        return True

    def _on_answer(self, tell: Callable[[str], None], answer: Any) -> None:
        if answer is None:  # of somebody else
            tell(f'no answer counts: {self._control.refusal}' if self._control else '')
        else:
            tell(answer.message if answer.success else f'refused: {answer.message}')

    def _set_pace(self, pace: float, tell: Callable[[str], None]) -> bool:
        if not self._parameters.service_is_ready():
            return False
        wanted = Parameter(_PACE, value=pace).to_parameter_msg()
        future = self._parameters.call_async(SetParameters.Request(parameters=[wanted]))
        future.add_done_callback(partial(_on_set, pace, tell))
        return True


def _on_set(pace: float, tell: Callable[[str], None], future: Any) -> None:
    [result] = future.result().results
    how = f'{pace:g} times real time' if pace else 'as fast as the fleet decides'
    tell(f'the world flies {how}' if result.successful else f'refused: {result.reason}')

"""Asks a world to do something, with a seal: what no general tool of ROS can."""

import argparse
from collections.abc import Callable, Sequence
import sys
import time
from typing import Any

from rclpy.clock import Clock, ClockType
from uav_collect.config.arguments import Parser
from uav_collect.errors import ConfigError
from uav_collect.limits import FAILED, MAX_SEED, MAX_UAVS
from uav_collect.lockstep.asking import Asking, PATIENCE_S
from uav_collect.nodes.agent.world_choice import WorldChoice
from uav_collect.nodes.identity import place_of
from uav_collect.nodes.parameters import add_world_option
from uav_collect.nodes.process import parse_arguments, ProcessNode, run_node
from uav_collect.nodes.sealing import SealedClient
from uav_collect.nodes.topics import world_of, world_topics
from uav_collect.scenario.load import load
from uav_collect_msgs.srv import ControlMission, InjectFault

_DESCRIPTION = """
Asks a world to start or abort a mission, to pause, to resume, to do one event more while it is
paused, or to inject a fault, and says what it answers: exit status 0 if it does so, 1 if it does
not or none answers. With UAV_COLLECT_KEY_FILE the request has the seal that the world wants then.
"""
_ASKED = ControlMission.Request
_COMMANDS = {
    **{'start': _ASKED.START, 'abort': _ASKED.ABORT},
    **{'pause': _ASKED.PAUSE, 'resume': _ASKED.RESUME, 'step': _ASKED.STEP},
}
_INJECT = 'inject'
_TICK_S = 0.05
_REPEATABLE = (_ASKED.PAUSE, _ASKED.RESUME)  # a second one changes nothing


class ControlNode(ProcessNode):
    """Finds a world, asks it once, and ends with its answer."""

    def __init__(self, world: str, request: Any, patience_s: float) -> None:
        """Look for a world.

        Args:
            world: its name; empty for that without a name.
            request: of ControlMission or InjectFault.
            patience_s: how long to look for it and to wait for its answer [s].
        """
        super().__init__('control', namespace=world)
        names = world_topics(world_of(self.get_namespace()))
        self._request = request
        is_fault = isinstance(request, InjectFault.Request)
        service_type = InjectFault if is_fault else ControlMission
        service = names.inject_service if is_fault else names.control_service
        self._client = SealedClient(self, service_type, service)
        self._choice = WorldChoice(self, names.scenario, lambda _: None)
        is_repeatable = not is_fault and request.command in _REPEATABLE
        self._asking = Asking(
            is_repeatable=is_repeatable,
            begun_s=time.monotonic(),
            place=place_of(names.namespace),
            patience_s=patience_s,
        )
        self.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tick(self) -> None:
        self._choice.tick()
        now_s, world = time.monotonic(), self._choice.instance
        complaint = self._asking.complaint(now_s)
        if complaint is not None:
            self.get_logger().error(complaint)
            self.end(FAILED)
        elif self._client.client.service_is_ready() and self._asking.asks(world, now_s):
            self._client.call(self._request, self._on_answer, world)

    def _on_answer(self, answer: Any) -> None:
        if answer is None:  # of somebody else
            self._asking.refusal = self._client.refusal
            return
        sys.stdout.write(f'{answer.message}\n')
        self.end(0 if answer.success else FAILED)


def main(argv: Sequence[str]) -> int:
    """Ask, and wait for the answer; the exit status."""
    parser = Parser(prog='control', description=_DESCRIPTION)
    commands = [*_COMMANDS, _INJECT]
    parser.add_argument('command', choices=commands, help='what the world is to do')
    parser.add_argument(
        '--seed', type=_whole(MAX_SEED), default=0, metavar='N', help='mission seed of start (0)'
    )
    parser.add_argument(
        '--scenario',
        type=_scenario_text,
        metavar='NAME|FILE',
        help='scenario of start: one by its name, or a YAML file (that which the world has)',
    )
    parser.add_argument(
        '--uav', type=_whole(MAX_UAVS), default=0, metavar='N', help='id of the UAV of inject'
    )
    parser.add_argument('--fault', default='', metavar='KIND', help='gone, silent or slow')
    parser.add_argument(
        '--patience',
        type=float,
        default=PATIENCE_S,
        metavar='S',
        help='how long to look for a world and to wait for its answer [s] (%(default)g)',
    )
    add_world_option(parser)
    given = parse_arguments(parser, argv)
    return run_node(lambda: ControlNode(given.world, _request(given), given.patience), argv)


def _request(given: argparse.Namespace) -> Any:
    if given.command == _INJECT:
        return InjectFault.Request(uav=given.uav, fault=given.fault)
    scenario = given.scenario or ''
    return _ASKED(command=_COMMANDS[given.command], seed=given.seed, scenario=scenario)


def _scenario_text(name: str) -> str:
    """The resolved text of a scenario of this machine."""
    try:
        return load(name).to_yaml()
    except ConfigError as error:
        raise argparse.ArgumentTypeError(' '.join(str(error).split())) from error


def _whole(high: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        if not text.isdecimal() or int(text) > high:
            allowed = f'a whole number from 0 to {high}'
            raise argparse.ArgumentTypeError(f'{text!r} must be {allowed}')
        return int(text)

    return parse

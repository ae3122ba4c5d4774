"""Shows missions in flight in browsers, and hands on what their pages ask of the world."""

import argparse
from collections.abc import Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from uav_collect.config.arguments import Parser
from uav_collect.errors import ConfigError, FilmError, NodeError, RefusedError
from uav_collect.film.live import live_page, LiveFilm
from uav_collect.film.server import PageServer
from uav_collect.nodes.agent.world_choice import WorldChoice
from uav_collect.nodes.parameters import (
    add_world_option,
    declare,
    help_text,
    Parameter,
    WORLD_INSTANCE,
    wrapped,
)
from uav_collect.nodes.process import parse_arguments, ProcessNode, run_node
from uav_collect.nodes.topics import patient_qos, subscription, world_of, world_topics
from uav_collect.nodes.viewer.wishes import PageWishes
from uav_collect.scenario.load import fingerprint, from_yaml
from uav_collect.scenario.site import build_site

_DESCRIPTION = """
Shows the missions of a world as they fly, in any browser of this machine, and writes where. Start
it in any order: who comes late sees a mission from its start. A page looks at its own pace; with
--control it also starts, pauses, resumes, steps, aborts and paces what the world does.
"""
_READER_DEPTH = 10_000  # events that may wait while others are made ready
_TICK_S = 0.05

PARAMETERS = (
    Parameter(
        name='host',
        default='127.0.0.1',
        description='name or address of this machine to serve the page at; 0.0.0.0: all of them,'
        ' so that whoever reaches this machine can look, and with --control steer',
    ),
    Parameter(
        name='port',
        default=0,
        description='port to serve the page at; 0: any that is free',
        low=0,
        high=65_535,
    ),
    WORLD_INSTANCE,
)


class ViewerNode(ProcessNode):
    """Hands what it hears to a film, and the film to a server of pages."""

    def __init__(self, world: str, *, may_steer: bool) -> None:
        """Serve the page and listen.

        Args:
            world: name of the world; empty for that without a name.
            may_steer: pages may ask it to do something.

        Raises:
            NodeError: the page cannot be served.
        """
        super().__init__('viewer', namespace=world)
        declare(self, PARAMETERS)
        names = world_topics(world_of(self.get_namespace()))
        self._wishes = PageWishes(self, names, may_steer=may_steer)
        try:
            where = {name: self.get_parameter(name).value for name in ('host', 'port')}
            self._server = PageServer(**where, make_page=live_page, on_wish=self._wishes.put)
        except FilmError as error:
            raise NodeError(str(error)) from error
        self._state: dict[str, object] = {}
        self._film = LiveFilm(self._server)
        self._choice = WorldChoice(self, names.scenario, self._on_world)
        subscription(self, names.mission, self._on_mission)
        subscription(
            self, names.epoch, self._on_epoch, qos=patient_qos(names.epoch.qos, _READER_DEPTH)
        )
        self.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info(f'the page is at {self._server.url}')

    def on_stop(self) -> None:
        """Leave all pages."""
        self._server.close()

    def _tick(self) -> None:
        self._choice.tick()
        state: dict[str, object] = {
            'control': self._wishes.may_steer,
            'world': self._choice.is_there,
        }
        if state != self._state:
            self._state = state
            self._server.tell(state)
        self._wishes.hand_on(self._choice.instance, self._server.answer)

    def _on_world(self, msg: Any) -> None:
        try:
            scenario = from_yaml(msg.yaml)
            if fingerprint(scenario) != msg.fingerprint:
                raise ConfigError(f'scenario {scenario.name}: the versions of uav_collect differ')
            self._film.follow(msg.world_instance, build_site(scenario), msg.fingerprint)
        except (ConfigError, RefusedError) as error:
            self.warn('not shown', f'the scenario of the world is not shown: {error}')

    def _on_mission(self, msg: Any) -> None:
        try:
            self._film.take_mission(msg)
        except RefusedError as error:
            self.warn('not shown', f'not shown: {error}')

    def _on_epoch(self, msg: Any) -> None:
        try:
            self._film.take_epoch(msg)
        except RefusedError as error:
            self.warn('not shown', f'not shown: {error}')


def main(argv: Sequence[str]) -> int:
    """Show missions until a signal; the exit status."""
    parser = Parser(
        prog='viewer',
        description=wrapped(_DESCRIPTION),
        epilog=help_text(PARAMETERS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--control', action='store_true', help='let pages start, pause, step and pace missions'
    )
    add_world_option(parser)
    given = parse_arguments(parser, argv)
    return run_node(lambda: ViewerNode(given.world, may_steer=given.control), argv)

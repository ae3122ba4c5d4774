"""How people steer a world that runs: a service, an action, two parameters."""

from collections.abc import Callable
from typing import Any, Protocol

from uav_collect.errors import ConfigError
from uav_collect.lockstep.requested_scenario import requested_site, ScenariosOfWorld
from uav_collect.lockstep.roster import Roster
from uav_collect.lockstep.steering import Answer, Steering
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.sealing import serve
from uav_collect.nodes.topics import WorldTopics
from uav_collect.nodes.world.fly_mission import FlyMissionServer
from uav_collect.nodes.world.mission import MissionInFlight
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import Site
from uav_collect_msgs.srv import ControlMission, InjectFault

_ASKED = ControlMission.Request
_WHILE_PAUSED = (_ASKED.PAUSE, _ASKED.RESUME, _ASKED.STEP)
_COMMANDS = ('START', 'ABORT', 'PAUSE', 'RESUME', 'STEP')


class SteeredWorld(Protocol):
    """What steering needs of the world node."""

    mission: MissionInFlight | None
    roster: Roster
    site: Site

    def fly_over(self, site: Site) -> None:
        """Take another scenario; no mission is in flight."""

    def abort(self, note: str) -> None:
        """End the mission in flight, if there is one."""

    def go_on(self) -> None:
        """Do what may happen now, and be patient with agents anew."""


class WorldControl:
    """Hands on what people ask, and answers what happens."""

    def __init__(
        self,
        node: ProcessNode,
        world: SteeredWorld,
        steering: Steering,
        names: WorldTopics,
        instance: str,
    ) -> None:
        """Serve them.

        Args:
            instance: UUID of the world, which sealed requests are for.
        """
        self._node, self._world, self._steering = node, world, steering
        self._scenarios = ScenariosOfWorld()
        self._scenarios.add(world.site.scenario)
        serve(node, ControlMission, names.control_service, self._on_control, instance)
        serve(node, InjectFault, names.inject_service, self._on_inject, instance)
        node.add_post_set_parameters_callback(self._on_parameters)
        self.goals = FlyMissionServer(node, names.fly_mission, self._start, self._abort)

    def inform(self, now_s: float) -> None:
        """Say to the client of a goal how its mission is, when that is due."""
        world = self._world
        is_paused = self._steering.is_paused
        self.goals.inform(now_s, world.mission, world.roster.missing(), is_paused=is_paused)

    def close(self) -> None:
        """Answer clients as the process ends, and plan nothing more."""
        self._steering.schedule.is_closed = True
        self.goals.end_if_called_off(is_planned=False)
        self.goals.close()

    def _on_control(self, request: Any, response: Any) -> Any:
        mission = self._world.mission
        is_flying = mission is not None
        awaited = None if mission is None else mission.awaited_uav
        was_paused = self._steering.is_paused
        match request.command:
            case _ASKED.START:
                answer = self._start(int(request.seed), request.scenario)
            case _ASKED.ABORT:
                answer = self._abort('aborted by request')
            case _ASKED.PAUSE:
                answer = self._steering.pause(is_flying=is_flying, awaited=awaited)
            case _ASKED.RESUME:
                answer = self._steering.resume(is_flying=is_flying)
            case _ASKED.STEP:
                answer = self._steering.step(is_flying=is_flying, awaited=awaited)
            case _:
                known = ', '.join(_COMMANDS)
                answer = False, f'command {request.command} is none of {known}'
        is_steered = was_paused or self._steering.is_paused  # RESUME alone is no news
        if answer[0] and is_steered and request.command in _WHILE_PAUSED:
            self._node.get_logger().info(answer[1])
            self._world.go_on()
        response.success, response.message = answer
        return response

    def _on_inject(self, request: Any, response: Any) -> Any:
        mission, answer = self._world.mission, (False, 'there is no mission in flight')
        if mission is not None:
            answer = mission.inject(request.fault, request.uav)
        response.success, response.message = answer
        if response.success:
            self._node.get_logger().warning(f'fault injected: {response.message}')
        return response

    def _start(self, seed: int, scenario: str) -> Answer:
        """Plan a mission, over another scenario if one is named."""
        is_flying = self._world.mission is not None
        refusal = self._steering.schedule.refusal(seed, is_flying=is_flying)
        if refusal is not None:
            return False, refusal
        try:
            site = requested_site(scenario) if scenario else self._world.site
            self._scenarios.add(site.scenario)
        except ConfigError as error:
            return False, str(error)
        if fingerprint(site.scenario) != fingerprint(self._world.site.scenario):
            self._world.fly_over(site)
        return self._steering.start(seed, is_flying=is_flying)

    def _abort(self, note: str) -> Answer:
        answer = self._steering.abort(is_flying=self._world.mission is not None)
        self._world.abort(note)
        self.goals.end_if_called_off(is_planned=self._steering.schedule.next_seed is not None)
        return answer

    def _on_parameters(self, changed: list[Any]) -> None:
        """Take note of parameters that were changed in flight, and are valid."""
        changes: dict[str, Callable[[float], None]] = {
            'real_time_factor': self._steering.pacer.change,
            'decision_timeout_s': self._steering.change_timeout,
        }
        for each in changed:
            if each.name in changes:
                changes[each.name](float(each.value))
                self._node.get_logger().info(f'{each.name} is {each.value:g} from now on')

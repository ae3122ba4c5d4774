"""Asks a world what people ask of it: tests hold it while they do something to its fleet.

A world that is paused stays where it is, however long the test or a process of its fleet takes.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


class SteeredWorld:
    """The world of a ROS domain, as a node of the test steers it."""

    def __init__(
        self,
        node: Any,  # noqa: ANN401
        wait_until: Callable[[Callable[[], bool]], None],
    ) -> None:
        """Ask by a node, which something else spins."""
        from rcl_interfaces.srv import SetParameters
        from uav_collect.nodes import topics
        from uav_collect_msgs.srv import ControlMission

        self._wait_until = wait_until
        self.asked = ControlMission.Request
        self._control = node.create_client(ControlMission, topics.CONTROL_SERVICE)
        self._parameters = node.create_client(SetParameters, '/world_sim/set_parameters')

    def call(self, client: Any, request: Any) -> Any:  # noqa: ANN401
        """The answer of a service."""
        self._wait_until(client.service_is_ready)
        future = client.call_async(request)
        self._wait_until(future.done)
        return future.result()

    def control(self, command: int, seed: int = 0) -> Any:  # noqa: ANN401
        """What the world answers to a command."""
        return self.call(self._control, self.asked(command=command, seed=seed))

    def start(self, seed: int) -> None:
        """Have a mission started, of a world that flies on request."""
        answer = self.control(self.asked.START, seed)
        assert answer.success, answer.message

    def pause(self) -> None:
        """Let nothing more happen; a mission that comes waits at its start."""
        assert self.control(self.asked.PAUSE).success

    def step(self, n_events: int = 1) -> None:
        """Let so many events more happen, once a mission is in flight."""
        for _ in range(n_events):
            self._wait_until(lambda: bool(self.control(self.asked.STEP).success))

    def step_until(self, message: str) -> None:
        """Let events happen until the world answers so."""
        self._wait_until(lambda: self.control(self.asked.STEP).message == message)

    def resume(self) -> None:
        """Let the mission go on."""
        assert self.control(self.asked.RESUME).success

    def refusal_of(self, name: str, value: object) -> str:
        """Why a parameter of the world is not changed; empty if it is."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        parameter = Parameter(name, value=value).to_parameter_msg()
        answer = self.call(self._parameters, SetParameters.Request(parameters=[parameter]))
        (result,) = answer.results
        assert result.successful == (not result.reason)
        return str(result.reason)

    def change(self, name: str, value: object) -> None:
        """Change a parameter of the world."""
        assert self.refusal_of(name, value) == ''


@contextmanager
def steered_world() -> Iterator[SteeredWorld]:
    """Steer the world in the ROS domain of the test."""
    from fleets import listener

    with listener() as listening:
        yield SteeredWorld(listening.node, listening.wait_until)

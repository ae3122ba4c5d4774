"""What `ros2 run uav_collect ...` executes.

Most nodes handle one event at a time: they interpret the kernels, start at once and stay small.
That must be said before any of them is imported.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import signal
import sys

from uav_collect.kernels.compile import interpret_kernels
from uav_collect.limits import stop_signals


def world_sim() -> int:
    """Simulate the world of a mission."""
    with _loading():
        from uav_collect.nodes.world.node import main

    return main(sys.argv[1:])


def uav_agent() -> int:
    """Fly one UAV."""
    with _loading():
        from uav_collect.nodes.agent.node import main

    return main(sys.argv[1:])


def recorder() -> int:
    """Record every topic of a mission."""
    with _loading():
        from uav_collect.nodes.recorder.node import main

    return main(sys.argv[1:])


def trainer() -> int:
    """Learn from what fleets fly; its kernels are compiled, for it flies missions to validate."""
    with _loading(interprets=False):
        from uav_collect.nodes.trainer.node import main

    return main(sys.argv[1:])


@contextmanager
def _loading(*, interprets: bool = True) -> Iterator[None]:
    """End silently if a signal comes before there is a node to stop."""
    numbers = stop_signals()
    before = [signal.signal(number, lambda *_: os._exit(0)) for number in numbers]
    if interprets:
        interpret_kernels()
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)

"""What `ros2 run uav_collect ...` executes.

Most nodes handle one event at a time: they interpret the kernels, start at once and stay small.
That must be said before any of them is imported.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
import os
import signal
import sys

from uav_collect import files
from uav_collect.config.arguments import error_lines
from uav_collect.config.packages import late_packages, packages_of
from uav_collect.errors import MissingPackageError
from uav_collect.kernels.compile import interpret_kernels
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import stop_signals, UNUSABLE

Main = Callable[[Sequence[str]], int]  # of a node: takes the arguments, gives the exit status

# Messages ask for a package that would load, beside what they need of it, what generated them: a
# tenth of a node's start. It does without where that cannot be imported.
_GENERATOR = 'rosidl_generator_py.generate_py_impl'


def _executable(load: Callable[[], Main]) -> Callable[[], int]:
    """Run the node that a function loads; what is missing for it is said in one line."""

    @wraps(load)
    def run() -> int:
        files.mend_standard_streams()
        sys.modules.setdefault(_GENERATOR, None)  # type: ignore[arg-type] # so Python refuses it
        try:
            named = f'the libraries of {load.__name__} to load'
            with _signals_end_silently(), packages_of(load.__name__), waiting_for(named):
                main = load()
            with late_packages():  # a node loads some when it first needs them
                return main(sys.argv[1:])
        except MissingPackageError as error:
            sys.stderr.write(error_lines(error))
            return UNUSABLE

    return run


@contextmanager
def _signals_end_silently() -> Iterator[None]:
    """End at once if a signal comes before there is a node to stop."""
    numbers = stop_signals()
    before = [signal.signal(number, lambda *_: os._exit(0)) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@_executable
def world_sim() -> Main:
    """Simulate the world of a mission."""
    interpret_kernels()
    from uav_collect.nodes.world.node import main

    return main


@_executable
def uav_agent() -> Main:
    """Fly one UAV."""
    interpret_kernels()
    from uav_collect.nodes.agent.node import main

    return main


@_executable
def recorder() -> Main:
    """Record every topic of a mission."""
    interpret_kernels()
    from uav_collect.nodes.recorder.node import main

    return main


@_executable
def trainer() -> Main:
    """Learn from what fleets fly; its kernels are compiled, for it flies missions to validate."""
    from uav_collect.nodes.trainer.node import main

    return main


@_executable
def control() -> Main:
    """Ask a world to start, abort, pause, resume or step a mission, or to inject a fault."""
    interpret_kernels()
    from uav_collect.nodes.control.node import main

    return main


@_executable
def viewer() -> Main:
    """Show missions in flight to browsers."""
    interpret_kernels()
    from uav_collect.nodes.viewer.node import main

    return main

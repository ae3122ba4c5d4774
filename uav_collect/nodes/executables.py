"""What `ros2 run uav_collect ...` executes.

A node handles one event at a time: it interprets the kernels, starts at once and stays small. That
must be said before any of them is imported.
"""

import sys

from uav_collect.compiled import interpret_kernels


def world_sim() -> int:
    """Simulate the world of a mission."""
    interpret_kernels()
    from uav_collect.nodes.world_sim import main

    return main(sys.argv[1:])


def uav_agent() -> int:
    """Fly one UAV."""
    interpret_kernels()
    from uav_collect.nodes.uav_agent import main

    return main(sys.argv[1:])


def recorder() -> int:
    """Record every topic of a mission."""
    interpret_kernels()
    from uav_collect.nodes.recorder import main

    return main(sys.argv[1:])

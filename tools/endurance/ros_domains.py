"""ROS domains that tests and endurance runs on one machine do not share."""

from collections.abc import Iterator
from contextlib import contextmanager
import itertools
import os
import socket

_DOMAINS = range(1, 102)  # ids whose ports lie below the ephemeral ones
_turns = itertools.count()


@contextmanager
def own_domain() -> Iterator[int]:
    """Hold a ROS domain id that no test or endurance run on this machine holds."""
    first = os.getpid() + next(_turns)
    for turn in range(len(_DOMAINS)):
        domain = _DOMAINS[(first + turn) % len(_DOMAINS)]
        # A socket name without a file: one holder in a network namespace, freed when it exits.
        with socket.socket(socket.AF_UNIX) as claim:
            try:
                claim.bind(f'\0uav_collect_domain_{domain}')
            except OSError:
                continue
            yield domain
            return
    raise RuntimeError('every ROS domain id is held')

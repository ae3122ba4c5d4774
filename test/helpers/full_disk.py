"""Disks that take no more, as a limit on the size of each file that this process writes."""

from collections.abc import Iterator
from contextlib import contextmanager
import resource


@contextmanager
def no_file_beyond(n_bytes: int) -> Iterator[None]:
    """Let the system refuse what would make a file larger: EFBIG, as ENOSPC of a full disk."""
    _, hard = before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

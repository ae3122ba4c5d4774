"""Disks that take no more, as a limit on the size of each file that this process writes."""

from collections.abc import Iterator
from contextlib import contextmanager
import resource
import sys


@contextmanager
def no_file_beyond(n_bytes: int) -> Iterator[None]:
    """Let the system refuse what would make a file larger: EFBIG, as ENOSPC of a full disk."""
    _, hard = before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # What is imported meanwhile would leave bytecode that is cut off, which nobody can import.
    writes_none, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = writes_none

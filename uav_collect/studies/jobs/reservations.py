"""Reserves jobs, so that no two commands that share a store do one at the same time."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import errno
import fcntl
import os
from pathlib import Path

_FILE = 'reserved'  # in the store: of each job that somebody does, one byte is locked
_TAKEN = (errno.EACCES, errno.EAGAIN)  # by another process: POSIX leaves open which it is
_DIGITS = 15  # of a digest: its byte's number, which must fit 63 bits


class Reservations:
    """The jobs that this process does, which are free again as soon as it ends, however it does.

    A process that opens the file twice loses its locks when it closes one: open it once.
    """

    def __init__(self, descriptor: int) -> None:
        """Reserve in a file that is open."""
        self._descriptor = descriptor

    def take(self, digest: str) -> bool:
        """Reserve a job; returns whether it is ours, as it also is where nothing can be locked."""
        try:
            self._lock(digest, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:  # of another kind where the file system has no locks
            return error.errno not in _TAKEN
        return True

    def free(self, digest: str) -> None:
        """Let others do a job."""
        with suppress(OSError):  # as above
            self._lock(digest, fcntl.LOCK_UN)

    def _lock(self, digest: str, how: int) -> None:
        fcntl.lockf(self._descriptor, how, 1, int(digest[:_DIGITS], 16))


@contextmanager
def reserving(folder: Path) -> Iterator[Reservations]:
    """Reserve jobs of a store; all are free at the end.

    Raises:
        OSError: the folder takes no file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder / _FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        yield Reservations(descriptor)
    finally:
        os.close(descriptor)

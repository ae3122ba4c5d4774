"""Lets one process at a time compile: the others find in the cache what it has made."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import fcntl
import os
from pathlib import Path

from uav_collect.kernels.patience import waiting_for

_FILE = 'compiling'  # in the folder of the cache; locked by the process whose turn it is


class Turn:
    """This process's turn to compile, of all that share a cache.

    A kernel is compiled within another one, in one thread at a time: numba sees to that.
    """

    def __init__(self) -> None:
        """Begin without it."""
        self._depth = 0  # kernels that are wanted, each within the one before
        self._file = -1  # descriptor of the locked file; -1: none

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Keep a turn that is taken in the block until the outermost block is left."""
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1
            if self._depth == 0 and self._file >= 0:
                os.close(self._file)
                self._file = -1

    def take(self, folder: Path) -> bool:
        """Wait until no other process compiles; does nothing where the folder takes no file.

        Returns:
            Whether it is this process's turn from now on, so that another may have been before.
        """
        if self._file >= 0:
            return False
        with suppress(OSError):
            self._file = os.open(folder / _FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            self._lock()
        return self._file >= 0

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            with waiting_for('another process that compiles kernels (once)'):
                fcntl.flock(self._file, fcntl.LOCK_EX)

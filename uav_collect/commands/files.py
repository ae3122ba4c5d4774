"""Files that a command writes: whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path


def check_writable(path: Path) -> None:
    """Raise OSError now if a file could not be written later."""
    target = path.resolve()
    if target.is_dir():
        raise IsADirectoryError(f'{path}: is a folder, must be a file')
    if _is_replaceable(target):
        with _partial(target):
            pass


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file such that a reader, a crash or a full disk never finds a part of it.

    A device or a pipe is written as it is: it must not be replaced by a file.

    Raises:
        OSError: naming the file.
    """
    target = path.resolve()  # a link stays a link
    if not _is_replaceable(target):
        target.write_bytes(content)
        return
    with _partial(target) as partial:
        with partial.open('wb') as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(target)


def _is_replaceable(target: Path) -> bool:
    return target.is_file() or not target.exists()


@contextmanager
def _partial(target: Path) -> Iterator[Path]:
    """A file beside the target, gone afterwards unless it became the target."""
    partial = target.with_name(f'.{target.name}.{os.getpid()}.part')
    try:
        partial.touch()
        yield partial
    except OSError as error:
        error.filename, error.filename2 = str(target), None  # the user's file, not the partial one
        raise
    finally:
        with suppress(OSError):
            partial.unlink()

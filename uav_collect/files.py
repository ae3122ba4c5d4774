"""Files: written whole or not at all, and tables as CSV."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
import csv
import errno
import io
import math
import os
from pathlib import Path
import stat
from typing import BinaryIO


def check_writable(path: Path) -> None:
    """Raise OSError, naming the file, if it could not be written later."""
    if path.is_dir():
        raise IsADirectoryError(f'{path}: is a folder, must be a file')
    if not _is_device(path):
        with naming(path), _partial(path):
            pass


@contextmanager
def open_file(path: Path) -> Iterator[tuple[BinaryIO, int]]:
    """Open a file to be read; it and its size in bytes.

    A folder is none, nor is a pipe or a device: they have no size and may never answer.

    Raises:
        OSError: naming the file.
    """
    try:
        # To open a pipe would wait for whoever writes into it.
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
    except ValueError as error:
        raise OSError(errno.EINVAL, f'is no path: {error}', str(path)) from error
    try:
        about = os.fstat(number)
        if not stat.S_ISREG(about.st_mode):
            is_folder = stat.S_ISDIR(about.st_mode)
            what = 'is a folder' if is_folder else 'is a pipe or a device'
            raise OSError(errno.EINVAL, f'{what}: must be a file', str(path))
        with naming(path), open(number, 'rb', closefd=False) as file:
            yield file, about.st_size
    finally:
        os.close(number)


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """All bytes of a file that must not be larger; of a larger one none are read.

    Raises:
        OSError: naming the file.
    """
    with open_file(path) as (file, n_bytes):
        content = file.read(most_bytes + 1) if n_bytes <= most_bytes else b''
        if max(n_bytes, len(content)) > most_bytes:  # it may grow
            what = f'has {n_bytes:,} bytes: must have at most {most_bytes:,}'
            raise OSError(errno.EFBIG, what, str(path))
        return content


def write_atomically(path: Path, content: bytes | memoryview) -> None:
    """Write a file such that a reader, a crash or a full disk never finds a part of it.

    A device or a pipe, as /dev/stdout, is written as it is: it must not be replaced by a file.

    Raises:
        OSError: naming the file; what it held before is still there.
    """
    write_parts_atomically(path, [content])


def write_parts_atomically(path: Path, parts: Iterable[bytes | memoryview]) -> None:
    """Write a file as `write_atomically` does, one part of its content after the other."""
    with naming(path):
        if _is_device(path):
            with path.open('ab') as device:
                device.writelines(parts)
            return
        with _partial(path) as partial:
            with partial.open('wb') as file:
                file.writelines(parts)
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path.resolve())  # a link stays a link


def drop_partial(folder: Path) -> None:
    """Remove what writers that were killed left in a folder that nobody else writes into."""
    for partial in folder.glob('.*.part'):
        partial.unlink()


def csv_of(rows: Iterable[Iterable[object]]) -> bytes:
    """A table as a CSV file: the header, then a line for each row, as UTF-8."""
    text = io.StringIO()
    csv.writer(text, lineterminator='\n').writerows(rows)
    return text.getvalue().encode()


def blank_if_nan(number: float) -> float | str:
    """A cell of a table: empty where the number is not known."""
    return '' if math.isnan(number) else number


def _is_device(path: Path) -> bool:
    # Behind /dev/stdout there may be an ordinary file, which is still not ours to replace.
    return path.exists() and (not path.is_file() or Path('/dev') in path.absolute().parents)


@contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """A file beside another, gone afterwards unless it took its place."""
    target = path.resolve()
    partial = target.with_name(f'.{target.name}.{os.getpid()}.part')
    try:
        partial.touch()
        yield partial
    finally:
        with suppress(OSError):
            partial.unlink()


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the user's file in an error, not the partial one."""
    try:
        yield
    except OSError as error:
        error.filename, error.filename2 = str(path), None
        raise

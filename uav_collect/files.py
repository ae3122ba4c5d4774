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
import sys
from typing import Any, BinaryIO


def mend_standard_streams() -> None:
    """Let this process say anything anywhere, and lose no more by it than what it says.

    A standard stream that is closed counts as /dev/null: the next file that is opened would get
    its number, and with it what libraries print. What an encoding lacks is written as an escape.
    On stderr nothing fails: who does not listen there still wants the results.
    """
    for number, name in enumerate(('stdin', 'stdout', 'stderr')):
        if not _is_open(number):
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest free number
        stream = getattr(sys, name)
        if getattr(stream, 'closed', False) or stream in (None, sys.__stderr__):
            setattr(sys, name, _standard_stream(number))
        elif name != 'stdin' and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')


class _Unfailing(io.FileIO):
    """A file that takes what it is given, whether that arrives or not."""

    def write(self, content: Any) -> int:  # noqa: ANN401 - a buffer
        with suppress(OSError):
            return super().write(content) or 0
        return len(content)


def _standard_stream(number: int) -> io.TextIOWrapper:
    mode = 'rb' if number == 0 else 'wb'
    kind = _Unfailing if number == 2 else io.FileIO
    raw = kind(number, mode, closefd=False)
    buffer = io.BufferedReader(raw) if number == 0 else io.BufferedWriter(raw)
    return io.TextIOWrapper(buffer, errors='backslashreplace', line_buffering=number == 2)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


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
        OSError: it cannot be opened; naming the file. Errors of reading it name none.
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
        with open(number, 'rb', closefd=False) as file:
            yield file, about.st_size
    finally:
        os.close(number)


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """All bytes of a file that must not be larger; of a larger one none are read.

    Raises:
        OSError: naming the file.
    """
    with open_file(path) as (file, n_bytes):
        with naming(path):
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

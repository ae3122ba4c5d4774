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

_STREAM_FOLDERS = ('/dev', '/dev/fd', '/proc/self/fd')
_waiting_pipes: dict[Path, int] = {}  # that `check_writable` has opened


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


def check_there(path: Path) -> None:
    """Raise OSError, naming a path that leads nowhere or, by links, in a circle."""
    with naming(path):
        path.stat()


def check_writable(path: Path) -> None:
    """Make sure that `write_result` can write a file later.

    Raises:
        OSError: naming the file.
    """
    with naming(path):
        if not is_stream(path):
            with _partial(path):
                pass
        elif path.is_fifo():  # to close it would be the end for its reader
            _waiting_pipes[path] = _open_stream(path)
        else:
            os.close(_open_stream(path))


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
            raise OSError(errno.EINVAL, _no_file(about), str(path))
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

    Raises:
        OSError: naming the file, which is a pipe, say; what it held before is still there.
    """
    write_parts_atomically(path, [content])


def write_result(path: Path, content: bytes | memoryview) -> None:
    """Write a file that a user names: as `write_atomically` does, or into a pipe or a device.

    What /dev/stdout stands for is written as it is: it must not be replaced by a file.

    Raises:
        OSError: naming the file, which nobody reads, say.
    """
    with naming(path):
        if not is_stream(path):
            write_parts_atomically(path, [content])
            return
        waiting = _waiting_pipes.pop(path, None)
        with open(_open_stream(path) if waiting is None else waiting, 'wb') as stream:
            stream.write(content)


def write_parts_atomically(path: Path, parts: Iterable[bytes | memoryview]) -> None:
    """Write a file as `write_atomically` does, one part of its content after the other."""
    with naming(path), _partial(path) as partial:
        with partial.open('wb') as file:
            file.writelines(parts)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(os.path.realpath(path))  # a link stays a link


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


def is_stream(path: Path) -> bool:
    """Whether what is there can be written, but not replaced."""
    about = _about(path)
    if about is None or stat.S_ISDIR(about.st_mode):
        return False
    # Behind /dev/stdout there may be an ordinary file, which is still not ours to replace.
    return not stat.S_ISREG(about.st_mode) or str(path.absolute().parent) in _STREAM_FOLDERS


def _open_stream(path: Path) -> int:
    """Open a pipe or a device, to be written at its end, without waiting for a reader.

    Raises:
        OSError: nobody reads the pipe.
    """
    try:
        number = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_NOCTTY)
    except OSError as error:
        if error.errno == errno.ENXIO and path.is_fifo():
            raise OSError(errno.ENXIO, 'is a pipe that nobody reads', str(path)) from error
        raise
    os.set_blocking(number, True)
    return number


def _about(path: Path) -> os.stat_result | None:
    """What is there; None if nothing is.

    Raises:
        OSError: it cannot be told, as where links lead in a circle.
    """
    try:
        return path.stat()
    except FileNotFoundError:
        return None


def _no_file(about: os.stat_result) -> str:
    what = 'is a folder' if stat.S_ISDIR(about.st_mode) else 'is a pipe or a device'
    return f'{what}: must be a file'


@contextmanager
def _partial(path: Path) -> Iterator[Path]:
    """A file beside another, gone afterwards unless it took its place.

    Raises:
        OSError: what is there is no file.
    """
    about = _about(path)
    if about is not None and not stat.S_ISREG(about.st_mode):
        raise OSError(errno.EINVAL, _no_file(about), str(path))
    target = Path(os.path.realpath(path))
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
        error.filename = str(path)
        del error.filename2  # None would be shown
        raise

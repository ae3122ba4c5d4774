"""Files: written whole or not at all, and tables as CSV."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
import csv
import io
import math
import os
from pathlib import Path


def check_writable(path: Path) -> None:
    """Raise OSError, naming the file, if it could not be written later."""
    if path.is_dir():
        raise IsADirectoryError(f'{path}: is a folder, must be a file')
    if not _is_device(path):
        with naming(path), _partial(path):
            pass


def write_atomically(path: Path, content: bytes | memoryview) -> None:
    """Write a file such that a reader, a crash or a full disk never finds a part of it.

    A device or a pipe, as /dev/stdout, is written as it is: it must not be replaced by a file.

    Raises:
        OSError: naming the file; what it held before is still there.
    """
    with naming(path):
        if _is_device(path):
            with path.open('ab') as device:
                device.write(content)
            return
        with _partial(path) as partial:
            with partial.open('wb') as file:
                file.write(content)
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

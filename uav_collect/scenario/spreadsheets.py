"""Workbooks (.xlsx) as tables, by openpyxl: the first sheet that says where things are."""

from collections.abc import Iterator
import io
from pathlib import Path
from typing import Any
import warnings
import zipfile
import zlib

from uav_collect.config.packages import late_packages
from uav_collect.config.yaml_text import shown, shown_path
from uav_collect.errors import ConfigError, in_one_line, reason_of
from uav_collect.scenario.tables import (
    Known,
    names_places,
    of_bounded,
    Sheet,
    sheet_of_rows,
    SheetRow,
)

_MAX_UNPACKED = 256 * 2**20  # bytes of all that is packed in a workbook
_MAX_MEMBERS = 10_000
_MOST_WHOLE = 1e15  # up to which a float tells each whole number from the next
# What openpyxl and what it reads with raise for workbooks that are none.
_BROKEN = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, NotImplementedError, OSError),
    *(RecursionError, RuntimeError, SyntaxError, TypeError, ValueError),
    *(zipfile.BadZipFile, zlib.error),
)


def sheet_of_workbook(path: Path, content: bytes, known: Known) -> Sheet:
    """Read a table of a workbook; of formulas what they gave when it was saved.

    Raises:
        ConfigError: it is no workbook, too large, or has no table.
        MissingPackageError: openpyxl is missing.
    """
    check_packed(path, content)
    with late_packages():
        import openpyxl
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # about parts of workbooks that are not read
            book: Any = openpyxl.load_workbook(
                io.BytesIO(content), read_only=True, data_only=True, keep_links=False
            )
            sheets = [
                (sheet.title, [*of_bounded(path, 'row', _rows_of(sheet))])
                for sheet in book.worksheets
            ]
    except ConfigError:
        raise
    except _BROKEN as error:
        raise ConfigError(
            f'{shown_path(path)}: is no workbook that can be read: '
            f'{in_one_line(reason_of(error), 200)}'
        ) from error
    filled = [(title, rows) for title, rows in sheets if rows]
    if not filled:
        raise ConfigError(f'{shown_path(path)}: is empty: must have a sheet with a table')
    title, rows = next((it for it in filled if names_places(it[1], known)), filled[0])
    notes = () if len(filled) == 1 else (f'of {len(filled)} sheets, {shown(title)} is read',)
    return sheet_of_rows(path, 'row', rows, known, notes)


def check_packed(path: Path, content: bytes) -> None:
    """Refuse a packed file that would take too much memory.

    Raises:
        ConfigError: it does, or is broken.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            sizes = [member.file_size for member in packed.infolist()]
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError) as error:
        what = in_one_line(reason_of(error), 200)
        raise ConfigError(f'{shown_path(path)}: is no packed file: {what}') from error
    if len(sizes) > _MAX_MEMBERS or sum(sizes) > _MAX_UNPACKED:
        raise ConfigError(
            f'{shown_path(path)}: has {sum(sizes):,} bytes in {len(sizes):,} files unpacked: must '
            f'have at most {_MAX_UNPACKED:,} in {_MAX_MEMBERS:,}'
        )


def _rows_of(sheet: Any) -> Iterator[SheetRow]:  # noqa: ANN401 - of openpyxl
    sheet.reset_dimensions()  # a workbook may say anything of its size
    for number, row in enumerate(sheet.iter_rows(values_only=True), start=1):
        cells = [_text(value) for value in row]
        while cells and not cells[-1]:
            cells.pop()
        yield SheetRow(number, cells)


def _text(value: object) -> str:
    """A cell as a user would write it into a text."""
    if value is None:
        return ''
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and value.is_integer() and abs(value) < _MOST_WHOLE:
        return str(int(value))
    return str(value).strip()

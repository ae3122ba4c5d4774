"""Tables as text: encoding, separator and header line found, fields as they are written.

What comes out has one form wherever it is from: a text, a workbook, the features of a map.
"""

from collections.abc import Callable, Iterator
import csv
from dataclasses import dataclass
import io
from itertools import islice
from pathlib import Path
import re
from typing import NamedTuple

from uav_collect.config.yaml_text import shown_path
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_SENSORS

MAX_LINES = 2 * MAX_SENSORS  # of a table, blank ones among them
MAX_COLUMNS = 1_000
_MAX_BLANK = 1_000_000  # lines
MAX_FIELD = 10_000  # characters
_SEPARATORS = {',': 'commas', ';': 'semicolons', '\t': 'tabs', '|': 'bars'}
_ENCODINGS = {
    'utf-8-sig': 'UTF-8',
    'utf-16': 'UTF-16',
    'utf-16-le': 'UTF-16',
    'utf-16-be': 'UTF-16',
    'cp1252': 'Windows-1252',
}
_N_TRIED = 20  # lines in which a header is looked for
_N_WEIGHED = 50  # lines by which separators are compared
_ANNOUNCED = re.compile('sep=(.)', re.IGNORECASE)  # as spreadsheets begin a CSV file
_WIDTH = re.compile('[0-9]{1,4}[sdn]')  # as water surveys write below the names of columns
_CONTROL = re.compile('[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]')

NAMES_PLACES = 100  # at least, of a header by which it is known where things are
FOLDER = 'folder'  # property of a thing on a map: the folders that it lies in
# How well a row does as a header: how many known columns it names, and NAMES_PLACES more if one
# can tell by them where things are.
Known = Callable[[list[str]], int]


class SheetRow(NamedTuple):
    """One row of a table."""

    number: int  # where it stands, from 1
    cells: list[str]


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A table: the names of its columns, and its rows; those without any text are left out."""

    path: Path
    unit: str  # what its rows are called, in messages
    header: SheetRow
    lines: tuple[SheetRow, ...]
    notes: tuple[str, ...] = ()

    @property
    def is_map(self) -> bool:
        """Whether its rows are things on a map, whose coordinates have no names."""
        return self.header.number == 0

    def where(self, number: int) -> str:
        """Where a row stands, as a message begins."""
        return where_of(self.path, self.unit, number)


def where_of(path: Path, unit: str, number: int) -> str:
    """Where a row of a file stands, as a message begins."""
    if unit == 'line':
        return f'{shown_path(path)}:{number}'
    return f'{shown_path(path)}: {unit} {number}'


def text_of(path: Path, content: bytes) -> str:
    """The text of a file in UTF-8, UTF-16 or Windows-1252, whichever it can be.

    Raises:
        ConfigError: it is no text.
    """
    text, encoding = _decoded(path, content)
    wrong = _CONTROL.search(text)
    if wrong:
        line = text.count('\n', 0, wrong.start()) + 1
        what = f'the character U+{ord(wrong.group()):04X}'
        raise ConfigError(
            f'{shown_path(path)}:{line}: must be text, but is {encoding} with {what}'
        )
    return text


def _decoded(path: Path, content: bytes) -> tuple[str, str]:
    for encoding in _encodings(content):
        try:
            return content.decode(encoding), _ENCODINGS[encoding]
        except UnicodeDecodeError as error:
            place = error.start
    line = content[:place].count(b'\n') + 1
    raise ConfigError(
        f'{shown_path(path)}:{line}: must be text as UTF-8, UTF-16 or Windows-1252, but has the '
        f'byte 0x{content[place]:02X}'
    )


def _encodings(content: bytes) -> tuple[str, ...]:
    if content.startswith((b'\xff\xfe', b'\xfe\xff')):
        return ('utf-16',)
    head = content[:1000]
    # Half of what is written in Latin letters is zeros in UTF-16, and none elsewhere.
    odd, even = head[1::2].count(0), head[::2].count(0)
    if odd > len(head) / 4 and even < odd / 4:
        return ('utf-16-le',)
    if even > len(head) / 4 and odd < even / 4:
        return ('utf-16-be',)
    return 'utf-8-sig', 'cp1252'


def sheet_of_text(path: Path, text: str, known: Known) -> Sheet:
    """Read a table whose fields are separated by commas, semicolons, tabs or bars.

    Raises:
        ConfigError: it has no line with text, too many, or quotes that do not end.
    """
    announced = _ANNOUNCED.fullmatch(text.partition('\n')[0].strip())
    separator = announced[1] if announced else _separator_of(text, known)
    try:
        lines = [*of_bounded(path, 'line', _lines_of(text, separator))][1 if announced else 0 :]
    except csv.Error as error:
        raise ConfigError(f'{shown_path(path)}: is not valid CSV: {error}') from error
    word = _SEPARATORS.get(separator, separator)
    notes = () if separator == ',' else (f'fields are separated by {word}',)
    return sheet_of_rows(path, 'line', lines, known, notes)


def sheet_of_rows(
    path: Path, unit: str, lines: list[SheetRow], known: Known, notes: tuple[str, ...] = ()
) -> Sheet:
    """A table of rows; of the first ones that is the header by which one knows where things are.

    Raises:
        ConfigError: no row has any text.
    """
    if not lines:
        raise ConfigError(f'{shown_path(path)}: is empty: must begin with the names of columns')
    scores = _scores([line.cells for line in lines], known)
    best = scores.index(max(scores)) if max(scores) >= NAMES_PLACES else 0
    header, below = lines[best], lines[best + 1 :]
    if best:
        notes = (*notes, f'the names of columns stand in {unit} {header.number}')
    if below and all(_WIDTH.fullmatch(cell) for cell in below[0].cells):
        notes = (*notes, f'left out: {unit} {below[0].number}, widths of columns')
        below = below[1:]
    return Sheet(path=path, unit=unit, header=header, lines=tuple(below), notes=notes)


def names_places(lines: list[SheetRow], known: Known) -> bool:
    """Whether one of the first rows is a header by which one knows where things are."""
    return max(_scores([line.cells for line in lines], known)) >= NAMES_PLACES


def _scores(rows: list[list[str]], known: Known) -> list[int]:
    """How well each of the first rows does as a header."""
    return [known(cells) if len(cells) <= MAX_COLUMNS else 0 for cells in rows[:_N_TRIED]]


def of_bounded(path: Path, unit: str, lines: Iterator[SheetRow]) -> Iterator[SheetRow]:
    """The rows with text, as long as they are not too many.

    Raises:
        ConfigError: they are.
    """
    n_lines = n_blank = 0
    for line in lines:
        is_blank = not any(line.cells)
        n_blank += is_blank
        n_lines += not is_blank
        if is_blank and n_blank <= _MAX_BLANK:
            continue
        if n_lines > MAX_LINES or is_blank:
            raise ConfigError(
                f'{shown_path(path)}: has more than {MAX_LINES:,} {unit}s: must have at most '
                f'{MAX_SENSORS:,} sensors'
            )
        if len(line.cells) > MAX_COLUMNS:
            what = f'has {len(line.cells):,} fields: must have at most {MAX_COLUMNS:,}'
            raise ConfigError(f'{where_of(path, unit, line.number)}: {what}')
        yield line


def _lines_of(text: str, separator: str, *, is_strict: bool = True) -> Iterator[SheetRow]:
    reader = csv.reader(io.StringIO(text, newline=''), delimiter=separator, strict=is_strict)
    for cells in reader:
        yield SheetRow(reader.line_num, [cell.strip() for cell in cells])


def _separator_of(text: str, known: Known) -> str:
    """The separator by which a header names most columns, and rows have as many fields as it."""
    return max(_SEPARATORS, key=lambda separator: _weight(text, separator, known))


def _weight(text: str, separator: str, known: Known) -> tuple[int, float, int]:
    lines = _lines_of(text[: MAX_FIELD * _N_WEIGHED], separator, is_strict=False)
    try:
        rows = [line.cells for line in islice(lines, _N_WEIGHED) if any(line.cells)]
    except csv.Error:
        return 0, 0.0, 0
    if not rows:
        return 0, 0.0, 0
    scores = _scores(rows, known)
    header = rows[scores.index(max(scores))]
    alike = sum(len(row) == len(header) for row in rows) / len(rows)
    return max(scores), alike, len(header)

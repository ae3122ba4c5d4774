"""The one way to print by rich: what names and values hold stands there as it is."""

from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import TextColumn


LEAST_COLUMNS = 80  # of what is printed: in fewer, tables would lose their figures


def plain_console(
    *, stderr: bool = False, file: IO[str] | None = None, width: int | None = None
) -> 'Console':
    """A console that takes nothing in a text for markup, and colours no part of it by itself.

    It is as wide as the terminal. On stdout, which keeps what it says, it is never narrower than
    tables are: the terminal wraps their lines then.
    """
    from rich.console import Console

    console = Console(
        stderr=stderr, file=file, width=width, markup=False, emoji=False, highlight=False
    )
    if not stderr and width is None and console.width < LEAST_COLUMNS:
        console.width = LEAST_COLUMNS
    return console


def plain_column(text_format: str) -> 'TextColumn':
    """A column of a progress bar, as plain as the console."""
    from rich.progress import TextColumn

    return TextColumn(text_format, markup=False)

"""What a command says while it works, on stderr, and Ctrl-C that waits until it has saved."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
import os
import signal
import sys
from time import monotonic
from types import FrameType

from uav_collect.analysis.console import plain_column, plain_console
from uav_collect.kernels.compile import kernels_are_cached, kernels_are_compiled
from uav_collect.limits import stop_signals

INTERRUPTED = 130  # exit status after Ctrl-C, as shells have it
_NOTICE = b'\nstopping at the next step and saving; again: stop at once, without saving\n'
_LINE_EVERY_S = 5.0


@contextmanager
def progress_bar(total: int, noun: str) -> Iterator[Callable[[int], None]]:
    """Show how many of a total are done; call what it yields with how many more are."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    console = plain_console(stderr=True)
    if not console.is_terminal:
        yield _lines(console.print, total, noun)
        return
    columns = (plain_column(noun), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(noun, total=total)
        yield lambda n_more: bar.advance(task, n_more)


def _lines(say: Callable[[str], None], total: int, noun: str) -> Callable[[int], None]:
    n_done, said_s = 0, monotonic()

    def advance(n_more: int) -> None:
        nonlocal n_done, said_s
        n_done += n_more
        if monotonic() - said_s >= _LINE_EVERY_S:
            said_s = monotonic()
            say(f'{n_done} of {total} {noun}')

    return advance


def say_if_compiling(kernels: Iterable[Callable[..., object]]) -> None:
    """Say that the first missions take longer, when these kernels have to be compiled for them."""
    if kernels_are_compiled() and not kernels_are_cached(kernels):
        plain_console(stderr=True).print('compiling (once): this takes about a minute')


def say(text: str) -> None:
    """Write a line to stderr."""
    sys.stderr.write(f'{text}\n')


class Interruption:
    """Remembers whether a signal came that asks this process to end."""

    def __init__(self) -> None:
        """Start without a signal."""
        self.signal_number: int | None = None

    @property
    def exit_status(self) -> int:
        """128 plus the signal number, as shells have it."""
        return 128 + (self.signal_number or signal.SIGINT)

    def note(self, signal_number: int, frame: FrameType | None) -> None:
        """Handle a signal: note the first, obey the second."""
        del frame
        if self.signal_number is not None:
            raise KeyboardInterrupt
        self.signal_number = signal_number
        os.write(2, _NOTICE)  # a handler may have interrupted another write of sys.stderr


@contextmanager
def deferred_interruption() -> Iterator[Interruption]:
    """Note signals that ask this process to end, instead of ending."""
    interruption = Interruption()
    with _handled_by(interruption.note):
        yield interruption


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Raise KeyboardInterrupt at every signal that asks this process to end."""
    with _handled_by(signal.default_int_handler):
        yield


def ignore_signals() -> None:
    """Let nothing more interrupt this process, until the context around it is left."""
    for number in stop_signals():
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def _handled_by(handle: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    terminals = [number for number in (1, 2) if os.isatty(number)]

    def handle_one(signal_number: int, frame: FrameType | None) -> None:
        for number in terminals:
            if not os.isatty(number):  # closed: whatever is still said would fail
                with open(os.devnull, 'wb') as nowhere:
                    os.dup2(nowhere.fileno(), number)
        handle(signal_number, frame)

    before = {number: signal.signal(number, handle_one) for number in stop_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

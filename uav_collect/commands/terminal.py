"""What a command says while it works, on stderr, and Ctrl-C that waits until it has saved."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
import signal
from types import FrameType
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.analysis.console import plain_column, plain_console
from uav_collect.config.arguments import error_lines
from uav_collect.kernels.patience import repeated_line
from uav_collect.kernels.patience import say as say
from uav_collect.kernels.stops import interrupts, kept_handlers, watchdog
from uav_collect.limits import stop_signals
from uav_collect.training.time_left import TimeLeft

if TYPE_CHECKING:
    from uav_collect.scenario.model import Scenario

_NOTICE = b'\nstopping at the next step and saving; again: stop at once, without saving\n'
_LINE_EVERY_S = 5.0


@contextmanager
def progress_bar(total: int, noun: str) -> Iterator[Callable[[int], None]]:
    """Show how many of a total are done; call what it yields with how many more are."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress

    console = plain_console(stderr=True)
    if not console.is_terminal:
        with _lines(total, noun) as advance:
            yield advance
        return
    left = TimeLeft()
    columns = (BarColumn(), MofNCompleteColumn(), plain_column('{task.description}'))
    with Progress(plain_column(noun), *columns, console=console, transient=True) as bar:
        task = bar.add_task('', total=total)

        def advance_bar(n_more: int) -> None:
            share_done = (bar.tasks[0].completed + n_more) / total
            bar.update(task, advance=n_more, description=left.text(share_done))

        yield advance_bar


@contextmanager
def _lines(total: int, noun: str) -> Iterator[Callable[[int], None]]:
    """A line every few seconds, whether something was done or not."""
    left, n_done, time_left = TimeLeft(), 0, ''

    def advance(n_more: int) -> None:
        nonlocal n_done, time_left
        n_done += n_more
        time_left = left.text(n_done / total)

    def line(lasted_s: float) -> str:
        return f'{n_done} of {total} {noun}, {time_left or f"{lasted_s:.0f} s so far"}'

    with repeated_line(line, every_s=_LINE_EVERY_S):
        yield advance


class Interruption:
    """Remembers whether a signal came that asks this process to end."""

    def __init__(self) -> None:
        """Start without a signal."""
        self._number: int | None = None

    @property
    def signal_number(self) -> int | None:
        """The first signal that came."""
        return self._number

    def acknowledge(self) -> bool:
        """Whether a signal came; if so, who asks ends the process, however long that takes."""
        if self._number is None:
            return False
        watchdog.acknowledge()
        return True

    @property
    def exit_status(self) -> int:
        """128 plus the signal number, as shells have it."""
        return 128 + (self._number or signal.SIGINT)

    def note(self, signal_number: int, frame: FrameType | None) -> None:
        """Handle a signal: note the first, obey the second."""
        if self._number is not None:
            interrupts.raise_one(signal_number, frame)
        self._number = signal_number
        os.write(2, _NOTICE)  # a handler may have interrupted another write of sys.stderr


def say_reach(scenario: 'Scenario') -> None:
    """Write how far the energy of a scenario's fleet reaches, unless it reaches everywhere."""
    from uav_collect.planning.reach import energy_remark
    from uav_collect.scenario.site import build_site

    remark = energy_remark(build_site(scenario))
    if remark is not None:
        say(remark)


def say_error(error: Exception) -> None:
    """Write what is wrong to stderr."""
    say(error_lines(error).removesuffix('\n'))


def write_files(contents: Mapping[Path, bytes]) -> bool:
    """Write what a command has found; whether all could be, else a line says which could not.

    It does not raise: the tables that are still to be shown may have taken hours.
    """
    is_written = True
    for path, content in contents.items():
        try:
            files.write_result(path, content)
        except BrokenPipeError:  # whoever reads it has left
            raise
        except OSError as error:
            say_error(error)
            is_written = False
    return is_written


@contextmanager
def deferred_interruption() -> Iterator[Interruption]:
    """Note signals that ask this process to end, instead of ending."""
    interruption = Interruption()
    with _handled_by(interruption.note):
        yield interruption


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Raise KeyboardInterrupt at every signal that asks this process to end."""
    with _handled_by(interrupts.raise_one):
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

    with kept_handlers():
        for number in stop_signals():
            signal.signal(number, handle_one)
        yield

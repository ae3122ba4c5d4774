"""What a process says, on stderr, while it waits: for what, and how long it already does."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import sys
from threading import Event, Thread
from time import monotonic

SAID_AFTER_S = 1.0  # shorter waits need no word; Python itself may have taken two seconds before
SAID_EVERY_S = 30.0  # of one that lasts

_is_silent = False
_is_explained: Callable[[], bool] = bool  # nothing does


def be_silent() -> None:
    """Say nothing more in this process: another one speaks for it."""
    global _is_silent
    _is_silent = True


def explain(is_explained: Callable[[], bool]) -> None:
    """Let waits go unsaid while something tells that it says itself what takes so long."""
    global _is_explained
    _is_explained = is_explained


def say(text: str) -> None:
    """Write a line to stderr, if there is one."""
    if _is_silent:
        return
    with suppress(OSError, ValueError, AttributeError):  # full, closed, or none at all
        sys.stderr.write(f'{text}\n')
        sys.stderr.flush()


@contextmanager
def waiting_for(what: str, say_line: Callable[[str], None] = say) -> Iterator[None]:
    """Say what the block waits for once that takes more than a second, and now and then again.

    Args:
        what: follows 'waiting for '.
    """

    def say_unless_explained(line: str) -> None:
        if not _is_explained():
            say_line(line)

    with repeated_line(
        lambda waited_s: f'waiting for {what}{_so_far(waited_s)}', say_unless_explained
    ):
        yield


@contextmanager
def repeated_line(
    text: Callable[[float], str],
    say_line: Callable[[str], None] = say,
    *,
    after_s: float = SAID_AFTER_S,
    every_s: float = SAID_EVERY_S,
) -> Iterator[None]:
    """Say a line every so often while the block lasts, whatever it does.

    Args:
        text: gives the line for how long the block has lasted [s].
        after_s: until the first line [s].
        every_s: between two lines [s].
    """
    is_over, begun_s = Event(), monotonic()

    def tell() -> None:
        pause_s = after_s
        while not is_over.wait(pause_s):
            say_line(text(monotonic() - begun_s))
            pause_s = every_s

    thread = Thread(target=tell, name='patience', daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()  # no line comes after what the block leads to


def _so_far(waited_s: float) -> str:
    return f' ({waited_s:.0f} s so far)' if waited_s >= SAID_EVERY_S else ''

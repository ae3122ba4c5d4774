"""Ctrl-C that waits until what runs can be saved."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import signal
from types import FrameType

_NOTICE = b'\nstopping at the next step and saving; again: stop at once, without saving\n'


class Interruption:
    """Whether SIGINT or SIGTERM came."""

    def __init__(self) -> None:
        """Nothing came yet."""
        self.signal_number: int | None = None

    @property
    def exit_status(self) -> int:
        """As shells have it."""
        return 128 + (self.signal_number or signal.SIGINT)

    def note(self, signal_number: int, frame: FrameType | None) -> None:
        """Handle a signal: note the first, obey the second."""
        del frame
        if self.signal_number is not None:
            raise KeyboardInterrupt
        self.signal_number = signal_number
        os.write(2, _NOTICE)  # a handler may have interrupted another write of sys.stderr


@contextmanager
def noted() -> Iterator[Interruption]:
    """Note SIGINT and SIGTERM instead of stopping."""
    interruption = Interruption()
    before = {
        number: signal.signal(number, interruption.note)
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

"""Ends a process that does not come to obey a signal: it compiles, or one step takes very long.

Python handles a signal between two of its own instructions in the main thread, and the compiler
takes minutes for one. Here another thread hears of each signal at once. While kernels are compiled
there is nothing to save. Nor does the loop of a long run come to a step at which it saves before
they are compiled.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import os
import select
import signal
from threading import current_thread, Event, main_thread, Thread
from time import monotonic
from types import FrameType

from uav_collect.kernels.compile import compilation
from uav_collect.limits import stop_signals

DEAF_S = 8.0  # until a process that has not heard a signal is ended; it answers within 10 s
_LOOK_S = 0.1
_SHOW_CURSOR = b'\x1b[?25h\n'  # a progress display may have hidden it

_is_heard = Event()  # that a signal came; by whoever can end this process in its own way


def heard() -> None:
    """Note that who can end this process in its own way knows of the signal, and will."""
    _is_heard.set()


@contextmanager
def obeyed_signals(exit_status: Callable[[int], int]) -> Iterator[None]:
    """End the process if a handled signal to stop comes while it compiles, or is not `heard`.

    Only in a main thread, which alone handles signals; within another such block it does nothing.

    Args:
        exit_status: by the signal's number.
    """
    if current_thread() is not main_thread() or _is_open():
        yield
        return
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    _is_heard.clear()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt_and_hear)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    Thread(target=_listen, args=(reading, exit_status), name='signals', daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(-1)
        if signal.getsignal(signal.SIGINT) is interrupt_and_hear:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        os.close(writing)  # which ends the thread


def interrupt_and_hear(signal_number: int, frame: FrameType | None) -> None:
    """Handle a signal by KeyboardInterrupt, which is a way to end."""
    heard()
    signal.default_int_handler(signal_number, frame)


def _is_open() -> bool:
    """Whether somebody listens already."""
    listening = signal.set_wakeup_fd(-1)
    if listening != -1:
        signal.set_wakeup_fd(listening, warn_on_full_buffer=False)
    return listening != -1


def _listen(reading: int, exit_status: Callable[[int], int]) -> None:
    """Wait for a signal, then see that the process ends; over when the other side is closed."""
    numbers = {*map(int, stop_signals())}
    asked, asked_s = 0, 0.0
    while True:
        if select.select([reading], [], [], _LOOK_S if asked else None)[0]:
            came = os.read(reading, 1)
            if not came:
                os.close(reading)
                return
            if came[0] in numbers and not asked:
                asked, asked_s = came[0], monotonic()
        if asked and compilation.is_going_on:
            _end(exit_status(asked), 'stopped while it compiled')
        elif asked and not _is_heard.is_set() and monotonic() - asked_s >= DEAF_S:
            _end(exit_status(asked), f'stopped in a step that took more than {DEAF_S:.0f} s')


def _end(status: int, why: str) -> None:
    with suppress(OSError):
        if os.isatty(2):
            os.write(2, _SHOW_CURSOR)
        os.write(2, f'{why}; what was saved before is whole\n'.encode())
    os._exit(status)

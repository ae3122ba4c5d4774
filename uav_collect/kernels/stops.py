"""Ends a process that does not come to obey a signal: it compiles, or one step takes very long.

Python handles a signal between two of its own instructions in the main thread, and the compiler
takes minutes for one. Here another thread hears of each signal at once. While kernels are compiled
there is nothing to save. Nor does the loop of a long run come to a step at which it saves before
they are compiled. Who acknowledges a signal ends the process in its own way, however long that
takes, and nobody who saves is disturbed.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import math
import os
import select
import signal
from threading import current_thread, main_thread, RLock, Thread
from types import FrameType

from uav_collect.kernels.compile import compilation
from uav_collect.limits import stop_signals

DEAF_S = 8.0  # until a process that has not acknowledged a signal is ended; it answers within 10 s
_LOOK_S = 0.1  # from one look to the next while a signal is not acknowledged
_SHOW_CURSOR = b'\x1b[?25h\n'  # a progress display may have hidden it


class LookClock:
    """Time as the listening thread has it [s]: it stands while the whole process is held up.

    By the wall clock a process that the system has not run for a while would be ended before it
    can look at the signal.
    """

    def __init__(self) -> None:
        """Begin at 0."""
        self._n_looks = 0

    def __call__(self) -> float:
        """The time now."""
        return self._n_looks * _LOOK_S

    def note_look(self) -> None:
        """Note that nothing came until the next look."""
        self._n_looks += 1


class Watchdog:
    """Decides whether a process that was asked to end is ended by force."""

    def __init__(self, is_compiling: Callable[[], bool], clock_s: Callable[[], float]) -> None:
        """Know of nobody who would end the process.

        Args:
            is_compiling: whether kernels are being compiled.
            clock_s: a monotonic clock [s].
        """
        self._is_compiling, self._clock_s = is_compiling, clock_s
        self._lock = RLock()  # a signal may be handled while it is held
        self._is_acknowledged = False
        self._n_saving = 0
        self._saved_s = -math.inf

    def forget(self) -> None:
        """Wait for another signal."""
        self._is_acknowledged = False

    def acknowledge(self) -> None:
        """Note that who can end this process in its own way will, however long that takes.

        While kernels are compiled nobody can.
        """
        if not self._is_compiling():
            self._is_acknowledged = True

    @contextmanager
    def saving(self) -> Iterator[None]:
        """Do not end the process while the block lasts, nor before it can look at the signal."""
        with self._lock:
            self._n_saving += 1
        try:
            yield
        finally:
            with self._lock:
                self._n_saving -= 1
                self._saved_s = self._clock_s()

    def why_ended(self, asked_s: float) -> str | None:
        """Why a process that was asked to end at a time is ended now; None if it is not."""
        with self._lock:
            if self._is_acknowledged or self._n_saving:
                return None
            if self._is_compiling():
                return 'stopped while it compiled'
            if self._clock_s() - max(asked_s, self._saved_s) >= DEAF_S:
                return f'stopped in a step that took more than {DEAF_S:.0f} s'
            return None


class Interrupts:
    """How often a signal has raised KeyboardInterrupt in this process."""

    def __init__(self) -> None:
        """Start with none."""
        self.n_raised = 0

    def raise_one(self, signal_number: int, frame: FrameType | None) -> None:
        """Handle a signal by KeyboardInterrupt, which is a way to end.

        While kernels are compiled who listens ends the process: interrupted, the compiler would
        complain of what it has half built.
        """
        if compilation.is_going_on and _is_open():
            return
        self.n_raised += 1
        watchdog.acknowledge()
        signal.default_int_handler(signal_number, frame)

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Count those of Ctrl-C, too, that Python would raise itself; in a main thread."""
        is_python = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if not is_python or current_thread() is not main_thread():
            yield
            return
        own = self.raise_one
        signal.signal(signal.SIGINT, own)
        try:
            yield
        finally:
            if signal.getsignal(signal.SIGINT) is own:
                signal.signal(signal.SIGINT, signal.default_int_handler)


_clock_s = LookClock()
watchdog = Watchdog(lambda: compilation.is_going_on, _clock_s)  # of this process
interrupts = Interrupts()


@contextmanager
def obeyed_signals(exit_status: Callable[[int], int]) -> Iterator[None]:
    """End the process if a handled signal to stop is not acknowledged in time.

    Only in a main thread, which alone handles signals; within another such block it does nothing.

    Args:
        exit_status: of a process that is ended by force, by the signal's number.
    """
    if current_thread() is not main_thread() or _is_open():
        yield
        return
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    watchdog.forget()
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    Thread(target=_listen, args=(reading, exit_status), name='signals', daemon=True).start()
    try:
        with interrupts.counted():
            yield
    finally:
        signal.set_wakeup_fd(-1)
        os.close(writing)  # which ends the thread


@contextmanager
def kept_handlers() -> Iterator[None]:
    """Give signals to stop back to who handled them, whatever the block does; in a main thread.

    Handlers that are not Python's cannot be given back.
    """
    if current_thread() is not main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in stop_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)


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
                asked, asked_s = came[0], _clock_s()
        elif asked:
            _clock_s.note_look()
        if asked and (why := watchdog.why_ended(asked_s)) is not None:
            _end(exit_status(asked), why)


def _end(status: int, why: str) -> None:
    with suppress(OSError):
        if os.isatty(2):
            os.write(2, _SHOW_CURSOR)
        os.write(2, f'{why}; what was saved before is whole\n'.encode())
    os._exit(status)

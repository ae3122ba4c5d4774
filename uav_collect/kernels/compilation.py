"""Knows when this process compiles kernels, in whatever thread, and says so on stderr."""

from collections.abc import Callable
from threading import current_thread, RLock, Timer
from time import monotonic
from typing import Any

from uav_collect.kernels.patience import explain, SAID_EVERY_S, say

COMPILED_IN = 'three to four minutes of processor time'  # as documents have it
_SAID_AFTER_S = 1.0  # of compiling, in all


class Compilation:
    """Whether kernels are being compiled, and how long that has taken so far."""

    def __init__(
        self,
        say_line: Callable[[str], None] = say,
        clock_s: Callable[[], float] = monotonic,
    ) -> None:
        """Begin with none.

        Args:
            say_line: says a line to the user.
            clock_s: a monotonic clock [s].
        """
        self._say, self._clock_s = say_line, clock_s
        self._lock = RLock()  # numba may compile again while it compiles
        self._is_watched = False
        self._n_begun = 0  # and not ended
        self._begun_s = self._ended_s = 0.0
        self._say_at_s = _SAID_AFTER_S  # of compiling
        self._timer: Timer | None = None

    @property
    def is_watched(self) -> bool:
        """Whether numba was asked for a kernel: how all of them run is settled since."""
        return self._is_watched

    @property
    def is_going_on(self) -> bool:
        """Whether a kernel is being compiled now."""
        return self._n_begun > 0

    @property
    def duration_s(self) -> float:
        """How long kernels have been compiled so far, what was found in the cache left out [s]."""
        with self._lock:
            return self._ended_s + (self._clock_s() - self._begun_s if self._n_begun else 0.0)

    def now_s(self) -> float:
        """A monotonic clock that stands while kernels are compiled [s]."""
        with self._lock:
            return (self._begun_s if self._n_begun else self._clock_s()) - self._ended_s

    def watch(self, event: Any) -> None:  # noqa: ANN401 - a module
        """Let `numba.core.event` tell from now on when kernels are compiled."""
        if self._is_watched:
            return
        self._is_watched = True
        own = {'on_start': lambda *_: self.begin(), 'on_end': lambda *_: self.end()}
        explain(lambda: self.is_going_on)
        event.register('numba:compile', type('Listener', (event.Listener,), own)())

    def begin(self) -> None:
        """Note that a kernel begins to be compiled."""
        with self._lock:
            self._n_begun += 1
            if self._n_begun == 1:
                self._begun_s = self._clock_s()
                self._set_timer()

    def end(self) -> None:
        """Note that a kernel is compiled, or cannot be."""
        with self._lock:
            if self._n_begun == 1:
                self._ended_s = self.duration_s
                if self._timer is not None:
                    self._timer.cancel()
            self._n_begun -= 1

    def _set_timer(self) -> None:
        self._timer = Timer(max(0.0, self._say_at_s - self.duration_s), self._tell)
        self._timer.daemon = True
        self._timer.start()

    def _tell(self) -> None:
        with self._lock:
            if self._n_begun == 0 or current_thread() is not self._timer:
                return
            duration_s, is_due = self.duration_s, self.duration_s >= self._say_at_s
            so_far = '' if self._say_at_s == _SAID_AFTER_S else f', {duration_s:.0f} s so far'
            if is_due:
                self._say_at_s = duration_s + SAID_EVERY_S
            self._set_timer()
        if is_due:  # without the lock: whoever reads may be slow
            self._say(f'compiling kernels (once): this takes {COMPILED_IN}{so_far}')

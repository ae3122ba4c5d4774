"""How long work takes that has begun: an estimate, or none while there is nothing to go by."""

from collections import deque
from time import monotonic

_LEAST_S = 10.0  # of steady progress, until which nothing is said
_MOST_S = 300.0  # of progress that counts
_STEADY = 1.5  # most by which speeds in the two halves of that time may differ
_LEAST_STEPS = 4  # in which it came


class TimeLeft:
    """Estimates the time left from how fast the share that is done has grown of late."""

    def __init__(self) -> None:
        """Start without any progress."""
        self._steps: deque[tuple[float, float]] = deque()  # when, and what share was done then
        self._begun_s = 0.0

    def text(self, share_done: float) -> str:
        """'12:34 min left' when a share of the work, 0..1, is done; '' while that is unknown."""
        left_s = self.after(share_done, monotonic())
        return '' if left_s is None else f'{minutes_text(left_s)} left'

    def after(self, share_done: float, now_s: float) -> float | None:
        """Seconds left when a share of the work, 0..1, is done; None while that is unknown.

        The time before the first progress does not count: it went into something else.
        """
        steps = self._steps
        if not steps or share_done > steps[-1][1]:
            steps.append((now_s, share_done))
        if len(steps) == 2 and steps[0][1] == 0.0:
            steps.popleft()
        if len(steps) == 1:
            self._begun_s = now_s
        span_s = min(_MOST_S, max(_LEAST_S, 0.5 * (now_s - self._begun_s)))
        while len(steps) > 2 and steps[1][0] <= now_s - span_s:
            steps.popleft()
        first_s, first_share = steps[0]
        if now_s - first_s < _LEAST_S or len(steps) <= _LEAST_STEPS:
            return None
        middle_s = 0.5 * (first_s + now_s)
        middle_share = max(share for when_s, share in steps if when_s <= middle_s)
        slower, faster = sorted((middle_share - first_share, share_done - middle_share))
        if slower * _STEADY < faster:
            return None
        return (1.0 - share_done) * (now_s - first_s) / (share_done - first_share)


def minutes_text(duration_s: float) -> str:
    """A time as hours, minutes and seconds, as far as there are any."""
    minutes, seconds = divmod(round(duration_s), 60)
    if minutes < 60:
        return f'{minutes}:{seconds:02d} min'
    hours, minutes = divmod(minutes, 60)
    return f'{hours}:{minutes:02d} h'

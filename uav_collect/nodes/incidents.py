"""What went wrong and was survived: named in log and diagnostics, however often it comes."""

from collections import Counter, deque
from dataclasses import dataclass, field

from uav_collect.errors import in_one_line

_N_KEPT = 5  # latest incidents that diagnostics spell out
_MOST_LINES = 50  # of one kind within a period
_PERIOD_S = 10.0


@dataclass
class _Lines:
    """How much was logged of a kind since a time."""

    since_s: float
    n_written: int = 0
    n_silent: int = 0


@dataclass
class Incidents:
    """Counts incidents by kind and keeps the latest ones."""

    counts: Counter[str] = field(default_factory=Counter)
    latest: deque[str] = field(default_factory=lambda: deque(maxlen=_N_KEPT))
    _lines: dict[str, _Lines] = field(default_factory=dict)

    def note(self, kind: str, text: str, now_s: float) -> str | None:
        """Count an incident of a kind such as 'command refused'.

        Args:
            text: what happened; it is cut, and kept in one line.
            now_s: monotonic time.

        Returns:
            The line to log; None if the latest incidents read the same, or there were too many of
            this kind of late: how many, the next line tells.
        """
        text = in_one_line(text)
        self.counts[kind] += 1
        if text in self.latest:
            return None
        self.latest.append(text)
        lines = self._lines.get(kind)
        if lines is None or now_s - lines.since_s > _PERIOD_S:
            n_silent = 0 if lines is None else lines.n_silent
            self._lines[kind] = _Lines(since_s=now_s, n_written=1)
            return f'{text} (and {n_silent} more: {kind})' if n_silent else text
        if lines.n_written == _MOST_LINES:
            lines.n_silent += 1
            return None
        lines.n_written += 1
        return text

    def summary(self) -> list[tuple[str, str]]:
        """Keys and values for diagnostics: how many of each kind, then the latest ones."""
        counted = [(kind, str(count)) for kind, count in self.counts.items()]
        latest = [
            (f'latest incident {number}', text)
            for number, text in enumerate(reversed(self.latest), start=1)
        ]
        return [*counted, *latest]

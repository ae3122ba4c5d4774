"""What went wrong and was survived: named in the log and in diagnostics."""

from collections import Counter, deque
from dataclasses import dataclass, field

_N_KEPT = 5  # latest incidents that diagnostics spell out


@dataclass
class Incidents:
    """Counts incidents by kind and keeps the latest ones."""

    counts: Counter[str] = field(default_factory=Counter)
    latest: deque[str] = field(default_factory=lambda: deque(maxlen=_N_KEPT))

    def note(self, kind: str, text: str) -> bool:
        """Count an incident of a kind such as 'command refused'.

        Returns:
            Whether it is worth a line: the latest ones read otherwise.
        """
        self.counts[kind] += 1
        is_new = text not in self.latest
        if is_new:
            self.latest.append(text)
        return is_new

    def summary(self) -> list[tuple[str, str]]:
        """Keys and values for diagnostics: how many of each kind, then the latest ones."""
        counted = [(kind, str(count)) for kind, count in self.counts.items()]
        latest = [
            (f'latest incident {number}', text)
            for number, text in enumerate(reversed(self.latest), start=1)
        ]
        return [*counted, *latest]

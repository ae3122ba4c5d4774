"""What went wrong and was survived: named in the log and in diagnostics."""

from collections import Counter, deque
from dataclasses import dataclass, field

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

_KEPT = 5  # latest incidents that diagnostics spell out


@dataclass
class Incidents:
    """Counts incidents by kind and keeps the latest ones."""

    counts: Counter[str] = field(default_factory=Counter)
    latest: deque[str] = field(default_factory=lambda: deque(maxlen=_KEPT))

    def note(self, kind: str, text: str) -> None:
        """Count an incident of a kind such as 'command refused'."""
        self.counts[kind] += 1
        self.latest.append(text)

    def key_values(self) -> list[KeyValue]:
        """For a diagnostic status."""
        counted = [KeyValue(key=kind, value=str(count)) for kind, count in self.counts.items()]
        told = [
            KeyValue(key=f'latest incident {number}', value=text)
            for number, text in enumerate(reversed(self.latest), start=1)
        ]
        return [*counted, *told]


def diagnostics(stamp: Time, statuses: list[DiagnosticStatus]) -> DiagnosticArray:
    """The statuses as one message."""
    message = DiagnosticArray(status=statuses)
    message.header.stamp = stamp
    return message


def status(
    level: bytes, name: str, message: str, values: list[KeyValue] | None = None
) -> DiagnosticStatus:
    """One diagnostic status; the hardware is the UAV or world that the name begins with."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id=name.partition(':')[0],
        values=values or [],
    )

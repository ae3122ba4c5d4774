"""What went wrong and was survived: named in the log and in diagnostics."""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from uav_collect.lockstep.roster import Roster

_KEPT = 5  # latest incidents that diagnostics spell out


@dataclass
class Incidents:
    """Counts incidents by kind and keeps the latest ones."""

    counts: Counter[str] = field(default_factory=Counter)
    latest: deque[str] = field(default_factory=lambda: deque(maxlen=_KEPT))

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

    def key_values(self) -> list[KeyValue]:
        """For a diagnostic status."""
        counted = [KeyValue(key=kind, value=str(count)) for kind, count in self.counts.items()]
        told = [
            KeyValue(key=f'latest incident {number}', value=text)
            for number, text in enumerate(reversed(self.latest), start=1)
        ]
        return [*counted, *told]


def world_diagnostics(
    stamp: Time,
    incidents: Incidents,
    roster: Roster,
    mission_id: str,
    unflown: Iterable[int],
    namespace: str = '',
) -> DiagnosticArray:
    """How a world and its fleet are.

    Args:
        stamp: wall-clock time.
        mission_id: of the mission in flight; empty if there is none.
        unflown: ids of the UAVs that the failsafe has flown home.
        namespace: of the world, '' or such as '/a'; other worlds speak of others.
    """
    values = incidents.key_values()
    world = f'{namespace[1:]}/' if namespace else ''
    level = DiagnosticStatus.WARN if values else DiagnosticStatus.OK
    told = f'mission {mission_id} in flight' if mission_id else 'no mission in flight'
    statuses = [_status(level, f'{world}world_sim: mission', told, values)]
    for uav in range(1, roster.n_uavs + 1):
        level, told = DiagnosticStatus.OK, str(roster.pilots.get(uav, ''))
        if uav in unflown:
            level, told = DiagnosticStatus.ERROR, 'flown home by the failsafe'
        elif uav in roster.missing():
            level, told = DiagnosticStatus.WARN, 'no agent'
        statuses.append(_status(level, f'{world}uav_{uav}: agent', told, []))
    message = DiagnosticArray(status=statuses)
    message.header.stamp = stamp
    return message


def _status(level: bytes, name: str, message: str, values: list[KeyValue]) -> DiagnosticStatus:
    hardware = name.partition(':')[0]
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id=hardware, values=values
    )

"""How a world and its fleet are: incidents at once in its log, every second in diagnostics."""

from collections.abc import Collection
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from uav_collect.lockstep.roster import Roster
from uav_collect.nodes import topics
from uav_collect.nodes.process import ProcessNode
from uav_collect.nodes.topics import publisher
from uav_collect.nodes.world.mission import MissionInFlight

_PERIOD_S = 1.0


class WorldDiagnostics:
    """The incidents of a world, and its publisher of diagnostics."""

    def __init__(self, node: ProcessNode, namespace: str) -> None:
        """Advertise diagnostics for the world of a namespace, '' or such as '/a'."""
        self._node = node
        # Worlds share /diagnostics: the names of their parts begin with their own.
        self._prefix = f'{namespace[1:]}/' if namespace else ''
        self._published_s = 0.0
        self._publisher = publisher(node, topics.DIAGNOSTICS)

    def warn(self, kind: str, text: str) -> None:
        """Log and publish an incident of a kind such as 'command refused'."""
        if self._node.warn(kind, text):
            self._published_s = 0.0  # soon

    def warn_if_lost(self, failure: str | None) -> None:
        """Log and publish why something could not be written, if that is so."""
        if failure is not None:
            self.warn('log lost', failure)

    def is_due(self, now_s: float) -> bool:
        """Whether diagnostics are to be published, by the monotonic clock."""
        return now_s - self._published_s > _PERIOD_S

    def publish(self, roster: Roster, mission: MissionInFlight | None) -> None:
        """Publish how the world and its fleet are."""
        self._published_s = time.monotonic()
        unflown = () if mission is None else mission.unflown
        statuses = [self._mission_status('' if mission is None else mission.mission_id)]
        statuses += [
            self._agent_status(roster, uav, unflown) for uav in range(1, roster.n_uavs + 1)
        ]
        message = DiagnosticArray(status=statuses)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _mission_status(self, mission_id: str) -> DiagnosticStatus:
        values = [KeyValue(key=key, value=value) for key, value in self._node.incidents.summary()]
        level = DiagnosticStatus.WARN if values else DiagnosticStatus.OK
        text = f'mission {mission_id} in flight' if mission_id else 'no mission in flight'
        return _status(level, f'{self._prefix}world_sim: mission', text, values)

    def _agent_status(
        self, roster: Roster, uav: int, unflown: Collection[int]
    ) -> DiagnosticStatus:
        level, text = DiagnosticStatus.OK, str(roster.pilots.get(uav, ''))
        if uav in unflown:
            level, text = DiagnosticStatus.ERROR, 'flown home by the failsafe'
        elif uav in roster.missing():
            level, text = DiagnosticStatus.WARN, 'no agent'
        return _status(level, f'{self._prefix}uav_{uav}: agent', text, [])


def _status(level: bytes, name: str, message: str, values: list[KeyValue]) -> DiagnosticStatus:
    hardware = name.partition(':')[0]
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id=hardware, values=values
    )

"""Who flies which UAV: agents join, leave silently, come back."""

from dataclasses import dataclass, field

from uav_collect.limits import GUARD_AFTER
from uav_collect.uav.action_codes import NONE


@dataclass(frozen=True, kw_only=True)
class Pilot:
    """An agent process that asks to fly a UAV."""

    uav: int  # id, from 1
    instance: str  # UUID of the process
    host: str
    pid: int
    policy: str
    policy_version: str
    allocator: str
    guard_after: int = NONE  # decisions without news after which its guard decides; 0: never

    def __str__(self) -> str:
        """Name the process and its host for people."""
        return f'process {self.pid} on {self.host}'

    @property
    def configuration(self) -> str:
        """What decides; it stays the same within a mission, whichever process flies."""
        guard = (
            '' if self.guard_after in (NONE, GUARD_AFTER) else f', guard after {self.guard_after}'
        )
        return (
            f'policy {self.policy!r} ({self.policy_version}), bandwidth {self.allocator!r}{guard}'
        )


@dataclass(frozen=True, kw_only=True)
class JoinAnswer:
    """Whether an agent may fly the UAV that it asks for."""

    accepted: bool
    retry: bool = False  # the UAV's last agent seems alive, but may be dying
    reason: str = ''


@dataclass
class Roster:
    """The pilots of a fleet, by UAV id."""

    n_uavs: int
    pilots: dict[int, Pilot] = field(default_factory=dict)  # the latest of each UAV
    present: set[int] = field(default_factory=set)  # UAVs whose pilot is alive
    flying: dict[int, Pilot] = field(default_factory=dict)  # as the mission in flight began

    def join(self, pilot: Pilot) -> JoinAnswer:
        """Let an agent fly a UAV, or say why not."""
        if not 1 <= pilot.uav <= self.n_uavs:
            return JoinAnswer(
                accepted=False,
                reason=f'UAV {pilot.uav} is unknown: the scenario has UAVs 1..{self.n_uavs}',
            )
        holder = self.pilots.get(pilot.uav)
        if holder and holder.instance != pilot.instance and pilot.uav in self.present:
            reason = f'UAV {pilot.uav} is flown by another agent, {holder}'
            return JoinAnswer(accepted=False, retry=True, reason=reason)
        begun = self.flying.get(pilot.uav)
        if begun and begun.configuration != pilot.configuration:
            return JoinAnswer(
                accepted=False,
                reason=f'UAV {pilot.uav} began the mission in flight with {begun.configuration}, '
                f'not {pilot.configuration}',
            )
        self.pilots[pilot.uav] = pilot
        self.present.add(pilot.uav)
        return JoinAnswer(accepted=True)

    def begin_mission(self) -> None:
        """Fix the pilots of the mission that starts now."""
        self.flying = {uav: self.pilots[uav] for uav in sorted(self.present)}

    def end_mission(self) -> None:
        """Let any policy join: between missions there is none to stay with."""
        self.flying = {}

    def mark_gone(self, uav: int) -> Pilot | None:
        """Note that the agent of a UAV is gone; which one it was."""
        if uav not in self.present:
            return None
        self.present.discard(uav)
        return self.pilots[uav]

    def mark_alive(self, uav: int) -> None:
        """Note that the agent of a UAV, thought to be gone, was only too slow to be heard."""
        if uav in self.pilots:
            self.present.add(uav)

    def missing(self) -> list[int]:
        """Ids of the UAVs without an agent."""
        return [uav for uav in range(1, self.n_uavs + 1) if uav not in self.present]

    def is_flown_by(self, uav: int, instance: str) -> bool:
        """Whether an agent process is the one that flies a UAV."""
        pilot = self.pilots.get(uav)
        return pilot is not None and pilot.instance == instance

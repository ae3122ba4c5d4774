"""Who flies which UAV: agents join, leave silently, come back.

An agent that asks to join gets a claim, which keeps nobody else out. The UAV is its own once it
has greeted the world on its command topic: a request alone, forged or of a process that died, is
worth nothing. An agent that greeted and then showed no sign of life is gone as well:
the middleware only reports those dead who were alive once.
"""

from dataclasses import dataclass, field

from uav_collect.limits import GUARD_AFTER
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.policy import TOPIC

CONFIRM_S = 3.0  # for a greeting to be followed by a sign of life
_MOST_CLAIMS = 32  # for one UAV, the latest


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
        # Which version a trainer's policy has, each mission says by itself.
        version = '' if self.policy == TOPIC else f' ({self.policy_version})'
        return f'policy {self.policy!r}{version}, bandwidth {self.allocator!r}{guard}'


@dataclass(frozen=True, kw_only=True)
class JoinAnswer:
    """Whether an agent may fly the UAV that it asks for."""

    accepted: bool
    retry: bool = False  # the UAV's last agent seems alive, but may be dying
    reason: str = ''


@dataclass
class Roster:
    """The pilots of a fleet, by UAV id; times are of one monotonic clock."""

    n_uavs: int
    pilots: dict[int, Pilot] = field(default_factory=dict)  # the latest of each UAV
    present: set[int] = field(default_factory=set)  # UAVs whose pilot is alive
    flying: dict[int, Pilot] = field(default_factory=dict)  # as the mission in flight began
    _claims: dict[int, dict[str, Pilot]] = field(default_factory=dict)  # by UAV, then instance
    _alive: set[int] = field(default_factory=set)  # UAVs on whose topic somebody is alive
    _unproven: dict[int, float] = field(
        default_factory=dict
    )  # present UAVs not among those: until

    def join(self, pilot: Pilot) -> JoinAnswer:
        """Let an agent claim a UAV, or say why not."""
        refusal = self._refusal(pilot)
        if refusal is not None:
            return refusal
        claims = self._claims.setdefault(pilot.uav, {})
        claims.pop(pilot.instance, None)
        if len(claims) == _MOST_CLAIMS:
            del claims[next(iter(claims))]
        claims[pilot.instance] = pilot
        return JoinAnswer(accepted=True)

    def greet(self, uav: int, instance: str, now_s: float) -> JoinAnswer:
        """Let an agent that has a claim fly the UAV, or say why not."""
        pilot = self._claims.get(uav, {}).pop(instance, None)
        if pilot is None:
            if uav in self.present and self.is_flown_by(uav, instance):
                return JoinAnswer(accepted=True)
            return JoinAnswer(accepted=False, retry=True, reason='it has not joined')
        refusal = self._refusal(pilot)
        if refusal is not None:
            return refusal
        self.pilots[uav] = pilot
        self.present.add(uav)
        if uav not in self._alive:
            self._unproven[uav] = now_s + CONFIRM_S
        return JoinAnswer(accepted=True)

    def begin_mission(self) -> None:
        """Fix the pilots of the mission that starts now."""
        self.flying = {uav: self.pilots[uav] for uav in sorted(self.present)}

    def end_mission(self) -> None:
        """Let any policy join: between missions there is none to stay with."""
        self.flying = {}

    def change_fleet(self, n_uavs: int) -> None:
        """Let all agents join anew, a fleet of another scenario.

        Who is alive on the topics of UAVs stays known: agents keep their publishers.
        """
        self.n_uavs = n_uavs
        for record in (self.pilots, self.present, self.flying, self._claims, self._unproven):
            record.clear()

    def mark_gone(self, uav: int) -> Pilot | None:
        """Note that nobody is alive on a UAV's topic; the agent that is gone."""
        self._alive.discard(uav)
        return self._remove(uav)

    def mark_alive(self, uav: int, *, is_back: bool = False) -> Pilot | None:
        """Note a sign of life on a UAV's topic.

        Args:
            is_back: of an agent that was thought to be gone, and was only too slow to be heard.

        Returns:
            The UAV's last agent, if that was given up and may be who lives: it has to join anew.
        """
        self._alive.add(uav)
        self._unproven.pop(uav, None)
        if is_back and uav in self.pilots:
            self.present.add(uav)
        return None if uav in self.present else self.pilots.get(uav)

    def remove_silent(self, now_s: float) -> list[Pilot]:
        """Give up agents that greeted and showed no sign of life since; which ones."""
        silent = [uav for uav, until_s in self._unproven.items() if now_s > until_s]
        return [lost for uav in silent if (lost := self._remove(uav)) is not None]

    def missing(self) -> list[int]:
        """Ids of the UAVs without an agent."""
        return [uav for uav in range(1, self.n_uavs + 1) if uav not in self.present]

    def is_flown_by(self, uav: int, instance: str) -> bool:
        """Whether an agent process is the one that flies a UAV."""
        pilot = self.pilots.get(uav)
        return pilot is not None and pilot.instance == instance

    def _remove(self, uav: int) -> Pilot | None:
        self._unproven.pop(uav, None)
        if uav not in self.present:
            return None
        self.present.discard(uav)
        return self.pilots[uav]

    def _refusal(self, pilot: Pilot) -> JoinAnswer | None:
        """Why an agent may not fly the UAV that it asks for; None if it may."""
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
        return None

"""Joins what messages tell of missions into episodes: whole, or not at all.

Messages may come in any order, twice or never. A mission is handed out once all of it is here, and
given up once so many later ones were, or when there is no room for more.
"""

from collections import Counter, OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum

from uav_collect.ingest.rebuild import MissionParts, Retracer
from uav_collect.ingest.reports import (
    EventTold,
    is_decision,
    is_failsafe,
    MissionTold,
    RefusedError,
    Terms,
    Told,
    TransitionTold,
)
from uav_collect.missions.experience import Episode
from uav_collect.uav.actions import HOME

_PATIENCE_MISSIONS = 8  # later ones joined before a mission is given up
_N_REMEMBERED = 4096  # missions whose stragglers are known as such


class Cause(StrEnum):
    """Why a mission was dropped."""

    MISSING = 'missing'  # a message did not come
    REFUSED = 'refused'  # a message does not match the scenario, the layout or other messages
    FAILSAFE = 'failsafe'  # an agent did not answer: nobody chose to fly home


class Fate(StrEnum):
    """What became of a message about an event or a decision."""

    USED = 'used'
    UNNEEDED = 'unneeded'  # of UAVs that turn home, or past the end of what is kept
    DUPLICATE = 'duplicate'
    LATE = 'late'  # its mission had been given up
    DROPPED = 'dropped'  # with its mission


@dataclass(frozen=True, kw_only=True)
class Joined:
    """A mission, whole or cut off where it had enough decisions."""

    mission_id: str
    episode: Episode
    efficiency_kbit_per_j: float


@dataclass
class Tally:
    """What became of missions and of messages."""

    n_joined: int = 0  # missions, those that were cut off among them
    dropped: Counter[Cause] = field(default_factory=Counter)  # missions
    messages: Counter[Fate] = field(default_factory=Counter)

    @staticmethod
    def sum(tallies: 'Iterable[Tally]') -> 'Tally':
        """That of several worlds."""
        total = Tally()
        for each in tallies:
            total.n_joined += each.n_joined
            total.dropped += each.dropped
            total.messages += each.messages
        return total


@dataclass
class _Mission:
    """What came of one mission."""

    told: MissionTold | None = None
    events: dict[int, EventTold] = field(default_factory=dict)
    transitions: dict[int, TransitionTold] = field(default_factory=dict)  # by event
    n_ready: int = 0  # leading events that are here, with their decisions
    n_decided: int = 0  # of them
    is_whole: bool = False  # they are all of the mission
    is_cut: bool = False  # they are all that is kept of it
    cut_after: int | None = None  # decisions, where the world gave it up
    n_overtaken: int = 0  # later missions that were joined

    @property
    def n_messages(self) -> int:
        return len(self.events) + len(self.transitions)

    @property
    def is_here(self) -> bool:
        return self.told is not None and (self.is_whole or self.is_cut)

    def note(self, told: Told) -> bool:
        """Keep a message; whether it may be news.

        Raises:
            RefusedError: there is another one in its place.
        """
        known: Told | None
        match told:
            case MissionTold():
                known, self.told = self.told, told
                self.cut_after = told.cut_after or self.cut_after
            case EventTold():
                known = self.events.get(told.event)
                self.events[told.event] = told
            case TransitionTold():
                known = self.transitions.get(told.event)
                self.transitions[told.event] = told
        if known is not None and known != told:
            event = '' if isinstance(told, MissionTold) else f', event {told.event}'
            raise RefusedError(f'mission {told.mission_id}{event}: is told in two ways')
        return known is None or isinstance(told, MissionTold)

    def advance(self, max_decisions: int) -> None:
        """Go on past the events that are here."""
        while not (self.is_whole or self.is_cut):
            event = self.events.get(self.n_ready)
            if event is None or (is_decision(event) and event.event not in self.transitions):
                break
            self.n_ready += 1
            self.n_decided += is_decision(event)
            self.is_cut = self.n_decided > max_decisions
            self.is_whole = event.is_last and not self.is_cut
        self.is_cut |= self.cut_after is not None and self.n_decided >= self.cut_after > 1

    def parts(self) -> MissionParts:
        if self.told is None or self.n_decided == 0:
            raise RefusedError(f'mission {self.events[0].mission_id}: holds no decision')
        return MissionParts(
            told=self.told,
            events=[self.events[index] for index in range(self.n_ready)],
            transitions=self.transitions,
            is_whole=self.is_whole,
        )


class Assembly:
    """Joins the missions of one world, which flies one after the other."""

    def __init__(
        self,
        terms: Terms,
        retracer: Retracer,
        *,
        max_decisions: int,
        max_messages: int = 20_000,
        known: Iterable[str] = (),
    ) -> None:
        """Wait for the first message.

        Args:
            max_decisions: after how many a mission is cut off.
            max_messages: that wait at most; for more, the missions that wait longest are dropped.
            known: ids of missions that were joined before.
        """
        self.tally = Tally()
        self._terms, self._retracer = terms, retracer
        self._max_decisions, self._max_messages = max_decisions, max_messages
        self._missions: OrderedDict[str, _Mission] = OrderedDict()  # by id, the oldest first
        self._closed: OrderedDict[str, Fate] = OrderedDict()  # by id: what awaits its stragglers
        self.n_waiting = 0  # messages about events and decisions
        for mission_id in known:
            self._close(mission_id, Fate.UNNEEDED)

    def take(self, told: Told) -> Joined | None:
        """Take a message.

        Returns:
            The mission that is here with it, if one is.

        Raises:
            RefusedError: the message cannot be learned from; its mission is dropped.
        """
        mission_id = told.mission_id
        if mission_id in self._closed:
            self._count(told, self._closed[mission_id])
            return None
        if isinstance(told, TransitionTold) and told.action == HOME:
            self._count(told, Fate.UNNEEDED)
            return None
        mission = self._missions.setdefault(mission_id, _Mission())
        try:
            self._terms.check(told)
            is_new = mission.note(told)
        except RefusedError:
            self._count(told, Fate.DROPPED)
            self._drop(mission_id, Cause.REFUSED)
            raise
        if not is_new:
            self._count(told, Fate.DUPLICATE)
            return None
        self.n_waiting += not isinstance(told, MissionTold)
        return self._go_on(mission_id, mission, told)

    def give_up(self) -> None:
        """Drop the missions that still wait for messages: no more will come."""
        for mission_id in [*self._missions]:
            self._drop(mission_id, Cause.MISSING)

    def _go_on(self, mission_id: str, mission: _Mission, told: Told) -> Joined | None:
        if isinstance(told, EventTold) and is_failsafe(told):
            self._drop(mission_id, Cause.FAILSAFE)
            return None
        mission.advance(self._max_decisions)
        joined = self._join(mission_id, mission) if mission.is_here else None
        self._make_room()
        return joined

    def _join(self, mission_id: str, mission: _Mission) -> Joined:
        try:
            parts = mission.parts()
            joined = Joined(
                mission_id=mission_id,
                episode=self._retracer.episode(parts),
                efficiency_kbit_per_j=self._retracer.efficiency_kbit_per_j(parts),
            )
        except RefusedError:
            self._drop(mission_id, Cause.REFUSED)
            raise
        n_used = mission.n_ready + mission.n_decided
        self.tally.n_joined += 1
        self.tally.messages[Fate.USED] += n_used
        self.tally.messages[Fate.UNNEEDED] += mission.n_messages - n_used
        for older in [*self._missions]:
            if older == mission_id:
                break
            self._missions[older].n_overtaken += 1
            if self._missions[older].n_overtaken >= _PATIENCE_MISSIONS:
                self._drop(older, Cause.MISSING)
        self._close(mission_id, Fate.UNNEEDED if mission.is_cut else Fate.DUPLICATE)
        return joined

    def _make_room(self) -> None:
        while self.n_waiting > self._max_messages or len(self._missions) > _N_REMEMBERED:
            self._drop(next(iter(self._missions)), Cause.MISSING)

    def _drop(self, mission_id: str, cause: Cause) -> None:
        self.tally.dropped[cause] += 1
        self.tally.messages[Fate.DROPPED] += self._missions[mission_id].n_messages
        self._close(mission_id, Fate.LATE if cause is Cause.MISSING else Fate.DROPPED)

    def _close(self, mission_id: str, stragglers: Fate) -> None:
        mission = self._missions.pop(mission_id, None)
        self.n_waiting -= 0 if mission is None else mission.n_messages
        self._closed[mission_id] = stragglers
        if len(self._closed) > _N_REMEMBERED:
            self._closed.popitem(last=False)

    def _count(self, told: Told, fate: Fate) -> None:
        if not isinstance(told, MissionTold):
            self.tally.messages[fate] += 1

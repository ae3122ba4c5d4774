"""Joins reports of missions into episodes: whole, or not at all.

Reports may come in any order, twice or never. A mission is handed out once all of it is here and
its world has said that it is its own; it is given up once so many later ones were handed out, or
when there is no room for more.
"""

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import StrEnum

from uav_collect.errors import RefusedError
from uav_collect.ingest.mission_ids import MissionIds
from uav_collect.ingest.rebuild import EpisodeBuilder, MissionParts
from uav_collect.ingest.reports import (
    EventReport,
    FleetReport,
    MissionReport,
    ReportSpec,
    TransitionReport,
)
from uav_collect.missions.experience import Episode
from uav_collect.uav.action_codes import HOME

_PATIENCE_MISSIONS = 8  # later ones joined before a mission is given up
_N_REMEMBERED = 4096  # missions that are closed whose stragglers are known as such


class DropReason(StrEnum):
    """Why a mission was dropped."""

    MISSING = 'incomplete'  # a report did not come
    REFUSED = 'refused'  # a report does not match the scenario, the layout or other reports
    FAILSAFE = 'by the failsafe'  # an agent did not answer: nobody chose to fly home
    FOREIGN = 'foreign'  # no world that lives says that it is its own: a recording, played back


class ReportOutcome(StrEnum):
    """What became of the report of an event or a decision."""

    USED = 'used'
    UNNEEDED = 'unneeded'  # of UAVs that turn home, or past the end of what is kept
    DUPLICATE = 'duplicate'
    LATE = 'late'  # its mission had been given up
    DROPPED = 'dropped'  # with its mission


@dataclass(frozen=True, kw_only=True)
class JoinedMission:
    """A mission, whole or cut off where it had enough decisions."""

    mission_id: str
    episode: Episode
    efficiency_kbit_per_j: float


@dataclass
class JoinCounts:
    """What became of missions and of reports."""

    n_joined: int = 0  # missions, those that were cut off among them
    n_known: int = 0  # missions that were joined before, here or elsewhere
    dropped: Counter[DropReason] = field(default_factory=Counter)  # missions
    reports: Counter[ReportOutcome] = field(default_factory=Counter)
    n_missing: int = 0  # reports that dropped missions lacked, as far as those beside them show

    @property
    def missions_text(self) -> str:
        """What became of the missions, for people."""
        words = [f'{self.n_joined} missions joined']
        if self.n_known:
            words.append(f'{self.n_known} known before')
        reasons = [f'{n} {reason}' for reason in DropReason if (n := self.dropped[reason])]
        if reasons:
            words.append(f'{self.dropped.total()} dropped: {", ".join(reasons)}')
        return ', '.join(words)

    @property
    def messages_text(self) -> str:
        """What became of single reports, for people; empty where all of them were used."""
        counts = {
            'came twice': self.reports[ReportOutcome.DUPLICATE],
            'came too late': self.reports[ReportOutcome.LATE],
            'did not come': self.n_missing,
        }
        return ', '.join(f'{n} {what}' for what, n in counts.items() if n)

    @property
    def n_missions(self) -> int:
        """All missions that something was reported of and that wait no more."""
        return self.n_joined + self.n_known + self.dropped.total()

    @staticmethod
    def sum(parts: 'Iterable[JoinCounts]') -> 'JoinCounts':
        """The counts of several worlds together."""
        total = JoinCounts()
        for part in parts:
            total.n_joined += part.n_joined
            total.n_known += part.n_known
            total.dropped += part.dropped
            total.reports += part.reports
            total.n_missing += part.n_missing
        return total


@dataclass
class _PartialMission:
    """The reports of one mission that are here."""

    about: MissionReport | None = None
    events: dict[int, EventReport] = field(default_factory=dict)
    transitions: dict[int, TransitionReport] = field(default_factory=dict)  # by event
    n_ready: int = 0  # events without a gap from the first on, with their decisions
    n_decided: int = 0  # of them
    is_whole: bool = False  # they are all of the mission
    is_cut: bool = False  # they are all that is kept of it
    cut_after: int | None = None  # decisions, where the world aborted it
    is_own: bool = False  # its world has said so, or nobody asks
    n_overtaken: int = 0  # later missions that were joined

    @property
    def n_reports(self) -> int:
        return len(self.events) + len(self.transitions)

    @property
    def n_missing(self) -> int:
        """How many reports lie in the gaps between those that are here."""
        n_events = 1 + max((*self.events, *self.transitions), default=-1)
        decided = {event.event for event in self.events.values() if event.is_decision}
        return n_events - len(self.events) + len(decided - self.transitions.keys())

    @property
    def is_asked(self) -> bool:
        """Whether its world has still to answer."""
        return self.about is not None and not self.is_own

    @property
    def is_ready(self) -> bool:
        return self.is_own and self.about is not None and (self.is_whole or self.is_cut)

    def add(self, report: FleetReport) -> bool:
        """Keep a report; whether it may be news.

        Raises:
            RefusedError: there is another one in its place.
        """
        known: FleetReport | None
        match report:
            case MissionReport():
                known, self.about = self.about, report
                self.cut_after = report.cut_after or self.cut_after
            case EventReport():
                known = self.events.get(report.event)
                self.events[report.event] = report
            case TransitionReport():
                known = self.transitions.get(report.event)
                self.transitions[report.event] = report
        if known is not None and known != report:
            event = '' if isinstance(report, MissionReport) else f', event {report.event}'
            raise RefusedError(f'mission {report.mission_id}{event}: is told in two ways')
        return known is None or isinstance(report, MissionReport)

    def advance(self, max_decisions: int) -> None:
        """Count the events that are ready, up to the first gap."""
        while not (self.is_whole or self.is_cut):
            event = self.events.get(self.n_ready)
            if event is None or (event.is_decision and event.event not in self.transitions):
                break
            self.n_ready += 1
            self.n_decided += event.is_decision
            self.is_cut = self.n_decided > max_decisions
            self.is_whole = event.is_last and not self.is_cut
        self.is_cut |= self.cut_after is not None and self.n_decided >= self.cut_after > 1

    def parts(self) -> MissionParts:
        if self.about is None or self.n_decided == 0:
            raise RefusedError(f'mission {self.events[0].mission_id}: holds no decision')
        return MissionParts(
            mission=self.about,
            events=[self.events[index] for index in range(self.n_ready)],
            transitions=self.transitions,
            is_whole=self.is_whole,
        )


class MissionJoiner:
    """Joins the missions of one world, which flies one after the other."""

    def __init__(
        self,
        spec: ReportSpec,
        builder: EpisodeBuilder,
        *,
        max_decisions: int,
        max_reports: int = 20_000,
        known: MissionIds | None = None,
        ask: Callable[[MissionReport], None] | None = None,
    ) -> None:
        """Wait for the first report.

        Args:
            spec: what reports must match.
            builder: of the episodes of missions that are joined.
            max_decisions: after how many a mission is cut off.
            max_reports: that wait at most; for more, the missions that wait longest are dropped.
            known: missions that were joined before, here or elsewhere; others may add to them.
            ask: asks the world that a mission names whether it is its own, for `answer`; None:
                what was recorded needs nobody's word.
        """
        self.counts = JoinCounts()
        self._spec, self._builder = spec, builder
        self._max_decisions, self._max_reports = max_decisions, max_reports
        self._ask = ask
        self._missions: OrderedDict[str, _PartialMission] = OrderedDict()  # by id, oldest first
        self._closed: OrderedDict[str, ReportOutcome] = OrderedDict()  # by id: of its stragglers
        self._known = MissionIds() if known is None else known
        self.n_waiting = 0  # reports of events and decisions

    def add(self, report: FleetReport) -> JoinedMission | None:
        """Keep a report until its mission is whole, or needs it no more.

        Returns:
            The mission that it makes whole, if it does.

        Raises:
            RefusedError: the report cannot be learned from; its mission is dropped.
        """
        mission_id = report.mission_id
        if mission_id in self._closed:
            self._count(report, self._closed[mission_id])
            return None
        if mission_id in self._known:
            self.counts.n_known += 1
            self._close(mission_id, ReportOutcome.UNNEEDED)
            self._count(report, ReportOutcome.UNNEEDED)
            return None
        if self._is_unneeded(report):
            self._count(report, ReportOutcome.UNNEEDED)
            return None
        mission = self._missions.setdefault(mission_id, _PartialMission(is_own=self._ask is None))
        try:
            self._spec.check(report)
            is_first = mission.about is None
            is_new = mission.add(report)
        except RefusedError:
            self._count(report, ReportOutcome.DROPPED)
            self._drop(mission_id, DropReason.REFUSED)
            raise
        if not is_new:
            self._count(report, ReportOutcome.DUPLICATE)
            return None
        self.n_waiting += not isinstance(report, MissionReport)
        if isinstance(report, MissionReport) and self._ask is not None and is_first:
            self._ask(report)
        return self._advance(mission_id, mission, report)

    @property
    def n_unvouched(self) -> int:
        """How many missions wait for the answer of their world."""
        return sum(mission.is_asked for mission in self._missions.values())

    def answer(self, mission_id: str, *, is_own: bool) -> JoinedMission | None:
        """Note what the world of a mission has answered, or that nobody has.

        Returns:
            The mission, if it waited for nothing else.

        Raises:
            RefusedError: its reports contradict each other; it is dropped.
        """
        mission = self._missions.get(mission_id)
        if mission is None:
            return None
        if not is_own:
            self._drop(mission_id, DropReason.FOREIGN)
            return None
        mission.is_own = True
        return self._join(mission_id, mission) if mission.is_ready else None

    def _is_unneeded(self, report: FleetReport) -> bool:
        """Whether a report is of a UAV that turns home, or of a mission longer than has room."""
        if isinstance(report, MissionReport):
            return False
        is_home = isinstance(report, TransitionReport) and report.action == HOME
        return is_home or report.event >= self._max_reports

    def drop_incomplete(self) -> None:
        """Drop the missions that still wait for reports: no more will come."""
        for mission_id in [*self._missions]:
            self._drop(mission_id, DropReason.MISSING)

    def _advance(
        self, mission_id: str, mission: _PartialMission, report: FleetReport
    ) -> JoinedMission | None:
        """Join a mission if the new report makes it whole, or drop it if nobody flew it."""
        if isinstance(report, EventReport) and report.is_failsafe:
            self._drop(mission_id, DropReason.FAILSAFE)
            return None
        mission.advance(self._max_decisions)
        joined = self._join(mission_id, mission) if mission.is_ready else None
        self._make_room()
        return joined

    def _join(self, mission_id: str, mission: _PartialMission) -> JoinedMission:
        try:
            parts = mission.parts()
            joined = JoinedMission(
                mission_id=mission_id,
                episode=self._builder.episode(parts),
                efficiency_kbit_per_j=self._builder.efficiency_kbit_per_j(parts),
            )
        except RefusedError:
            self._drop(mission_id, DropReason.REFUSED)
            raise
        n_used = mission.n_ready + mission.n_decided
        self.counts.n_joined += 1
        self.counts.reports[ReportOutcome.USED] += n_used
        self.counts.reports[ReportOutcome.UNNEEDED] += mission.n_reports - n_used
        self._note_overtaken(mission_id)
        stragglers = ReportOutcome.UNNEEDED if mission.is_cut else ReportOutcome.DUPLICATE
        self._close(mission_id, stragglers)
        return joined

    def _note_overtaken(self, mission_id: str) -> None:
        """Drop the missions that began before this one, once enough such were joined.

        Those whose world has not answered yet wait for that, not for reports.
        """
        for older in [*self._missions]:
            if older == mission_id:
                break
            if self._missions[older].is_asked:
                continue
            self._missions[older].n_overtaken += 1
            if self._missions[older].n_overtaken >= _PATIENCE_MISSIONS:
                self._drop(older, DropReason.MISSING)

    def _make_room(self) -> None:
        """Drop the missions that wait longest, if too much waits."""
        while self.n_waiting > self._max_reports or len(self._missions) > _N_REMEMBERED:
            self._drop(next(iter(self._missions)), DropReason.MISSING)

    def _drop(self, mission_id: str, reason: DropReason) -> None:
        self.counts.dropped[reason] += 1
        self.counts.reports[ReportOutcome.DROPPED] += self._missions[mission_id].n_reports
        is_missing = reason is DropReason.MISSING
        self.counts.n_missing += self._missions[mission_id].n_missing if is_missing else 0
        self._close(mission_id, ReportOutcome.LATE if is_missing else ReportOutcome.DROPPED)

    def _close(self, mission_id: str, stragglers: ReportOutcome) -> None:
        """Forget the reports of a mission, and remember what becomes of those still to come."""
        mission = self._missions.pop(mission_id, None)
        if mission is not None:
            self.n_waiting -= mission.n_reports
        self._closed[mission_id] = stragglers
        if len(self._closed) > _N_REMEMBERED:
            self._closed.popitem(last=False)

    def _count(self, report: FleetReport, outcome: ReportOutcome) -> None:
        if not isinstance(report, MissionReport):
            self.counts.reports[outcome] += 1

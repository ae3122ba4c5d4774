"""A mission that still flies as a film: what a page begins with, and more event by event.

Scenario, mission and events come on topics that are not ordered against each other, from worlds
that come and go, and to a viewer that comes late all at once. What is shown is the latest mission
of the world that is followed, its events in their order.
"""

from collections import deque, OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from uav_collect.analysis.readings import ReadingFinder
from uav_collect.errors import in_one_line, MissionLogError, RefusedError
from uav_collect.film.page import film_page, LIVE
from uav_collect.film.shown import (
    event_values,
    fault_values,
    new_runs,
    opening,
    unpacked_maps,
    Values,
)
from uav_collect.kernels.arrays import Bools, Floats
from uav_collect.recording.epochs import epoch_problem, faults_of, row_of
from uav_collect.recording.log_model import EVENT_DTYPE
from uav_collect.recording.mission_log import header_from_line, MissionHeader
from uav_collect.scenario.site import Site
from uav_collect.uav.briefing import briefing_of

ABORTED = 2  # phase of a Mission message: its world gave it up
MOST_EVENTS = 100_000  # of a mission that are shown: a browser holds no more
_MOST_CHARACTERS = 200  # of what a world says of that
_MOST_MISSIONS = 8  # kept until it is known whether they are shown
_MOST_WAITING = 10_000  # events of each of them, the latest: as many as a reader waits for


class Screen(Protocol):
    """Who shows it."""

    def begin(self, mission: str, opening: Mapping[str, object]) -> None:
        """Show another mission."""

    def add(self, n_events: int, update: Mapping[str, object]) -> None:
        """Show more of it, up to so many of its events."""


class FilmedMission:
    """One mission, event by event."""

    def __init__(self, header: MissionHeader, site: Site, demand_bit: Floats) -> None:
        """Know how it begins.

        Args:
            demand_bit: data waiting at each sensor at the start [bit], shape (S,).
        """
        self._briefing = briefing_of(site)
        self._model = header.event_model()
        self._finder = ReadingFinder(header, site, demand_bit)
        self._known: Bools = np.zeros((len(header.uavs), site.scenario.n_cells), dtype=np.bool_)
        flown = {
            'name': 'flown', 'is_over': False, 'lacks_events': False, 'knows': True, 'events': [],
            'faults': [],
        }  # fmt: skip
        self.opening: Values = {
            **opening(header, site, demand_bit),
            'flights': [flown],
            'notes': [],
        }

    def update(self, epoch: Any) -> Values:  # noqa: ANN401 - a message
        """What an event adds.

        Raises:
            RefusedError: it cannot be of this mission; nothing of it counts.
        """
        problem = epoch_problem(epoch, self._model)
        if problem is not None:
            raise RefusedError(f'event {epoch.event}: {problem}')
        event, news = np.array([row_of(epoch)], dtype=EVENT_DTYPE)[0], self._news(epoch)
        values = event_values(event, self._briefing, self._finder.readings(event), news)
        update: Values = {'event': values}
        if faults := faults_of([epoch]):
            update['faults'] = [fault_values(fault) for fault in faults]
        if epoch.terminal:
            update['is_over'] = True
        return update

    def _news(self, epoch: Any) -> list[tuple[int, list[int]]]:  # noqa: ANN401 - a message
        """The cells that each UAV has come to know as complete."""
        n_uavs, n_cells = self._known.shape
        if len(epoch.uav_complete) != n_uavs * ((n_cells + 7) // 8):
            raise RefusedError(f'event {epoch.event}: uav_complete is no map of {n_uavs} UAVs')
        before, self._known = self._known, unpacked_maps(bytes(epoch.uav_complete), n_cells)
        return new_runs(before, self._known)


@dataclass(kw_only=True)
class _Heard:
    """What has come of one mission."""

    start: Any = None  # its first Mission message
    epochs: deque[Any] = field(  # that are not shown yet
        default_factory=lambda: deque(maxlen=_MOST_WAITING)
    )
    end_note: str | None = None  # why it was given up, until that is shown
    is_unusable: bool = False  # none of its events is kept


class LiveFilm:
    """Chooses what is shown of all that is heard."""

    def __init__(self, screen: Screen) -> None:
        """Show nothing yet."""
        self._screen = screen
        self._world, self._fingerprint = '', ''  # of the world that is followed
        self._site: Site | None = None
        self._heard: OrderedDict[str, _Heard] = OrderedDict()  # by mission, the latest last
        self._shown = ''  # the mission
        self._film: FilmedMission | None = None  # of it
        self._next_event = 0

    def follow(self, world: str, site: Site, fingerprint: str) -> None:
        """Show the missions of a world, by its instance, with a scenario of that fingerprint.

        Raises:
            RefusedError: what it has said already cannot be shown.
        """
        self._world, self._site, self._fingerprint = world, site, fingerprint
        self._show()

    def take_mission(self, msg: Any) -> None:  # noqa: ANN401 - a message
        """Take note of the start of a mission, or of its end.

        Raises:
            RefusedError: it cannot be shown.
        """
        heard = self._heard_of(msg.mission_id)
        heard.start = heard.start or msg
        if msg.phase == ABORTED:
            heard.end_note = in_one_line(msg.note, _MOST_CHARACTERS)
        self._show()

    def take_epoch(self, msg: Any) -> None:  # noqa: ANN401 - a message
        """Show an event, or keep it until its mission is known.

        Raises:
            RefusedError: it cannot be shown.
        """
        heard = self._heard_of(msg.mission_id)
        if not heard.is_unusable:
            heard.epochs.append(msg)
            self._show()

    def _heard_of(self, mission: str) -> _Heard:
        if mission not in self._heard:
            self._heard[mission] = _Heard()
            others = [name for name in self._heard if name != self._shown]
            if len(others) > _MOST_MISSIONS:
                del self._heard[others[0]]
        return self._heard[mission]

    def _show(self) -> None:
        """Show all of the latest mission that is not shown yet."""
        latest = self._latest()
        if latest is None:
            return
        heard = self._heard[latest]
        if latest != self._shown:
            self._begin(latest, heard)
        while heard.epochs and self._film is not None:
            self._add(heard.epochs.popleft(), self._film)
        if heard.end_note is not None:
            note, heard.end_note = f'the mission was given up: {heard.end_note}', None
            self._screen.add(self._next_event, {'is_over': True, 'note': note})

    def _latest(self) -> str | None:
        """The latest mission of the world that is followed, over the scenario that it has."""
        here = self._world, self._fingerprint
        known = [
            (heard.start.index, mission)
            for mission, heard in self._heard.items()
            if heard.start is not None and not heard.is_unusable
            if (heard.start.world_instance, heard.start.scenario_fingerprint) == here
        ]
        return max(known)[1] if known else None

    def _begin(self, mission: str, heard: _Heard) -> None:
        """Show a mission from its start on, and forget the others.

        Raises:
            RefusedError: it is not of the scenario that its world has.
        """
        try:
            film = filmed(heard.start, self._site)
        except (MissionLogError, RefusedError) as error:
            heard.is_unusable = True
            heard.epochs.clear()
            raise RefusedError(f'mission {in_one_line(mission)}: {error}') from error
        self._shown, self._film, self._next_event = mission, film, 0
        self._heard = OrderedDict({mission: heard})
        self._screen.begin(mission, film.opening)

    def _add(self, epoch: Any, film: FilmedMission) -> None:  # noqa: ANN401 - a message
        n_missing = epoch.event - self._next_event
        if n_missing < 0 or epoch.event > MOST_EVENTS:
            return  # it is shown already, or too much
        update = film.update(epoch)
        self._next_event = epoch.event + 1  # one that is refused is missing
        if n_missing:
            are_missing = '1 event is' if n_missing == 1 else f'{n_missing} events are'
            update['note'] = f'{are_missing} missing before the one at {epoch.time_s:.0f} s'
            update['lacks_events'] = True
        if epoch.event == MOST_EVENTS:
            update['note'] = f'after {MOST_EVENTS:,} events no more are shown'
        self._screen.add(self._next_event, update)


def filmed(start: Any, site: Site | None) -> FilmedMission:  # noqa: ANN401 - a message
    """The mission that a Mission message tells of, before its first event.

    Raises:
        MissionLogError: its log's header is none.
        RefusedError: it is of another site.
    """
    header = header_from_line(start.log_header)
    demand_bit = np.array(start.demand_bit, dtype=np.float64)
    if site is None or not is_flown_over(header, site):
        raise RefusedError('log_header is of another scenario')
    if demand_bit.shape != (site.n_sensors,):
        must = f'must have {site.n_sensors}, one of each sensor'
        raise RefusedError(f'demand_bit has {demand_bit.size} values: {must}')
    if not (np.isfinite(demand_bit) & (demand_bit >= 0.0)).all():
        raise RefusedError('demand_bit has a value that is no number from 0')
    return FilmedMission(header, site, demand_bit)


def is_flown_over(header: MissionHeader, site: Site) -> bool:
    """Whether a mission is one of a site, as far as its header tells."""
    area = site.scenario.area
    own = len(header.uavs), header.n_rows, header.n_columns, header.cell_size_m
    return own == (site.scenario.n_uavs, area.n_rows, area.n_columns, area.cell_size_m)


def live_page(begun: Mapping[str, object] | None, connect: str) -> bytes:
    """The page of a mission that flies; None: of one that is waited for.

    Args:
        begun: its opening.
        connect: to what the page may connect.
    """
    return film_page(None if begun is None else dict(begun), connect, LIVE)

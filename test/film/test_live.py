"""A mission that flies grows to the film that is made of its log."""

from collections.abc import Mapping
import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from uav_collect.errors import RefusedError
from uav_collect.film import live
from uav_collect.film.footage import footage
from uav_collect.film.live import LiveFilm
from uav_collect.missions.reflight import FlownBy, fly_again
from uav_collect.missions.rollout import fly
from uav_collect.recording.log_model import EVENT_NAMES
from uav_collect.recording.mission_log import header_line, MissionLog
from uav_collect.recording.mission_messages import MessagePlace
from uav_collect.scenario.load import fingerprint, load
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.policy import policy_named
from uav_collect.world.sensor_field import demand_of

WORLD = 'a-world'
SEED = 4


class Screen:
    """What was shown: of each mission its id, its opening and what came after it."""

    def __init__(self) -> None:
        self.missions: list[tuple[str, dict[str, Any], list[dict[str, Any]]]] = []
        self.n_events: list[int] = []  # up to each update

    def begin(self, mission: str, opening: Mapping[str, object]) -> None:
        self.missions.append((mission, dict(opening), []))

    def add(self, n_events: int, update: Mapping[str, object]) -> None:
        self.n_events.append(n_events)
        self.missions[-1][2].append(dict(update))

    @property
    def updates(self) -> list[dict[str, Any]]:
        return self.missions[-1][2]

    @property
    def events(self) -> list[Any]:
        return [update['event'] for update in self.updates if 'event' in update]


@pytest.fixture(scope='module')
def site() -> Site:
    return build_site(load('paper_8x8'))


@pytest.fixture(scope='module')
def log(site: Site) -> MissionLog:
    [flown] = fly(site, [SEED], 'sweep', 'exact')
    return flown


@pytest.fixture(scope='module')
def epochs(site: Site, log: MissionLog) -> list[Any]:
    """The Epoch messages of the mission."""
    crew = [
        FlownBy(policy=policy_named('sweep'), allocator='exact', guard_after=NONE)
        for _ in log.header.uavs
    ]
    flown = fly_again(site, log.header, crew)
    return [
        SimpleNamespace(
            **{name: event[name].item() for name in EVENT_NAMES if name != 'heard'},
            heard=[bit + 1 for bit in range(8) if int(event['heard']) >> bit & 1],
            uav_complete=flown.messages[MessagePlace('epoch', 0, number)]['uav_complete'],
            mission_id=f'{WORLD}-0',
            terminal=number == len(log.events) - 1,
            **{'fault': [], 'fault_uav': [], 'fault_s': []},
        )
        for number, event in enumerate(log.events)
    ]


def start(site: Site, log: MissionLog, index: int = 0, **values: object) -> SimpleNamespace:
    """The Mission message that a mission starts with."""
    said = {
        'mission_id': f'{WORLD}-{index}',
        'phase': 0,
        'world_instance': WORLD,
        'scenario_fingerprint': fingerprint(site.scenario),
        'index': index,
        'log_header': header_line(log.header),
        'demand_bit': demand_of(site, SEED).tolist(),
        'note': '',
    }
    return SimpleNamespace(**{**said, **values})


@pytest.fixture
def screen() -> Screen:
    return Screen()


@pytest.fixture
def film(screen: Screen, site: Site) -> LiveFilm:
    following = LiveFilm(screen)
    following.follow(WORLD, site, fingerprint(site.scenario))
    return following


def as_json(values: object) -> Any:  # noqa: ANN401 - whatever it holds
    return json.loads(json.dumps(values))


def test_a_mission_grows_to_the_film_of_its_log(
    film: LiveFilm, screen: Screen, site: Site, log: MissionLog, epochs: list[Any]
) -> None:
    film.take_mission(start(site, log))
    for epoch in epochs:
        film.take_epoch(epoch)
    whole = as_json(footage(log, site, demand_of(site, SEED)))
    [(mission, opening, updates)] = screen.missions
    assert mission == f'{WORLD}-0'
    assert as_json(screen.events) == whole['flights'][0]['events']
    assert [update.get('is_over', False) for update in updates] == [False] * (len(epochs) - 1) + [
        True
    ]
    opening['flights'][0] |= {'events': screen.events, 'is_over': True}
    assert as_json(opening) == whole


def test_topics_may_come_in_any_order(
    screen: Screen, site: Site, log: MissionLog, epochs: list[Any]
) -> None:
    film = LiveFilm(screen)
    for epoch in epochs[:3]:
        film.take_epoch(epoch)
    assert screen.missions == []
    film.take_mission(start(site, log))
    film.follow(WORLD, site, fingerprint(site.scenario))
    film.take_epoch(epochs[3])
    assert len(screen.events) == 4


def test_who_comes_late_shows_the_latest_mission(
    film: LiveFilm, screen: Screen, site: Site, log: MissionLog
) -> None:
    for index in range(50):
        film.take_mission(start(site, log, index))
    film.take_mission(start(site, log, 3))
    assert [mission for mission, _, _ in screen.missions] == [f'{WORLD}-{i}' for i in range(50)]


def test_events_that_come_again_are_shown_once(
    film: LiveFilm, screen: Screen, site: Site, log: MissionLog, epochs: list[Any]
) -> None:
    film.take_mission(start(site, log))
    for epoch in [*epochs[:3], *epochs[:4]]:
        film.take_epoch(epoch)
    assert len(screen.events) == 4


def test_events_that_are_missing_are_named(
    film: LiveFilm, screen: Screen, site: Site, log: MissionLog, epochs: list[Any]
) -> None:
    film.take_mission(start(site, log))
    film.take_epoch(epochs[6])
    assert screen.updates[0]['note'].startswith('6 events are missing before the one at ')
    assert screen.updates[0]['lacks_events']  # so what waits at the end may have been read
    film.take_epoch(epochs[7])
    assert 'note' not in screen.updates[1]
    assert screen.n_events == [7, 8]


def test_other_worlds_and_other_scenarios_are_not_shown(
    film: LiveFilm, screen: Screen, site: Site, log: MissionLog
) -> None:
    film.take_mission(start(site, log, 1, world_instance='another'))
    film.take_mission(start(site, log, 2, scenario_fingerprint='0' * 16))
    assert screen.missions == []
    film.follow('another', site, fingerprint(site.scenario))
    assert len(screen.missions) == 1


def test_a_mission_that_is_given_up_is_over(
    film: LiveFilm, screen: Screen, site: Site, log: MissionLog
) -> None:
    film.take_mission(start(site, log))
    film.take_mission(start(site, log, phase=live.ABORTED, note='by\nrequest'))
    assert screen.updates == [{'is_over': True, 'note': 'the mission was given up: by request'}]


def test_who_comes_late_hears_that_a_mission_was_given_up(
    screen: Screen, site: Site, log: MissionLog, epochs: list[Any]
) -> None:
    film = LiveFilm(screen)
    film.take_mission(start(site, log))
    film.take_mission(start(site, log, phase=live.ABORTED, note='by request'))
    film.take_epoch(epochs[0])
    film.follow(WORLD, site, fingerprint(site.scenario))
    film.take_epoch(epochs[1])
    assert ['is_over' in update for update in screen.updates] == [False, True, False]
    assert screen.n_events == [1, 1, 2]


@pytest.mark.parametrize(
    ('values', 'why'),
    [
        ({'log_header': 'x'}, 'mission a-world-0: line 1: no header of a mission log'),
        ({'demand_bit': [1.0]}, 'mission a-world-0: demand_bit has 1 values: must have'),
        ({'demand_bit': [np.nan]}, 'mission a-world-0: demand_bit has'),
    ],
)
def test_a_mission_that_cannot_be_is_refused_once(
    values: dict[str, Any],
    why: str,
    film: LiveFilm,
    screen: Screen,
    site: Site,
    log: MissionLog,
    epochs: list[Any],
) -> None:
    if values.get('demand_bit') and np.isnan(values['demand_bit'][0]):
        values = {'demand_bit': values['demand_bit'] * site.n_sensors}
    with pytest.raises(RefusedError, match=f'^{why}'):
        film.take_mission(start(site, log, **values))
    for epoch in epochs:
        film.take_epoch(epoch)
    assert screen.missions == []
    assert not film._heard[f'{WORLD}-0'].epochs


@pytest.mark.parametrize(
    ('values', 'why'),
    [
        ({'uav': 9}, 'event 0: uav is 9: must be 1 to 2'),
        ({'x_m': np.nan}, 'event 0: x_m is .nan: must be'),
        ({'uav_complete': b'1'}, 'event 0: uav_complete is no map of 2 UAVs'),
    ],
)
def test_an_event_that_cannot_be_is_refused_and_the_next_one_shown(
    values: dict[str, Any],
    why: str,
    film: LiveFilm,
    screen: Screen,
    site: Site,
    log: MissionLog,
    epochs: list[Any],
) -> None:
    film.take_mission(start(site, log))
    with pytest.raises(RefusedError, match=f'^{why}'):
        film.take_epoch(SimpleNamespace(**{**vars(epochs[0]), **values}))
    film.take_epoch(epochs[1])
    assert len(screen.events) == 1
    assert screen.updates[0]['note'].startswith('1 event is missing before the one at ')


def test_no_more_is_shown_than_a_browser_holds(
    film: LiveFilm,
    screen: Screen,
    site: Site,
    log: MissionLog,
    epochs: list[Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(live, 'MOST_EVENTS', 2)
    film.take_mission(start(site, log))
    for epoch in epochs:
        film.take_epoch(epoch)
    assert len(screen.events) == 3
    assert screen.updates[-1]['note'] == 'after 2 events no more are shown'


def test_missions_that_are_never_known_are_forgotten(
    film: LiveFilm, screen: Screen, site: Site, log: MissionLog, epochs: list[Any]
) -> None:
    film.take_mission(start(site, log))
    for number in range(100):
        film.take_epoch(SimpleNamespace(**{**vars(epochs[0]), 'mission_id': f'x-{number}'}))
    assert len(film._heard) <= live._MOST_MISSIONS + 1
    film.take_epoch(epochs[0])
    assert len(screen.events) == 1


def test_of_a_mission_that_is_not_known_the_latest_events_wait(
    film: LiveFilm,
    screen: Screen,
    site: Site,
    log: MissionLog,
    epochs: list[Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(live, '_MOST_WAITING', 5)
    for epoch in epochs[:20]:
        film.take_epoch(epoch)
    film.take_mission(start(site, log))
    assert len(screen.events) == 5
    assert screen.updates[0]['note'].startswith('15 events are missing before the one at ')

"""The viewer: a real browser that shows, and steers, missions of real processes as they fly."""

from collections.abc import Iterator
from contextlib import contextmanager
import json
from pathlib import Path
import signal
import time
from typing import Any

import pytest

for needed in ('rclpy', 'uav_collect_msgs', 'websockets'):
    pytest.importorskip(needed)

from browser import launched_browser, Watched
from fleets import Fleet, logs, parameters, scenario_of
from processes import DEADLINE_S, Processes, RunningProcess, wait_until
from uav_collect.film.footage import footage
from uav_collect.lockstep.seals import KEY_FILE
from uav_collect.recording.mission_log import from_jsonl
from uav_collect.scenario.site import build_site
from uav_collect.world.sensor_field import demand_of
from websockets.sync.client import ClientConnection, connect

pytestmark = pytest.mark.ros

SEED = 6
LAPTOP = {'width': 1366, 'height': 768}


@pytest.fixture
def key_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A key of the processes that start after it."""
    file = tmp_path / 'key'
    file.write_bytes(b'0123456789abcdef')
    file.chmod(0o600)
    monkeypatch.setenv(KEY_FILE, str(file))
    return file


@pytest.fixture
def fleet(processes: Processes, tmp_path: Path) -> Fleet:
    return Fleet(processes=processes, scenario=scenario_of(), folder=tmp_path / 'run')


def start_viewer(processes: Processes, *flags: str) -> tuple[RunningProcess, str]:
    """A viewer, and the URL of its page."""
    viewer = processes.start('viewer', *flags)
    return viewer, viewer.wait_for(r'the page is at (http://\S+)')[1]


@contextmanager
def listening(url: str, mission: str = '') -> Iterator[ClientConnection]:
    """A page without a browser, of a mission by its id."""
    place = url.removesuffix('/').removeprefix('http://')
    with connect(f'ws://{place}/live?mission={mission}', origin=f'http://{place}') as page:
        yield page


def heard(page: ClientConnection, what: str) -> Any:  # noqa: ANN401 - JSON
    """The next message about something."""
    end_s = time.monotonic() + DEADLINE_S
    while (left_s := end_s - time.monotonic()) > 0.0:
        message = json.loads(page.recv(left_s))
        if what in message:
            return message[what]
    raise AssertionError(f'nothing about {what} within {DEADLINE_S} s')


def ask(page: ClientConnection, **wish: object) -> str:
    """What comes of a wish."""
    page.send(json.dumps(wish))
    return str(heard(page, 'said'))


def said(shown: Watched, words: str, where: str = 'live-said') -> None:
    """Wait until the page says something."""
    shown.wait_until(f'document.getElementById("{where}")?.textContent.includes({words!r})')


def test_a_page_starts_steps_and_shows_missions_as_they_are_logged(
    key_file: Path, processes: Processes, fleet: Fleet
) -> None:
    viewer, url = start_viewer(processes, '--control')
    with launched_browser() as browser:
        shown = Watched(browser)
        page = shown.page
        page.set_viewport_size(LAPTOP)
        page.goto(url)
        said(shown, 'Waiting for a world.', 'live-status')
        world = fleet.start_world(missions=0)
        fleet.start_agents()
        said(shown, 'Waiting for a mission.', 'live-status')

        # With the key it steers as `control` does; parameters have no seal.
        page.click('#live-pause')
        said(shown, 'paused: the next mission waits at its start')
        page.select_option('#live-pace', '20')
        said(shown, 'refused: parameters are fixed')
        page.fill('#live-seed', str(SEED))
        page.click('#live-start')
        shown.wait_until('window.film?.film.seed === 6')
        for n_events in (1, 2):
            page.click('#live-step')
            shown.wait_until(f'film.flight.events.length === {n_events}')
        assert page.evaluate('film.flight.isOver') is False
        page.click('#live-resume')
        shown.wait_until('film.flight.isOver')

        [log] = logs(fleet.scenario, [SEED])
        site = build_site(fleet.scenario)
        whole = footage(from_jsonl(log), site, demand_of(site, SEED))
        [flight] = json.loads(json.dumps(whole['flights']))
        assert page.evaluate('film.flight.events') == flight['events']
        page.keyboard.press('End')
        homes_m = [list(uav.home_m) for uav in fleet.scenario.uavs]
        places_m = 'film.flight.at(film.time_s).map(({x_m, y_m}) => [x_m, y_m])'
        assert page.evaluate(places_m) == homes_m

        # The next mission comes by itself once this one has been seen.
        page.fill('#live-seed', str(SEED + 1))
        page.click('#live-start')
        shown.wait_until('window.film?.film.seed === 7 && film.flight.isOver')
        world.send(signal.SIGINT)
        said(shown, 'the world is gone', 'live-status')
        assert shown.errors == []
        viewer.send(signal.SIGINT)
        assert viewer.wait_for_exit() == 0
        said(shown, 'The viewer is gone', 'live-status')


@pytest.fixture
def flown(processes: Processes, tmp_path: Path) -> RunningProcess:
    """A world without a key that has flown a mission of one UAV, and waits."""
    fleet = Fleet(processes=processes, scenario=scenario_of(1), folder=tmp_path / 'run')
    world = fleet.start_world(missions=0)
    fleet.start_agents()
    started = processes.start(
        'control', 'start', '--seed', str(SEED), '--patience', str(DEADLINE_S)
    )
    assert started.wait_for_exit() == 0
    world.wait_for('ended after')
    return world


def test_who_comes_late_sees_all_and_steers_if_that_is_wanted(
    processes: Processes, flown: RunningProcess
) -> None:
    viewer, url = start_viewer(processes, '--control')
    n_events = len(from_jsonl(logs(scenario_of(1), [SEED])[0]).events)
    with listening(url) as page:
        mission = heard(page, 'mission')
    with listening(url, mission) as page:
        updates: list[Any] = []
        while len(updates) < n_events:
            updates += heard(page, 'updates')
        assert updates[-1]['is_over'] is True
        assert ask(page, command='pace', pace=7) == 'the world flies 7 times real time'
        flown.wait_for('real_time_factor is 7 from now on')
        assert ask(page, command='pace', pace=0) == 'the world flies as fast as the fleet decides'
        assert ask(page, command='abort').startswith('refused: ')

    port = url.removesuffix('/').rpartition(':')[2]
    second = processes.start('viewer', *parameters(port=port))
    _, other = start_viewer(processes)
    with listening(other) as page:
        wait_until(lambda: heard(page, 'state')['world'], meanwhile=lambda: None)
        only = 'this page only looks: start the viewer with --control to steer'
        assert ask(page, command='pause') == ask(page, command='pace', pace=5) == only
    assert second.wait_for_exit() == 2
    assert f'error: the page cannot be served at 127.0.0.1, port {port}: ' in second.output
    viewer.send(signal.SIGINT)
    assert viewer.wait_for_exit() == 0

"""The page of a mission that flies, in a real browser, by a server without any world."""

from contextlib import closing
import json
from typing import Any

from browser import launched_browser, Watched
import pytest
from uav_collect.film.footage import footage
from uav_collect.film.live import FilmedMission, live_page
from uav_collect.film.server import PageServer
from uav_collect.missions.rollout import fly
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site
from uav_collect.world.sensor_field import demand_of

SEED = 4
QUARTER_SECOND = """(() => {  // how far the page looks in that, from the start [s]
    film.isPlaying = true;
    [film.time_s, film.last_ms] = [0, 0];
    film.frame(250);
    return film.time_s;
})()"""


@pytest.fixture(scope='module')
def opening_and_events() -> tuple[dict[str, Any], list[Any]]:
    """What a page of a mission begins with, and what comes after it."""
    site = build_site(load('paper_8x8'))
    [log] = fly(site, [SEED], 'sweep', 'exact')
    demand_bit = demand_of(site, SEED)
    [flight] = json.loads(json.dumps(footage(log, site, demand_bit)['flights']))
    return FilmedMission(log.header, site, demand_bit).opening, flight['events']


def serve(port: int, opening: dict[str, Any], events: list[tuple[int, Any]]) -> PageServer:
    """A server that has heard of events, each with its number."""
    server = PageServer('127.0.0.1', port, live_page, lambda *_: '')
    server.tell({'control': False, 'world': True})
    server.begin('w-0', opening)
    for number, event in events:
        server.add(number + 1, {'event': event})
    return server


def test_a_page_that_only_looks_goes_on_with_a_viewer_that_comes_again(
    opening_and_events: tuple[dict[str, Any], list[Any]],
) -> None:
    opening, events = opening_and_events
    half = len(events) // 2
    with launched_browser() as browser:
        shown = Watched(browser)
        numbered = [*enumerate(events)]
        with closing(serve(0, opening, numbered[:half])) as server:
            url = server.url
            shown.page.goto(url)
            shown.wait_until(f'film.flight.events.length === {half}')
            assert shown.page.locator('#live-steering').is_hidden()
            assert not shown.page.evaluate('film.flight.isOver')
            latest_s = events[half - 1]['time_s']
            assert shown.page.evaluate('film.isFollowing')
            assert shown.page.evaluate(QUARTER_SECOND) > 0.25 * latest_s
            shown.page.keyboard.press('Home')
            assert not shown.page.evaluate('film.isFollowing')
            assert shown.page.evaluate(QUARTER_SECOND) <= 0.25 * shown.page.evaluate('film.speed')
            shown.page.keyboard.press('l')
            assert shown.page.evaluate('film.time_s') == latest_s
            assert shown.page.evaluate('film.isFollowing')
        shown.wait_until("live.status.textContent.includes('The viewer is gone')")
        port = int(url.removesuffix('/').rpartition(':')[2])
        # This one came late, and has not heard of the first events.
        with closing(serve(port, opening, numbered[10:])) as server:
            server.add(
                len(events),
                {'is_over': True, 'note': 'the mission was given up: <b>by</b> request'},
            )
            shown.wait_until('film.flight.isOver')
            assert not shown.page.evaluate('film.isFollowing')
            assert shown.page.evaluate('film.flight.events') == events
            n_read = sum(len(event.get('reads', ())) for event in events)
            assert shown.page.locator('#sensors .go').count() == n_read
            noted = shown.page.locator('#notes').inner_text()
            assert noted == 'the mission was given up: <b>by</b> request'


def test_a_page_that_has_not_heard_of_its_viewer_yet_misses_none(
    opening_and_events: tuple[dict[str, Any], list[Any]],
) -> None:
    opening, _ = opening_and_events
    with launched_browser() as browser, closing(serve(0, opening, [])) as server:
        shown = Watched(browser)
        shown.page.route_web_socket('**/live**', lambda _: None)  # nobody answers
        shown.page.goto(server.url, wait_until='commit')
        shown.wait_until("live.status.textContent === 'Connecting to the viewer.'")

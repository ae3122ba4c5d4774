"""What part of the area a film's page shows, and how much it draws, in a real browser."""

from dataclasses import replace
from pathlib import Path

from browser import Watched
from film_pages import check_places, check_silence, flown, LAPTOP, PHONE, seek, show, written
import pytest
from tiny_world import tiny, uav
from uav_collect.scenario.load import load


@pytest.fixture(scope='module')
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp('film'), flown(load('paper_8x8')))


def test_a_narrow_area_has_the_width_of_the_page(screen: Watched, tmp_path: Path) -> None:
    row = {'area.boundary': [[0, 0], [400, 0], [400, 50], [0, 50]]}
    mission = flown(load('paper_8x8', row), 'sweep')
    film = written(tmp_path, mission)
    show(screen, film)
    page = screen.page
    check_places(page, mission)
    assert 50.0 / page.evaluate('film.map.px') > 150  # pixels of a cell; eight are in the row
    tall = page.evaluate('document.documentElement.scrollHeight')
    assert tall == LAPTOP['height']
    check_silence(screen, film)


def test_all_that_uavs_fly_over_is_on_the_map(screen: Watched, tmp_path: Path) -> None:
    sensors = (75.0, 25.0, 1.0), (125.0, 25.0, 0.5)
    row = tiny(uav(5.0), sensors=sensors, demand__known_empty='sensors')
    film = written(tmp_path, flown(row, 'sweep'))
    show(screen, film)
    page = screen.page
    west_m, north, width_m, high_m = page.evaluate('film.extent.whole')
    assert high_m < 100.0 < width_m  # of four rows of 50 m one has sensors
    places_m = 'film.flights.flatMap((it) => it.events.map((event) => [event.x_m, event.y_m]))'
    for x_m, y_m in page.evaluate(places_m):
        assert west_m < x_m < west_m + width_m
        assert north < 200.0 - y_m < north + high_m


# Reaches beyond all four sides of the 4 x 4 cells of 50 m.
EDGE_M = [[-40, -30], [220, -20], [260, 120], [210, 230], [-10, 225]]
ZONE_M = [[60, 110], [90, 110], [70, 140]]
IN_VIEW = """(kind) => {
  const all = [...document.querySelectorAll('.map')].map((map) => {
    const frame = map.getBoundingClientRect();
    return [...map.querySelectorAll(kind)].every((part) => {
      const box = part.getBoundingClientRect();
      return part.getAttribute('visibility') === 'hidden'
        || (frame.left < box.left && box.right < frame.right
          && frame.top < box.top && box.bottom < frame.bottom);
    });
  });
  return [all.length, all.every(Boolean)];
}"""


@pytest.fixture(scope='module')
def fenced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A film of a field whose outline reaches beyond its cells."""
    sensors = [(25.0, 175.0, 1.0), (195.0, 25.0, 0.5)]
    sensors += [(10.0 + 5 * k, 60.0, 0.1) for k in range(18)]
    area = {'area__boundary': EDGE_M, 'area__no_fly': [ZONE_M]}
    scenario = tiny(uav(5.0), sensors=sensors, demand__known_empty='sensors', **area)
    mission = flown(scenario)
    names = ['Barn', 'South-east corner', *mission.site.sensor_ids[2:]]
    site = replace(mission.site, sensor_ids=tuple(names))
    return written(tmp_path_factory.mktemp('fenced'), replace(mission, site=site))


@pytest.mark.parametrize('size', [LAPTOP, PHONE], ids=['laptop', 'phone'])
def test_the_whole_edge_all_zones_and_all_names_are_on_the_map(
    screen: Watched, fenced: Path, size: dict[str, int]
) -> None:
    show(screen, fenced, size)
    page = screen.page
    for n_maps in (1, 2):
        for kind in ('.boundary', '.no-fly', '.name'):
            assert page.evaluate(IN_VIEW, kind) == [n_maps, True], kind
        page.locator('#beside-1').check()
    check_silence(screen, fenced)


def test_maps_beside_each_other_are_as_large_as_they_can_be(screen: Watched, fenced: Path) -> None:
    show(screen, fenced)
    page = screen.page
    page.locator('#beside-1').check()
    columns = page.evaluate('film.columns()')
    px = page.evaluate('film.map.px')
    page.evaluate(
        """(columns) => {
      document.getElementById('maps').style.setProperty('--columns', columns);
      film.fitMaps();
    }""",
        3 - columns,
    )
    assert page.evaluate('film.map.px') > px  # metres of a pixel: the map is smaller


def test_the_table_of_sensors_ends_with_a_whole_row(screen: Watched, fenced: Path) -> None:
    show(screen, fenced)
    cut = """() => {
      const box = document.querySelector('.rows');
      const foot = box.getBoundingClientRect().bottom;
      return [box.scrollHeight > box.clientHeight, [...box.querySelectorAll('tbody tr')]
        .map((row) => row.getBoundingClientRect())
        .filter(({ top, bottom }) => top < foot - 1 && bottom > foot + 1).length];
    }"""
    assert screen.page.evaluate(cut) == [True, 0]


def test_a_map_is_looked_at_from_near_by_wheel_keys_and_buttons(watched: Watched) -> None:
    page = watched.page
    whole_px = page.evaluate('film.map.px')
    assert page.locator('#farther').is_disabled()
    page.keyboard.press('i')
    assert page.evaluate('film.map.px') == pytest.approx(whole_px / 2)
    page.locator('#nearer').click()
    assert page.evaluate('film.map.px') == pytest.approx(whole_px / 4)
    before = page.evaluate('film.extent.middle')
    box = page.locator('.map svg').bounding_box()
    page.mouse.move(box['x'] + 300, box['y'] + 300)
    page.mouse.down()
    page.mouse.move(box['x'] + 280, box['y'] + 310)
    page.mouse.up()
    moved = [before[0] + 20 * whole_px / 4, before[1] - 10 * whole_px / 4]
    assert page.evaluate('film.extent.middle') == pytest.approx(moved, abs=0.1)
    page.keyboard.press('w')
    assert page.evaluate('film.map.px') == whole_px
    seek(page, 30.0)
    badge = page.locator('.map .uav circle').first.bounding_box()
    at = badge['x'] + badge['width'] / 2, badge['y'] + badge['height'] / 2
    page.mouse.move(*at)
    page.mouse.wheel(0, -100)
    watched.wait_until(f'film.map.px < {0.9 * whole_px}')
    badge = page.locator('.map .uav circle').first.bounding_box()
    there = badge['x'] + badge['width'] / 2, badge['y'] + badge['height'] / 2
    assert there == pytest.approx(at, abs=1.5)  # what is under the pointer stays there
    page.keyboard.press('o')
    assert page.evaluate('film.map.px') == whole_px


def test_the_nearer_map_is_about_the_uav_that_is_chosen(watched: Watched) -> None:
    page = watched.page
    seek(page, 60.0)
    page.keyboard.press('2')
    for _ in range(3):
        page.keyboard.press('i')
    x, y, width, high = page.evaluate('film.extent.box')
    badge = page.locator('.map .uav').nth(1)
    x_m, y_m = (float(badge.get_attribute(name)) for name in ('data-x', 'data-y'))
    assert x <= x_m <= x + width
    assert y <= 400.0 - y_m <= y + high


def test_of_very_many_events_no_more_is_drawn_than_can_be_seen(watched: Watched) -> None:
    page = watched.page
    drawn = """() => {
      const { flight } = film;
      const moves = flight.events.filter(({ action }) => action !== 5);
      for (let round = 1; round <= 300; round += 1) {
        flight.add(moves.map((it) => ({ ...it, time_s: it.time_s + 300 * round })));
      }
      film.resized();
      film.seek(film.end_s);
      const sizes = (chosen) => [...document.querySelectorAll(chosen)]
        .map((it) => it.getAttribute('d').split(/[ML]/).length);
      return [flight.events.length, ...['#chart .line.m0', '#strip path', '.map .trail']
        .map((chosen) => Math.max(...sizes(chosen)))];
    }"""
    n_events, n_curve, n_strip, n_trail = page.evaluate(drawn)
    assert n_events > 20_000
    assert n_curve < 1_010
    assert n_strip < 3_400
    assert n_trail < 3_010

"""The page of a film in a real browser: it shows what the log says, and asks for nothing."""

from dataclasses import replace
from pathlib import Path

from browser import Watched
from film_pages import check_places, check_silence, flown, LAPTOP, PHONE, seek, show, written
import numpy as np
import pytest
from uav_collect.analysis.legs import mission_legs, state_at
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.results import FlownMission
from uav_collect.film.mission_page import mission_page
from uav_collect.planning.bound import bound_of
from uav_collect.scenario.load import load, with_uavs

NASTY = '</script><img src=x onerror=alert(1)>\u2028&"\''


@pytest.fixture(scope='module')
def mission() -> FlownMission:
    """One in which UAVs meet and part, and one of them is silent in the end."""
    faults = [{'uav': 2, 'kind': 'silent', 'at_s': 150.0}]
    return flown(load('paper_8x8', {'radio.contact_range_m': 150.0, 'faults': faults}))


@pytest.fixture(scope='module')
def film(mission: FlownMission, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('film') / 'film.html'
    file.write_bytes(mission_page(mission, bound_of(mission.site, 0)))
    return file


def test_places_energies_and_data_are_those_of_the_log_at_ten_times(
    watched: Watched, mission: FlownMission
) -> None:
    check_places(watched.page, mission)


def test_the_slider_leads_to_a_time(watched: Watched) -> None:
    slider = watched.page.locator('#time')
    slider.focus()
    slider.fill('100')
    assert watched.page.evaluate('film.time_s') == 100
    assert watched.page.locator('#clock').inner_text().startswith('100.0 s of')


def test_the_end_shows_the_figures_of_the_mission(watched: Watched, mission: FlownMission) -> None:
    watched.page.keyboard.press('End')
    figures = mission_metrics(mission.log)
    texts = [
        watched.page.locator(f'#total-{name}').inner_text()
        for name in ('data', 'share', 'energy', 'efficiency')
    ]
    assert texts == [
        f'{figures.collected_bit / 1e6:.2f} of {figures.total_bit / 1e6:.2f} Mbit',
        '100 %',
        f'{figures.energy_kj:.1f} kJ',
        f'{figures.efficiency_kbit_per_j:.3f} kbit/J',
    ]
    assert 'landed' in watched.page.locator('article .deed').first.inner_text()


def test_the_map_of_a_uav_has_as_many_complete_cells_as_its_log_says(
    watched: Watched, mission: FlownMission
) -> None:
    page, events, n_alone = watched.page, mission.log.events, 0
    for event in events[:: len(events) // 8]:
        seek(page, float(event['time_s']))
        page.keyboard.press('0')
        assert page.locator('.known').get_attribute('data-cells') == '0'
        page.keyboard.press(str(event['uav']))
        last = events[events['time_s'] <= event['time_s']]
        own = last[last['uav'] == event['uav']][-1]
        shown = int(page.locator('.known').get_attribute('data-cells'))
        assert shown >= own['known_complete']  # it may have heard of more since, at this instant
        if own['event'] == last[-1]['event']:
            n_alone += 1
            assert shown == own['known_complete']
    assert n_alone > 0


def test_contacts_are_those_in_range_and_none_of_a_silent_uav(
    watched: Watched, mission: FlownMission
) -> None:
    legs, counts = mission_legs(mission.log, mission.site.scenario), set[int]()
    for time_s in range(5, 200, 13):
        seek(watched.page, time_s)
        first, second = (state_at(own, time_s).place_m for own in legs)
        apart_m = ((first[0] - second[0]) ** 2 + (first[1] - second[1]) ** 2) ** 0.5
        expected = int(apart_m <= 150.0 and time_s < 150.0)
        assert watched.page.locator('.map .contact').count() == expected
        counts.add(expected)
    assert counts == {0, 1}


def test_a_hover_shows_its_sensors_with_rates_and_shares(
    watched: Watched, mission: FlownMission
) -> None:
    reading = max(mission.readings, key=lambda it: it.end_s - it.start_s)
    seek(watched.page, (reading.start_s + reading.end_s) / 2)
    reads = watched.page.locator(f'article[data-uav="{reading.uav}"] .reads')
    together = [it for it in mission.readings if it.event == reading.event]
    share = reading.bandwidth_hz / sum(it.bandwidth_hz for it in together)
    assert reads.locator('li').count() == len(together)
    text = f'{reading.sensor_id} {reading.rate_bps / 1e6:.2f} Mbit/s, {share * 100:.0f} %'
    assert text in reads.inner_text()
    assert watched.page.locator('.map circle.reading').count() >= 1
    assert watched.page.locator('.map .hovers line').count() >= len(together)


def test_the_table_says_which_sensor_was_read_when_and_by_whom(
    watched: Watched, mission: FlownMission
) -> None:
    page = watched.page
    reading = mission.readings[len(mission.readings) // 2]
    page.locator('#sensors input').fill(reading.sensor_id)
    cells = page.locator('#sensors tbody tr').first.locator('td').all_inner_texts()
    assert cells[:5] == [
        reading.sensor_id,
        f'{reading.data_bit / 1e6:.2f}',
        f'{reading.start_s:.1f}',
        str(reading.uav),
        f'{reading.rate_bps / 1e6:.2f}',
    ]
    page.locator('#sensors tbody button').first.click()
    assert page.evaluate('film.time_s') == pytest.approx(reading.start_s)
    page.locator('#sensors input').fill('no such sensor')
    assert 'no sensor' in page.locator('#sensors').inner_text()


def test_it_plays_and_pauses_by_button_and_by_key(watched: Watched) -> None:
    page = watched.page
    page.locator('#speed').select_option('5')
    page.locator('#play').click()
    watched.wait_until('film.time_s > 5')
    assert page.locator('#play').inner_text() == 'Pause'
    page.locator('body').press('Space')
    assert page.locator('#play').inner_text() == 'Play'
    time_s = page.evaluate('film.time_s')
    assert page.evaluate('new Promise(requestAnimationFrame).then(() => film.time_s)') == time_s
    page.keyboard.press('End')
    page.locator('article button').first.click()  # it does not keep the keyboard
    page.keyboard.press('Space')  # from the end it begins anew
    watched.wait_until(f'film.isPlaying && film.time_s < {time_s + 60}')


def test_it_goes_event_by_event(watched: Watched, mission: FlownMission) -> None:
    page = watched.page
    times_s = sorted({*mission.log.events['time_s'].tolist()})
    for expected_s in times_s[1:4]:
        page.locator('#on').click()
        assert page.evaluate('film.time_s') == expected_s
    assert 'UAV' in page.locator('#said').inner_text()
    page.keyboard.press('ArrowLeft')
    assert page.evaluate('film.time_s') == times_s[2]
    page.locator('#back').click()
    assert page.evaluate('film.time_s') == times_s[1]
    page.keyboard.press('Shift+ArrowRight')
    assert page.evaluate('film.time_s') == pytest.approx(times_s[1] + 10)
    page.keyboard.press('End')
    assert page.evaluate('film.time_s === film.end_s')
    page.keyboard.press('Home')
    assert page.evaluate('film.time_s') == 0


def test_every_key_that_is_listed_does_something(watched: Watched) -> None:
    page = watched.page
    page.keyboard.press('?')
    keys = page.locator('#keys')
    assert keys.is_visible()
    assert all(word in keys.inner_text() for word in ('space', 'names of sensors', 'faster'))
    page.keyboard.press('Escape')
    assert not keys.is_visible()
    page.keyboard.press('+')
    assert page.locator('#speed').input_value() == '20'
    page.keyboard.press('-')
    page.keyboard.press('-')
    assert page.locator('#speed').input_value() == '5'
    page.keyboard.press('g')
    assert page.locator('.ghost').count() == 2 * 2
    names = page.locator('.name').count()
    page.keyboard.press('n')
    assert page.locator('.name').count() != names
    page.keyboard.press('d')
    assert page.evaluate('document.documentElement.dataset.theme') == 'dark'
    assert page.locator('#theme').inner_text() == 'Light'


def test_ghosts_fly_over_the_map_and_beside_it(watched: Watched) -> None:
    page = watched.page
    seek(page, 40.0)
    page.get_by_label('sweep, over the map').check()
    page.get_by_label('clairvoyant plan, beside the map').check()
    assert page.locator('.ghost').count() == 2
    assert page.locator('.map svg').count() == 2
    other = page.locator('.map svg').nth(1).locator('.uav').first
    expected = page.evaluate('film.flights[2].uavAt(0, 40).x_m')
    assert float(other.get_attribute('data-x')) == pytest.approx(expected)
    page.get_by_label('clairvoyant plan, beside the map').uncheck()
    assert page.locator('.map svg').count() == 1


@pytest.mark.parametrize('size', [LAPTOP, PHONE], ids=['laptop', 'phone'])
def test_nothing_is_wider_than_the_screen_and_every_card_can_be_reached(
    screen: Watched, size: dict[str, int], tmp_path: Path
) -> None:
    film = written(tmp_path, flown(with_uavs(load('paper_8x8'), 9), 'sweep'))
    show(screen, film, size, color_scheme='dark')
    page = screen.page
    for label in ('hert, beside the map', 'hert, over the map'):
        page.get_by_label(label).check()
    assert page.evaluate('document.documentElement.scrollWidth') == size['width']
    if size is LAPTOP:
        assert page.evaluate('document.documentElement.scrollHeight') == size['height']
    last = page.locator('article').last
    last.scroll_into_view_if_needed()
    box, player = last.bounding_box(), page.locator('footer').bounding_box()
    assert 0 <= box['x'] <= size['width'] - box['width']
    assert box['y'] + box['height'] <= player['y'] + 1
    assert page.evaluate('getComputedStyle(document.body).backgroundColor') == 'rgb(13, 18, 24)'
    check_silence(screen, film)


def test_faults_and_data_left_behind_are_marked(screen: Watched, tmp_path: Path) -> None:
    faults = [{'uav': 2, 'kind': 'gone', 'at_s': 40.0}]
    scarce = {'fleet.default.energy_budget_kj': 20.0, 'faults': faults}
    mission = flown(load('paper_8x8', scarce), 'sweep')
    film = written(tmp_path, mission)
    show(screen, film)
    page = screen.page
    assert page.locator('.map circle.left').count() == 0
    assert page.locator('.uav.faulty').count() == 0
    page.keyboard.press('End')
    n_read = len({reading.sensor for reading in mission.readings})
    n_left = int((mission.demand_bit > 0).sum()) - n_read
    assert n_left > 0
    assert page.locator('.map circle.left').count() == n_left
    assert page.locator('.uav.faulty').get_attribute('data-uav') == '2'
    assert '(fault: gone)' in page.locator('article').nth(1).inner_text()
    assert 'energy reserve' in page.locator('article').first.inner_text()
    check_silence(screen, film)


def test_no_data_is_marked_as_left_that_an_event_not_recorded_may_have_read(
    screen: Watched, tmp_path: Path
) -> None:
    mission = flown(load('paper_8x8', {'fleet.default.energy_budget_kj': 20.0}), 'sweep')
    gappy = replace(mission.log, events=np.delete(mission.log.events, 5))
    show(screen, written(tmp_path, replace(mission, log=gappy, is_whole=False)))
    screen.page.keyboard.press('End')
    assert screen.page.locator('.map circle.waiting').count() > 0
    assert screen.page.locator('.map circle.left').count() == 0


def test_closed_cells_are_drawn_and_count_for_no_knowledge(
    screen: Watched, tmp_path: Path
) -> None:
    corners = [[0, 0], [400, 0], [400, 200], [200, 200], [200, 400], [0, 400]]
    zone = [[105, 105], [145, 105], [125, 145]]
    area = {'area.boundary': corners, 'area.no_fly': [zone]}
    mission = flown(load('paper_8x8', area), 'sweep')
    film = written(tmp_path, mission)
    show(screen, film)
    page = screen.page
    check_places(page, mission)
    paths = [page.locator(f'.map .{name}').get_attribute('d') for name in ('outside', 'closed')]
    assert [path.count('M') for path in paths] == [16, 1]
    assert page.locator('.map .no-fly').count() == 1
    assert page.locator('.map .boundary').count() == 1
    page.keyboard.press('End')
    page.keyboard.press('1')
    assert page.locator('.known').get_attribute('d').count('M') == 64 - 16 - 1
    assert 'knows 47 of 47 cells' in page.locator('article').first.inner_text()
    legend = page.locator('#legend').inner_text()
    for sign in ('message', 'closed cell', 'no-fly zone', "area's edge"):
        assert sign in legend
    check_silence(screen, film)


def test_names_are_never_markup(screen: Watched, tmp_path: Path) -> None:
    mission = flown(load('paper_8x8'))
    fleet = tuple(replace(uav, policy=NASTY) for uav in mission.log.header.uavs)
    header = replace(mission.log.header, scenario=NASTY, uavs=fleet)
    site = replace(mission.site, sensor_ids=(NASTY,) * mission.site.n_sensors)
    log = replace(mission.log, header=header)
    film = written(tmp_path, replace(mission, log=log, site=site))
    show(screen, film)
    page = screen.page
    assert page.locator('img').count() == 0
    assert page.locator('#title').text_content() == NASTY
    assert page.locator('#sensors td').first.text_content() == NASTY
    page.keyboard.press('n')
    assert page.locator('.name').first.text_content() == NASTY
    check_silence(screen, film)


@pytest.mark.parametrize('n_events', [0, 1, 25])
def test_a_mission_that_was_cut_off_shows_what_there_is(
    screen: Watched, n_events: int, tmp_path: Path
) -> None:
    mission = flown(load('paper_8x8'))
    log = replace(mission.log, events=mission.log.events[:n_events])
    film = written(tmp_path, replace(mission, log=log, is_whole=False))
    show(screen, film)
    page = screen.page
    assert 'not all of it was recorded' in page.locator('#notes').inner_text()
    page.keyboard.press('ArrowRight')
    page.keyboard.press('End')
    assert page.locator('article').count() == 2
    assert 'not over' in page.locator('#flights').inner_text()
    check_silence(screen, film)


@pytest.mark.parametrize(('motion', 'is_there'), [('reduce', True), ('no-preference', False)])
def test_messages_fly_to_who_heard_them_unless_motion_is_not_wanted(
    screen: Watched, film: Path, motion: str, is_there: bool
) -> None:
    show(screen, film, reduced_motion=motion)
    page = screen.page
    page.evaluate('film.seek(film.flight.events.find((it) => it.heard).time_s + 0.5)')
    places = """() => {
      const dot = document.querySelector('circle.message');
      const line = document.querySelector('line.message');
      return [dot.getAttribute('cx'), line.getAttribute('x2'), dot.getAttribute('cy'),
        line.getAttribute('y2')].map(Number);
    }"""
    x_m, end_x_m, y_m, end_y_m = page.evaluate(places)
    assert (x_m == pytest.approx(end_x_m) and y_m == pytest.approx(end_y_m)) == is_there
    check_silence(screen, film)

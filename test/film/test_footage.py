"""What a film is given of a mission: its events, what UAVs knew, the flights beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
import html
import json
from typing import Any

import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.results import flown_mission
from uav_collect.film.footage import footage
from uav_collect.film.ghosts import Ghost, ghosts_of, PLAN
from uav_collect.film.knowledge import news_of
from uav_collect.film.mission_page import mission_page
from uav_collect.film.page import film_page, json_in_html
from uav_collect.missions import rollout
from uav_collect.missions.reflight import FlownBy, fly_again
from uav_collect.planning.bound import bound_of
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.action_codes import HOVER, REASON_NAMES
from uav_collect.uav.policy import policy_named
from uav_collect.world.sensor_field import demand_of


def flown(scenario: Scenario, policy: str = 'sweep', seed: int = 0) -> tuple[Site, MissionLog]:
    site = build_site(scenario)
    [log] = rollout.fly(site, [seed], policy)
    return site, log


def footage_of(site: Site, log: MissionLog) -> dict[str, Any]:
    values = footage(log, site, demand_of(site, log.header.mission_seed))
    read: dict[str, Any] = json.loads(json.dumps(values, allow_nan=False))
    return read


def n_known(events: Sequence[Mapping[str, Any]], uav: int) -> list[int]:
    """How many cells a UAV knows to be complete, by event."""
    known, counts = set[int](), []
    for event in events:
        for who, runs in event.get('news', ()):
            if who == uav:
                for first, n_cells in zip(runs[::2], runs[1::2], strict=True):
                    new = {*range(first, first + n_cells)}
                    assert not known & new
                    known |= new
        counts.append(len(known))
    return counts


@pytest.mark.parametrize('scenario', ['paper_8x8', 'rough_10x10'])
def test_what_uavs_know_is_what_their_log_counts(scenario: str) -> None:
    site, log = flown(load(scenario), seed=3)
    events = footage_of(site, log)['flights'][0]['events']
    for uav_number in range(2):
        counts = n_known(events, uav_number)
        own = log.events['uav'] == uav_number + 1
        assert np.array(counts)[own].tolist() == log.events['known_complete'][own].tolist()


def test_uavs_that_were_lost_or_silent_are_known_about_too() -> None:
    faults = [
        {'uav': 1, 'kind': 'gone', 'at_decision': 6},
        {'uav': 2, 'kind': 'silent', 'at_s': 30.0},
    ]
    site, log = flown(load('paper_8x8', {'faults': faults}))
    [flight] = footage_of(site, log)['flights']
    assert flight['knows']
    assert {fault['fault'] for fault in flight['faults']} == {'gone', 'silent'}
    assert 'fault' in {event['reason'] for event in flight['events']}


def test_a_uav_that_the_world_flew_home_is_known_about_too() -> None:
    site, log = flown(load('paper_8x8'))
    crew = [FlownBy(policy=policy_named('sweep'), allocator='exact', guard_after=0)] * 2
    again = fly_again(site, log.header, [replace(each) for each in crew], failsafes={7})
    assert 'failsafe' in {REASON_NAMES[event['reason']] for event in again.log.events}
    knowledge = news_of(again.log, site)
    assert knowledge.problem is None
    assert len(knowledge.news) == len(again.log.events)


def test_a_log_that_was_changed_shows_no_knowledge_and_says_why() -> None:
    site, log = flown(load('paper_8x8'))
    events = log.events.copy()
    events['x_m'][20] += 1.0
    shown = footage_of(site, replace(log, events=events))
    assert not shown['flights'][0]['knows']
    [note] = shown['notes']
    assert 'event 20' in note
    assert 'x_m' in note


def test_of_a_recording_without_its_first_event_nothing_is_known() -> None:
    site, log = flown(load('paper_8x8'))
    shown = footage_of(site, replace(log, events=log.events[3:]))
    assert len(shown['flights'][0]['events']) == len(log.events) - 3
    assert shown['flights'][0]['lacks_events']
    assert 'first event' in shown['notes'][0]


def test_of_a_mission_that_goes_on_all_is_known_so_far() -> None:
    site, log = flown(load('paper_8x8'))
    [flight] = footage_of(site, replace(log, events=log.events[:30]))['flights']
    assert not flight['is_over']
    assert len(flight['events']) == 30
    assert n_known(flight['events'], 1)[-1] > 0


def test_a_mission_that_has_not_begun_has_a_fleet_and_no_events() -> None:
    site, log = flown(load('paper_8x8'))
    shown = footage_of(site, replace(log, events=log.events[:0]))
    assert shown['flights'][0]['events'] == []
    assert shown['notes'] == []
    assert len(shown['uavs']) == 2


def test_a_hover_names_its_sensors_with_rates_that_give_its_duration() -> None:
    site, log = flown(tiny(uav(5.0), uav(10.0)))
    shown = footage_of(site, log)
    hovers = [it for it in shown['flights'][0]['events'] if it['action'] == HOVER]
    assert sum(len(hover['reads']) for hover in hovers) == 3
    for hover in hovers:
        uploads_s = [shown['sensors'][it]['bit'] / bps for it, _, bps in hover['reads']]
        assert max(uploads_s) == pytest.approx(hover['duration_s'], rel=1e-4)


def test_ghosts_fly_the_same_data_by_rules_and_by_the_shortest_plan() -> None:
    site, log = flown(load('paper_8x8'), 'hert')
    bound = bound_of(site, 0)
    assert bound.shortest is not None
    flights = ghosts_of(site, log.header, bound)
    assert flights.problems == ()
    ghosts = {ghost.name: ghost.log for ghost in flights.flown}
    assert [*ghosts] == ['sweep', PLAN]
    assert ghosts[PLAN].header.total_bit == log.header.total_bit
    planned = mission_metrics(ghosts[PLAN])
    assert planned.is_complete
    assert planned.completion_s == pytest.approx(bound.shortest.completion_s)


def test_a_ghost_that_cannot_fly_keeps_no_other_one_on_the_ground() -> None:
    site, log = flown(load('paper_8x8'), 'hert')
    bound = bound_of(site, 0)
    assert bound.shortest is not None
    all_cells = tuple(range(site.n_cells)), ()  # in some of which no data waits
    impossible = replace(bound, shortest=replace(bound.shortest, cells=all_cells))
    page = mission_page(flown_mission(log, site), impossible)
    footage_in_page = page.decode().partition('id="footage">')[2].partition('</script>')[0]
    shown = json.loads(footage_in_page)
    assert [flight['name'] for flight in shown['flights']] == ['flown', 'sweep']
    [note] = shown['notes']
    assert note.startswith(f'Not flown beside it: {PLAN}: UAV 1, event ')


def test_a_page_of_five_hundred_events_is_small() -> None:
    site, log = flown(load('paper_15x15', {'area.cells_per_side': 20}), 'hert', seed=1)
    ghosts = [Ghost(name=name, log=log) for name in ('one', 'another', PLAN)]
    page = film_page(footage(log, site, demand_of(site, 1), ghosts=ghosts))
    assert len(log.events) > 500
    assert len(page) < 1_500_000


@pytest.mark.parametrize('text', ['</script><b>', '<!--', '\u2028\u2029', 'a & b', '\ud800'])
def test_no_name_ends_the_script_that_holds_it(text: str) -> None:
    written = json_in_html({'name': text})
    assert not {*'<>&\u2028\u2029'} & {*written}
    assert json.loads(written)['name'] == text


def test_a_page_has_one_policy_for_what_it_may_load() -> None:
    site, log = flown(tiny(uav(5.0)))
    page = film_page(footage_of(site, log)).decode()
    rules = html.unescape(page.partition('Policy" content="')[2].partition('"')[0])
    assert "default-src 'none'" in rules
    assert "connect-src 'none'" in rules
    assert '{{' not in page.partition('<script type')[0]
    assert 'http://' not in page.replace('http://www.w3.org/2000/svg', '')
    assert 'https://' not in page


def test_where_no_message_arrives_nobody_is_in_contact() -> None:
    mute = {'radio.loss_share': 1.0, 'radio.contact_range_m': 100.0}
    site, log = flown(load('paper_8x8', mute))
    assert footage_of(site, log)['contact_range_m'] == 0.0


def test_where_a_page_may_connect_is_never_markup() -> None:
    page = film_page(None, 'ws://[::1%"><img src=x>]:80').decode()
    assert '<img' not in page.partition('<style>')[0]

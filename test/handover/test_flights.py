"""Flights as stretches, and the table of their states."""

import csv
from dataclasses import replace
from datetime import timedelta
import tracemalloc

from handed_on import flown_on_earth, handed_on, on_earth, START
import pytest
from tiny_world import fly_scripts, tiny
from uav_collect.analysis.legs import mission_legs
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.errors import ConfigError
from uav_collect.handover.flights import MissionFlights
from uav_collect.handover.states_file import states_file
from uav_collect.uav.action_codes import FORWARD, HOVER, RIGHT


def states(mission: MissionFlights, rate_hz: float = 1.0) -> list[dict[str, str]]:
    return [*csv.DictReader(states_file(mission, rate_hz).decode().splitlines())]


def test_legs_that_lead_straight_on_are_one_run() -> None:
    mission, log = flown_on_earth()
    stretches = mission.flights[1].stretches  # two cells north, two east, a hover, home
    assert [stretch.kind for stretch in stretches] == ['move', 'move', 'hover', 'home']
    assert [stretch.length_m for stretch in stretches[:2]] == [100.0, 100.0]
    legs = mission_legs(log, on_earth())[1]
    assert len(legs) == 6
    for quantity in ('energy_j', 'length_m'):
        total = sum(getattr(leg, quantity) for leg in legs)
        assert sum(getattr(stretch, quantity) for stretch in stretches) == pytest.approx(total)
    assert (stretches[0].start_s, stretches[-1].end_s) == (legs[0].start_s, legs[-1].end_s)


def test_who_stays_on_the_ground_has_no_flight() -> None:
    scenario = tiny()
    mission = handed_on(scenario, fly_scripts(scenario, [RIGHT, HOVER], []))
    assert [flight.uav for flight in mission.flights] == [1]


def test_times_are_those_of_the_calendar_to_a_millisecond() -> None:
    mission, _ = flown_on_earth()
    assert mission.clock(0.0) == '2026-06-01T08:00:00.000Z'
    assert mission.clock(3661.0004) == '2026-06-01T09:01:01.000Z'
    eve = replace(mission, start=START.replace(month=12, day=31) + timedelta(hours=15))
    assert eve.clock(3599.9996) == '2027-01-01T00:00:00.000Z'


def test_states_tell_where_every_uav_was_at_a_rate() -> None:
    mission, _ = flown_on_earth()
    rows = states(mission, 2.0)
    second = [row for row in rows if row['uav'] == '2']
    assert [float(row['time_s']) for row in second[:3]] == [0.0, 0.5, 1.0]
    row = second[3]  # 1.5 s at 10 m/s north
    assert (float(row['x_m']), float(row['y_m'])) == pytest.approx((25.0, 40.0))
    assert (row['doing'], float(row['speed_mps']), float(row['heading_deg'])) == (
        'move',
        10.0,
        0.0,
    )
    place = float(row['lat_deg']), float(row['lon_deg'])
    assert place == mission.lat_lon_deg((25.0, 40.0))
    times_s = [float(row['time_s']) for row in rows]
    assert times_s == sorted(times_s)
    hovering = [row for row in second if row['doing'] == 'hover']
    assert {(row['speed_mps'], row['heading_deg']) for row in hovering} == {('0.0', '')}


def test_the_last_state_of_each_uav_is_its_landing() -> None:
    mission, log = flown_on_earth()
    metrics = mission_metrics(log)
    for uav, home in zip(metrics.uavs, ('25.0', '60.0'), strict=True):
        last = [row for row in states(mission) if row['uav'] == str(uav.id)][-1]
        assert (last['doing'], last['x_m'], last['altitude_m']) == ('landed', home, '0.0')
        assert float(last['time_s']) == pytest.approx(uav.landed_s)
        assert float(last['energy_left_j']) == pytest.approx(uav.energy_left_j)


def test_states_have_no_degrees_where_the_earth_is_not_known() -> None:
    scenario = tiny()
    mission = handed_on(scenario, fly_scripts(scenario, [RIGHT, HOVER], []))
    assert 'lat_deg' not in states(mission)[0]


def test_a_table_that_nobody_reads_is_refused() -> None:
    mission, _ = flown_on_earth()
    with pytest.raises(ConfigError, match=r'--rate-hz is 1e\+06: makes \d+ rows, must make at'):
        states_file(mission, 1e6)


def test_a_table_takes_little_more_memory_than_its_text() -> None:
    mission, _ = flown_on_earth()
    tracemalloc.start()
    try:
        n_bytes = len(states_file(mission, 100.0))
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak_bytes < 4 * n_bytes  # text and its bytes, no rows


def test_there_is_no_row_where_a_recording_lacks_what_a_uav_did() -> None:
    _, log = flown_on_earth([FORWARD, RIGHT, RIGHT, RIGHT], [FORWARD, RIGHT])
    gap = log.events[log.events['uav'] == 1][2]  # in the middle of a straight line
    kept = replace(log, events=log.events[log.events['event'] != gap['event']])
    lacking, whole = (states(handed_on(on_earth(), it)) for it in (kept, log))
    end_s = gap['time_s'] + gap['duration_s']
    assert [(row['time_s'], row['uav']) for row in lacking] == [
        (row['time_s'], row['uav'])
        for row in whole
        if row['uav'] != '1' or not gap['time_s'] <= float(row['time_s']) < end_s
    ]

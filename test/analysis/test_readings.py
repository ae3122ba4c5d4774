"""Who read which sensor, when and how fast: by hand for tiny worlds, against the log elsewhere."""

from dataclasses import replace
import math

import numpy as np
import pytest
from tiny_world import fly_scripts, rate_bps, tiny
from uav_collect.analysis.readings import (
    is_left,
    mission_readings,
    Reading,
    READING_COLUMNS,
    readings_csv,
)
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOVER, LEFT, RIGHT
from uav_collect.world.sensor_field import demand_of

TO_A = [RIGHT, HOVER]
TO_B = [FORWARD, FORWARD, RIGHT, RIGHT, HOVER]


def readings_of(scenario: Scenario, log: MissionLog) -> tuple[Reading, ...]:
    site = build_site(scenario)
    return mission_readings(log, site, demand_of(site, log.header.mission_seed))


@pytest.fixture(scope='module')
def tiny_log() -> MissionLog:
    return fly_scripts(tiny(), TO_A, TO_B)


def test_a_sensor_alone_has_all_the_bandwidth_of_its_uav(tiny_log: MissionLog) -> None:
    first = readings_of(tiny(), tiny_log)[0]
    assert (first.sensor_id, first.uav, first.cell) == ('S1', 1, 1)
    assert (first.x_m, first.y_m, first.data_bit) == (75.0, 25.0, 1e6)
    assert first.bandwidth_hz == pytest.approx(0.5e6, rel=1e-9)
    assert first.rate_bps == pytest.approx(rate_bps(0.5e6), rel=1e-6)
    assert first.start_s == 10.0  # a move of 50 m at 5 m/s
    assert first.end_s == pytest.approx(10.0 + 1e6 / rate_bps(0.5e6), rel=1e-6)


def test_two_sensors_of_a_hover_share_it_and_are_done_together(tiny_log: MissionLog) -> None:
    [*_, larger, smaller] = readings_of(tiny(), tiny_log)
    assert [larger.sensor_id, smaller.sensor_id] == ['S2', 'S3']
    assert larger.uav == smaller.uav == 2
    assert larger.bandwidth_hz + smaller.bandwidth_hz == pytest.approx(0.5e6, rel=1e-9)
    assert larger.end_s == pytest.approx(smaller.end_s, rel=1e-9)
    assert larger.rate_bps == pytest.approx(2.0 * smaller.rate_bps, rel=1e-9)  # twice the data
    assert larger.rate_bps == pytest.approx(rate_bps(larger.bandwidth_hz), rel=1e-6)


def test_with_equal_bandwidth_the_sensor_of_less_data_is_done_first() -> None:
    log = fly_scripts(tiny(), [], TO_B, allocator='equal')
    larger, smaller = readings_of(tiny(), log)
    assert larger.bandwidth_hz == smaller.bandwidth_hz == 0.25e6
    assert smaller.end_s - smaller.start_s == pytest.approx((larger.end_s - larger.start_s) / 2)


@pytest.mark.parametrize('allocator', ['exact', 'equal'])
def test_readings_add_up_to_every_hover_of_the_log(allocator: str) -> None:
    scenario = load('paper_8x8', {'radio.csi_error_variance': 0.01})
    [log] = fly(build_site(scenario), [3], 'random', allocator)
    readings = readings_of(scenario, log)
    hovers = log.events[log.events['action'] == HOVER]
    assert len(hovers) > 5
    assert {reading.event for reading in readings} == {*hovers['event'].tolist()}
    for hover in hovers:
        served = [reading for reading in readings if reading.event == hover['event']]
        assert len(served) == hover['n_sensors']
        assert {reading.uav for reading in served} == {hover['uav']}
        assert sum(it.data_bit for it in served) == pytest.approx(hover['collected_bit'])
        latest_s = max(it.end_s for it in served)
        assert latest_s == pytest.approx(hover['time_s'] + hover['duration_s'], rel=1e-9)
        assert sum(it.bandwidth_hz for it in served) == pytest.approx(scenario.bandwidth_hz)


def test_the_channel_is_that_of_the_visit() -> None:
    fading = tiny(radio__rician_a1=1.0, radio__rician_a2=4.39, radio__los_b=0.14)
    rates_bps = []
    for script in (TO_A, [RIGHT, FORWARD, LEFT, BACKWARD, RIGHT, HOVER]):  # the second visit
        log = fly_scripts(fading, script, [])
        [reading] = readings_of(fading, log)
        [hover] = log.events[log.events['action'] == HOVER]
        assert reading.data_bit / reading.rate_bps == pytest.approx(hover['duration_s'], rel=1e-9)
        rates_bps.append(reading.rate_bps)
    assert rates_bps[0] != pytest.approx(rates_bps[1], rel=1e-3)


def test_rates_are_not_known_where_an_agent_shared_bandwidth_its_own_way(
    tiny_log: MissionLog,
) -> None:
    events = tiny_log.events.copy()
    events['duration_s'][events['action'] == HOVER] *= 1.5
    readings = readings_of(tiny(), replace(tiny_log, events=events))
    assert [reading.sensor_id for reading in readings] == ['S1', 'S2', 'S3']
    assert all(math.isnan(reading.rate_bps) for reading in readings)
    assert all(math.isnan(reading.bandwidth_hz) for reading in readings)
    hover = events[events['action'] == HOVER][0]
    assert readings[0].end_s == hover['time_s'] + hover['duration_s']


def test_rates_are_not_known_after_a_decision_that_a_recording_lacks(tiny_log: MissionLog) -> None:
    is_lost = (tiny_log.events['uav'] == 2) & (tiny_log.events['decision'] == 1)
    readings = readings_of(tiny(), replace(tiny_log, events=tiny_log.events[~is_lost]))
    assert [reading.sensor_id for reading in readings] == ['S1', 'S2', 'S3']
    assert [math.isnan(reading.rate_bps) for reading in readings] == [False, True, True]


def test_data_are_left_where_nobody_hovered() -> None:
    scenario = tiny()
    site, log = build_site(scenario), fly_scripts(scenario, TO_A, [])
    assert is_left(log, site, demand_of(site, 0)).tolist() == [False, True, True]
    assert is_left(log, site, np.array([1.0, 0.0, 2.0])).tolist() == [False, False, True]


def test_of_a_log_that_lacks_events_no_data_are_said_to_be_left() -> None:
    scenario = tiny()
    log = fly_scripts(scenario, TO_A, [])
    gappy = replace(log, events=np.delete(log.events, 1))
    assert not is_left(gappy, build_site(scenario), demand_of(build_site(scenario), 0)).any()


def test_a_table_of_readings_has_a_line_for_each_and_blanks_for_what_is_not_known(
    tiny_log: MissionLog,
) -> None:
    first, *_ = readings_of(tiny(), tiny_log)
    unknown = replace(first, sensor_id='Lärche, "3"', rate_bps=math.nan, bandwidth_hz=math.nan)
    header, *lines = readings_csv([(7, [first]), (8, [unknown])]).decode().splitlines()
    assert tuple(header.split(',')) == READING_COLUMNS
    assert lines[0].startswith('7,S1,1,')
    assert lines[1].startswith('8,"Lärche, ""3""",1,')
    assert ',1.0,,,75.0,25.0,1' in lines[1]

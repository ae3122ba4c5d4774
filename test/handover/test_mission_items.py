"""Missions for ground stations, read back by pymavlink, and by what QGroundControl documents."""

from collections.abc import Callable
from dataclasses import replace
import json
import math
from pathlib import Path
from typing import Any

from handed_on import flown_on_earth, GEOD, handed_on, lengths_m, on_earth, REFERENCE
import numpy as np
from pymavlink import mavutil, mavwp
import pytest
from tiny_world import fly_scripts, tiny, uav
from uav_collect.analysis.legs import between_m, HOME_LEG, HOVER_LEG
from uav_collect.errors import MissionLogError
from uav_collect.handover.flights import MissionFlights, UavFlight
from uav_collect.handover.mission_items import plan_file, waypoint_file
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOVER, LEFT, RIGHT

MAV = mavutil.mavlink
PLACED = (MAV.MAV_CMD_NAV_TAKEOFF, MAV.MAV_CMD_NAV_WAYPOINT, MAV.MAV_CMD_NAV_LOITER_TIME)


@pytest.fixture(scope='module')
def mission() -> MissionFlights:
    return flown_on_earth()[0]


def loaded(mission: MissionFlights, index: int, folder: Path) -> list[Any]:
    """The items of a UAV's waypoint file, as pymavlink reads them."""
    file = folder / 'one.waypoints'
    file.write_bytes(waypoint_file(mission, mission.flights[index]))
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(file)) > 3
    return [loader.wp(number) for number in range(loader.count())]


def test_a_waypoint_file_takes_off_flies_stays_and_lands(
    mission: MissionFlights, tmp_path: Path
) -> None:
    home, *items = loaded(mission, 0, tmp_path)
    assert (home.seq, home.current, home.command) == (0, 1, MAV.MAV_CMD_NAV_WAYPOINT)
    assert [item.command for item in items] == [
        MAV.MAV_CMD_NAV_TAKEOFF,
        MAV.MAV_CMD_DO_CHANGE_SPEED,
        MAV.MAV_CMD_NAV_LOITER_TIME,  # over A
        MAV.MAV_CMD_NAV_WAYPOINT,  # two moves to the east as one
        MAV.MAV_CMD_NAV_WAYPOINT,  # home
        MAV.MAV_CMD_NAV_LAND,
    ]
    assert [item.seq for item in items] == [*range(1, 7)]
    assert [item.current for item in items] == [0] * 6
    assert {item.autocontinue for item in items} == {1}
    assert (items[1].frame, items[1].param1, items[1].param2) == (MAV.MAV_FRAME_MISSION, 1.0, 5.0)
    assert (items[-1].x, items[-1].y, items[-1].z) == (items[-2].x, items[-2].y, 0.0)


@pytest.mark.parametrize('index', [0, 1])
def test_ways_between_waypoints_are_as_long_as_flown(
    mission: MissionFlights, index: int, tmp_path: Path
) -> None:
    placed = [item for item in loaded(mission, index, tmp_path)[1:] if item.command in PLACED]
    assert {item.frame for item in placed} == {MAV.MAV_FRAME_GLOBAL_RELATIVE_ALT}
    assert {item.z for item in placed} == {mission.altitude_m}
    flown_m = [
        stretch.length_m
        for stretch in mission.flights[index].stretches
        if stretch.kind != HOVER_LEG
    ]
    found_m = lengths_m([(item.y, item.x) for item in placed])
    assert found_m == pytest.approx(flown_m, abs=0.01)


def test_ways_over_kilometres_are_as_long_as_flown_to_a_decimetre(tmp_path: Path) -> None:
    wide = on_earth(area__cell_size_m=1500.0)
    log = fly_scripts(wide, [RIGHT, RIGHT, RIGHT, FORWARD, FORWARD, FORWARD, LEFT], [])
    mission = handed_on(wide, log)
    placed = [item for item in loaded(mission, 0, tmp_path)[1:] if item.command in PLACED]
    found_m = lengths_m([(item.y, item.x) for item in placed])
    flown_m = [4500.0, 4500.0, 1500.0, 1500.0 * 13**0.5]
    assert found_m == pytest.approx(flown_m, abs=0.1)


def test_a_way_home_around_a_no_fly_zone_has_a_waypoint_at_each_corner(tmp_path: Path) -> None:
    wall_m = [[55.0, 5.0], [95.0, 5.0], [95.0, 145.0], [55.0, 145.0]]  # closes three cells
    zones = {'area__reference': REFERENCE, 'area__no_fly': [wall_m]}
    scenario = tiny(uav(5.0), sensors=[(25.0, 75.0, 1.0)], **zones)
    around = [FORWARD, HOVER, FORWARD, FORWARD, RIGHT, RIGHT, BACKWARD, BACKWARD, BACKWARD]
    log = fly_scripts(scenario, around)
    mission = handed_on(scenario, log)
    [*_, home] = log.events
    home_m = [leg.length_m for leg in mission.flights[0].stretches if leg.kind == HOME_LEG]
    assert len(home_m) > 1
    assert sum(home_m) == pytest.approx(home['duration_s'] * 5.0, rel=1e-9)
    items = [item for item in loaded(mission, 0, tmp_path) if item.command in PLACED]
    ways_m = lengths_m([(item.y, item.x) for item in items])
    assert ways_m[-len(home_m) :] == pytest.approx(home_m, abs=0.01)
    for leg in mission.flights[0].stretches:
        for share in range(101):
            x_m, y_m = between_m(leg.start_m, leg.end_m, share / 100)
            assert not (50.0 < x_m < 100.0 and y_m < 150.0)


def test_forward_is_true_north(mission: MissionFlights, tmp_path: Path) -> None:
    take_off, _, corner, *_ = loaded(mission, 1, tmp_path)[1:]
    azimuth_deg, _, length_m = GEOD.inv(take_off.y, take_off.x, corner.y, corner.x)
    assert azimuth_deg == pytest.approx(0.0, abs=0.01)
    assert length_m == pytest.approx(100.0, abs=0.01)


def test_a_stay_has_whole_seconds_and_no_less_than_the_hover(tmp_path: Path) -> None:
    mission, log = flown_on_earth()
    for index in range(2):
        [stay] = [
            item
            for item in loaded(mission, index, tmp_path)
            if item.command == MAV.MAV_CMD_NAV_LOITER_TIME
        ]
        own = log.events[log.events['uav'] == index + 1]
        [hover_s] = own['duration_s'][own['action'] == HOVER]
        assert stay.param1 == math.ceil(hover_s)


def test_of_a_flight_that_was_cut_short_the_uav_returns_to_launch(tmp_path: Path) -> None:
    scenario = on_earth()
    log = fly_scripts(scenario, [RIGHT, HOVER, RIGHT, RIGHT], [])
    cut = handed_on(scenario, replace(log, events=log.events[:5]))
    *_, last = loaded(cut, 0, tmp_path)
    assert last.command == MAV.MAV_CMD_NAV_RETURN_TO_LAUNCH


def test_a_plan_is_what_qgroundcontrol_documents(mission: MissionFlights) -> None:
    document = json.loads(plan_file(mission, mission.flights[1]))
    assert (document['fileType'], document['version']) == ('Plan', 1)
    assert document['geoFence'] == {'circles': [], 'polygons': [], 'version': 2}
    assert document['rallyPoints'] == {'points': [], 'version': 2}
    plan = document['mission']
    assert (plan['version'], plan['firmwareType'], plan['vehicleType']) == (2, 12, 2)
    assert plan['cruiseSpeed'] == plan['hoverSpeed'] == 10.0
    lat_deg, lon_deg, _ = plan['plannedHomePosition']
    assert (lat_deg, lon_deg) == mission.lat_lon_deg((25.0, 25.0))
    for number, item in enumerate(plan['items'], start=1):
        assert (item['type'], item['doJumpId']) == ('SimpleItem', number)
        assert item['autoContinue'] is True
        assert len(item['params']) == 7
        is_placed = item['frame'] == MAV.MAV_FRAME_GLOBAL_RELATIVE_ALT
        height = {'Altitude': item['params'][6], 'AltitudeMode': 1} if is_placed else {}
        assert {key: value for key, value in item.items() if 'Altitude' in key} == height
    assert {'Altitude' in item for item in plan['items']} == {True, False}


@pytest.mark.parametrize('index', [0, 1])
def test_a_plan_and_a_waypoint_file_say_the_same(
    mission: MissionFlights, index: int, tmp_path: Path
) -> None:
    plan = json.loads(plan_file(mission, mission.flights[index]))['mission']['items']
    items = loaded(mission, index, tmp_path)[1:]
    assert len(plan) == len(items)
    for planned, item in zip(plan, items, strict=True):
        assert (planned['command'], planned['frame']) == (item.command, item.frame)
        params = [item.param1, item.param2, item.param3, item.param4, item.x, item.y, item.z]
        assert [param or 0.0 for param in planned['params']] == pytest.approx(params, abs=1e-8)


def test_a_plan_leaves_the_yaw_open_and_a_waypoint_file_has_a_number_as_it_can_say_no_other(
    mission: MissionFlights, tmp_path: Path
) -> None:
    flight = mission.flights[0]
    placed = [it for it in loaded(mission, 0, tmp_path) if it.command in PLACED]
    planned = json.loads(plan_file(mission, flight))['mission']['items']
    assert {it['params'][3] for it in planned if it['command'] in PLACED} == {None}
    assert {it.param4 for it in placed} == {0.0}
    _, *lines = waypoint_file(mission, flight).decode().splitlines()
    assert all(math.isfinite(float(word)) for line in lines for word in line.split('\t'))


@pytest.mark.parametrize('lacking', [0, 1])
@pytest.mark.parametrize('write', [plan_file, waypoint_file])
def test_a_flight_with_a_gap_is_no_mission(
    lacking: int, write: Callable[[MissionFlights, UavFlight], bytes]
) -> None:
    _, log = flown_on_earth()
    own = np.flatnonzero(log.events['uav'] == 1)
    cut = replace(log, events=np.delete(log.events, own[lacking]))
    mission = handed_on(on_earth(), cut)
    first, second = mission.flights
    assert first.take_off_m == on_earth().uavs[0].start_m
    with pytest.raises(MissionLogError, match=r'UAV 1: the recording lacks .* must be there'):
        write(mission, first)
    assert write(mission, second)

import math

import pytest
from tiny_world import (
    CELL_A,
    CELL_B,
    Flight,
    fly_scripts,
    GAIN,
    HOVER_W,
    MOVE_10_J,
    rate_bps,
    tiny,
    uav,
)
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import FORWARD, HOME, HOVER, LEFT, NONE, RIGHT


def order_of(scenario: Scenario, *scripts: list[int]) -> list[tuple[float, int]]:
    events = fly_scripts(scenario, *scripts).events
    return [(float(event['time_s']), int(event['uav'])) for event in events]


# Order of events


def test_at_the_start_all_uavs_decide_in_the_order_of_their_indices() -> None:
    fleet = [uav(10.0), uav(5.0), uav(10.0), uav(2.0)]
    order = order_of(tiny(*fleet), [RIGHT], [FORWARD], [FORWARD], [RIGHT])
    assert order[:4] == [(0.0, 1), (0.0, 2), (0.0, 3), (0.0, 4)]


def test_the_uav_whose_action_ends_first_decides_next() -> None:
    order = order_of(tiny(uav(5.0), uav(12.5)), [RIGHT, RIGHT], [FORWARD] * 3)
    assert order[2:] == [(4.0, 2), (8.0, 2), (10.0, 1), (12.0, 2), (20.0, 1)]


def test_uavs_that_end_at_once_decide_by_index() -> None:
    order = order_of(tiny(), [RIGHT, RIGHT], [FORWARD] * 3)
    assert order[2:] == [(5.0, 2), (10.0, 1), (10.0, 2), (15.0, 2), (20.0, 1)]


def test_a_decision_leaves_the_running_actions_of_others_alone() -> None:
    alone = fly_scripts(tiny(uav(5.0)), [RIGHT, FORWARD, FORWARD, LEFT]).events
    among = fly_scripts(
        tiny(uav(5.0), uav(12.5), uav(7.0)),
        [RIGHT, FORWARD, FORWARD, LEFT],
        [FORWARD] * 3,
        [RIGHT, RIGHT],
    ).events
    own = among[among['uav'] == 1]
    for field in ('time_s', 'x_m', 'y_m', 'duration_s', 'energy_j', 'energy_left_j'):
        assert own[field].tolist() == alone[field].tolist()


def test_a_uav_that_turned_home_decides_no_more_and_the_others_go_on() -> None:
    order = order_of(tiny(uav(5.0), uav(10.0)), [], [FORWARD, RIGHT, RIGHT])
    assert [unit for _, unit in order] == [1, 2, 2, 2, 2]


# Flight


def test_a_move_ends_at_the_centre_of_the_next_cell_and_costs_time_and_energy() -> None:
    flight = Flight(tiny(uav(10.0)))
    flight.step(RIGHT)
    flight.step(FORWARD)
    view = flight.look().view
    assert (view.x_m, view.y_m, view.cell) == (75.0, 75.0, 5)
    assert view.time_s == 10.0
    assert view.energy_left_j == pytest.approx(1e6 - 2 * MOVE_10_J, abs=1e-2)
    assert view.previous_action == FORWARD


def test_before_its_first_action_a_uav_has_none() -> None:
    view = Flight(tiny()).look().view
    assert view.previous_action == NONE
    assert view.energy_left_j == 1e6


def test_positions_run_evenly_from_start_to_end_of_an_action() -> None:
    flight = Flight(tiny())
    flight.step(RIGHT)
    flight.step(FORWARD)
    places = [flight.simulation.position_m(0, time_s) for time_s in (0.0, 2.5, 5.0, 10.0)]
    assert places == [(25.0, 25.0), (37.5, 25.0), (50.0, 25.0), (75.0, 25.0)]
    assert flight.simulation.position_m(1, 2.5) == (25.0, 50.0)


def test_the_way_home_is_straight_and_the_uav_stays_there() -> None:
    flight = Flight(tiny(uav(5.0), uav(10.0, home_m=(175.0, 0.0))))
    flight.step(RIGHT)
    flight.step(HOME)
    home_s = math.hypot(150.0, 25.0) / 10.0
    assert flight.simulation.position_m(1, home_s / 2) == pytest.approx((100.0, 12.5))
    assert flight.simulation.position_m(1, home_s) == (175.0, 0.0)
    assert flight.simulation.position_m(1, 1e3) == (175.0, 0.0)


def test_the_mission_ends_when_the_last_uav_is_home() -> None:
    log = fly_scripts(tiny(), [RIGHT], [FORWARD, FORWARD, FORWARD])
    assert log.events['action'][-1] == HOME
    mission = mission_metrics(log)
    # 50 m there and back at 5 m/s, 150 m there and back at 10 m/s.
    assert [unit.landed_s for unit in mission.uavs] == [20.0, 30.0]
    assert mission.completion_s == 30.0
    assert log.events['time_s'][-1] + log.events['interval_s'][-1] == 30.0


def test_energy_counts_flight_hover_and_the_way_home() -> None:
    scenario = tiny(uav(10.0), radio__system_bandwidth_mhz=0.5)
    mission = mission_metrics(fly_scripts(scenario, [RIGHT, HOVER, RIGHT]))
    hover_s = 1e6 / rate_bps(0.5e6)
    assert mission.energy_j == pytest.approx(4 * MOVE_10_J + HOVER_W * hover_s, rel=1e-5)
    assert mission.collected_bit == 1e6


# What a UAV sees


def test_the_view_is_the_three_by_three_region_row_by_row_from_the_south_west() -> None:
    sensors = [
        (25.0 + 50.0 * (cell % 4), 25.0 + 50.0 * (cell // 4), 1.0 + cell) for cell in range(16)
    ]
    flight = Flight(tiny(uav(5.0, start=(2, 1)), sensors=sensors))
    region_mbit = [bit / 1e6 for bit in flight.look().view.region_bit]
    assert region_mbit == pytest.approx([5.0, 6.0, 7.0, 9.0, 10.0, 11.0, 13.0, 14.0, 15.0])


@pytest.mark.parametrize(
    ('start', 'outside'),
    [((0, 0), [0, 1, 2, 3, 6]), ((3, 3), [2, 5, 6, 7, 8]), ((0, 2), [0, 1, 2]), ((1, 1), [])],
)
def test_outside_the_area_there_is_nothing_to_see(
    start: tuple[int, int], outside: list[int]
) -> None:
    region_bit = Flight(tiny(uav(5.0, start=start))).look().view.region_bit
    assert [index for index in range(9) if math.isnan(region_bit[index])] == outside


def test_the_demand_of_a_cell_is_that_of_all_its_sensors() -> None:
    view = Flight(tiny(uav(5.0, start=(1, 1)))).look().view
    assert view.region_bit[8] == 0.75e6
    assert view.n_sensors == 0


def test_the_sensors_of_the_own_cell_are_seen_one_by_one() -> None:
    view = Flight(tiny(uav(5.0, start=(2, 2)))).look().view
    assert view.n_sensors == 2
    assert [view.sensor[index] for index in range(2)] == [1, 2]
    assert [view.sensor_bit[index] for index in range(2)] == [0.5e6, 0.25e6]
    gains = [view.sensor_gain[index] for index in range(2)]
    assert gains == pytest.approx([GAIN] * 2, rel=1e-6)
    assert [view.sensor_error_gain[index] for index in range(2)] == [0.0, 0.0]


def test_a_sensor_without_data_does_not_show() -> None:
    sensors = [(25.0, 25.0, 0.0), (25.0, 25.0, 1.0), (75.0, 25.0, 0.0)]
    flight = Flight(tiny(uav(5.0), sensors=sensors))
    view = flight.look().view
    assert (view.n_sensors, view.sensor[0]) == (1, 1)
    assert flight.known(0) == [1, 4, 5]


# Hovering


def test_data_are_claimed_when_the_hover_starts() -> None:
    start = (2, 2)
    flight = Flight(tiny(uav(5.0, start=start), uav(10.0, start=start)))
    flight.step(HOVER)
    event = flight.look()
    assert (event.uav, event.view.time_s) == (1, 0.0)
    assert event.view.region_bit[4] == 0.0
    assert event.view.n_sensors == 0
    assert CELL_B in flight.known(1)
    assert flight.simulation.waiting_bit()[CELL_B] == 0.0


def test_a_cell_is_complete_for_its_collector_when_the_hover_ends() -> None:
    flight = Flight(tiny(uav(5.0, start=(2, 2))))
    flight.step(HOVER)
    assert CELL_B not in flight.known(0)
    flight.look()
    assert CELL_B in flight.known(0)


def test_a_cell_with_waiting_data_is_not_complete() -> None:
    flight = Flight(tiny(uav(5.0)))
    flight.look()
    assert flight.known(0) == [0, 4, 5]
    assert CELL_A not in flight.known(0)


def test_an_unseen_cell_is_not_complete_even_if_it_is_empty() -> None:
    flight = Flight(tiny(uav(5.0)))
    flight.look()
    assert 15 not in flight.known(0)


def test_a_hover_lasts_as_long_as_its_slowest_sensor() -> None:
    scenario = tiny(uav(5.0, start=(2, 2)), radio__system_bandwidth_mhz=0.5)
    events = fly_scripts(scenario, [HOVER], allocator='equal').events
    assert events['duration_s'][0] == pytest.approx(0.5e6 / rate_bps(0.25e6), rel=1e-5)
    assert events['collected_bit'][0] == 0.75e6
    assert events['n_sensors'][0] == 2
    assert events['energy_j'][0] == pytest.approx(HOVER_W * events['duration_s'][0], rel=1e-5)


def test_the_exact_allocator_lets_all_sensors_end_at_once() -> None:
    scenario = tiny(uav(5.0, start=(2, 2)), radio__system_bandwidth_mhz=0.5)
    flight = Flight(scenario)
    share_hz = flight.act(flight.look(), HOVER).share_hz
    assert sum(share_hz) == pytest.approx(0.5e6, rel=1e-12)
    ends_s = [0.5e6 / rate_bps(share_hz[0]), 0.25e6 / rate_bps(share_hz[1])]
    assert ends_s[0] == pytest.approx(ends_s[1], rel=1e-5)
    assert flight.look().view.time_s == pytest.approx(ends_s[0], rel=1e-5)


def test_a_hover_stays_where_it_is() -> None:
    flight = Flight(tiny(uav(5.0, start=(2, 2))))
    flight.step(HOVER)
    view = flight.look().view
    assert (view.x_m, view.y_m, view.previous_action) == (125.0, 125.0, HOVER)


def test_an_action_that_collects_nothing_serves_no_sensor() -> None:
    events = fly_scripts(tiny(uav(5.0, start=(2, 2))), [RIGHT, FORWARD]).events
    assert events['n_sensors'].tolist() == [0, 0, 0]
    assert events['collected_bit'].tolist() == [0.0, 0.0, 0.0]

import math

import numpy as np
import pytest
from tiny_world import Flight, tiny, uav
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import FORWARD, HOME, LEFT, RIGHT
from uav_collect.world.dynamics import mission_of, place_at


@pytest.mark.parametrize(
    ('range_m', 'heard'), [(50.0, [1]), (49.999, []), (0.0, []), (math.inf, [1])]
)
def test_contact_reaches_exactly_as_far_as_the_range(range_m: float, heard: list[int]) -> None:
    scenario = tiny(uav(5.0), uav(10.0, start=(0, 1)), radio__contact_range_m=range_m)
    assert [message.sender for message in Flight(scenario).look().heard] == heard


def test_uavs_at_one_place_are_in_contact_at_any_range() -> None:
    event = Flight(tiny(radio__contact_range_m=0.0)).look()
    assert [message.sender for message in event.heard] == [1]


@pytest.mark.parametrize(('range_m', 'heard'), [(25.0, [0]), (24.999, [])])
def test_contact_is_judged_where_the_others_are_at_that_moment(
    range_m: float, heard: list[int]
) -> None:
    # After 5 s the first UAV is half way from x = 25 m to 75 m, the second has come to 75 m.
    scenario = tiny(uav(5.0), uav(10.0, start=(0, 2)), radio__contact_range_m=range_m)
    flight = Flight(scenario)
    flight.step(RIGHT)
    flight.step(LEFT)
    event = flight.look()
    assert (event.uav, event.view.time_s) == (1, 5.0)
    assert [message.sender for message in event.heard] == heard


def test_a_uav_that_waits_for_others_has_flown_at_its_own_speed() -> None:
    # The first flies for 10 s, the second for 5 s; then it waits where it came to, at x = 125 m.
    scenario = tiny(uav(5.0), uav(10.0, start=(0, 3)))
    env = VectorEnv(build_site(scenario), [0], VectorEnvConfig(is_synchronous=True))
    for action in (RIGHT, LEFT):
        decisions = env.step(np.array([action]))
    assert decisions.time_s[0] == 10.0
    mission = mission_of(env._batch.missions, 0)
    for time_s, x_m in ((0.0, 175.0), (2.5, 150.0), (5.0, 125.0), (7.5, 125.0), (10.0, 125.0)):
        assert place_at(env.briefing, mission, 1, time_s) == (x_m, 25.0)


def test_a_message_tells_where_its_sender_is_now() -> None:
    flight = Flight(tiny())
    flight.step(RIGHT)
    flight.step(FORWARD)
    message = flight.look().heard[0]
    assert (message.sender, message.x_m, message.y_m, message.time_s) == (0, 50.0, 25.0, 5.0)


def test_both_sides_learn_where_the_other_is() -> None:
    flight = Flight(tiny())
    flight.step(RIGHT)
    flight.step(FORWARD)
    flight.look()
    first, second = (agent.belief for agent in flight.agents)
    assert (second.peer_x_m[0], second.peer_y_m[0], second.peer_s[0]) == (50.0, 25.0, 5.0)
    assert (first.peer_x_m[1], first.peer_y_m[1], first.peer_s[1]) == (25.0, 75.0, 5.0)


def test_the_deciding_uav_hears_all_in_contact_and_they_hear_its_updated_map() -> None:
    corners = [uav(5.0), uav(5.0, start=(0, 3)), uav(5.0, start=(3, 0))]
    flight = Flight(tiny(*corners, radio__contact_range_m=300.0))
    south_west = [0, 4, 5]  # cell 1 has data
    south_east = [2, 3, 6, 7]
    assert [message.sender for message in flight.look().heard] == [1, 2]
    assert [flight.known(unit) for unit in range(3)] == [south_west] * 3
    flight.step(RIGHT)
    flight.step(FORWARD)
    assert [flight.known(unit) for unit in range(3)] == [sorted(south_west + south_east)] * 3


def test_maps_travel_one_hop_per_event() -> None:
    # Three UAVs in a row, each in contact with the next one only.
    row = [uav(5.0), uav(5.0, start=(0, 2)), uav(5.0, start=(2, 3))]
    flight = Flight(tiny(*row, radio__contact_range_m=112.0))
    event = flight.look()
    assert [message.sender for message in event.heard] == [1]
    assert flight.known(0) == [0, 4, 5]
    assert flight.known(1) == [0, 4, 5]
    assert flight.known(2) == []
    flight.act(event, FORWARD)
    event = flight.look()
    assert [message.sender for message in event.heard] == [0, 2]
    assert flight.known(2) == flight.known(1) == flight.known(0) == [0, 2, 3, 4, 5, 6, 7]


def test_what_the_deciding_uav_hears_it_passes_on_within_the_event() -> None:
    # At 5 s the second UAV has come into range of the first, which is out of the third one's.
    fleet = [uav(5.0), uav(10.0, start=(0, 3)), uav(5.0, start=(1, 3))]
    flight = Flight(tiny(*fleet, radio__contact_range_m=112.0))
    for action in (RIGHT, LEFT, FORWARD):
        flight.step(action)
    assert flight.known(2) == [2, 3, 6, 7, 11]
    event = flight.look()
    assert (event.uav, event.view.time_s) == (1, 5.0)
    assert [message.sender for message in event.heard] == [0, 2]
    assert set(flight.known(2)) == {0, 4, 5} | {2, 3, 6, 7, 11}


def test_out_of_range_nothing_is_exchanged() -> None:
    scenario = tiny(uav(5.0), uav(5.0, start=(3, 3)), radio__contact_range_m=100.0)
    flight = Flight(scenario)
    assert flight.look().heard == ()
    assert flight.known(1) == []
    assert flight.agents[1].belief.peer_s[0] < 0.0


def test_a_uav_on_its_way_home_still_exchanges() -> None:
    flight = Flight(tiny(uav(5.0, start=(3, 3), home_m=(25.0, 25.0)), uav(10.0)))
    flight.step(HOME)
    flight.step(RIGHT)
    flight.look()
    event = flight.step(RIGHT)
    assert event.uav == 1
    assert [message.sender for message in event.heard] == [0]
    assert set(flight.known(0)) >= {0, 2, 4, 5, 6}  # what the other one has seen
    assert set(flight.known(1)) >= {11, 14, 15}  # what it had seen itself


def test_a_uav_that_has_landed_is_silent() -> None:
    flight = Flight(tiny(uav(5.0), uav(10.0)))
    flight.step(HOME)  # where it is
    event = flight.step(RIGHT)
    assert event.uav == 1
    assert event.heard == ()
    event = flight.step(RIGHT)
    assert event.heard == ()
    assert flight.known(0) == [0, 4, 5]


def test_a_uav_is_silent_from_the_moment_it_lands() -> None:
    # The second one comes home exactly when the first one decides.
    flight = Flight(tiny(uav(10.0), uav(10.0, home_m=(75.0, 25.0))))
    flight.step(FORWARD)
    flight.step(HOME)
    assert flight.simulation.phase(1, 4.999) == 1
    assert flight.simulation.phase(1, 5.0) == 2
    assert flight.look().heard == ()

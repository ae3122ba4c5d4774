import math

import pytest
from tiny_world import CELL_A, Flight, GAIN, tiny, uav
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOVER, LEFT, RIGHT

# Fading as strong as it gets, so that channels differ.
FADING = {'radio__rician_a1': 0.01, 'radio__rician_a2': 0.0}


def gain_at_a(flight: Flight, way: list[int]) -> float:
    """The channel to sensor 0 that the only UAV sees after a way that ends in cell A."""
    for action in way:
        flight.step(action)
    view = flight.look().view
    assert view.cell == CELL_A
    return view.sensor_gain[0]


def test_a_channel_is_the_same_at_every_look_of_one_visit() -> None:
    flight = Flight(tiny(uav(5.0), **FADING))
    gain = gain_at_a(flight, [RIGHT])
    assert flight.look().view.sensor_gain[0] == gain


def test_a_channel_is_another_at_the_next_visit() -> None:
    flight = Flight(tiny(uav(5.0), **FADING))
    first = gain_at_a(flight, [RIGHT])
    second = gain_at_a(flight, [FORWARD, RIGHT, BACKWARD, LEFT])
    assert first != second


def test_the_visits_of_a_cell_count_not_the_way_there() -> None:
    direct = gain_at_a(Flight(tiny(uav(5.0), **FADING)), [RIGHT])
    around = gain_at_a(Flight(tiny(uav(5.0), **FADING)), [FORWARD, RIGHT, BACKWARD])
    assert direct == around


def test_a_channel_depends_on_mission_and_uav() -> None:
    gains = {
        gain_at_a(Flight(tiny(uav(5.0, start=(0, 1)), **FADING), seed=seed), [])
        for seed in range(5)
    }
    assert len(gains) == 5
    flight = Flight(tiny(uav(5.0, start=(0, 1)), uav(5.0, start=(0, 1)), **FADING))
    first = flight.step(RIGHT).view.sensor_gain[0]
    second = flight.step(RIGHT).view.sensor_gain[0]
    assert first != second


def test_a_channel_does_not_depend_on_what_other_uavs_do() -> None:
    alone = gain_at_a(Flight(tiny(uav(5.0), **FADING)), [RIGHT])
    for others_way in ([FORWARD, FORWARD], [RIGHT, RIGHT], [RIGHT, FORWARD]):
        flight = Flight(tiny(uav(5.0), uav(10.0), **FADING))
        flight.step(RIGHT)
        for action in others_way:
            flight.step(action)
        event = flight.look()
        assert (event.uav, event.view.cell) == (0, CELL_A)
        assert event.view.sensor_gain[0] == alone


def test_a_hover_uses_the_channel_that_its_own_uav_saw() -> None:
    # Both stand over A; the first one looks and flies off, the second one collects.
    start = (0, 1)
    flight = Flight(tiny(uav(5.0, start=start), uav(5.0, start=start), **FADING))
    flight.step(FORWARD)
    event = flight.look()
    assert (event.uav, event.view.cell) == (1, CELL_A)
    cn0_hz = 1e16 * event.view.sensor_gain[0]
    flight.act(event, HOVER)
    duration_s = 1e6 / (0.5e6 * math.log2(1.0 + cn0_hz / 0.5e6))
    assert flight.simulation.events()['duration_s'][-1] == pytest.approx(duration_s, rel=1e-9)


def test_more_antennas_gather_more_power() -> None:
    gains = [
        gain_at_a(Flight(tiny(uav(5.0), radio__n_antennas=antennas)), [RIGHT])
        for antennas in (1, 2, 4)
    ]
    assert gains == pytest.approx([gains[0], 2 * gains[0], 4 * gains[0]], rel=1e-6)


def test_the_estimation_error_is_relative_to_the_large_scale_gain() -> None:
    flight = Flight(tiny(uav(5.0, start=(0, 1)), radio__csi_error_variance=0.01))
    view = flight.look().view
    assert view.sensor_error_gain[0] == pytest.approx(0.01 * view.sensor_gain[0], rel=1e-6)
    flight.act(flight.look(), HOVER)
    # Interference of P alpha sigma^2 beside the noise on 1 MHz (one UAV).
    cn0_hz = 1e16 * view.sensor_gain[0]
    rate = 1e6 * math.log2(1.0 + cn0_hz / (0.01 * cn0_hz + 1e6))
    assert flight.simulation.events()['duration_s'][-1] == pytest.approx(1e6 / rate, rel=1e-6)


def test_fading_does_not_change_the_estimation_error() -> None:
    for seed in range(3):
        scenario = tiny(uav(5.0, start=(0, 1)), radio__csi_error_variance=0.5, **FADING)
        view = Flight(scenario, seed=seed).look().view
        assert view.sensor_error_gain[0] == pytest.approx(0.5 * GAIN, rel=1e-6)
        assert view.sensor_gain[0] != pytest.approx(GAIN, rel=1e-3)

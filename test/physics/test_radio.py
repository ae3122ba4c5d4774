import math

from hypothesis import given, settings
from hypothesis import strategies as st
from interpreted import interpreted
import numpy as np
import pytest
from uav_collect.physics import radio

by_the_same_cases = settings(deadline=None, derandomize=True, database=None)

ALTITUDE_M = 100.0
LOS_A, LOS_B, RICIAN_A1, RICIAN_A2 = 11.95, 0.14, 1.0, 4.39
TX_POWER_W = 0.01  # 10 dBm
NOISE_W_PER_HZ = 1e-18  # -150 dBm per Hz
BANDWIDTH_HZ = 0.5e6

decades = st.floats(-12.0, 12.0)
elevations_rad = st.floats(0.0, math.pi / 2)


def overhead_signal_w() -> float:
    gain = radio.path_gain(ALTITUDE_M, radio.reference_gain(2e9), 2.6)
    return TX_POWER_W * gain


def test_the_reference_gain_at_2_ghz_is_that_of_a_wavelength_of_15_cm() -> None:
    # c / (4 pi f) = 0.149896229 m / 12.5663706 = 0.0119283629 m
    assert radio.reference_gain(2e9) == pytest.approx(0.0119283629**2, rel=1e-8)
    assert radio.reference_gain(4e9) == pytest.approx(radio.reference_gain(2e9) / 4)


def test_the_line_of_sight_is_missing_as_rarely_as_computed_by_hand() -> None:
    # 1 - P = a e / (1 + a e): overhead e = exp(-0.14 (90 - 11.95)), in the corner at 70.53 deg
    corner = radio.elevation_rad(math.hypot(25.0, 25.0), ALTITUDE_M)
    assert math.degrees(corner) == pytest.approx(70.5288, abs=1e-4)
    missing = [
        1.0 - radio.line_of_sight_probability(angle, LOS_A, LOS_B)
        for angle in (math.pi / 2, corner)
    ]
    assert missing == pytest.approx([2.14654e-4, 3.26802e-3], rel=1e-5)


def test_the_rician_factor_takes_radians() -> None:
    corner = radio.elevation_rad(math.hypot(25.0, 25.0), ALTITUDE_M)
    assert radio.rician_factor(0.0, RICIAN_A1, RICIAN_A2) == 1.0
    # exp(4.39 pi / 2) = exp(6.89580), exp(4.39 * 1.230959) = exp(5.40391)
    assert radio.rician_factor(math.pi / 2, RICIAN_A1, RICIAN_A2) == pytest.approx(
        988.11, rel=1e-5
    )
    assert radio.rician_factor(corner, RICIAN_A1, RICIAN_A2) == pytest.approx(222.27, rel=1e-4)


def test_the_path_gain_at_100_m_is_the_reference_gain_times_10_to_the_minus_5_point_2() -> None:
    assert radio.path_gain(100.0, 1.0, 2.6) == pytest.approx(6.30957344e-6)
    assert radio.path_gain(1.0, 1.4e-4, 2.6) == 1.4e-4


@pytest.mark.parametrize(('n_sensors', 'rate_mbps'), [(1, 2.12226), (4, 0.773285), (10, 0.374814)])
def test_overhead_sensors_have_the_rates_computed_by_hand(
    n_sensors: int, rate_mbps: float
) -> None:
    # One sensor: 8.97763e-12 W over 0.5e6 * 1e-18 W is 17.9553; 0.5 log2(18.9553) = 2.12226
    rate_bps = radio.uplink_rate_bps(
        BANDWIDTH_HZ / n_sensors, overhead_signal_w(), 0.0, NOISE_W_PER_HZ
    )
    assert rate_bps * 1e-6 == pytest.approx(rate_mbps, rel=1e-5)


def test_a_channel_error_acts_like_noise() -> None:
    signal_w, noise_w = overhead_signal_w(), BANDWIDTH_HZ * NOISE_W_PER_HZ
    halved = radio.uplink_rate_bps(BANDWIDTH_HZ, signal_w, noise_w, NOISE_W_PER_HZ)
    assert halved == pytest.approx(BANDWIDTH_HZ * math.log2(1.0 + signal_w / (2.0 * noise_w)))


def test_no_bandwidth_means_no_rate_and_little_signal_little() -> None:
    assert radio.uplink_rate_bps(0.0, 1e-12, 0.0, NOISE_W_PER_HZ) == 0.0
    # 1 + 1e-20 is 1 in double precision; the rate is still b * snr / ln 2
    weak = radio.uplink_rate_bps(1e6, 1e-32, 0.0, NOISE_W_PER_HZ)
    assert weak == pytest.approx(1e-14 / math.log(2.0))


def test_with_unlimited_bandwidth_the_rate_reaches_signal_over_noise_density() -> None:
    limit_bps = 1e-12 / NOISE_W_PER_HZ / math.log(2.0)
    assert radio.uplink_rate_bps(1e16, 1e-12, 0.0, NOISE_W_PER_HZ) == pytest.approx(limit_bps)


@by_the_same_cases
@given(decades, decades, decades, st.floats(1e-3, 3.0))
def test_a_rate_grows_with_bandwidth_and_signal_and_falls_with_error(
    bandwidth: float, signal: float, error: float, step: float
) -> None:
    def rate(*exponents: float) -> float:
        return radio.uplink_rate_bps(*(10.0**exponent for exponent in exponents), 1.0)

    here = rate(bandwidth, signal, error)
    slack = 1.0 + 1e-12
    assert 0.0 < here <= rate(bandwidth + step, signal, error) * slack
    assert here <= rate(bandwidth, signal + step, error) * slack
    assert here * slack >= rate(bandwidth, signal, error + step)


@by_the_same_cases
@given(decades, decades, decades, st.floats(1e-3, 3.0))
def test_a_rate_is_concave_in_the_bandwidth(
    bandwidth: float, signal: float, error: float, step: float
) -> None:
    low_hz, high_hz = 10.0**bandwidth, 10.0 ** (bandwidth + step)
    rates = [
        radio.uplink_rate_bps(bandwidth_hz, 10.0**signal, 10.0**error, 1.0)
        for bandwidth_hz in (low_hz, (low_hz + high_hz) / 2.0, high_hz)
    ]
    assert rates[1] * (1.0 + 1e-12) >= (rates[0] + rates[2]) / 2.0


@by_the_same_cases
@given(elevations_rad, elevations_rad, st.floats(0.1, 30.0), st.floats(0.0, 50.0))
def test_a_steeper_link_has_a_line_of_sight_more_often(
    one: float, other: float, los_a: float, los_b: float
) -> None:
    low, high = sorted((one, other))
    probabilities = radio.line_of_sight_probabilities(np.array([low, high]), los_a, los_b)
    assert 0.0 <= probabilities[0] <= probabilities[1] <= 1.0


@by_the_same_cases
@given(elevations_rad, elevations_rad, st.floats(0.0, 10.0), st.floats(0.0, 1e6))
def test_a_steeper_link_fades_less(
    one: float, other: float, rician_a1: float, rician_a2: float
) -> None:
    low, high = sorted((one, other))
    factors = radio.rician_factors(np.array([low, high]), rician_a1, rician_a2)
    assert 0.0 <= factors[0] <= factors[1] < math.inf


def test_arrays_broadcast_to_the_scalar_results() -> None:
    distance_m = np.array([[100.0, 120.0, 300.0]])
    exponent = np.array([[2.0], [2.6]])
    gains = radio.path_gains(distance_m, 1e-4, exponent)
    assert gains.shape == (2, 3)
    assert gains[1, 2] == radio.path_gain(300.0, 1e-4, 2.6)
    assert radio.elevations_rad(np.array([0.0, 100.0]), 100.0) == pytest.approx(
        [math.pi / 2, math.pi / 4]
    )


def draw(seed: int, uav: int, sensor: int, visit: int, **changed: float) -> tuple[float, float]:
    link = {'antennas': 1, 'los': 0.5, 'gain': 2.0, 'nlos': 0.2, 'rician': 3.0} | changed
    return radio.channel_draw(
        seed,
        uav,
        sensor,
        visit,
        int(link['antennas']),
        link['los'],
        link['gain'],
        link['nlos'],
        link['rician'],
    )


def test_a_channel_is_the_same_whenever_it_is_drawn() -> None:
    keys = [(seed, uav, sensor, visit) for seed in (0, 9) for uav in (0, 1) for sensor in (0, 5)
            for visit in (0, 1)]  # fmt: skip
    forwards = [draw(*key) for key in keys]
    assert [draw(*key) for key in reversed(keys)] == forwards[::-1]
    assert len({gain for gain, _ in forwards}) == len(keys)


def test_the_line_of_sight_is_there_as_often_as_its_probability_says() -> None:
    path_gains = np.array([draw(1, 0, sensor, 0, los=0.8)[1] for sensor in range(20_000)])
    assert set(path_gains) == {2.0, 0.4}
    assert abs((path_gains == 2.0).mean() - 0.8) < 4.0 * math.sqrt(0.8 * 0.2 / 20_000)


@pytest.mark.parametrize(('los', 'path_gain'), [(1.0, 2.0), (0.0, 0.4)])
def test_a_certain_line_of_sight_is_never_or_always_missing(los: float, path_gain: float) -> None:
    assert {draw(1, 0, sensor, 0, los=los)[1] for sensor in range(200)} == {path_gain}


@pytest.mark.parametrize('antennas', [1, 4])
@pytest.mark.parametrize('rician', [0.0, 3.0, 988.0])
def test_fading_has_the_mean_and_variance_of_rice(antennas: int, rician: float) -> None:
    drawn = np.array(
        [
            draw(2, 1, sensor, 0, los=1.0, gain=1.0, antennas=antennas, rician=rician)[0]
            for sensor in range(10_000)
        ]
    )
    # Per antenna |g|^2 has mean 1 and variance (2 k + 1) / (k + 1)^2.
    variance = antennas * (2.0 * rician + 1.0) / (rician + 1.0) ** 2
    assert abs(drawn.mean() - antennas) < 4.0 * math.sqrt(variance / len(drawn))
    assert drawn.var() == pytest.approx(variance, rel=0.12)


def test_without_scattering_the_channel_is_the_path_gain_of_each_antenna() -> None:
    gain, path_gain = draw(3, 0, 0, 0, los=1.0, gain=0.5, antennas=3, rician=1e300)
    assert gain == pytest.approx(3 * path_gain)
    assert path_gain == 0.5


def test_more_antennas_keep_the_first_ones_channel() -> None:
    alone, alpha = draw(3, 0, 0, 0, antennas=1)
    together, alpha_together = draw(3, 0, 0, 0, antennas=2)
    assert alpha == alpha_together
    assert together > alone


def bits() -> str:
    lines = []
    for index in range(400):
        angle = radio.elevation_rad(0.37 * index, ALTITUDE_M)
        los = radio.line_of_sight_probability(angle, LOS_A, LOS_B)
        rician = radio.rician_factor(angle, RICIAN_A1, RICIAN_A2)
        away_m = math.hypot(0.37 * index, ALTITUDE_M)
        gain = radio.path_gain(away_m, radio.reference_gain(2e9), 2.0 + index / 300.0)
        drawn, alpha = radio.channel_draw(2**40 + index, 1, index, 2, 3, los, gain, 0.2, rician)
        rate = radio.uplink_rate_bps(1e3 * (index + 1), 0.01 * drawn, 1e-4 * alpha, 1e-18)
        lines.append(' '.join(x.hex() for x in (angle, los, rician, gain, drawn, alpha, rate)))
    return '\n'.join(lines)


def test_interpreted_links_equal_compiled_ones_to_the_bit() -> None:
    assert interpreted(bits) == bits()

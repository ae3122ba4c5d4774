"""How far sensors are heard."""

import math

import pytest
from uav_collect.fields.radio_reach import mean_rate_bps, reach_m
from uav_collect.scenario.load import load

RADIO = load('paper_10x10').radio


def test_right_below_the_mean_rate_is_that_of_the_equation() -> None:
    # At 90 degrees a line of sight is there with 1 / (1 + 11.95 exp(-0.14 (90 - 11.95))), 0.99978.
    gain = 1.4228584e-4 * 100.0**-2.6  # alpha_0 at 2 GHz, 100 m
    snr = 0.01 * gain / (1e-18 * 5e5)  # 10 mW over 0.5 MHz of -150 dBm/Hz
    sight = 1 / (1 + 11.95 * math.exp(-0.14 * (90 - 11.95)))
    rate_bps = 5e5 * (sight * math.log2(1 + snr) + (1 - sight) * math.log2(1 + 0.2 * snr))
    assert mean_rate_bps(RADIO, 100.0, 5e5, 0.0) == pytest.approx(rate_bps, rel=1e-6)


def test_the_mean_rate_falls_with_the_distance() -> None:
    rates_bps = [
        mean_rate_bps(RADIO, 100.0, 5e5, away_m) for away_m in (0.0, 50.0, 100.0, 200.0, 1e3)
    ]
    assert rates_bps == sorted(rates_bps, reverse=True)


@pytest.mark.parametrize('share', [0.25, 0.5, 0.9])
def test_at_its_reach_a_sensor_has_its_share_of_the_rate(share: float) -> None:
    away_m = reach_m(RADIO, 100.0, 5e5, share)
    near_bps = mean_rate_bps(RADIO, 100.0, 5e5, 0.0)
    assert mean_rate_bps(RADIO, 100.0, 5e5, away_m) == pytest.approx(share * near_bps, rel=1e-6)


def test_sensors_reach_farther_the_higher_a_uav_flies_relative_to_what_is_below_it() -> None:
    assert reach_m(RADIO, 150.0, 5e5, 0.5) > reach_m(RADIO, 50.0, 5e5, 0.5)

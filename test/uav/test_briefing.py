"""What UAVs expect of a scenario before they take off."""

from itertools import pairwise
import math

import pytest
from tiny_world import tiny
from uav_collect.missions.rollout import fly
from uav_collect.planning.reach import take_off_lines
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.briefing import brief, mean_hover_s

FAINT = {
    'radio__tx_power_dbm': -50.0,
    'radio__noise_dbm_per_hz': 0.0,
    'radio__carrier_hz': 3e11,
    'radio__path_loss_exponent': 6.0,
}


def faint(**overrides: object) -> Scenario:
    """Sensors known to be there, whose signal is lost in noise: 1 + SNR is 1."""
    return tiny(demand__known_empty='sensors', **FAINT, **overrides)


def test_sensors_that_can_hardly_be_heard_are_expected_to_take_as_long_as_that_takes() -> None:
    scenario = faint(area__altitude_m=10_000.0, demand__data_mbit=[1.0, 1.0])
    # Where noise is all, a rate is cn0 / ln 2, whatever the bandwidth; gain by hand.
    gain = (4 * math.pi * 3e11 / 299792458.0) ** -2 * 10_000.0**-6
    rate_bps = 1e-8 * gain / 1e-3 / math.log(2)
    assert mean_hover_s(scenario, 1.0) == pytest.approx(1e6 / rate_bps, rel=1e-4)
    assert brief(scenario).hover_s == pytest.approx(1.5 * 1e6 / (1.5 * rate_bps), rel=1e-4)


def test_a_fleet_that_hears_nothing_flies_and_comes_home_without_data() -> None:
    site = build_site(faint())
    assert any('reaches about' in line for line in take_off_lines(site))
    [log] = fly(site, [3], 'hert')
    assert log.events['collected_bit'].sum() == 0.0
    assert log.is_over


def test_expected_hovers_have_no_step_where_signals_become_faint() -> None:
    powers_dbm = [-50.0 + step for step in range(16)]  # snr from 1.7e-7 to 5.4e-6
    hovers_s = [
        mean_hover_s(tiny(radio__tx_power_dbm=it, radio__noise_dbm_per_hz=-130.0), 1.0)
        for it in powers_dbm
    ]
    ratios = [weak_s / strong_s for weak_s, strong_s in pairwise(hovers_s)]
    assert ratios == pytest.approx([10**0.1] * 15, rel=1e-5)

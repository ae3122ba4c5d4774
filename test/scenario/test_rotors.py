"""The power of rotors, against the example of its source and limits."""

from dataclasses import replace
import math

import pytest
from uav_collect.scenario.rotors import (
    disc_area_m2,
    hover_tip_speed_mps,
    Rotors,
    solidity_of,
)

# Table I of Zeng, Xu and Zhang 2019.
ZENG = Rotors(
    weight_n=20.0,
    disc_m2=0.503,
    solidity=0.05,
    tip_speed_mps=120.0,
    profile_drag=0.012,
    induced_correction=0.1,
    drag_area_m2=0.0151,
    efficiency=1.0,
    air_density_kgpm3=1.225,
)


def test_the_example_of_the_source_has_its_powers() -> None:
    assert ZENG.blade_profile_power_w == pytest.approx(79.86, abs=0.005)
    assert ZENG.induced_power_w == pytest.approx(88.63, abs=0.005)
    assert ZENG.induced_speed_mps == pytest.approx(4.03, abs=0.005)
    # d_0 = S_FP / (s A) = 0.6 and 1/2 d_0 rho s A, by hand
    assert ZENG.parasite_coefficient == pytest.approx(0.5 * 0.6 * 1.225 * 0.05 * 0.503, rel=1e-3)


def test_the_example_of_the_source_has_its_disc_and_its_solidity() -> None:
    assert disc_area_m2(1, 0.4) == pytest.approx(0.503, abs=0.0005)
    assert solidity_of(blades=4, chord_m=0.0157, radius_m=0.4) == pytest.approx(0.05, abs=5e-5)


def test_rotors_that_share_the_weight_take_the_power_of_each_together() -> None:
    one = replace(ZENG, weight_n=5.0, disc_m2=disc_area_m2(1, 0.2))
    four = replace(ZENG, weight_n=20.0, disc_m2=disc_area_m2(4, 0.2))
    assert four.blade_profile_power_w == pytest.approx(4 * one.blade_profile_power_w)
    assert four.induced_power_w == pytest.approx(4 * one.induced_power_w)
    assert four.induced_speed_mps == pytest.approx(one.induced_speed_mps)


def test_losses_raise_all_powers_and_no_speed() -> None:
    lossy = replace(ZENG, efficiency=0.5)
    assert lossy.blade_profile_power_w == pytest.approx(2 * ZENG.blade_profile_power_w)
    assert lossy.induced_power_w == pytest.approx(2 * ZENG.induced_power_w)
    assert lossy.parasite_coefficient == pytest.approx(2 * ZENG.parasite_coefficient)
    assert lossy.induced_speed_mps == ZENG.induced_speed_mps


def test_blades_at_the_tip_speed_of_hover_carry_the_weight() -> None:
    tip_speed_mps = hover_tip_speed_mps(20.0, 0.503, 0.05, 0.5, 1.225)
    radius_m, steps = math.sqrt(0.503 / math.pi), 10_000
    chord_m = 0.05 * math.pi * radius_m  # of all blades together
    lift_n = 0.0
    for step in range(steps):
        speed_mps = tip_speed_mps * (step + 0.5) / steps
        lift_n += 0.5 * 1.225 * speed_mps**2 * chord_m * 0.5 * radius_m / steps
    assert lift_n == pytest.approx(20.0, rel=1e-6)

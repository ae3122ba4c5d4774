from hypothesis import given, settings
from hypothesis import strategies as st
from interpreted import interpreted
import numpy as np
import pytest
from uav_collect.physics import energy

by_the_same_cases = settings(deadline=None, derandomize=True, database=None)

# Zeng, Xu and Zhang 2019, Table I
ZENG = (79.86, 88.63, 120.0, 4.03, 0.5 * 0.6 * 1.225 * 0.05 * 0.503)

speeds_mps = st.floats(0.01, 100.0)


@pytest.mark.parametrize(
    ('speed_mps', 'power_w'), [(0.0, 168.49), (5.0, 143.613490), (10.0, 126.033687)]
)
def test_power_is_that_computed_by_hand(speed_mps: float, power_w: float) -> None:
    # At 10 m/s: 79.86 * 1.0208333 + 88.63 * sqrt(sqrt(1 + 3.0786325^2) - 3.0786325)
    # + 0.009242625 * 1000 = 81.523750 + 35.267312 + 9.242625
    assert energy.propulsion_power_w(speed_mps, *ZENG) == pytest.approx(power_w, rel=1e-7)


def test_hovering_takes_blade_and_induced_power() -> None:
    assert energy.propulsion_power_w(0.0, *ZENG) == 79.86 + 88.63


def test_at_high_speed_induced_power_falls_with_the_speed_instead_of_vanishing() -> None:
    # sqrt(1 + y^2) - y tends to 1 / (2 y), so the power tends to P_1 v_0 / V
    assert energy.propulsion_power_w(1e6, 0.0, 88.63, 120.0, 4.03, 0.0) == pytest.approx(
        88.63 * 4.03 / 1e6, rel=1e-9
    )


def test_at_high_speed_drag_takes_almost_all_power() -> None:
    assert energy.propulsion_power_w(1e6, *ZENG) == pytest.approx(ZENG[4] * 1e18, rel=1e-5)


@by_the_same_cases
@given(speeds_mps, speeds_mps)
def test_induced_power_falls_and_the_rest_grows_with_speed(one: float, other: float) -> None:
    slow, fast = sorted((one, other))
    blade_w, induced_w, tip_mps, induced_mps, drag = ZENG
    induced = energy.propulsion_powers_w(
        np.array([slow, fast]), 0.0, induced_w, tip_mps, induced_mps, 0.0
    )
    rest = energy.propulsion_powers_w(
        np.array([slow, fast]), blade_w, 0.0, tip_mps, induced_mps, drag
    )
    assert induced[0] * (1.0 + 1e-12) >= induced[1] > 0.0
    assert 0.0 < rest[0] <= rest[1]


def test_arrays_broadcast_to_the_scalar_results() -> None:
    speed_mps = np.array([5.0, 10.0])
    power_w = energy.propulsion_powers_w(speed_mps, np.array([[79.86], [80.0]]), *ZENG[1:])
    assert power_w.shape == (2, 2)
    assert power_w[0, 1] == energy.propulsion_power_w(10.0, *ZENG)


def bits() -> str:
    powers_w = [energy.propulsion_power_w(0.11 * index, *ZENG) for index in range(500)]
    return '\n'.join(map(float.hex, powers_w))


def test_interpreted_power_equals_compiled_power_to_the_bit() -> None:
    assert interpreted(bits) == bits()

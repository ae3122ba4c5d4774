"""Propulsion power of a rotary-wing UAV.

A scalar kernel with a name in the singular; the plural is the same kernel over broadcast arrays.
"""

import math

import numpy as np
from uav_collect.kernels.compile import kernel


@kernel
def propulsion_power_w(
    speed_mps: float,
    blade_profile_power_w: float,
    induced_power_w: float,
    tip_speed_mps: float,
    induced_speed_mps: float,
    parasite_coefficient: float,
) -> float:
    """Power to fly level at a constant speed; at 0 m/s, to hover.

    Args:
        speed_mps: V [m/s], >= 0.
        blade_profile_power_w: P_0 [W].
        induced_power_w: P_1 [W], in hover.
        tip_speed_mps: U_tip [m/s] of the rotor blade, > 0.
        induced_speed_mps: v_0 [m/s], mean induced speed in hover, > 0.
        parasite_coefficient: P_2 [W s^3/m^3].

    Returns:
        Power [W].

    Source: paper eq. (uav_energy_model), after Zeng et al. 2019.
    """
    tip_ratio = speed_mps / tip_speed_mps
    induced_ratio = speed_mps / induced_speed_mps
    half_square = 0.5 * induced_ratio * induced_ratio
    # sqrt(1 + y^2) - y cancels at high speed; 1 / (sqrt(1 + y^2) + y) is the same number.
    inflow = 1.0 / (math.sqrt(1.0 + half_square * half_square) + half_square)
    blade_w = blade_profile_power_w * (1.0 + 3.0 * tip_ratio * tip_ratio)
    induced_w = induced_power_w * math.sqrt(inflow)
    return blade_w + induced_w + parasite_coefficient * speed_mps * speed_mps * speed_mps


propulsion_powers_w = np.vectorize(propulsion_power_w, otypes=[float])

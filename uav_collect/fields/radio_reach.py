"""How far from the point below a UAV a sensor is still heard well: what a cell's size follows."""

import math

from uav_collect.physics.radio import (
    elevation_rad,
    line_of_sight_probability,
    path_gain,
    reference_gain,
    uplink_rate_bps,
)
from uav_collect.scenario.model import RadioConfig

_MOST_M = 1e6  # nobody is heard from farther
_N_HALVINGS = 60  # of the span that a reach is sought in


def mean_rate_bps(
    radio: RadioConfig, altitude_m: float, bandwidth_hz: float, ground_m: float
) -> float:
    """Mean rate of a sensor that has a UAV's bandwidth for itself.

    Args:
        radio: channel between sensors and UAVs.
        altitude_m: of the UAV [m].
        bandwidth_hz: of the UAV [Hz].
        ground_m: from the sensor to the point below the UAV [m].

    Returns:
        Rate [bit/s], averaged over line of sight or none; fading counts by its mean power, so the
        true mean is somewhat lower, everywhere alike.

    Source: paper Sec. III-B.
    """
    sight = line_of_sight_probability(
        elevation_rad(ground_m, altitude_m), radio.los_a, radio.los_b
    )
    gain = path_gain(
        math.hypot(ground_m, altitude_m),
        reference_gain(radio.carrier_hz),
        radio.path_loss_exponent,
    )
    rates_bps = [
        uplink_rate_bps(
            bandwidth_hz,
            radio.tx_power_w * radio.n_antennas * alpha,
            radio.tx_power_w * radio.csi_error_variance * alpha,
            radio.noise_w_per_hz,
        )
        for alpha in (gain, gain * radio.nlos_attenuation)
    ]
    return sight * rates_bps[0] + (1.0 - sight) * rates_bps[1]


def reach_m(
    radio: RadioConfig, altitude_m: float, bandwidth_hz: float, rate_share: float
) -> float:
    """Distance on the ground [m] at which the mean rate is a share of that right below a UAV."""
    wanted_bps = rate_share * mean_rate_bps(radio, altitude_m, bandwidth_hz, 0.0)
    near_m, far_m = 0.0, _MOST_M
    for _ in range(_N_HALVINGS):
        middle_m = (near_m + far_m) / 2
        if mean_rate_bps(radio, altitude_m, bandwidth_hz, middle_m) >= wanted_bps:
            near_m = middle_m
        else:
            far_m = middle_m
    return near_m

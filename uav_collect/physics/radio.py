"""The link between a sensor and a hovering UAV: geometry, large-scale gain, fading, rate.

Every formula is a scalar kernel with a name in the singular; its plural is the same kernel over
broadcast arrays (`path_gain`, `path_gains`). Gains are power gains, linear. Source: the paper's
Sec. III-B; where it is unclear (degrees or radians, what N_0 is per) docs/paper_map.md says how it
was read.
"""

import math

import numpy as np
from uav_collect.kernels import keyed_random
from uav_collect.kernels.compile import kernel

SPEED_OF_LIGHT_MPS = 299792458.0

_DEGREES_PER_RADIAN = 180.0 / math.pi
_EXPONENT_LIMIT = 600.0  # exp() stays finite; both models have long reached their limits there
_ANTENNA_SHIFT = 8  # the stream number has the low byte of the counter word, the antenna the rest


@kernel
def elevation_rad(horizontal_m: float, altitude_m: float) -> float:
    """Angle [rad] under which a sensor sees a UAV that is a ground distance and a height away."""
    return math.atan2(altitude_m, horizontal_m)


@kernel
def line_of_sight_probability(elevation_rad: float, los_a: float, los_b: float) -> float:
    """Probability of a line of sight.

    Args:
        elevation_rad: elevation angle [rad]; the model itself counts in degrees.
        los_a: the paper's a [degrees, and as a pure factor], > 0.
        los_b: the paper's b [1/degree], >= 0.

    Returns:
        Probability, 0..1.

    Source: paper Sec. III-B, P_LoS, after Al-Hourani et al. 2014.
    """
    exponent = -los_b * (elevation_rad * _DEGREES_PER_RADIAN - los_a)
    return 1.0 / (1.0 + los_a * math.exp(min(exponent, _EXPONENT_LIMIT)))


@kernel
def rician_factor(elevation_rad: float, rician_a1: float, rician_a2: float) -> float:
    """Power of the deterministic over the scattered part, A_1 exp(A_2 theta) with theta in rad."""
    return rician_a1 * math.exp(min(rician_a2 * elevation_rad, _EXPONENT_LIMIT))


def reference_gain(carrier_hz: float) -> float:
    """Free-space gain at 1 m, alpha_0 = (4 pi f_c / c)^-2."""
    return (4.0 * math.pi * carrier_hz / SPEED_OF_LIGHT_MPS) ** -2


@kernel
def path_gain(distance_m: float, reference_gain: float, path_loss_exponent: float) -> float:
    """Large-scale gain with a line of sight; without one it is `nlos_attenuation` times this.

    Source: paper eq. (large_fading).
    """
    return reference_gain * math.pow(distance_m, -path_loss_exponent)


@kernel
def channel_draw(
    mission_seed: int,
    uav: int,
    sensor: int,
    visit: int,
    antennas: int,
    los_probability: float,
    path_gain_los: float,
    nlos_attenuation: float,
    rician_factor: float,
) -> tuple[float, float]:
    """The channel of one hover: line of sight or not, and Rician fading on every antenna.

    Args:
        mission_seed: 0..2^63-1.
        uav: index of the UAV.
        sensor: index of the sensor.
        visit: how many times this UAV has drawn this channel before.
        antennas: of the UAV, >= 1.
        los_probability: 0..1.
        path_gain_los: large-scale gain with a line of sight.
        nlos_attenuation: factor on it without one.
        rician_factor: >= 0.

    Returns:
        ||h||^2 after maximum ratio combining, and the large-scale gain alpha alone.

    Source: paper eqs. (channel_model), (large_fading) and the Rician model below them.
    """
    steady = math.sqrt(rician_factor / (rician_factor + 1.0))
    # g_hat is CN(0, 1): its real and its imaginary part have variance 1/2 each.
    scattered = math.sqrt(0.5 / (rician_factor + 1.0))
    alpha = path_gain_los
    fading = 0.0
    for antenna in range(antennas):
        stream = keyed_random.CHANNEL | antenna << _ANTENNA_SHIFT
        word_0, word_1, word_2, _ = keyed_random.draw_words(
            mission_seed, stream, uav, sensor, visit
        )
        if antenna == 0 and word_2 / 4294967296.0 >= los_probability:
            alpha = path_gain_los * nlos_attenuation
        real, imaginary = keyed_random.normal_pair(word_0, word_1)
        in_phase = steady + real * scattered
        quadrature = imaginary * scattered
        fading += in_phase * in_phase + quadrature * quadrature
    return alpha * fading, alpha


@kernel
def log_of_1_plus(r: float) -> float:
    """Natural log of 1 + r, r >= 0, to the last digits."""
    # Where 1 + r keeps the digits of r, log is twice as fast as log1p.
    return math.log(1.0 + r) if r > 1.0 else math.log1p(r)


@kernel
def uplink_rate_bps(
    bandwidth_hz: float, signal_w: float, error_w: float, noise_w_per_hz: float
) -> float:
    """Shannon rate of one sensor on its bandwidth share.

    Args:
        bandwidth_hz: the sensor's share [Hz], >= 0.
        signal_w: received power P_s ||h||^2 [W] by the channel as the UAV knows it.
        error_w: power P_s alpha sigma_e^2 [W] of the channel estimation error, which acts like
            noise; 0 is perfect CSI.
        noise_w_per_hz: N_0 [W/Hz], > 0.

    Returns:
        Rate [bit/s]; 0 where the share is 0.

    Source: paper eqs. (data_rate) and (data_rate_imp_csi).
    """
    if bandwidth_hz == 0.0:
        return 0.0
    snr = signal_w / (error_w + bandwidth_hz * noise_w_per_hz)
    return bandwidth_hz * (log_of_1_plus(snr) / math.log(2.0))


elevations_rad = np.vectorize(elevation_rad, otypes=[float])
line_of_sight_probabilities = np.vectorize(line_of_sight_probability, otypes=[float])
rician_factors = np.vectorize(rician_factor, otypes=[float])
path_gains = np.vectorize(path_gain, otypes=[float])

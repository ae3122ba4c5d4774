"""How a hovering UAV divides its bandwidth among the sensors of the cell: the kernels.

The problem (paper eq. prob:bandwidth): shares b that sum to at most B and minimise the hover time,
the longest upload. Scaled by B for bandwidth and N_0 B for power, the unknowns are x = b / B and
u = 1 / hover time; a sensor is served in time when f(x) >= c u with

    f = x log1p(s / (e + x)),   s = S / (N_0 B),   e = E / (N_0 B),   c = D ln 2 / B.

f is concave, so its tangents at any shares lie above it: the u that they allow bounds the best u
from above, and the shares themselves bound it from below. So every allocation carries a
certificate, its gap: its hover time is at most (1 + gap) times the shortest possible one.

A row is one hover: sensors 0..n-1 of sequences that may be longer. Demand 0 gets no bandwidth. A
sensor with demand and no signal cannot be served: hover_s is inf with any shares, gap 0. For many
hovers as arrays there is `allocation`.
"""

import math

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import allocating_kernel, kernel
from uav_collect.physics.radio import log_of_1_plus, uplink_rate_bps

# How bandwidth is shared; cvxpy is no kernel, agents call it by themselves.
EXACT = 0
EQUAL = 1

_ROUNDING = 1e-12
_GAP_WANTED = 1e-12
_MAX_ITERATIONS = 60  # 28 is the most seen, with numbers spread over 60 orders of magnitude
_SMALLEST_STEP = 0.05  # a share shrinks at most to this part of itself in one iteration
_SERIES_BELOW = 0.03  # signal to noise ratio under which log1p(r) - r / (1 + r) loses digits
_LOG_2 = math.log(2.0)


@kernel
def hover_time_s(
    signal_w: Row[float],
    error_w: Row[float],
    demand_bit: Row[float],
    share_hz: Row[float],
    n: int,
    noise_w_per_hz: float,
) -> float:
    """Time until the last of n sensors has sent its demand on its share.

    Args:
        signal_w: received power [W] of each sensor, P_s ||h||^2.
        error_w: power [W] of its channel estimation error, 0 for perfect CSI.
        demand_bit: data [bit] it has to send.
        share_hz: its bandwidth [Hz].
        n: sensors.
        noise_w_per_hz: N_0 [W/Hz].

    Returns:
        Hover time [s]; 0 without demand, inf where a sensor with demand has no rate.

    Source: paper eq. (hovering_time).
    """
    longest_s = 0.0
    for i in range(n):
        if demand_bit[i] > 0.0:
            rate_bps = uplink_rate_bps(share_hz[i], signal_w[i], error_w[i], noise_w_per_hz)
            if not rate_bps > 0.0:  # also when it is not a number
                return math.inf
            longest_s = max(longest_s, demand_bit[i] / rate_bps)
    return longest_s


@kernel
def share_bandwidth(
    allocator: int,
    signal_w: Row[float],
    error_w: Row[float],
    demand_bit: Row[float],
    n: int,
    bandwidth_hz: float,
    noise_w_per_hz: float,
    share_hz: Row[float],
) -> tuple[float, float]:
    """Share by the allocator EXACT or EQUAL; the rest as for `share_equal`."""
    if allocator == EQUAL:
        return share_equal(
            signal_w, error_w, demand_bit, n, bandwidth_hz, noise_w_per_hz, share_hz
        )
    return share_exact(signal_w, error_w, demand_bit, n, bandwidth_hz, noise_w_per_hz, share_hz)


@kernel
def share_equal(
    signal_w: Row[float],
    error_w: Row[float],
    demand_bit: Row[float],
    n: int,
    bandwidth_hz: float,
    noise_w_per_hz: float,
    share_hz: Row[float],
) -> tuple[float, float]:
    """Give every sensor with demand the same share.

    Args:
        signal_w: received power [W] of each sensor, P_s ||h||^2, >= 0.
        error_w: power [W] of its channel estimation error, >= 0; 0 is perfect CSI.
        demand_bit: data [bit] it has to send, >= 0.
        n: sensors.
        bandwidth_hz: B [Hz], > 0.
        noise_w_per_hz: N_0 [W/Hz], > 0.
        share_hz: overwritten with the shares [Hz].

    Returns:
        Hover time [s], and its certified gap.
    """
    n_active, audible = _split_equally(signal_w, demand_bit, n, bandwidth_hz, share_hz)
    if n_active == 0:
        return 0.0, 0.0
    if not audible:
        return math.inf, 0.0
    hover_s = hover_time_s(signal_w, error_w, demand_bit, share_hz, n, noise_w_per_hz)
    return hover_s, certified_gap(
        signal_w, error_w, demand_bit, share_hz, n, bandwidth_hz, noise_w_per_hz, hover_s
    )


@kernel
def share_exact(
    signal_w: Row[float],
    error_w: Row[float],
    demand_bit: Row[float],
    n: int,
    bandwidth_hz: float,
    noise_w_per_hz: float,
    share_hz: Row[float],
) -> tuple[float, float]:
    """Find the shares of the shortest hover, by Newton's method on all x and u together.

    Arguments and result as for `share_equal`, than which it is never slower. The gap is at most
    1e-12 but for rounding; the shares sum to the bandwidth but for rounding.

    Source: paper eq. (prob:bandwidth), Sec. VI.
    """
    n_active, audible = _split_equally(signal_w, demand_bit, n, 1.0, share_hz)
    if n_active < 2 or not audible:
        return share_equal(
            signal_w, error_w, demand_bit, n, bandwidth_hz, noise_w_per_hz, share_hz
        )
    upper, found, equal = _solve(
        signal_w, error_w, demand_bit, n, bandwidth_hz, noise_w_per_hz, share_hz
    )
    if found > equal * (1.0 + _ROUNDING):
        for i in range(n):
            share_hz[i] = share_hz[i] * bandwidth_hz
    else:  # equal sensors: rounding must not make this slower than the equal split
        _split_equally(signal_w, demand_bit, n, bandwidth_hz, share_hz)
    hover_s = hover_time_s(signal_w, error_w, demand_bit, share_hz, n, noise_w_per_hz)
    gap = upper * hover_s - 1.0
    return hover_s, 0.0 if gap < 0.0 else gap


@kernel
def _split_equally(
    signal_w: Row[float],
    demand_bit: Row[float],
    n: int,
    bandwidth_hz: float,
    share_hz: Row[float],
) -> tuple[int, bool]:
    # Sensors with demand, and whether all of them can be heard.
    n_active = 0
    audible = True
    for i in range(n):
        if demand_bit[i] > 0.0:
            n_active += 1
            audible = audible and signal_w[i] > 0.0
    for i in range(n):
        share_hz[i] = bandwidth_hz / n_active if demand_bit[i] > 0.0 else 0.0
    return n_active, audible


@kernel
def certified_gap(
    signal_w: Row[float],
    error_w: Row[float],
    demand_bit: Row[float],
    share_hz: Row[float],
    n: int,
    bandwidth_hz: float,
    noise_w_per_hz: float,
    hover_s: float,
) -> float:
    """By which part a hover time may exceed the shortest possible one, at most.

    The tangents at `share_hz` prove it, whoever chose these shares; the bound is tight at the
    best shares and loose far from them. Arguments as for `hover_time_s`, and that time.
    """
    if hover_s == 0.0 or hover_s == math.inf:
        return 0.0 if hover_s == 0.0 else hover_s
    per_watt = 1.0 / (noise_w_per_hz * bandwidth_hz)
    cost = 0.0
    used = 0.0
    weighted = 0.0
    for i in range(n):
        if demand_bit[i] > 0.0:
            x = share_hz[i] / bandwidth_hz
            c = demand_bit[i] * _LOG_2 / bandwidth_hz
            a, v = _tangent(x, signal_w[i] * per_watt, error_w[i] * per_watt, c)
            cost += a
            used += x
            weighted += a * v
    gap = (weighted + (1.0 - used)) / cost * hover_s - 1.0
    return 0.0 if gap < 0.0 else gap


@kernel
def _tangent(x: float, s: float, e: float, c: float) -> tuple[float, float]:
    # At share x: c / f', what one more u costs in bandwidth, and f / c, the u it has.
    level = e + x
    r = s / level
    q = r / (1.0 + r)
    log = log_of_1_plus(r)
    if r > _SERIES_BELOW:
        bend = log - q
    else:  # log1p(r) = -log(1 - q) = q + q^2/2 + q^3/3 ...
        tail = 1 / 7 + q * (1 / 8 + q * (1 / 9 + q * (1 / 10 + q * (1 / 11 + q / 12))))
        bend = q * q * (1 / 2 + q * (1 / 3 + q * (1 / 4 + q * (1 / 5 + q * (1 / 6 + q * tail)))))
    return c / (bend + e / level * q), x * log / c


@allocating_kernel
def _solve(
    signal_w: Row[float],
    error_w: Row[float],
    demand_bit: Row[float],
    n: int,
    bandwidth_hz: float,
    noise_w_per_hz: float,
    x: Row[float],
) -> tuple[float, float, float]:
    """Find the shares of the largest u, by Newton's method from equal ones.

    Args:
        signal_w: received power [W] of each sensor; > 0 where it has demand.
        error_w: power [W] of its channel estimation error.
        demand_bit: data [bit] it has to send.
        n: sensors, two or more of them with demand.
        bandwidth_hz: B [Hz].
        noise_w_per_hz: N_0 [W/Hz].
        x: equal shares of 1 where there is demand, 0 elsewhere; overwritten with the best ones.

    Returns:
        u [1/s]: its bound from above, that of the shares found, that of the equal shares.

    Source: paper eq. (prob:bandwidth), Sec. VI.
    """
    tangents = [0.0] * (2 * n)
    upper, equal, slack = _survey(
        signal_w, error_w, demand_bit, n, bandwidth_hz, noise_w_per_hz, x, tangents
    )
    lower = equal
    _balance(demand_bit, n, x, tangents)
    for _ in range(_MAX_ITERATIONS):
        upper, lower, slack = _survey(
            signal_w, error_w, demand_bit, n, bandwidth_hz, noise_w_per_hz, x, tangents
        )
        if upper - lower <= _GAP_WANTED * lower:
            break
        _newton_step(demand_bit, n, x, tangents, upper, slack)
    return upper, lower, equal


@allocating_kernel
def _survey(
    signal_w: Row[float],
    error_w: Row[float],
    demand_bit: Row[float],
    n: int,
    bandwidth_hz: float,
    noise_w_per_hz: float,
    x: Row[float],
    tangents: Row[float],
) -> tuple[float, float, int]:
    # Bounds of the best u at shares x, and the sensor whose share matters least to its rate.
    per_watt = 1.0 / (noise_w_per_hz * bandwidth_hz)
    per_bit = _LOG_2 / bandwidth_hz
    cost = 0.0
    used = 0.0
    weighted = 0.0
    slowest = math.inf
    flattest = 0.0
    slack = 0
    for i in range(n):
        if demand_bit[i] > 0.0:
            a, v = _tangent(
                x[i], signal_w[i] * per_watt, error_w[i] * per_watt, demand_bit[i] * per_bit
            )
            tangents[i] = a
            tangents[n + i] = v
            cost += a
            used += x[i]
            weighted += a * v
            slowest = min(slowest, v)
            if a > flattest:
                flattest = a
                slack = i
    return (weighted + (1.0 - used)) / cost, slowest / max(1.0, used), slack


@allocating_kernel
def _balance(demand_bit: Row[float], n: int, x: Row[float], tangents: Row[float]) -> None:
    # Shares by demand over spectral efficiency: from here Newton needs fewer iterations.
    total = 0.0
    for i in range(n):
        if demand_bit[i] > 0.0:
            x[i] = x[i] / tangents[n + i]
            total += x[i]
    for i in range(n):
        x[i] = x[i] / total


@allocating_kernel
def _newton_step(
    demand_bit: Row[float], n: int, x: Row[float], tangents: Row[float], u: float, slack: int
) -> None:
    # All tangents meet c u where the shares sum to 1. The slack sensor takes what the others
    # leave instead of its own step: the same number, without its rounding error, which grows
    # with c / f'.
    left = 1.0
    for i in range(n):
        if i != slack and demand_bit[i] > 0.0:
            step = tangents[i] * (u - tangents[n + i])
            x[i] = min(max(x[i] + step, _SMALLEST_STEP * x[i]), 1.0)
            left -= x[i]
    x[slack] = max(left, _SMALLEST_STEP * x[slack])

"""How a hovering UAV divides its bandwidth among the sensors of the cell.

The problem (paper eq. prob:bandwidth): shares that sum to at most B and minimise the hover time,
the longest upload. Every allocation carries a certificate, its gap: its hover time is at most
(1 + gap) times the shortest possible one (`bandwidth_newton` says how that is known).

A row is one hover: sensors 0..n-1 of sequences that may be longer. Demand 0 gets no bandwidth. A
sensor with demand and no signal cannot be served: hover_s is inf with any shares, gap 0.
"""

from dataclasses import dataclass
import math
from typing import cast

import numpy as np
from uav_collect.errors import AllocationError
from uav_collect.kernels.arrays import Bools, check_shape, Floats, new_row, Row
from uav_collect.kernels.compile import kernel, kernels_are_compiled
from uav_collect.physics.bandwidth_newton import certified_gap, solve
from uav_collect.physics.radio import uplink_rate_bps

# What `share_bandwidth` is told; cvxpy is there for batches only.
EXACT = 0
EQUAL = 1

_ROUNDING = 1e-12
# Scaled numbers beyond these would leave the range of doubles on the way.
_TINY, _HUGE = 1e-100, 1e100


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
    upper, found, equal = solve(
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
def _share_rows(
    allocator: int,
    signal_w: Row[Row[float]],
    error_w: Row[Row[float]],
    demand_bit: Row[Row[float]],
    size: tuple[int, int],
    bandwidth_hz: float,
    noise_w_per_hz: float,
    share_hz: Row[Row[float]],
    hover_s: Row[float],
    gap: Row[float],
) -> None:
    for m in range(size[0]):
        hover_s[m], gap[m] = share_bandwidth(
            allocator,
            signal_w[m],
            error_w[m],
            demand_bit[m],
            size[1],
            bandwidth_hz,
            noise_w_per_hz,
            share_hz[m],
        )


@dataclass(frozen=True, kw_only=True)
class Allocation:
    """Bandwidth for M hovers over at most S sensors each."""

    share_hz: Floats  # (M, S), 0 without demand
    hover_s: Floats  # (M,), inf where a sensor with demand has no signal
    gap: Floats  # (M,), hover_s <= (1 + gap) * shortest possible


def check_hovers(
    signal_w: Floats,
    error_w: Floats,
    demand_bit: Floats,
    bandwidth_hz: float,
    noise_w_per_hz: float,
) -> None:
    """Raise unless an allocator may work with these; arguments as for `allocate_exact`."""
    for name, value, unit in (
        ('bandwidth_hz', bandwidth_hz, 'Hz'),
        ('noise_w_per_hz', noise_w_per_hz, 'W/Hz'),
    ):
        if not 0.0 < value < math.inf:
            raise AllocationError(f'{name} must be finite and > 0 {unit}, got {value:g} {unit}')
    if signal_w.ndim != 2:
        raise ValueError(f'signal_w must have shape (hovers, sensors), got {signal_w.shape}')
    check_shape(error_w, signal_w.shape, 'error_w')
    check_shape(demand_bit, signal_w.shape, 'demand_bit')
    noise_w = noise_w_per_hz * bandwidth_hz
    _check_range('signal_w', signal_w, 'W', noise_w, 'the noise on all the bandwidth')
    _check_range('error_w', error_w, 'W', noise_w, 'the noise on all the bandwidth')
    _check_range('demand_bit', demand_bit, 'bit', bandwidth_hz, 'the bandwidth')


def _check_range(name: str, values: Floats, unit: str, scale: float, scale_name: str) -> None:
    bad = ~((values >= 0.0) & (values < math.inf))
    if bad.any():
        raise AllocationError(
            f'{name} must be finite and >= 0 {unit}, got {_first(values, bad, unit)}'
        )
    bad = (values > 0.0) & ((values < _TINY * scale) | (values > _HUGE * scale))
    if bad.any():
        raise AllocationError(
            f'{name} must be 0 or within {_TINY:g}..{_HUGE:g} times {scale_name}, '
            f'got {_first(values, bad, unit)}'
        )


def _first(values: Floats, bad: Bools, unit: str) -> str:
    hover, sensor = np.argwhere(bad)[0]
    return f'{values[hover, sensor]:g} {unit} for sensor {sensor} of hover {hover}'


def _allocate(
    allocator: int,
    signal_w: Floats,
    error_w: Floats,
    demand_bit: Floats,
    bandwidth_hz: float,
    noise_w_per_hz: float,
) -> Allocation:
    check_hovers(signal_w, error_w, demand_bit, bandwidth_hz, noise_w_per_hz)
    n_hovers, n_sensors = signal_w.shape
    tables = [_table(values) for values in (signal_w, error_w, demand_bit)]
    share_hz = _table(np.zeros(signal_w.shape))
    hover_s, gap = new_row(n_hovers, 0.0), new_row(n_hovers, 0.0)
    _share_rows(
        allocator,
        tables[0],
        tables[1],
        tables[2],
        (n_hovers, n_sensors),
        float(bandwidth_hz),
        float(noise_w_per_hz),
        share_hz,
        hover_s,
        gap,
    )
    return Allocation(
        share_hz=np.array(share_hz).reshape(signal_w.shape),
        hover_s=np.array(hover_s),
        gap=np.array(gap),
    )


def _table(values: Floats) -> Row[Row[float]]:
    # Interpreted kernels want lists: numpy's scalars are slow, and warn where floats do not.
    table = np.ascontiguousarray(values, dtype=np.float64)
    return cast(Row[Row[float]], table if kernels_are_compiled() else table.tolist())


def allocate_exact(
    signal_w: Floats,
    error_w: Floats,
    demand_bit: Floats,
    bandwidth_hz: float,
    noise_w_per_hz: float,
) -> Allocation:
    """Find the shares of the shortest hovers.

    Args:
        signal_w: received power P_s ||h||^2 [W], shape (M, S), >= 0.
        error_w: power P_s alpha sigma_e^2 [W] of the channel estimation error, shape (M, S),
            >= 0; 0 is perfect CSI.
        demand_bit: data to send [bit], shape (M, S), >= 0.
        bandwidth_hz: B [Hz], > 0.
        noise_w_per_hz: N_0 [W/Hz], > 0.

    Returns:
        Shares, hover times and certified gaps.

    Raises:
        AllocationError: a number is out of its range or not a number.
        ValueError: the shapes differ.

    Source: paper eq. (prob:bandwidth), Sec. VI.
    """
    return _allocate(EXACT, signal_w, error_w, demand_bit, bandwidth_hz, noise_w_per_hz)


def allocate_equal(
    signal_w: Floats,
    error_w: Floats,
    demand_bit: Floats,
    bandwidth_hz: float,
    noise_w_per_hz: float,
) -> Allocation:
    """Give every sensor with demand the same share; otherwise as `allocate_exact`."""
    return _allocate(EQUAL, signal_w, error_w, demand_bit, bandwidth_hz, noise_w_per_hz)


def allocate_cvxpy(
    signal_w: Floats,
    error_w: Floats,
    demand_bit: Floats,
    bandwidth_hz: float,
    noise_w_per_hz: float,
) -> Allocation:
    """Solve the problem by cvxpy and Clarabel, slowly; otherwise as `allocate_exact`.

    For users who want another problem: it is written down in `bandwidth_reference`.
    """
    from uav_collect.physics import bandwidth_convex

    return bandwidth_convex.allocate(signal_w, error_w, demand_bit, bandwidth_hz, noise_w_per_hz)

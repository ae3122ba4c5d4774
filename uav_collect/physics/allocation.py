"""Bandwidth for many hovers at once, as arrays whose numbers are checked."""

from dataclasses import dataclass
import math
from typing import cast

import numpy as np
from uav_collect.errors import AllocationError
from uav_collect.kernels.arrays import Bools, check_shape, Floats, new_row, Row
from uav_collect.kernels.compile import kernel, kernels_are_compiled
from uav_collect.physics.bandwidth import EQUAL, EXACT, share_bandwidth

# Scaled numbers beyond these would leave the range of doubles on the way.
_TINY, _HUGE = 1e-100, 1e100


@dataclass(frozen=True, kw_only=True)
class Allocation:
    """Bandwidth for M hovers over at most S sensors each."""

    share_hz: Floats  # (M, S), 0 without demand
    hover_s: Floats  # (M,), inf where a sensor with demand has no signal
    gap: Floats  # (M,), hover_s <= (1 + gap) * shortest possible


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

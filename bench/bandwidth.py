"""Measures the bandwidth allocators on the paper's links, CPU time per hover.

python bench/bandwidth.py
"""

import json
import os
import subprocess
import sys
import time
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from uav_collect.kernels.arrays import Floats
from uav_collect.physics.allocation import allocate_exact
from uav_collect.physics.radio import (
    channel_draw,
    elevations_rad,
    line_of_sight_probabilities,
    path_gains,
    reference_gain,
    rician_factors,
)

SENSORS = (1, 10, 30)
CSI_ERRORS = (0.0, 0.01)
BANDWIDTH_HZ = 0.5e6
NOISE_W_PER_HZ = 1e-18
TX_POWER_W = 0.01
N_COMPILED, N_INTERPRETED, N_SOLVED = 2_000, 50, 15
REPEATS = 15


class Hovers(NamedTuple):
    """Hovers over cells of the paper; fields of shape (M, S)."""

    signal_w: Floats
    error_w: Floats
    demand_bit: Floats


class Row(NamedTuple):
    """CPU time per hover [us] and the largest relative error of hover times."""

    n_sensors: int
    csi_error: float
    cvxpy_new_us: float
    cvxpy_kept_us: float
    clarabel_us: float
    compiled_us: float
    interpreted_us: float
    error: float


def draw_hovers(n_hovers: int, n_sensors: int, csi_error: float) -> Hovers:
    """Hovers over cells of 50 m from 100 m, with the paper's radio."""
    rng = np.random.default_rng(n_sensors)
    shape = (n_hovers, n_sensors)
    away_m = np.hypot(rng.uniform(-25.0, 25.0, shape), rng.uniform(-25.0, 25.0, shape))
    angle_rad = elevations_rad(away_m, 100.0)
    los = line_of_sight_probabilities(angle_rad, 11.95, 0.14)
    rician = rician_factors(angle_rad, 1.0, 4.39)
    gain = path_gains(np.hypot(away_m, 100.0), reference_gain(2e9), 2.6)
    hover, sensor = np.indices(shape)
    draw = np.vectorize(channel_draw, otypes=[float, float])
    received, alpha = draw(0, 0, sensor, hover, 1, los, gain, 0.2, rician)
    return Hovers(
        signal_w=TX_POWER_W * received,
        error_w=TX_POWER_W * csi_error * alpha,
        demand_bit=rng.uniform(0.1e6, 1e6, shape),
    )


def exact_us(n_hovers: int, n_sensors: int, csi_error: float) -> float:
    """Median CPU time of the exact allocator for one hover of a batch [us]."""
    hovers = draw_hovers(n_hovers, n_sensors, csi_error)
    allocate_exact(*hovers, BANDWIDTH_HZ, NOISE_W_PER_HZ)  # compiles
    times_s = []
    for _ in range(REPEATS):
        start_s = time.process_time()
        allocate_exact(*hovers, BANDWIDTH_HZ, NOISE_W_PER_HZ)
        times_s.append(time.process_time() - start_s)
    return float(np.median(times_s)) / n_hovers * 1e6


def measure_interpreted() -> dict[str, float]:
    """CPU time for each number of sensors and each error, in a process that interprets [us]."""
    environment = os.environ | {'UAV_COLLECT_KERNELS': 'interpreted'}
    command = [sys.executable, __file__, '--interpreted']
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def print_interpreted() -> None:
    """What `measure_interpreted` reads."""
    figures = {
        f'{n_sensors} {csi_error}': exact_us(N_INTERPRETED, n_sensors, csi_error)
        for n_sensors in SENSORS
        for csi_error in CSI_ERRORS
    }
    print(json.dumps(figures))


def measure(n_sensors: int, csi_error: float, interpreted_us: float) -> Row:
    """All methods on the same hovers."""
    from uav_collect.physics import bandwidth_convex as reference  # seconds to import

    hovers = draw_hovers(N_SOLVED, n_sensors, csi_error)
    exact = allocate_exact(*hovers, BANDWIDTH_HZ, NOISE_W_PER_HZ)
    reference.allocate_cvxpy(*hovers, BANDWIDTH_HZ, NOISE_W_PER_HZ)  # compiles
    times_s: list[tuple[float, ...]] = []
    errors = []
    for m in range(N_SOLVED):
        row = (hovers.signal_w[m], hovers.error_w[m], hovers.demand_bit[m])
        scaled = reference.scaled(*row, BANDWIDTH_HZ, NOISE_W_PER_HZ, float(exact.hover_s[m]))
        cones = reference.ConeProgram(*scaled)
        start_s = time.process_time()
        program = reference.build_program(n_sensors, csi_error > 0.0)
        reference.solve_program(program, *scaled)
        new_s = time.process_time()
        reference.solve_program(program, *scaled)
        kept_s = time.process_time()
        cones.solve()
        clarabel_s = time.process_time()
        times_s.append((new_s - start_s, kept_s - new_s, clarabel_s - kept_s))
        best_s = reference.shortest_hover_s(*row, BANDWIDTH_HZ, NOISE_W_PER_HZ)
        errors.append(abs(float(exact.hover_s[m]) / best_s - 1.0))
    new_us, kept_us, clarabel_us = (np.median(times_s, axis=0) * 1e6).tolist()
    return Row(
        n_sensors=n_sensors,
        csi_error=csi_error,
        cvxpy_new_us=new_us,
        cvxpy_kept_us=kept_us,
        clarabel_us=clarabel_us,
        compiled_us=exact_us(N_COMPILED, n_sensors, csi_error),
        interpreted_us=interpreted_us,
        error=max(*errors, float(exact.gap.max())),
    )


def verdict(value: float, bound: float, *, is_upper: bool, form: str) -> str:
    """The value, green where it keeps its bound."""
    kept = value <= bound if is_upper else value >= bound
    return f'[{"green" if kept else "red"}]{value:{form}}[/]'


def table_of(rows: list[Row]) -> Table:
    """Times, ratios and targets."""
    table = Table(
        title='Bandwidth allocation: median CPU time per hover in us',
        caption='targets: exact <= 5 us, Clarabel / exact >= 100, cvxpy / exact >= 1000, '
        'error (against Clarabel at 1e-11) <= 1e-10; kept: compiled once, only its numbers change',
    )
    for heading in (
        'sensors',
        'CSI error',
        'cvxpy',
        'cvxpy kept',
        'Clarabel',
        'exact',
        'interpreted',
        'Clarabel / exact',
        'cvxpy / exact',
        'cvxpy kept / exact',
        'error',
    ):
        table.add_column(heading, justify='right')
    for row in rows:
        us = row.compiled_us
        table.add_row(
            str(row.n_sensors),
            f'{row.csi_error:g}',
            f'{row.cvxpy_new_us:.0f}',
            f'{row.cvxpy_kept_us:.0f}',
            f'{row.clarabel_us:.0f}',
            verdict(us, 5.0, is_upper=True, form='.2f'),
            f'{row.interpreted_us:.1f}',
            verdict(row.clarabel_us / us, 100.0, is_upper=False, form='.0f'),
            verdict(row.cvxpy_new_us / us, 1000.0, is_upper=False, form='.0f'),
            verdict(row.cvxpy_kept_us / us, 1000.0, is_upper=False, form='.0f'),
            verdict(row.error, 1e-10, is_upper=True, form='.0e'),
        )
    return table


def main() -> None:
    """Measure and print."""
    interpreted = measure_interpreted()
    rows = [
        measure(n_sensors, csi_error, interpreted[f'{n_sensors} {csi_error}'])
        for csi_error in CSI_ERRORS
        for n_sensors in SENSORS
    ]
    Console(width=None if sys.stdout.isatty() else 132).print(table_of(rows))


if __name__ == '__main__':
    if sys.argv[1:] == ['--interpreted']:
        print_interpreted()
    else:
        main()

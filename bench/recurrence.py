"""Measures the GRU forward and back on one core, compiled beside operations of torch.

python bench/recurrence.py [--quick]

Both compute the same over packed sequences; the floor is what the products of a large square
matrix leave possible.
"""

from collections.abc import Callable
import sys
import time

import numpy as np
from rich.console import Console
from rich.table import Table
import torch
from torch import nn, Tensor
from uav_collect.learning.learner import keep_freed_memory
from uav_collect.learning.recurrence import CompiledRecurrence, Recurrence

BATCHES = ((4, 250), (16, 95))  # missions, decisions of each; shared by two UAVs
N_UAVS = 2
SHORTEST = 0.8  # of the longest sequence: missions end one by one
HIDDEN_SIZES = (64, 256)
GEMM_SIZE = 2048
# Products with each of the two weights: forward, by what it is fed, by the weight.
N_PRODUCTS = 6
WAYS = {'torch': Recurrence, 'compiled': CompiledRecurrence}


def step_sizes(n_missions: int, n_decisions: int) -> list[int]:
    """How many sequences reach each step."""
    longest = n_decisions // N_UAVS
    lengths = np.linspace(SHORTEST, 1.0, n_missions * N_UAVS) * longest
    return [int((lengths > step).sum()) for step in range(longest)]


def calls_of(sizes: list[int], hidden_size: int) -> dict[str, Callable[[], None]]:
    """Forward and back by each way, with the same inputs and weights."""
    torch.manual_seed(0)
    cell = nn.GRUCell(hidden_size, hidden_size)
    weights = cell.weight_ih, cell.weight_hh, cell.bias_ih, cell.bias_hh
    encoded = torch.randn(sum(sizes), hidden_size).relu_().requires_grad_()
    from_above = torch.randn(sum(sizes), hidden_size)

    def call(way: type[torch.autograd.Function]) -> None:
        hidden: Tensor = way.apply(encoded, *weights, sizes)
        torch.autograd.grad(hidden, (encoded, *weights), from_above)

    square = torch.rand(GEMM_SIZE, GEMM_SIZE)
    return {name: lambda way=way: call(way) for name, way in WAYS.items()} | {
        'product': lambda: square @ square
    }


def median_s(calls: dict[str, Callable[[], None]], n_repeats: int) -> dict[str, float]:
    """The median CPU time of each, called in turn; what the first call compiles is left out."""
    times_s: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(n_repeats + 1):
        for name, call in calls.items():
            start_s = time.process_time()
            call()
            times_s[name].append(time.process_time() - start_s)
    return {name: float(np.median(times[1:])) for name, times in times_s.items()}


def main() -> None:
    """Measure and print."""
    n_repeats = 5 if '--quick' in sys.argv[1:] else 31
    torch.set_num_threads(1)
    keep_freed_memory()
    table = Table(
        title=f'A GRU forward and back over missions of {N_UAVS} UAVs: CPU time in us a decision',
        caption=f'floor: its products at the speed of one of {GEMM_SIZE} x {GEMM_SIZE} numbers',
    )
    for heading in ('missions', 'decisions', 'units', *WAYS, 'torch / compiled', 'floor'):
        table.add_column(heading, justify='right')
    for n_missions, n_decisions in BATCHES:
        for hidden_size in HIDDEN_SIZES:
            sizes = step_sizes(n_missions, n_decisions)
            found = median_s(calls_of(sizes, hidden_size), n_repeats)
            n_flops = 2 * N_PRODUCTS * 3 * hidden_size**2
            floor_s = n_flops / (2 * GEMM_SIZE**3) * found['product']
            table.add_row(
                str(n_missions),
                str(n_decisions),
                str(hidden_size),
                *(f'{found[name] / sum(sizes) * 1e6:.2f}' for name in WAYS),
                f'{found["torch"] / found["compiled"]:.2f}',
                f'{floor_s * 1e6:.2f}',
            )
    Console(width=None if sys.stdout.isatty() else 100).print(table)


if __name__ == '__main__':
    main()

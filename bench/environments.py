"""Measures how fast environments step on paper_10x10: decisions per second of CPU time.

python bench/environments.py
"""

from collections.abc import Callable
from functools import partial
import sys
import time

import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv
import numpy as np
from rich.console import Console
from rich.table import Table
from uav_collect.environments.aec import env
from uav_collect.environments.parallel import parallel_env
from uav_collect.environments.turns import TurnEnv
from uav_collect.environments.worlds import WorldsEnv
from uav_collect.kernels.arrays import Ints

TARGET = 300_000  # decisions per second, of many worlds at once
WORLDS = (1, 64, 256)
N_DECISIONS = 20_000  # of a measurement of many worlds; a tenth of that where Python steps each
REPEATS = 5
ARGUMENTS = {'scenario': 'paper_10x10', 'bandwidth': 'equal', 'max_decisions': 250}


def chosen(mask: Ints, rng: np.random.Generator) -> Ints:
    """A legal action at random, of each row of masks."""
    actions: Ints = (mask * rng.uniform(0.1, 1.0, mask.shape)).argmax(axis=-1)
    return actions


def vector_us(worlds: gymnasium.vector.VectorEnv) -> float:
    """CPU time of a decision of a vector environment; actions are chosen off the clock [us]."""
    rng, spent_s = np.random.default_rng(0), 0.0
    _, infos = worlds.reset(seed=0)
    n_steps = N_DECISIONS // worlds.num_envs
    if isinstance(worlds, SyncVectorEnv) or worlds.num_envs == 1:
        n_steps = max(20, n_steps // 10)
    for _ in range(n_steps):
        actions = chosen(infos['action_mask'], rng)
        start_s = time.process_time()
        *_, infos = worlds.step(actions)
        spent_s += time.process_time() - start_s
    return spent_s / (n_steps * worlds.num_envs) * 1e6


def many_us(n_worlds: int) -> float:
    """Many worlds over arrays [us]."""
    return vector_us(WorldsEnv(num_envs=n_worlds, **ARGUMENTS))


def peer_us(n_worlds: int) -> float:
    """The peer: Gymnasium's own vector environment over as many single ones [us]."""
    single = [partial(TurnEnv, **ARGUMENTS)] * n_worlds
    return vector_us(SyncVectorEnv(single, autoreset_mode=AutoresetMode.SAME_STEP))


def aec_us() -> float:
    """One UAV after the other, as PettingZoo's loop goes [us]."""
    world, rng, spent_s = env(**ARGUMENTS), np.random.default_rng(0), 0.0
    n_left = N_DECISIONS // 10
    while n_left > 0:
        world.reset()
        for agent in world.agent_iter():
            start_s = time.process_time()
            _, _, terminated, truncated, info = world.last()
            spent_s += time.process_time() - start_s
            is_over = terminated or truncated
            action = None if is_over else int(chosen(info['action_mask'], rng))
            start_s = time.process_time()
            world.step(action)
            spent_s += time.process_time() - start_s
            n_left -= not is_over
            if n_left == 0 or (agent not in world.agents and not world.agents):
                break
    return spent_s / (N_DECISIONS // 10) * 1e6


def parallel_us() -> float:
    """All UAVs at the same instants, for a decision of one of them [us]."""
    world, rng, spent_s = parallel_env(**ARGUMENTS), np.random.default_rng(0), 0.0
    n_decisions = 0
    while n_decisions < N_DECISIONS // 10:
        _, infos = world.reset()
        while world.agents:
            actions = {it: int(chosen(info['action_mask'], rng)) for it, info in infos.items()}
            n_decisions += sum(info['decides'] for info in infos.values())
            start_s = time.process_time()
            *_, infos = world.step(actions)
            spent_s += time.process_time() - start_s
    return spent_s / n_decisions * 1e6


def median(measure: Callable[[], float]) -> float:
    """The median of several measurements, after one that compiles."""
    measure()
    return float(np.median([measure() for _ in range(REPEATS)]))


def main() -> None:
    """Measure and print."""
    table = Table(
        title='Environments on paper_10x10 with observations and equal bandwidth, one core',
        caption=f'target: {TARGET:,} decisions/s from 64 worlds on; the peer steps as many single'
        " environments by Gymnasium's SyncVectorEnv",
    )
    for heading in ('environment', 'worlds', 'us a decision', 'decisions/s', 'peer / it'):
        table.add_column(heading, justify='left' if heading == 'environment' else 'right')
    for name, measure in (('AEC', aec_us), ('parallel', parallel_us)):
        us = median(measure)
        table.add_row(name, '1', f'{us:.1f}', f'{1e6 / us:,.0f}', '')
    for n_worlds in WORLDS:
        us, peer = (median(partial(measure, n_worlds)) for measure in (many_us, peer_us))
        per_s = 1e6 / us
        colour = 'green' if n_worlds < 64 or per_s >= TARGET else 'red'
        shown = f'[{colour}]{per_s:,.0f}[/]'
        table.add_row('WorldsEnv', str(n_worlds), f'{us:.2f}', shown, f'{peer / us:.1f}')
    Console(width=None if sys.stdout.isatty() else 100).print(table)


if __name__ == '__main__':
    main()

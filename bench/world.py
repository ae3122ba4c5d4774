"""Measures how fast missions fly in one process: CPU time per decision on paper_10x10.

python bench/world.py
"""

from collections.abc import Callable, Iterator
from functools import partial
import json
import os
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from uav_collect.kernels.arrays import Bools, Ints, new_row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.handle import Handle
from uav_collect.missions.batch_kernels import fly_batch, Settings
from uav_collect.missions.batch_start import new_batch
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.physics.bandwidth import EQUAL
from uav_collect.physics.radio import channel_draw
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.heuristics import Heuristic
from uav_collect.uav.observation import Layout
from uav_collect.world.sensor_field import lay_out, SensorField

WORLDS = (1, 64, 300, 1000)
CAPACITY = 512  # events of a mission that is measured
STEPS = 60
REPEATS = 7
ROLLOUT_TARGET, STEPPING_TARGET = 1_000_000, 150_000  # decisions per second
FLAT = 1.25  # times the cost at 64 worlds
N_DRAWS = 100_000
RULES = (Heuristic.HERT, Heuristic.SWEEP, Heuristic.RANDOM)


class Cost(NamedTuple):
    """CPU time per decision [us]: in the air, and with the take-off of the missions."""

    flying_us: float
    in_all_us: float


def scenario_for(rule: Heuristic) -> Scenario:
    """The paper's; random actions get less energy, or they would fly for hours."""
    budget_kj = 200.0 if rule == Heuristic.RANDOM else 1000.0
    return load('paper_10x10', {'fleet.default.energy_budget_kj': budget_kj})


def fly_once(rule: Heuristic, n_worlds: int) -> Cost:
    """Whole missions in the kernel, logged."""
    site = build_site(scenario_for(rule))
    start_s = time.process_time()
    settings = Settings(rule=int(rule), allocator=EQUAL, is_logged=1)
    batch = new_batch(site, range(n_worlds), settings, CAPACITY)
    off_s = time.process_time()
    if fly_batch(Handle(batch), new_row(n_worlds, NONE)):
        raise RuntimeError(f'a mission has more than {CAPACITY} events')
    end_s = time.process_time()
    us_per_s = 1e6 / sum(batch.n_events)
    return Cost((end_s - off_s) * us_per_s, (end_s - start_s) * us_per_s)


def log_once(n_worlds: int) -> float:
    """HERT's missions as logs in Python, CPU time per decision [us]."""
    site = build_site(scenario_for(Heuristic.HERT))
    start_s = time.process_time()
    logs = fly(site, range(n_worlds), 'hert', 'equal')
    return (time.process_time() - start_s) / sum(len(log.events) for log in logs) * 1e6


def random_actions(legal: Bools, rng: np.random.Generator) -> Ints:
    """A legal action of each mission."""
    chosen: Ints = (legal * rng.uniform(0.1, 1.0, legal.shape)).argmax(axis=1)
    return chosen


def step_once(layout: Layout, n_worlds: int) -> float:
    """Missions stepped from Python by random actions, chosen off the clock [us]."""
    site, rng = build_site(scenario_for(Heuristic.HERT)), np.random.default_rng(0)
    env = VectorEnv(site, range(n_worlds), VectorEnvConfig(layout=layout))
    decisions, spent_s, n_decisions = env.decisions, 0.0, 0
    for _ in range(STEPS):
        actions = random_actions(decisions.legal, rng)
        start_s = time.process_time()
        decisions = env.step(actions)
        spent_s += time.process_time() - start_s
        n_decisions += int((decisions.uav >= 0).sum())
    return spent_s / n_decisions * 1e6


def copy_once(layout: Layout, n_worlds: int) -> float:
    """Copying as many observations as a step hands out, CPU time per decision [us]."""
    site = build_site(scenario_for(Heuristic.HERT))
    env = VectorEnv(site, range(n_worlds), VectorEnvConfig(layout=layout))
    table = env.decisions.observation
    target = np.empty_like(table)
    start_s = time.process_time()
    for _ in range(STEPS):
        np.copyto(target, table)
    return (time.process_time() - start_s) / (STEPS * n_worlds) * 1e6


@kernel
def draw_channels(sensor_field: SensorField, n_draws: int) -> float:
    """Draw channels as hovers do."""
    total = 0.0
    n_sensors = len(sensor_field.path_gain)
    for draw in range(n_draws):
        sensor = draw % n_sensors
        gain, _ = channel_draw(
            0,
            draw & 1,
            sensor,
            draw // n_sensors,
            sensor_field.n_antennas,
            sensor_field.los_probability[sensor],
            sensor_field.path_gain[sensor],
            sensor_field.nlos_attenuation,
            sensor_field.rician_factor[sensor],
        )
        total += gain
    return total


def draw_once() -> float:
    """The channels that a decision of HERT needs, on average, drawn alone [us]."""
    site = build_site(scenario_for(Heuristic.HERT))
    logs = fly(site, range(20), 'hert', 'equal')
    n_served = sum(int(log.events['n_sensors'].sum()) for log in logs)
    start_s = time.process_time()
    draw_channels(lay_out(site), N_DRAWS)
    draw_us = (time.process_time() - start_s) / N_DRAWS * 1e6
    return draw_us * n_served / sum(len(log.events) for log in logs)


def median(measure: Callable[[], float]) -> float:
    """The median of several measurements, after one that compiles."""
    measure()
    return float(np.median([measure() for _ in range(REPEATS)]))


def median_cost(rule: Heuristic, n_worlds: int) -> Cost:
    """The medians of several flights, after one that compiles."""
    fly_once(rule, n_worlds)
    costs = [fly_once(rule, n_worlds) for _ in range(REPEATS)]
    flying_us, in_all_us = np.median(costs, axis=0).tolist()
    return Cost(flying_us, in_all_us)


def in_new_process(flag: str, **environment: str) -> list[float]:
    """What this program prints with a flag, in a process of its own."""
    command = [sys.executable, __file__, flag]
    done = subprocess.run(
        command, env=os.environ | environment, check=True, capture_output=True, text=True
    )
    figures: list[float] = json.loads(done.stdout)
    return figures


def interpreted_us() -> list[float]:
    """The peer: the same sources as plain Python, by rule, then stepped by layout [us]."""
    flown = [fly_once(rule, 3).flying_us for rule in RULES]
    return flown + [step_once(layout, 4) for layout in Layout]


def first_mission_s() -> list[float]:
    """From the imports to the first landing, CPU time [s]."""
    fly_once(Heuristic.HERT, 1)
    return [time.process_time()]


def rate(cost_us: float, target: float) -> str:
    """Decisions per second, green where they reach the target."""
    per_s = 1e6 / cost_us
    return f'[{"green" if per_s >= target else "red"}]{per_s:,.0f}[/]'


def rollout_rows(rule: Heuristic, peer_us: float) -> Iterator[tuple[str, ...]]:
    """Whole missions in the kernel."""
    limit = f'{median(draw_once):.2f}' if rule == Heuristic.HERT else ''
    costs = {n_worlds: median_cost(rule, n_worlds) for n_worlds in WORLDS}
    for n_worlds, (flying_us, in_all_us) in costs.items():
        yield (
            *(rule.label, str(n_worlds), f'{flying_us:.2f}', f'{in_all_us:.2f}'),
            rate(flying_us, ROLLOUT_TARGET if n_worlds > 1 else 0.0),
            flatness(flying_us, costs[64].flying_us) if n_worlds > 1 else '',
            *(f'{peer_us / flying_us:.0f}', limit),
        )


def stepping_rows(layout: Layout, peer_us: float) -> Iterator[tuple[str, ...]]:
    """Missions stepped from Python."""
    costs_us = {n_worlds: median(partial(step_once, layout, n_worlds)) for n_worlds in WORLDS}
    for n_worlds, us in costs_us.items():
        yield (
            *(f'stepped, {layout.label}', str(n_worlds), f'{us:.2f}', ''),
            rate(us, STEPPING_TARGET if n_worlds > 1 else 0.0),
            flatness(us, costs_us[64]) if n_worlds > 1 else '',
            f'{peer_us / us:.0f}',
            f'{median(partial(copy_once, layout, n_worlds)):.2f}',
        )


def rows() -> Iterator[tuple[str, ...]]:
    """One row per way to fly and number of missions."""
    peers_us = in_new_process('--interpreted', UAV_COLLECT_KERNELS='interpreted')
    flown_us, stepped_us = peers_us[: len(RULES)], peers_us[len(RULES) :]
    for rule, peer_us in zip(RULES, flown_us, strict=True):
        yield from rollout_rows(rule, peer_us)
    logs_us = median(partial(log_once, 1000))
    yield 'hert, as logs', '1000', '', f'{logs_us:.2f}', f'{1e6 / logs_us:,.0f}', '', '', ''
    for layout, peer_us in zip(Layout, stepped_us, strict=True):
        yield from stepping_rows(layout, peer_us)


def flatness(cost_us: float, at_64_us: float) -> str:
    """The cost over that at 64 worlds, green where it is as flat as it should be."""
    ratio = cost_us / at_64_us
    return f'[{"green" if ratio <= FLAT else "red"}]{ratio:.2f}[/]'


def main() -> None:
    """Measure and print."""
    table = Table(
        title='Missions on paper_10x10 with equal bandwidth: CPU time per decision in us',
        caption=f'targets: {ROLLOUT_TARGET:,} decisions/s flown in the kernel, '
        f'{STEPPING_TARGET:,} stepped with observations from 64 missions on, cost over that at 64 '
        f'missions <= {FLAT}; peer: the same sources interpreted; limit: drawing the channels, or '
        f'copying the observations, and nothing else',
    )
    for heading in ('flown by', 'missions', 'flying', 'with take-off', 'decisions/s'):
        table.add_column(heading, justify='left' if heading == 'flown by' else 'right')
    for heading in ('over 64', 'peer / flying', 'limit'):
        table.add_column(heading, justify='right')
    for row in rows():
        table.add_row(*row)
    console = Console(width=None if sys.stdout.isatty() else 132)
    console.print(table)
    with tempfile.TemporaryDirectory() as empty:
        compiled_s = in_new_process('--first', XDG_CACHE_HOME=empty)[0]
    again_s = in_new_process('--first')[0]
    console.print(
        f'first mission of a process: {compiled_s:.0f} s of CPU time where kernels are compiled '
        f'(once), {again_s:.1f} s afterwards'
    )


if __name__ == '__main__':
    if sys.argv[1:] == ['--interpreted']:
        print(json.dumps(interpreted_us()))
    elif sys.argv[1:] == ['--first']:
        print(json.dumps(first_mission_s()))
    else:
        main()

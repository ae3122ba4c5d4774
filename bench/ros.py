"""Measures missions over ROS 2, wall-clock time, beside a bare round trip of two processes.

python bench/ros.py [MISSIONS]
"""

from collections.abc import Iterator
from contextlib import contextmanager
import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from uav_collect.commands.ros_processes import Fleet
from uav_collect.kernels.compile import interpret_kernels
from uav_collect.lockstep.seals import KEY_FILE
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.model import Scenario

MISSIONS = 30
N_ROUND_TRIPS = 3_000
N_STARTS = 5
FLEETS = (16, 32)
DEADLINE_S = 120.0
NO_SAMPLES = {'sample_rate_hz': 0.0, 'picture_period_s': 0.0}

RATE_PER_S = 1_500.0
ANSWER_MS = 2.0
AGENT_MB = 85.0
BARE_SHARE = 0.45  # of the round trips per second of two processes that do nothing else
JOIN_S = 15.0  # until the largest fleet flies
N_PAIRS = 5  # of flights without a key and with one, in turn
SEALED_SHARE = 0.9  # of the decisions per second that are left with a key
READY_S = 1.0


class Flight(NamedTuple):
    """What missions in a row took."""

    label: str
    n_missions: int
    rate_per_s: float  # decisions of a mission per second, median
    best_per_s: float
    answer_us: tuple[float, float]  # from publishing an observation to its command, p50 and p99
    agent_us: float  # the agent's own part of that, p50
    world_us: float  # from a command to the next observation, p50
    start_s: float  # from the first process to the first mission
    agent_mb: float  # resident memory of an agent after its missions, the largest
    bag_kb: float  # of a mission in the bag; 0 where nothing is recorded


# Parts that run in processes of their own.


def fly_timed() -> None:
    """Run a world that writes when it asked and was answered to standard output, as JSON."""
    interpret_kernels()
    from uav_collect.nodes.process import run_node
    from uav_collect.nodes.world.node import WorldNode

    asked_s: list[float] = []
    answered_s: list[float] = []
    agent_s: list[float] = []

    class TimedWorld(WorldNode):
        def _request_decision(self, mission: Any, event: Any) -> None:  # noqa: ANN401
            asked_s.append(time.monotonic())
            super()._request_decision(mission, event)

        def _on_command(self, uav: int, msg: Any) -> None:  # noqa: ANN401
            if msg.mission_id:  # no greeting
                answered_s.append(time.monotonic())
                agent_s.append(msg.compute_time_s)
            super()._on_command(uav, msg)

    status = run_node(TimedWorld, sys.argv[2:])
    sys.stdout.write(json.dumps([asked_s, answered_s, agent_s]))
    sys.exit(status)


def echo() -> None:
    """Send back what comes, until a signal."""
    from rclpy.node import Node
    from std_msgs.msg import UInt32
    from uav_collect.nodes.process import ProcessNode, run_node

    class Echo(ProcessNode):
        def __init__(self) -> None:
            Node.__init__(self, 'echo')
            back = self.create_publisher(UInt32, 'back', 10)
            self.create_subscription(UInt32, 'there', back.publish, 10)

    sys.exit(run_node(Echo, sys.argv[2:]))


def ping() -> None:
    """Measure round trips to `echo`; writes them to standard output [s], as JSON."""
    import rclpy
    from std_msgs.msg import UInt32
    from uav_collect.nodes.middleware import use_quick_discovery
    from uav_collect.nodes.process import make_executor

    use_quick_discovery()
    rclpy.init()
    node = rclpy.create_node('ping')
    executor = make_executor()
    executor.add_node(node)
    there = node.create_publisher(UInt32, 'there', 10)
    back: list[int] = []
    node.create_subscription(UInt32, 'back', lambda msg: back.append(msg.data), 10)
    while there.get_subscription_count() == 0 or node.count_publishers('back') == 0:
        executor.spin_once(timeout_sec=0.1)
    trips_s: list[float] = []
    for number in range(N_ROUND_TRIPS):
        start_s = time.perf_counter()
        there.publish(UInt32(data=number))
        while (not back or back[-1] != number) and time.perf_counter() < start_s + 1.0:
            executor.spin_once(timeout_sec=0.1)
        trips_s.append(time.perf_counter() - start_s)
    sys.stdout.write(json.dumps(trips_s[len(trips_s) // 10 :]))
    rclpy.shutdown()


# Measurements.


@contextmanager
def running(*command: str, output: Path | None = None) -> Iterator['subprocess.Popen[bytes]']:
    """A process that is ended with the context."""
    with (output or Path(os.devnull)).open('wb') as sink:
        process = subprocess.Popen(command, stdout=sink, stderr=subprocess.STDOUT)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(DEADLINE_S)


def round_trips_us() -> tuple[float, float]:
    """p50 and p99 of a message of four bytes to another process and back."""
    with running(sys.executable, __file__, '--echo'):
        done = subprocess.run(
            [sys.executable, __file__, '--ping'],
            stdout=subprocess.PIPE,
            check=True,
            timeout=DEADLINE_S,
        )
    p50, p99 = np.percentile(json.loads(done.stdout), [50, 99]) * 1e6
    return float(p50), float(p99)


def ready_s() -> float:
    """Median time from starting an agent until it waits for a world."""
    times_s = []
    for _ in range(N_STARTS):
        with tempfile.TemporaryDirectory() as name:
            fleet = Fleet(Path(name), 1)
            start_s = time.monotonic()
            agent = fleet.start('uav_agent', 'agent', ['--id', '1'])
            while b'waiting for a world_sim' not in agent.log.read_bytes():
                if time.monotonic() > start_s + DEADLINE_S:
                    raise RuntimeError(agent.last_words())
                time.sleep(0.002)
            times_s.append(time.monotonic() - start_s)
            fleet.stop()
    return float(np.median(times_s))


def fly(
    label: str,
    scenario: Scenario,
    policy: str,
    n_missions: int,
    *,
    records: bool = False,
    **parameters: float,
) -> Flight:
    """Fly missions in a row with processes, and with further parameters of the world."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / 'scenario.yaml').write_text(scenario.to_yaml(), encoding='utf-8')
        fleet = Fleet(folder, scenario.n_uavs + 2)
        start_s = time.time()
        try:
            if records:
                options = ['--ros-args', '-p', f'stop_after_missions:={n_missions}']
                arguments = ['--output', str(folder / 'bag'), *options]
                recorder = fleet.start('recorder', 'recorder', arguments, ends_last=True)
            agents = [
                fleet.start('uav_agent', f'uav_{uav}', ['--id', str(uav), '--policy', policy])
                for uav in range(1, scenario.n_uavs + 1)
            ]
            stamps_s = _world(folder, n_missions, parameters | {'recorders': int(records)})
            agent_mb = max(_resident_mb(agent.popen.pid) for agent in agents)
            if records:
                recorder.popen.wait(DEADLINE_S)
        finally:
            fleet.stop()
        bag_kb = sum(file.stat().st_size for file in folder.glob('bag/*.mcap')) / 1e3 / n_missions
        log = (folder / 'world.log').read_text()
        return _flight(label, stamps_s, log, start_s, agent_mb)._replace(bag_kb=bag_kb)


def _world(folder: Path, n_missions: int, parameters: dict[str, float]) -> list[list[float]]:
    values = parameters | {
        'scenario': folder / 'scenario.yaml',
        'missions': n_missions,
        'output_dir': folder / 'run',
    }
    parameters = [word for name in values for word in ('-p', f'{name}:={values[name]}')]
    with (folder / 'world.log').open('wb') as log:
        done = subprocess.run(
            [sys.executable, __file__, '--world', '--ros-args', *parameters],
            stdout=subprocess.PIPE,
            stderr=log,
            check=True,
            timeout=DEADLINE_S,
        )
    stamps_s: list[list[float]] = json.loads(done.stdout)
    return stamps_s


def _flight(
    label: str, stamps_s: list[list[float]], log: str, start_s: float, agent_mb: float
) -> Flight:
    asked_s, answered_s, agent_s = map(np.array, stamps_s)
    starts_s = [float(at) for at in re.findall(r'\[(\d+\.\d+)\].* starts, seed', log)]
    ends = re.findall(r'\[(\d+\.\d+)\].* ended after (\d+) decisions', log)
    rates_per_s = [
        int(n_decisions) / (float(end_s) - begun_s)
        for begun_s, (end_s, n_decisions) in zip(starts_s, ends, strict=True)
    ]
    p50, p99 = np.percentile(answered_s - asked_s, [50, 99]) * 1e6
    between_s = asked_s[1:] - answered_s[:-1]
    return Flight(
        label=label,
        n_missions=len(ends),
        rate_per_s=float(np.median(rates_per_s)),
        best_per_s=max(rates_per_s),
        answer_us=(float(p50), float(p99)),
        agent_us=float(np.median(agent_s)) * 1e6,
        world_us=float(np.median(between_s)) * 1e6,
        start_s=starts_s[0] - start_s,
        agent_mb=agent_mb,
        bag_kb=0.0,
    )


def _resident_mb(pid: int) -> float:
    status = Path(f'/proc/{pid}/status').read_text()
    return int(re.findall(r'VmRSS:\s+(\d+) kB', status)[0]) / 1e3


def sealed_shares(n_missions: int) -> tuple[list[float], list[Flight]]:
    """What is left of the decisions per second with a key, pair by pair, and the last pair."""
    scenario, shares, pair = load('paper_10x10'), [], []
    with tempfile.TemporaryDirectory() as name:
        key_file = Path(name) / 'key'
        key_file.write_bytes(os.urandom(32))
        key_file.chmod(0o600)
        for _ in range(N_PAIRS):
            os.environ.pop(KEY_FILE, None)
            pair = [fly('sweep, no key', scenario, 'sweep', n_missions)]
            os.environ[KEY_FILE] = str(key_file)
            pair.append(fly('sweep, with a key', scenario, 'sweep', n_missions))
            shares.append(pair[1].rate_per_s / pair[0].rate_per_s)
        del os.environ[KEY_FILE]
    return shares, pair


# The tables.


def verdict(value: float, target: float, *, is_upper: bool, form: str) -> str:
    """A figure, coloured by whether it meets its target."""
    is_met = value <= target if is_upper else value >= target
    return f'[{"green" if is_met else "red"}]{value:{form}}[/]'


def flights_table(flights: list[Flight]) -> Table:
    """A row per flight."""
    table = Table(title=f'Missions in lockstep (target {RATE_PER_S:,.0f} decisions/s, two agents)')
    table.add_column('')
    headings = ('missions', 'decisions/s', 'best', 'answer p50 us', 'p99 us', 'of it agent us')
    for heading in (*headings, 'world us', 'start s', 'agent MB', 'bag kB'):
        table.add_column(heading, justify='right')
    for flight in flights:
        p50_us, p99_us = flight.answer_us
        table.add_row(
            flight.label,
            str(flight.n_missions),
            verdict(flight.rate_per_s, RATE_PER_S, is_upper=False, form=',.0f'),
            f'{flight.best_per_s:,.0f}',
            f'{p50_us:,.0f}',
            verdict(p99_us, ANSWER_MS * 1e3, is_upper=True, form=',.0f'),
            f'{flight.agent_us:,.0f}',
            f'{flight.world_us:,.0f}',
            f'{flight.start_s:.2f}',
            verdict(flight.agent_mb, AGENT_MB, is_upper=True, form='.1f'),
            f'{flight.bag_kb:,.0f}' if flight.bag_kb else '',
        )
    return table


def main() -> None:
    """Measure and print."""
    n_missions = int(sys.argv[1]) if len(sys.argv) > 1 else MISSIONS
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    console = Console(width=None if sys.stdout.isatty() else 132)
    two = load('paper_10x10')
    load_before = os.getloadavg()[0]
    trip_us = round_trips_us()
    flights = [
        fly('hert', two, 'hert', n_missions),
        fly('sweep', two, 'sweep', n_missions),
        fly('sweep, no samples', two, 'sweep', n_missions, **NO_SAMPLES),
        fly('sweep, recorded', two, 'sweep', n_missions, records=True),
        fly('the same, no samples', two, 'sweep', n_missions, records=True, **NO_SAMPLES),
    ]
    shares, pair = sealed_shares(n_missions)
    flights += pair
    # More participants than find each other where discovery stays on this machine.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
    for n_uavs in FLEETS:
        many = with_uavs(load('paper_20x20'), n_uavs)
        flights.append(fly(f'{n_uavs} agents, 20 x 20 cells', many, 'sweep', 1))
    console.print(flights_table(flights))
    share = flights[0].rate_per_s * trip_us[0] * 1e-6
    console.print(
        f'bare round trip of two processes: p50 {trip_us[0]:,.0f} us, p99 {trip_us[1]:,.0f} us; '
        f'{flights[0].label} makes {verdict(share, BARE_SHARE, is_upper=False, form=".0%")} of as '
        f'many decisions; {FLEETS[-1]} agents fly after '
        f'{verdict(flights[-1].start_s, JOIN_S, is_upper=True, form=".1f")} s; '
        f'agent ready after {verdict(ready_s(), READY_S, is_upper=True, form=".2f")} s; '
        f'a key leaves {verdict(np.median(shares), SEALED_SHARE, is_upper=False, form=".1%")} of '
        f'the decisions/s, {min(shares):.1%} to {max(shares):.1%} in {N_PAIRS} pairs; '
        f'{os.cpu_count()} cores, load {load_before:.1f} before, {os.getloadavg()[0]:.1f} after'
    )


if __name__ == '__main__':
    match sys.argv[1:2]:
        case ['--world']:
            fly_timed()
        case ['--echo']:
            echo()
        case ['--ping']:
            ping()
        case _:
            main()

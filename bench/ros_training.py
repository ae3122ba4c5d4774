"""Measures learning over ROS 2: what it costs a fleet, how fast it learns, when a policy flies.

python bench/ros_training.py [SECONDS]
"""

from array import array
import csv
import hashlib
import os
from pathlib import Path
import re
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from uav_collect.commands.ros_processes import Fleet, FleetProcess, ros_parameters
from uav_collect.commands.train_fleet import world_names
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.training.config import load_preset
from uav_collect.training.seeds import first_training_seed
from uav_collect.uav.policy_file import load_policy, policy_bytes

SECONDS = 30.0  # of each measurement
WARM_S = 10.0  # before it: caches, the first updates
DEADLINE_S = 900.0
N_SWAPS = 150
LEAST_SHARE = 0.6  # of the decisions per second without a trainer
N_FILLING, N_MORE = 1200, 200  # missions until histories and replay are full, and after that
REPLAY_DECISIONS = 10_000
EAGER = 20  # decisions for each update: more updates than any learner makes
POLICY = Path('config', 'policies', 'paper_10x10_n2_aqmix.safetensors')


class Learned(NamedTuple):
    """What a fleet flew and a trainer learned in the time."""

    decisions_per_s: float
    cpu_ms: float  # of all its processes, for each decision
    updates_per_s: float


def fly(scenario: Scenario, n_worlds: int, seconds: float, per_update: int | None) -> Learned:
    """Fly worlds side by side, by a file or by what a trainer makes of it.

    Args:
        per_update: decisions for each update of the trainer; None: there is no trainer.
    """
    n_processes = n_worlds * (1 + scenario.n_uavs) + 1
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fleet = Fleet(folder, n_processes)
        try:
            processes = _start(fleet, folder, scenario, n_worlds, per_update)
            logs = [*folder.glob('world_sim*.log')]
            _wait(lambda: all(b'after' in log.read_bytes() for log in logs))
            time.sleep(WARM_S)
            begin_s, n_before, cpu_s = time.time(), _n_updates(folder), -_cpu_s(processes)
            time.sleep(seconds)
            end_s, n_after = time.time(), _n_updates(folder)
            cpu_s += _cpu_s(processes)
            fleet.check()
            n_decisions = sum(_n_decisions(log, begin_s, end_s) for log in logs)
        finally:
            fleet.stop()
    taken_s = end_s - begin_s
    return Learned(
        decisions_per_s=n_decisions / taken_s,
        cpu_ms=cpu_s / n_decisions * 1e3,
        updates_per_s=(n_after - n_before) / taken_s,
    )


def _start(
    fleet: Fleet, folder: Path, scenario: Scenario, n_worlds: int, per_update: int | None
) -> list[FleetProcess]:
    started = []
    file, names = folder / 'scenario.yaml', world_names(n_worlds)
    file.write_text(scenario.to_yaml(), encoding='utf-8')
    config = load_preset('strong')
    policy = str(POLICY) if per_update is None else 'topic'
    for number, world in enumerate(names):
        named = ['--world', world] if world else []
        values = ros_parameters(
            scenario=file,
            seed=first_training_seed(0, number, 1),
            missions=-1,
            max_decisions=config.max_decisions(scenario.n_cells),
            viewer_rate_hz=0.0,
        )
        started.append(fleet.start('world_sim', f'world_sim_{world}', [*named, *values]))
        for uav in range(1, scenario.n_uavs + 1):
            flags = ['--id', str(uav), '--policy', policy, '--bandwidth', 'equal']
            started.append(fleet.start('uav_agent', f'uav_{uav}_{world}', [*named, *flags]))
    if per_update is not None:
        values = ros_parameters(
            scenario=file,
            worlds=names,
            output_dir=folder / 'run',
            minutes=60.0,
            start_from=POLICY,
            overrides=['exploration.epsilon_first=0.05'],
            decisions_per_update=per_update,
            replay_decisions=REPLAY_DECISIONS,
        )
        started.append(fleet.start('trainer', 'trainer', values, stop_s=60.0))
    return started


def grown_mb(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Resident memory of each process when all histories are full, and how it grows after that."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fleet = Fleet(folder, scenario.n_uavs + 2)
        try:
            processes = _start(fleet, folder, scenario, 1, EAGER)
            log = folder / 'world_sim_.log'
            _wait(lambda: _n_missions(log) >= N_FILLING)
            full = {it.name.rstrip('_'): _resident_mb(it.popen.pid) for it in processes}
            _wait(lambda: _n_missions(log) >= N_FILLING + N_MORE)
            later = [_resident_mb(it.popen.pid) for it in processes]
        finally:
            fleet.stop()
    return {
        name: (mb, later_mb - mb) for (name, mb), later_mb in zip(full.items(), later, strict=True)
    }


def _cpu_s(processes: list[FleetProcess]) -> float:
    """Processor time that they have had so far."""
    ticks = 0
    for process in processes:
        status = Path(f'/proc/{process.popen.pid}/stat').read_text().rpartition(')')[2].split()
        ticks += int(status[11]) + int(status[12])
    return ticks / os.sysconf('SC_CLK_TCK')


def _n_missions(log: Path) -> int:
    return log.read_bytes().count(b' after ') if log.exists() else 0


def _resident_mb(pid: int) -> float:
    status = Path(f'/proc/{pid}/status').read_text()
    return int(re.findall(r'VmRSS:\s+(\d+) kB', status)[0]) / 1e3


def learn_in_process(scenario: Scenario, seconds: float, per_update: int) -> float:
    """Updates per second of the trainer that flies in its own process."""
    with tempfile.TemporaryDirectory() as name:
        file, run = Path(name, 'scenario.yaml'), Path(name, 'run')
        file.write_text(scenario.to_yaml(), encoding='utf-8')
        command = [
            *(sys.executable, '-m', 'uav_collect', 'train', '--scenario', str(file)),
            *('--start-from', str(POLICY), '--output', str(run)),
            *('--minutes', str((WARM_S + seconds) / 60.0)),
            *('--override', 'exploration.epsilon_first=0.05'),
            f'rollout.decisions_per_update={per_update}',
        ]
        subprocess.run(command, check=True, capture_output=True, timeout=DEADLINE_S)
        with (run / 'progress.csv').open(newline='') as rows:
            looks = [(float(it['wall_s']), int(it['n_updates'])) for it in csv.DictReader(rows)]
    (begin_s, n_before), (end_s, n_after) = next(it for it in looks if it[0] > WARM_S), looks[-1]
    return (n_after - n_before) / (end_s - begin_s)


def _n_decisions(log: Path, begin_s: float, end_s: float) -> int:
    """Decisions of the missions that ended in a time."""
    logged = re.findall(r'\[(\d+\.\d+)\].* after (\d+) decisions', log.read_text())
    return sum(int(number) for at_s, number in logged if begin_s <= float(at_s) < end_s)


def _n_updates(folder: Path) -> int:
    table = folder / 'run' / 'progress.csv'
    if not table.exists():
        return 0
    with table.open(newline='') as rows:
        return max((int(row['n_updates']) for row in csv.DictReader(rows)), default=0)


def swap_ms(scenario: Scenario) -> tuple[list[float], float]:
    """From publishing a policy to the first command of the last agent that flies it.

    Returns:
        Those times, and how long a mission takes [ms].
    """
    import rclpy
    from uav_collect.nodes import topics
    from uav_collect.nodes.middleware import use_quick_discovery
    from uav_collect.nodes.process import make_executor
    from uav_collect.nodes.topics import publisher, subscription
    from uav_collect_msgs.msg import Policy

    use_quick_discovery()
    rclpy.init()
    node = rclpy.create_node('swaps')
    executor = make_executor()
    executor.add_node(node)
    flown: dict[int, str] = {}
    n_missions = [0]

    def hear(uav: int, msg: Any) -> None:  # noqa: ANN401
        flown[uav] = msg.policy_version

    def count(msg: Any) -> None:  # noqa: ANN401
        n_missions[0] += msg.phase == msg.STARTED

    for uav in range(1, scenario.n_uavs + 1):
        subscription(node, topics.uav_topics(uav).command, lambda msg, uav=uav: hear(uav, msg))
    subscription(node, topics.MISSION, count)
    policies = publisher(node, topics.POLICY)
    content = policy_bytes(load_policy(POLICY))
    digest, version = hashlib.sha256(content).hexdigest(), load_policy(POLICY).header.version
    taken_ms = []
    with tempfile.TemporaryDirectory() as name:
        fleet = Fleet(Path(name), scenario.n_uavs + 2)
        try:
            _start_short(fleet, Path(name), scenario)
            for number in range(1, N_SWAPS + 1):
                epsilon = number / 10_000  # stands in the version
                message = Policy(
                    stamp=node.get_clock().now().to_msg(), version=version,
                    trainer_instance='bench', sequence=number, content=array('B', content),
                    sha256=digest, epsilon=epsilon, hover_share=0.6,
                )  # fmt: skip
                start_s = time.perf_counter()
                policies.publish(message)
                wanted = [f'{version} eps {epsilon:g}'] * scenario.n_uavs
                while [*flown.values()] != wanted:
                    executor.spin_once(timeout_sec=0.1)
                    if time.perf_counter() > start_s + DEADLINE_S:
                        raise RuntimeError(f'policy {number} does not fly')
                taken_ms.append((time.perf_counter() - start_s) * 1e3)
                if number == 10:  # all found each other
                    taken_ms.clear()
                    first_s, n_missions[0] = time.perf_counter(), 0
        finally:
            fleet.stop()
            rclpy.try_shutdown()
    return taken_ms, (time.perf_counter() - first_s) / n_missions[0] * 1e3


def _start_short(fleet: Fleet, folder: Path, scenario: Scenario) -> None:
    file = folder / 'scenario.yaml'
    file.write_text(scenario.to_yaml(), encoding='utf-8')
    values = ros_parameters(scenario=file, missions=-1, viewer_rate_hz=0.0)
    fleet.start('world_sim', 'world_sim', values)
    for uav in range(1, scenario.n_uavs + 1):
        fleet.start('uav_agent', f'uav_{uav}', ['--id', str(uav), '--policy', 'topic'])


def _wait(condition: Any) -> None:  # noqa: ANN401
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        if time.monotonic() > end_s:
            raise RuntimeError('the fleet does not fly')
        time.sleep(0.1)


def verdict(value: float, target: float, *, is_upper: bool, form: str) -> str:
    """A figure, coloured by whether it meets its target."""
    is_met = value <= target if is_upper else value >= target
    return f'[{"green" if is_met else "red"}]{value:{form}}[/]'


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    console = Console(width=None if sys.stdout.isatty() else 132)
    scenario, ratio = load('paper_10x10'), load_preset('strong').rollout.decisions_per_update
    table = Table(title=f'Learning over ROS 2, paper_10x10, an update each {ratio} decisions')
    speeds = ('decisions/s without', 'with a trainer', 'share')
    for heading in ('worlds', *speeds, 'CPU ms a decision without', 'with', 'updates/s'):
        table.add_column(heading, justify='right')
    for n_worlds in (1, 2):
        alone, taught = (fly(scenario, n_worlds, seconds, per) for per in (None, ratio))
        share = taught.decisions_per_s / alone.decisions_per_s
        table.add_row(
            str(n_worlds),
            f'{alone.decisions_per_s:,.0f}',
            f'{taught.decisions_per_s:,.0f}',
            verdict(share, LEAST_SHARE, is_upper=False, form='.0%'),
            f'{alone.cpu_ms:.2f}',
            f'{taught.cpu_ms:.2f}',
            f'{taught.updates_per_s:.2f}',
        )
    console.print(table)
    over_ros = fly(scenario, 1, seconds, EAGER).updates_per_s
    here = learn_in_process(scenario, seconds, EAGER)
    short = load('paper_10x10', {'fleet.default.energy_budget_kj': 6.0})
    taken_ms, mission_ms = swap_ms(short)
    p50, p99 = np.percentile(taken_ms, [50, 99])
    grown = grown_mb(short).items()
    memory = ', '.join(
        f'{name} {mb:.0f} MB and {more_mb:+.1f} MB' for name, (mb, more_mb) in grown
    )
    console.print(f'memory after {N_FILLING} missions, and for {N_MORE} more: {memory}')
    console.print(
        f'updates/s as fast as can be: {over_ros:.1f} beside a fleet, {here:.1f} in one process; '
        f'from publishing a policy to all agents flying it: p50 {p50:.0f} ms, p99 {p99:.0f} ms, '
        f'missions of {mission_ms:.0f} ms; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}'
    )


if __name__ == '__main__':
    main()

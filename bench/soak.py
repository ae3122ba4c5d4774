"""Flies for long, and kills agents: what grows, what leaks, which missions are lost.

python bench/soak.py missions [N]    four agents, one killed every 20 missions (1,000)
python bench/soak.py joins [N]       one agent of two killed within 2 s of joining, N times (200)

Every log is held against that of the same mission flown in one process.
"""

from collections.abc import Callable
import os
from pathlib import Path
import random
import re
import signal
import sys
import tempfile
import time

from rich.console import Console
from rich.table import Table
from uav_collect.commands.ros_processes import Fleet, FleetProcess, ros_parameters
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_folder import log_name
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site

N_MISSIONS, N_JOINS = 1_000, 200
KILL_EVERY = 20  # missions
WARM = 200  # missions after which nothing may grow any more
GROWTH_KB = 20.0  # of a process in 100 missions
WITHIN_S = 2.0  # of joining, an agent is killed
PACE = 60.0  # simulated over wall-clock time while agents are killed as they join
JOINED = 'UAV 2: process .* joined'
DEADLINE_S = 120.0  # without any progress

Sample = tuple[float, int]  # resident memory [kB], open files


class Flight:
    """A world and its agents, of which some are killed and started again."""

    def __init__(self, folder: Path, scenario: Scenario, n_missions: int, pace: float) -> None:
        self.folder, self.scenario = folder, scenario
        self.fleet = Fleet(folder, scenario.n_uavs + 1)
        file = folder / 'scenario.yaml'
        file.write_text(scenario.to_yaml(), encoding='utf-8')
        values = {
            'scenario': file,
            'missions': n_missions,
            'output_dir': folder / 'run',
            'real_time_factor': pace,
            'decision_timeout_s': 60.0,
        }
        self.world = self.fleet.start('world_sim', 'world', ros_parameters(**values))
        self.agents = {uav: self.start_agent(uav) for uav in range(1, scenario.n_uavs + 1)}

    def start_agent(self, uav: int) -> FleetProcess:
        """Start the agent of a UAV, for the first time or anew."""
        return self.fleet.start('uav_agent', f'uav_{uav}', ['--id', str(uav)])

    def replace_agent(self, uav: int) -> None:
        """Kill the agent of a UAV, as a crash does, and start another one."""
        self.agents[uav].popen.kill()
        self.agents[uav].popen.wait()
        self.agents[uav] = self.start_agent(uav)

    def count(self, pattern: str) -> int:
        """How often the world has said something."""
        return len(re.findall(pattern, (self.folder / 'world.log').read_text(errors='replace')))

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Wait for something, as long as there is progress."""
        since_s, before = time.monotonic(), -1
        while not condition():
            n_bytes = (self.folder / 'world.log').stat().st_size
            if n_bytes != before:
                since_s, before = time.monotonic(), n_bytes
            if time.monotonic() > since_s + DEADLINE_S:
                raise RuntimeError(f'no progress{self.world.log_tail()}')
            time.sleep(0.01)

    def n_wrong(self, n_missions: int) -> int:
        """Missions that were not flown, or not as they are in one process."""
        expected = fly(build_site(self.scenario), range(n_missions), 'sweep', 'exact')
        files = [self.folder / 'run' / log_name(seed) for seed in range(n_missions)]
        return sum(
            not file.exists() or file.read_bytes() != log.to_jsonl()
            for file, log in zip(files, expected, strict=True)
        )


def sample(process: FleetProcess) -> Sample:
    """What a process holds now."""
    status = Path(f'/proc/{process.popen.pid}/status').read_text()
    [resident_kb] = re.findall(r'VmRSS:\s+(\d+) kB', status)
    return float(resident_kb), len(os.listdir(f'/proc/{process.popen.pid}/fd'))


def soak_missions(n_missions: int, console: Console) -> None:
    """Fly missions in a row and kill an agent now and then."""
    samples: dict[str, list[tuple[int, Sample]]] = {}
    with tempfile.TemporaryDirectory() as name:
        flight = Flight(Path(name), with_uavs(load('paper_8x8'), 4), n_missions, 0.0)
        begun_s, n_killed = time.monotonic(), 0
        try:
            for at in range(KILL_EVERY, n_missions, KILL_EVERY):
                flight.wait_until(lambda at=at: flight.count(' ended after') >= at)
                for who, process in (('world', flight.world), *flight.agents.items()):
                    key = f'{who} {process.popen.pid}'
                    samples.setdefault(key, []).append((at, sample(process)))
                # The first agent lives through it all: what it gathers shows.
                flight.replace_agent(2 + n_killed % 3)
                n_killed += 1
            flight.wait_until(lambda: flight.world.popen.poll() is not None)
            took_s = time.monotonic() - begun_s
            status = flight.world.popen.returncode
        finally:
            flight.fleet.stop()
        n_wrong = flight.n_wrong(n_missions)
    table = Table(title=f'{n_missions} missions, four agents, {n_killed} killed, {took_s:.0f} s')
    for heading in (
        'process',
        'MB first',
        'MB last',
        f'kB per 100 missions after {WARM}',
        'files',
    ):
        table.add_column(heading, justify='right')
    for key, taken in samples.items():
        settled = [it for it in taken if it[0] >= WARM]
        if len(settled) < 5 or len(taken) < len(samples['world ' + str(flight.world.popen.pid)]):
            continue  # it was killed
        (first, (first_kb, first_files)), (last, (last_kb, last_files)) = settled[0], settled[-1]
        growth_kb = (last_kb - first_kb) / (last - first) * 100.0
        colour = 'green' if growth_kb <= GROWTH_KB else 'red'
        table.add_row(
            key.split()[0],
            f'{taken[0][1][0] / 1e3:.1f}',
            f'{last_kb / 1e3:.1f}',
            f'[{colour}]{growth_kb:.1f}[/]',
            f'{last_files - first_files:+d}',
        )
    console.print(table)
    console.print(f'world: exit status {status}; missions lost or otherwise: {n_wrong}')


def soak_joins(n_joins: int, console: Console) -> None:
    """Kill an agent again and again soon after it has joined."""
    draw = random.Random(0)
    with tempfile.TemporaryDirectory() as name:
        flight = Flight(Path(name), load('paper_8x8'), n_joins, PACE)
        begun_s = time.monotonic()
        back_s = []
        try:
            for number in range(1, n_joins + 1):
                asked_s = time.monotonic()
                flight.wait_until(lambda number=number: flight.count(JOINED) >= number)
                back_s.append(time.monotonic() - asked_s)
                time.sleep(draw.uniform(0.0, WITHIN_S))
                if flight.world.popen.poll() is not None:
                    break
                flight.replace_agent(2)
            flight.wait_until(lambda: flight.world.popen.poll() is not None)
            took_s, status = time.monotonic() - begun_s, flight.world.popen.returncode
        finally:
            flight.fleet.stop()
        n_ended, n_wrong = flight.count(' ended after'), flight.n_wrong(n_joins)
    back_s.sort()
    console.print(
        f'{len(back_s)} agents killed within {WITHIN_S:g} s of joining, {took_s:.0f} s: '
        f'{n_ended} missions ended, {n_wrong} of {n_joins} lost or otherwise, world: exit status '
        f'{status}; from the kill until the next one flies: median {back_s[len(back_s) // 2]:.1f} '
        f's, longest {back_s[-1]:.1f} s'
    )


def main() -> None:
    """Soak and print."""
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    console = Console(width=None if sys.stdout.isatty() else 132)
    kind, number = [*sys.argv[1:], 'missions'][0], int([*sys.argv[2:], 0][0])
    if kind == 'joins':
        soak_joins(number or N_JOINS, console)
    else:
        soak_missions(number or N_MISSIONS, console)


if __name__ == '__main__':
    main()

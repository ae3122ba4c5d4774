"""Lets bad luck befall every node of a fleet in flight, and counts what was lost by it.

`python tools/endurance/chaos.py` is `make chaos`. At random moments a node is killed, stopped
for a while, asked to end, cut off from some packets, or given a slow or a full disk; then it is
started anew. Every mission must be flown in the end, to the byte as in one process.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
import random
import shutil
import signal
import subprocess
import sys
import time

from flight import ending, Flight, flight_of, STOP_S
from rich.console import Console
from rich.table import Table
from uav_collect.errors import BagError
from uav_collect.limits import INTERRUPTED
from uav_collect.recording.bag_reader import read_missions
from uav_collect.scenario.load import load, with_uavs

SHIM = Path(__file__).with_name('faulty_io.c')
PACE = 200.0  # simulated over wall-clock time: a mission takes some seconds
N_UAVS = 3
N_EVENTS = 150  # within which a fault comes; about a mission
STOPPED_S = 3.0
N_UNLUCKY = 2  # missions that a node flies with a bad network or disk
NETWORK = {'FAULTY_UDP_LOSS': '0.05', 'FAULTY_UDP_DELAY_MS': '1'}
SLOW = {'FAULTY_DISK_DELAY_MS': '50'}
FULL = {'FAULTY_DISK_ROOM': '100000'}  # bytes
DISK = ('world', 'recorder', 'trainer')  # nodes that write files
KINDS = ('world', 'agent', 'recorder', 'trainer')


@dataclass(frozen=True, kw_only=True)
class Fault:
    """What befalls which node."""

    kind: str  # of node
    what: str

    def __str__(self) -> str:
        return f'{self.kind}: {self.what}'


def faults() -> list[Fault]:
    """One of each."""
    common = ('kill -9', 'stopped', 'SIGTERM', 'SIGHUP', 'network')
    found = [Fault(kind=kind, what=what) for kind in KINDS for what in common]
    return found + [
        Fault(kind=kind, what=f'{how} disk') for kind in DISK for how in ('slow', 'full')
    ]


class Chaos:
    """Faults in turn on one flight."""

    def __init__(self, flight: Flight, shim: Path, seed: int) -> None:
        self._flight, self._shim = flight, shim
        self._draw = random.Random(seed)  # nosec B311 # no secret
        self.complaints: list[str] = []

    def suffer(self, fault: Fault) -> None:
        """Let a fault come at a random moment, and wait until missions go on."""
        flight = self._flight
        until = flight.n_events + self._draw.randint(1, N_EVENTS)
        flight.wait_until(lambda: flight.n_events >= until, f'before {fault}')
        name = self._draw.choice(flight.agents) if fault.kind == 'agent' else fault.kind
        node = flight.nodes[name]
        match fault.what:
            case 'kill -9':
                node.popen.kill()
                node.popen.wait()
            case 'stopped':
                node.popen.send_signal(signal.SIGSTOP)
                time.sleep(STOPPED_S)
                node.popen.send_signal(signal.SIGCONT)
                self._go_on(fault, 1)
                return
            case 'SIGTERM' | 'SIGHUP':
                self._end(fault, name, signal.Signals[fault.what])
            case _:
                self._end(fault, name, signal.SIGTERM)
                self._be_unlucky(fault, name)
        if fault.kind == 'recorder':
            self._check_bag(fault)
        flight.start(name)
        self._go_on(fault, 1)

    def _end(self, fault: Fault, name: str, number: signal.Signals) -> None:
        node = self._flight.nodes[name]
        node.popen.send_signal(number)
        try:
            status = node.popen.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.complaints.append(f'{fault}: deaf for {STOP_S:.0f} s')
            node.popen.kill()
            node.popen.wait()
            return
        says_so = status == 1 and fault.what == 'full disk' and 'No space left' in node.text
        if status != 0 and not says_so:
            self.complaints.append(f'{fault}: exit status {status}')

    def _be_unlucky(self, fault: Fault, name: str) -> None:
        """Let a node fly with a bad network or disk for some missions, then end it."""
        flight = self._flight
        how = {'network': NETWORK, 'slow disk': SLOW, 'full disk': FULL}[fault.what]
        environment = {'LD_PRELOAD': str(self._shim), 'FAULTY_DISK': str(flight.folder), **how}
        node = flight.start(name, environment)
        # A node whose disk is full may end, if it says why.
        self._go_on(fault, N_UNLUCKY, may_end=name if fault.what == 'full disk' else '')
        if node.popen.poll() is None:
            self._end(fault, name, signal.SIGTERM)
        elif 'No space left' not in node.text:
            self.complaints.append(f'{fault}: ended without a word of the disk')

    def _go_on(self, fault: Fault, n_missions: int, may_end: str = '') -> None:
        flight = self._flight
        until = flight.n_ended + n_missions
        flight.wait_until(lambda: flight.n_ended >= until, f'after {fault}', may_end=may_end)

    def _check_bag(self, fault: Fault) -> None:
        """A recording that was ended or cut off can be read, after a repair at most."""
        bag = self._flight.bags[-1]
        if fault.what in ('kill -9', 'full disk'):
            done = self._flight.repair(bag)
            if done.returncode != 0:
                self.complaints.append(f'{fault}: {done.stderr.strip()}')
        try:
            read_missions(bag)
        except BagError as error:
            if 'holds no mission' not in str(error):
                self.complaints.append(f'{fault}: {error}')


def built_shim(folder: Path) -> Path:
    """The library that makes processes unlucky."""
    library = folder / 'faulty_io.so'
    compiler = next(filter(shutil.which, ('cc', 'gcc', 'clang')), None)
    if compiler is None:
        raise SystemExit('a C compiler is missing: sudo apt install gcc')
    command = [compiler, '-shared', '-fPIC', '-O2', '-o', library, SHIM, '-ldl']
    subprocess.run(command, check=True)
    return library


def main(argv: Sequence[str] | None = None) -> int:
    """Try faults and print what came of them; the exit status is 1 if anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        '--rounds', type=int, default=1, help='of all faults, each in its order (1)'
    )
    parser.add_argument('--seed', type=int, default=0, help='of the order and the moments (0)')
    parser.add_argument('--only', default='', help='faults with this in their name, as "world:"')
    arguments = parser.parse_args(argv)
    chosen = [each for each in faults() if arguments.only in str(each)]
    if not chosen or arguments.rounds < 1:
        parser.error(f'faults are {", ".join(map(str, faults()))}; rounds must be >= 1')
    console = Console(width=None if sys.stdout.isatty() else 100)
    draw, tried, begun_s = random.Random(arguments.seed), Counter[str](), time.monotonic()  # nosec B311 # no secret
    with flight_of(with_uavs(load('paper_8x8'), N_UAVS), pace=PACE) as flight:
        chaos = Chaos(flight, built_shim(flight.folder), arguments.seed)
        n_faults = arguments.rounds * len(chosen)
        with ending(console) as end:
            console.print(f'{len(flight.nodes)} nodes are starting')
            flight.wait_until(lambda: flight.n_ended >= 1, 'the first mission')
            for _ in range(arguments.rounds):
                for fault in draw.sample(chosen, len(chosen)):
                    chaos.suffer(fault)
                    tried[str(fault)] += 1
                    console.print(f'{tried.total()}/{n_faults} {fault}')
        flight.close()
        (n_missions, lost), n_updates = flight.lost(), flight.n_updates
        complaints = [*end.problems, *chaos.complaints, *flight.tracebacks()]
    table = Table(title=f'{time.monotonic() - begun_s:.0f} s, seed {arguments.seed}')
    for heading in ('node', 'fault', 'tried'):
        table.add_column(heading)
    for name, count in sorted(tried.items()):
        table.add_row(*name.split(': '), str(count))
    console.print(table)
    for complaint in complaints:
        console.print(complaint, markup=False)
    console.print(f'the trainer made {n_updates} updates')
    console.print(
        f'{tried.total()} faults, {n_missions} missions, {len(lost)} lost'
        f'{f" (seeds {lost})" if lost else ""}, {len(complaints)} other complaints'
    )
    return INTERRUPTED if end.is_interrupted else int(bool(lost or complaints))


if __name__ == '__main__':
    sys.exit(main())

"""A fleet that flies for long, every node a process, whichever of them are killed meanwhile.

A mission is lost if neither a log nor a bag holds it as it is flown in one process.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # whether or not it is installed
from rich.console import Console
from ros_domains import own_domain
from uav_collect.commands.ros_processes import find_executable, ros_parameters
from uav_collect.errors import BagError, FleetError
from uav_collect.missions.rollout import fly
from uav_collect.recording.bag_reader import read_missions
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.run_record import read_columns

DEADLINE_S = 120.0  # in which a mission ends at least, and an agent answers
STOP_S = 30.0  # how long a node may take to end
_POLL_S = 0.02
_ENDED = re.compile(r'mission \S+ ended')
_SEED = re.compile(r'mission \S+ starts, seed (\d+)')
# What a trainer of a tiny network takes; what it learns does not matter here.
_LEARNER = (
    'network.hidden_size=8, mixer.embedding_size=4, mixer.hypernetwork_size=6, mixer.pool_side=2,'
    ' replay.missions_per_batch=4, validation.missions=2, validation.every_updates=1000000'
)


@dataclass(frozen=True, kw_only=True)
class Node:
    """One process of the fleet."""

    name: str
    output: Path
    popen: 'subprocess.Popen[bytes]'

    @property
    def text(self) -> str:
        """What it has said."""
        return self.output.read_text(errors='replace')

    @property
    def resident_kb(self) -> float:
        """Its resident memory now."""
        status = Path(f'/proc/{self.popen.pid}/status').read_text()
        return float(re.findall(r'VmRSS:\s+(\d+) kB', status)[0])

    @property
    def n_files(self) -> int:
        """How many files it holds open now."""
        return len(os.listdir(f'/proc/{self.popen.pid}/fd'))


class Flight:
    """The nodes of one fleet, and all that they write."""

    def __init__(self, folder: Path, scenario: Scenario, *, pace: float) -> None:
        """Write down what all nodes need; none is started yet.

        Args:
            pace: simulated over wall-clock time; 0: as fast as it goes.
        """
        self.folder, self.scenario = folder, scenario
        self._pace = pace
        self._file = folder / 'scenario.yaml'
        self._file.write_text(scenario.to_yaml(), encoding='utf-8')
        self._n_starts: Counter[str] = Counter()
        self.nodes: dict[str, Node] = {}
        self.agents = [f'uav_{uav}' for uav in range(1, scenario.n_uavs + 1)]

    def start_all(self) -> None:
        """Start all nodes."""
        for name in ('recorder', 'trainer', *self.agents, 'world'):
            self.start(name)

    def start(self, name: str, environment: Mapping[str, str] | None = None) -> Node:
        """Start a node, for the first time or anew, with more in its environment."""
        number = self._n_starts[name]
        self._n_starts[name] += 1
        output = self.folder / f'{name}_{number}.log'
        executable, arguments, own = self._command(name, number)
        with output.open('wb') as said:
            popen = subprocess.Popen(
                [find_executable(executable), *arguments],
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                env={**os.environ, 'PYTHONUNBUFFERED': '1', **own, **(environment or {})},
                start_new_session=True,
            )
        node = self.nodes[name] = Node(name=name, output=output, popen=popen)
        return node

    def replace(self, name: str) -> None:
        """Kill a node, as a crash does, and start another one."""
        self.nodes[name].popen.kill()
        self.nodes[name].popen.wait()
        self.start(name)

    def close(self) -> None:
        """End all nodes, those last that receive what the others still say."""
        for names in ([*self.agents, 'world'], ['recorder', 'trainer']):
            started = [self.nodes[name].popen for name in names if name in self.nodes]
            for popen in started:
                popen.send_signal(signal.SIGINT)
            for popen in started:
                with suppress(subprocess.TimeoutExpired):
                    popen.wait(STOP_S)
                popen.kill()
                popen.wait()

    @property
    def n_ended(self) -> int:
        """How many missions have ended."""
        return sum(len(_ENDED.findall(text)) for text in self._said('world'))

    @property
    def n_updates(self) -> int:
        """How many updates the trainer has made and noted."""
        file = self.folder / 'training' / 'progress.csv'
        return int(read_columns(file, ('n_updates',))['n_updates'][-1]) if file.exists() else 0

    @property
    def n_events(self) -> int:
        """How many lines the logs of missions have."""
        return sum(file.read_bytes().count(b'\n') for file in self.folder.glob('run_*/*.jsonl'))

    def wait_until(self, condition: Callable[[], bool], what: str, may_end: str = '') -> None:
        """Wait for something, as long as missions end.

        Args:
            may_end: a node that may end by itself meanwhile.

        Raises:
            RuntimeError: it did not come, or a node has ended by itself.
        """
        n_ended, until_s = self.n_ended, time.monotonic() + DEADLINE_S
        while not condition():
            for node in self.nodes.values():
                if node.name != may_end and node.popen.poll() is not None:
                    raise RuntimeError(f'{node.name} ended: {node.text[-600:]}')
            if time.monotonic() > until_s:
                before, n_ended = n_ended, self.n_ended
                if n_ended == before:
                    raise RuntimeError(f'{what}: none ended within {DEADLINE_S:.0f} s')
                until_s = time.monotonic() + DEADLINE_S
            time.sleep(_POLL_S)

    def lost(self) -> tuple[int, list[int]]:
        """How many missions were begun, and the seeds of those that are lost.

        The last one is still in flight as the nodes end.
        """
        seeds = sorted({int(seed) for text in self._said('world') for seed in _SEED.findall(text)})
        begun = seeds[:-1]
        kept = {*self._logged(), *self._recorded()}
        logs = fly(build_site(self.scenario), begun, 'sweep', 'exact')
        expected = {seed: log.to_jsonl() for seed, log in zip(begun, logs, strict=True)}
        return len(begun), [seed for seed in begun if expected[seed] not in kept]

    def tracebacks(self) -> list[str]:
        """The outputs of nodes that show one."""
        files = sorted(self.folder.glob('*_*.log'))
        texts = [(file.name, file.read_text(errors='replace')) for file in files]
        return [f'{name}: {text[-600:]}' for name, text in texts if 'Traceback' in text]

    @property
    def bags(self) -> list[Path]:
        """The recordings, in order."""
        return sorted(self.folder.glob('bag_*'), key=lambda it: int(it.name.partition('_')[2]))

    def repair(self, bag: Path) -> subprocess.CompletedProcess[str]:
        """Make a bag readable whose recorder was killed."""
        command = [find_executable('recorder'), '--repair', str(bag)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    def _logged(self) -> Iterator[bytes]:
        for file in self.folder.glob('run_*/*.jsonl'):
            yield file.read_bytes()

    def _recorded(self) -> Iterator[bytes]:
        for bag in self.bags:
            with suppress(BagError):  # holds no mission, say
                for mission in read_missions(bag):
                    if mission.is_complete:
                        yield mission.log.to_jsonl()

    def _said(self, name: str) -> list[str]:
        files = self.folder.glob(f'{name}_*.log')
        return [file.read_text(errors='replace') for file in files]

    def _command(self, name: str, number: int) -> tuple[str, Sequence[str], dict[str, str]]:
        """Executable, arguments and environment of a node."""
        folder = self.folder
        if name == 'world':
            values = {
                'scenario': self._file, 'missions': -1, 'seed': self._next_seed(),
                'output_dir': folder / f'run_{number}', 'real_time_factor': self._pace,
                'decision_timeout_s': DEADLINE_S,
            }  # fmt: skip
            return 'world_sim', ros_parameters(**values), {}
        if name == 'recorder':
            return name, ['--output', str(folder / f'bag_{number}')], {}
        if name == 'trainer':
            values = {
                'scenario': self._file, 'output_dir': folder / 'training', 'decisions': 10**12,
                'overrides': [text.strip() for text in _LEARNER.split(',')],
                'replay_decisions': 2_000, 'decisions_per_update': 100, 'checkpoint_period_s': 1.0,
            }  # fmt: skip
            return name, ros_parameters(**values), {'UAV_COLLECT_KERNELS': 'interpreted'}
        uav = name.removeprefix('uav_')
        layout = ros_parameters(observation_layout='egocentric')
        return 'uav_agent', ['--id', uav, '--policy', 'sweep', *layout], {}

    def _next_seed(self) -> int:
        """The seed of the mission that a world before was killed in, and of the first one."""
        seeds = [int(seed) for text in self._said('world') for seed in _SEED.findall(text)]
        is_over = self.n_ended >= len(set(seeds)) > 0
        return max(seeds, default=0) + int(is_over)


@contextmanager
def flight_of(scenario: Scenario, *, pace: float) -> Iterator[Flight]:
    """A fleet in a folder and ROS domain of its own, both gone afterwards; SIGTERM is Ctrl-C."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    # Where processes are killed, shared memory stays behind, and no packet could get lost.
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with own_domain() as domain, tempfile.TemporaryDirectory(prefix='endurance-') as folder:
        os.environ.setdefault('ROS_DOMAIN_ID', str(domain))
        flight = Flight(Path(folder), scenario, pace=pace)
        try:
            try:
                flight.start_all()
            except FleetError as error:
                raise SystemExit(f'error: {error}') from None
            yield flight
        finally:
            flight.close()


@dataclass
class Ending:
    """Why what was tried ended early, if it did."""

    is_interrupted: bool = False
    problems: list[str] = field(default_factory=list)


@contextmanager
def ending(console: Console) -> Iterator[Ending]:
    """Let what is tried end early, by Ctrl-C or since it cannot go on: what was seen is kept."""
    end = Ending()
    try:
        yield end
    except KeyboardInterrupt:
        end.is_interrupted = True
        console.print(
            'interrupted: what was seen follows once the nodes have ended and what they flew'
            ' was compared, minutes where kernels are compiled for it'
        )
    except RuntimeError as error:
        end.problems.append(str(error))

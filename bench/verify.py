"""Records missions over ROS and proves them; then again, each with one byte changed.

python bench/verify.py [N]    N missions (100): every shipped policy and rule, policies that a
                              trainer publishes and that explore, a killed agent, a UAV without
                              one, lost messages and UAVs

Prints how many are proved, how many of the changed ones are named, and how long that takes beside
reading the messages alone.
"""

from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import hashlib
import json
import os
from pathlib import Path
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

import rclpy
from rich.console import Console
from uav_collect.commands.ros_processes import Fleet, FleetProcess, ros_parameters
from uav_collect.nodes import topics
from uav_collect.nodes.middleware import use_quick_discovery
from uav_collect.recording.bag_messages import messages
from uav_collect.recording.mission_folder import log_name
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.uav.policy import ANYWHERE, frozen_policy, shipped_policies, TOPIC
from uav_collect.uav.policy_file import policy_bytes
from uav_collect_msgs.msg import Policy

N_MISSIONS = 100
RULES = ('hert', 'hert-equal', 'sweep', 'random')
PLAIN, PUBLISHED, KILLED, ABSENT = 'plain', 'published', 'killed', 'absent'
EPSILONS = (0.3, 0.1, 0.0)  # of the published policies, in turn
PACE = 100.0  # simulated over wall-clock time where something is to happen in flight
TIMEOUT_S = 3.0  # until the failsafe takes over
DEADLINE_S = 120.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """Missions of one fleet, recorded into one run folder."""

    name: str
    scenario: Scenario
    policy: str
    kind: str = PLAIN

    def fly(self, folder: Path, n_missions: int) -> None:
        """Fly and record missions 0, 1, ..."""
        folder.mkdir()
        n_uavs, is_paced = self.scenario.n_uavs, self.kind in (PUBLISHED, KILLED)
        file = folder / 'scenario.yaml'
        file.write_text(self.scenario.to_yaml(), encoding='utf-8')
        fleet = Fleet(folder, n_uavs + 2)
        values = {'scenario': file, 'missions': n_missions, 'output_dir': folder, 'recorders': 1}
        values |= {'real_time_factor': PACE if is_paced else 0.0}
        values |= {'decision_timeout_s': TIMEOUT_S, 'wait_for_agents': self.kind != ABSENT}
        try:
            flags = ['--output', str(folder / 'bag')]
            stop = ros_parameters(stop_after_missions=n_missions)
            recorder = fleet.start('recorder', 'recorder', [*flags, *stop], ends_last=True)
            fleet.start('world_sim', 'world', ros_parameters(**values))
            agents = [
                fleet.start('uav_agent', f'uav_{uav}', self._flags(uav))
                for uav in range(1, n_uavs + (self.kind != ABSENT))
            ]
            if self.kind == PUBLISHED:
                publish_in_turn(frozen_content(self.scenario), folder, n_missions)
            if self.kind == KILLED:
                log = folder / log_name(0)
                wait_until(lambda: n_lines(log) > 5)
                agents[1].popen.kill()
                wait_until(lambda: b'"failsafe"' in log.read_bytes())
                if n_missions > 1:
                    fleet.start('uav_agent', 'uav_2_again', self._flags(2))
            wait_until(lambda: recorder.popen.poll() is not None, recorder)
        finally:
            fleet.stop()

    def _flags(self, uav: int) -> list[str]:
        return ['--id', str(uav), '--policy', self.policy]


def frozen_content(scenario: Scenario) -> bytes:
    """The file of the policy that is shipped for a scenario."""
    return policy_bytes(frozen_policy(f'{scenario.name}_n{scenario.n_uavs}_aqmix'))


def publish_in_turn(content: bytes, folder: Path, n_missions: int) -> None:
    """Publish a policy that explores now more, now less, as a trainer does; a mission each."""
    use_quick_discovery()
    with a_node() as node:
        trainer = topics.publisher(node, topics.POLICY)
        for number in range(n_missions):
            trainer.publish(
                Policy(
                    stamp=node.get_clock().now().to_msg(),
                    version=frozen_version(content),
                    trainer_instance='bench',
                    sequence=number + 1,
                    content=array('B', content),
                    sha256=hashlib.sha256(content).hexdigest(),
                    epsilon=EPSILONS[number % len(EPSILONS)],
                    hover_share=0.6,
                )
            )
            wait_until(lambda number=number: n_lines(folder / log_name(number)) > 0)


def frozen_version(content: bytes) -> str:
    """The version in a policy's file."""
    from uav_collect.uav.policy_file import policy_from_bytes

    return policy_from_bytes(content).header.version


@contextmanager
def a_node() -> Iterator[rclpy.node.Node]:
    """A node of this process."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('trainer', context=context)
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()


def n_lines(file: Path) -> int:
    """How many whole lines a file has so far."""
    return file.read_bytes().count(b'\n') if file.exists() else 0


def wait_until(condition: Callable[[], bool], process: FleetProcess | None = None) -> None:
    """Wait for something, but not for ever."""
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        if time.monotonic() > end_s:
            raise RuntimeError(f'not in time{process.log_tail() if process else ""}')
        time.sleep(0.02)


def cases() -> list[Case]:
    """Every shipped policy over what it is for, rules, and what goes wrong."""
    small = load('paper_8x8')
    found = [Case(name=ANYWHERE, scenario=small, policy=ANYWHERE)]
    for name in shipped_policies():
        if name != ANYWHERE:
            scenario, fleet, _ = name.rsplit('_', 2)
            flown = with_uavs(load(scenario), int(fleet.removeprefix('n')))
            found.append(Case(name=name, scenario=flown, policy=name))
    found += [Case(name=rule, scenario=small, policy=rule) for rule in RULES]
    found += [
        Case(name='published, exploring', scenario=small, policy=TOPIC, kind=PUBLISHED),
        Case(name='an agent killed', scenario=small, policy='sweep', kind=KILLED),
        Case(name='messages and UAVs lost', scenario=load('rough_10x10'), policy='sweep'),
        Case(name='a UAV without an agent', scenario=small, policy='sweep', kind=ABSENT),
    ]
    return found


def with_one_byte_changed(folder: Path, seed: int, draw: random.Random) -> str:
    """Change a byte somewhere in a mission's log or in the bag; which file."""
    [bag] = (folder / 'bag').glob('*.mcap')
    file = draw.choice([folder / log_name(seed), bag])
    content = bytearray(file.read_bytes())
    content[draw.randrange(len(content))] ^= draw.randrange(1, 256)
    file.write_bytes(content)
    return file.suffix


def proofs_of(folder: Path) -> list[dict[str, Any]]:
    """What the command finds."""
    found = folder / 'found.json'
    command = (sys.executable, '-m', 'uav_collect', 'verify', folder, '--json', found)
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode not in (0, 1, 2) or not found.exists():
        raise RuntimeError(f'verify: exit status {done.returncode}: {done.stderr}')
    return json.loads(found.read_text())


def is_proved(proof: dict[str, Any]) -> bool:
    """Whether there is nothing to say against a mission."""
    return proof['verdict'] == 'proved'


def main() -> None:
    """Record, prove, change, prove again; print."""
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    console, draw = Console(width=None if sys.stdout.isatty() else 132), random.Random(0)
    n_missions, todo = int([*sys.argv[1:], N_MISSIONS][0]), cases()
    shares = [n_missions * (at + 1) // len(todo) - n_missions * at // len(todo)
              for at in range(len(todo))]  # fmt: skip
    verdicts: Counter[str] = Counter()
    changed: Counter[tuple[str, str]] = Counter()
    prove_s = read_s = 0.0
    with tempfile.TemporaryDirectory() as name:
        for number, (case, n_of_case) in enumerate(zip(todo, shares, strict=True)):
            folder = Path(name) / str(number)
            case.fly(folder, n_of_case)
            begun_s = time.perf_counter()
            proofs = proofs_of(folder)
            prove_s += time.perf_counter() - begun_s
            begun_s = time.perf_counter()
            for _ in messages(folder / 'bag', lambda _: True):
                pass
            read_s += time.perf_counter() - begun_s
            verdicts.update(proof['verdict'] for proof in proofs)
            for proof in proofs:
                if not is_proved(proof):
                    console.print(f'{case.name}: {proof}', highlight=False)
            for seed in range(n_of_case):
                copy = Path(shutil.copytree(folder, Path(name) / 'changed'))
                suffix = with_one_byte_changed(copy, seed, draw)
                is_named = not all(map(is_proved, proofs_of(copy)))
                changed[suffix, 'named' if is_named else 'not seen'] += 1
                shutil.rmtree(copy)
            n_failsafes = sum(proof['failsafes'] for proof in proofs)
            console.print(f'{case.name}: {n_of_case} missions, {n_failsafes} failsafes')
    parts = ', '.join(f'{count} {word}' for word, count in verdicts.items())
    console.print(f'{n_missions} missions recorded: {parts}')
    parts = ', '.join(f'{suffix} {count} {word}' for (suffix, word), count in changed.items())
    console.print(f'the same with one byte changed: {parts}')
    prove_ms, read_ms = 1e3 * prove_s / n_missions, 1e3 * read_s / n_missions
    console.print(
        f'the command took {prove_s:.1f} s for {len(todo)} folders, {prove_ms:.0f} ms a mission'
        f'; reading all messages takes {read_ms:.0f} ms a mission'
    )


if __name__ == '__main__':
    main()

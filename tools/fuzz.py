"""Fuzzes every surface by random tries for a time, and keeps what fails.

`python tools/fuzz.py --minutes 30` is `make fuzz MINUTES=30`: each file test/fuzz/test_*.py is a
surface, and so are the topics of nodes in flight. Each is tried that long, as many side by side as
there are cores. What fails is shrunk, kept in runs/fuzz/SURFACE and tried first the next time.
Ctrl-C shows how far it came.
"""

import argparse
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
import os
from pathlib import Path
import secrets
import subprocess
import sys
import tempfile
from threading import Event
import time

ROOT = Path(__file__).resolve().parents[1]
TESTS = ROOT / 'test' / 'fuzz'
KEPT = ROOT / 'runs' / 'fuzz'
FIRST_TRIES = 200
BATCH_S = 60.0  # of tries in one process: what hypothesis remembers of them fills memory
_SAY_EVERY_S = 60.0
_TOPICS = 'topics'  # of nodes in flight; their test stands with those of nodes


@dataclass(kw_only=True)
class Surface:
    """A surface, and what came of its tries."""

    name: str
    n_tries: int = 0
    tried_s: float = 0.0
    failures: list[Path] = field(default_factory=list)

    @property
    def batch(self) -> int:
        """How many tries take as long as a batch should."""
        return int(BATCH_S * self.n_tries / self.tried_s) if self.n_tries else FIRST_TRIES


def surfaces() -> list[str]:
    """The names of all surfaces."""
    return sorted(
        [_TOPICS, *(file.stem.removeprefix('test_') for file in TESTS.glob('test_*.py'))]
    )


def fuzz(surface: Surface, budget_s: float, stopping: Event) -> None:
    """Try a surface for a time, until it fails, or until that is stopped."""
    while surface.tried_s < budget_s and not surface.failures and not stopping.is_set():
        share = min(1.0, (budget_s - surface.tried_s) / BATCH_S)
        _try_batch(surface, max(1, int(surface.batch * share)), stopping)


def _tests(surface: str) -> list[str]:
    if surface == _TOPICS:
        return [str(ROOT / 'test/nodes/test_hostile_messages.py'), '-k', 'fuzzed']
    return [str(TESTS / f'test_{surface}.py')]


def _try_batch(surface: Surface, n_tries: int, stopping: Event) -> None:
    seed, begin_s = secrets.randbelow(2**31), time.monotonic()
    kept = KEPT / surface.name
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix='fuzz-') as noted:
        (Path(noted) / 'examples').symlink_to(kept / 'examples')
        (kept / 'examples').mkdir(exist_ok=True)
        environment = os.environ | {
            'UAV_COLLECT_FUZZ_SEED': str(seed),
            'UAV_COLLECT_FUZZ_TRIES': str(n_tries),
            'UAV_COLLECT_FUZZ_FOLDER': noted,
        }
        command = [sys.executable, '-m', 'pytest', '-q', '-x', *_tests(surface.name)]
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )
        surface.n_tries += sum(file.stat().st_size for file in Path(noted).glob('tries-*'))
        surface.tried_s += time.monotonic() - begin_s
        has_tried = any(Path(noted).glob('tries-*'))
        if (done.returncode == 0 and has_tried) or stopping.is_set():
            return  # with tests that were skipped nothing is shown
        failure = kept / f'failure-{seed}.txt'
        last_try = Path(noted) / 'last_try'
        text = last_try.read_text() if last_try.exists() else 'nothing was tried\n'
        heading = f'# seed {seed}, {n_tries} tries, exit status {done.returncode}'
        failure.write_text(f'{heading}\n{done.stdout}{done.stderr}\n# the last try:\n{text}')
        surface.failures.append(failure.relative_to(ROOT))


def table(tried: Sequence[Surface]) -> str:
    """What came of all surfaces, for people."""
    lines = [f'{"surface":<12}{"minutes":>9}{"tries":>12}{"failures":>10}']
    for each in tried:
        found = len(each.failures)
        lines.append(f'{each.name:<12}{each.tried_s / 60:>9.1f}{each.n_tries:>12,}{found:>10}')
        lines += [f'  {failure}' for failure in each.failures]
    return '\n'.join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Fuzz; the exit status is 1 if anything failed, 130 if it was interrupted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=30.0, help='for each surface (30)')
    parser.add_argument('surfaces', nargs='*', metavar='SURFACE', help=', '.join(surfaces()))
    arguments = parser.parse_args(argv)
    wrong = set(arguments.surfaces) - set(surfaces())
    if wrong or not 0.0 < arguments.minutes < 1e6:
        parser.error(f'surfaces are {", ".join(surfaces())}; minutes must be > 0')
    tried = [Surface(name=name) for name in arguments.surfaces or surfaces()]
    n_cores = len(os.sched_getaffinity(0))
    total_min = arguments.minutes * -(-len(tried) // n_cores)
    print(f'{len(tried)} surfaces, {n_cores} at a time: about {total_min:.0f} min', flush=True)
    stopping = Event()
    is_interrupted = False
    with ThreadPoolExecutor(n_cores) as pool:
        jobs = [pool.submit(fuzz, each, 60.0 * arguments.minutes, stopping) for each in tried]
        try:
            _wait(jobs, tried)
        except KeyboardInterrupt:
            is_interrupted = True
            stopping.set()
    print(table(tried))
    return 130 if is_interrupted else int(any(each.failures for each in tried))


def _wait(jobs: Sequence[object], tried: Sequence[Surface]) -> None:
    said_s = time.monotonic()
    while not all(job.done() for job in jobs):
        time.sleep(0.5)
        if time.monotonic() - said_s >= _SAY_EVERY_S:
            said_s = time.monotonic()
            parts = [f'{each.name} {each.n_tries:,}' for each in tried]
            print(f'tries: {", ".join(parts)}', flush=True)
    for job in jobs:
        job.result()


if __name__ == '__main__':
    sys.exit(main())

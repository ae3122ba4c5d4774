"""What all fuzzed surfaces share: how many tries, when a try has failed, how commands are tried.

`make test` makes the same tries each time. `tools/fuzz.py`, which is `make fuzz`, asks for others
by the environment: how many, from which seed, and where to note them.
"""

import atexit
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
import faulthandler
from functools import cache, wraps
import importlib
import io
import os
from pathlib import Path
import pkgutil
import re
import signal
import tempfile
from types import FrameType
from typing import Any

from hypothesis import given, HealthCheck, Phase, seed, settings
from hypothesis.database import DirectoryBasedExampleDatabase
from hypothesis.strategies import SearchStrategy
from uav_collect.__main__ import main
from uav_collect.kernels.compile import compilation

SEED = os.environ.get('UAV_COLLECT_FUZZ_SEED')  # None: the same tries each time
N_TRIES = int(os.environ.get('UAV_COLLECT_FUZZ_TRIES', '1000'))  # of a surface
_FOLDER = os.environ.get('UAV_COLLECT_FUZZ_FOLDER')  # what is noted of tries, and kept of failures
_CPU_S = 5.0  # of a try, before it counts as hung; a busy machine does not change it
_WALL_S = 600.0  # the same for a try that waits
_MAX_LINE = 1_000  # characters of an error
_MAX_LINES = 21  # of an error: twenty problems and the number of the others
_NAN = re.compile(r'(?<![\w.])nan\b', re.IGNORECASE)  # a value of a user's file is shown as .nan


class HangError(BaseException):
    """A try that does not end; no `except Exception` of what is tried takes it."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a command ended."""

    status: int
    stdout: str
    stderr: str


def fuzzed(
    *, share: float = 1.0, **strategies: SearchStrategy[Any]
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Try a test with many drawn arguments; a try that raises or hangs is a failure.

    Args:
        share: of the surface's tries that this test makes.
        strategies: by argument.
    """

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @wraps(test)
        def try_once(*args: Any, **drawn: Any) -> None:  # noqa: ANN401
            note_try(drawn)
            with _ending():
                test(*args, **drawn)

        decorated = settings(_settings(), max_examples=max(1, round(N_TRIES * share)))(
            given(**strategies)(try_once)
        )
        return decorated if SEED is None else seed(int(SEED))(decorated)

    return decorate


@cache
def memory_folder(surface: str) -> Path:
    """A folder of this process that files are written to in no time, gone when it ends."""
    memory = '/dev/shm'
    root = memory if os.access(memory, os.W_OK) else None
    held = tempfile.TemporaryDirectory(prefix=f'fuzz-{surface}-', dir=root)
    atexit.register(held.cleanup)
    return Path(held.name)


def note_try(drawn: object) -> None:
    """Note what is tried, so that it is known if this process dies of it."""
    if _FOLDER is not None:
        with (Path(_FOLDER) / f'tries-{os.getpid()}').open('a') as noted:
            noted.write('.')
        (Path(_FOLDER) / 'last_try').write_text(f'{drawn!r}\n', errors='backslashreplace')


def run_command(*arguments: object) -> Outcome:
    """Run `python -m uav_collect ARGUMENTS` in this process, whose kernels stay as they are."""
    _import_kernels()
    environment = dict(os.environ)
    out, err = (io.TextIOWrapper(io.BytesIO(), 'utf-8', write_through=True) for _ in range(2))
    with redirect_stdout(out), redirect_stderr(err):
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else 1
        finally:
            os.environ.clear()  # commands of one mission choose to interpret kernels
            os.environ.update(environment)
    texts = [stream.buffer.getvalue().decode() for stream in (out, err)]
    return Outcome(status=status, stdout=texts[0], stderr=texts[1])


@cache
def _import_kernels() -> None:
    """Import all modules with kernels: what a command imports first, would be as it wants it."""
    for room in ('physics', 'uav', 'world', 'missions', 'planning', 'ingest'):
        package = importlib.import_module(f'uav_collect.{room}')
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f'uav_collect.{room}.{module.name}')


def check_outcome(outcome: Outcome, *, names: str | None = None) -> None:
    """Hold an outcome to what every command owes its user, whatever it was given.

    Args:
        names: what every line of a refusal must name, a file say.
    """
    assert outcome.status in (0, 2), outcome
    assert 'Traceback' not in outcome.stderr, outcome
    if outcome.status == 0:
        assert not _NAN.search(outcome.stdout), outcome
        return
    errors = [line for line in outcome.stderr.splitlines() if line.startswith('error: ')]
    assert errors, outcome
    check_lines([line.removeprefix('error: ') for line in errors], names=names)


def check_lines(lines: list[str], *, names: str | None = None) -> None:
    """Hold the lines of a refusal to what people can read."""
    assert 0 < len(lines) <= _MAX_LINES, lines
    for place, line in enumerate(lines):
        assert line.strip() and len(line) <= _MAX_LINE, line
        assert line.isprintable(), line
        if names is not None and not (place > 0 and line.startswith('... and ')):
            assert names in line, line


def _settings() -> settings:
    shared = settings(
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
        print_blob=True,
    )
    if SEED is None:
        return settings(shared, derandomize=True, database=None)
    kept = DirectoryBasedExampleDatabase(Path(_FOLDER or '.') / 'examples')
    return settings(shared, database=kept, phases=(Phase.reuse, Phase.generate, Phase.shrink))


@contextmanager
def _ending() -> Iterator[None]:
    """Raise in a try that takes too long; end the process if it does not even listen."""
    hung, compiled_s = [], compilation.duration_s

    def hang(signal_number: int, frame: FrameType | None) -> None:
        # Whichever try comes first compiles for all; half way the compiler must not be left.
        if compilation.is_going_on or compilation.duration_s > compiled_s:
            _start_clocks()
            return
        hung.append(HangError(f'no end after {_CPU_S} s of work or {_WALL_S} s of waiting'))
        raise hung[0]

    before = [(number, signal.signal(number, hang)) for number in (signal.SIGPROF, signal.SIGALRM)]
    _start_clocks()
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before:
            signal.signal(number, handler)
    if hung:  # and what was tried took it for something else
        raise hung[0]


def _start_clocks() -> None:
    signal.setitimer(signal.ITIMER_PROF, _CPU_S)
    signal.setitimer(signal.ITIMER_REAL, _WALL_S)
    faulthandler.dump_traceback_later(10.0 * _WALL_S, exit=True)

"""A process that compiles kernels says so, and knows how long."""

from pathlib import Path
from queue import SimpleQueue
import sys
from threading import Event

from processes import Processes
import pytest
from uav_collect.kernels.compilation import Compilation, COMPILED_IN
from uav_collect.kernels.compile import compilation, kernels_are_compiled
from uav_collect.training.progress import SpeedMeter

HANG_S = 600.0
ROOT = Path(__file__).parents[2]


def test_a_line_says_what_a_process_that_compiles_does() -> None:
    said: SimpleQueue[str] = SimpleQueue()
    compiling = Compilation(said.put)
    compiling.begin()
    assert said.get(timeout=HANG_S) == f'compiling kernels (once): this takes {COMPILED_IN}'
    compiling.end()


@pytest.mark.parametrize(
    'path',
    [
        'Makefile',
        'docs/glossary.md',
        'docs/how_to/compare_policies.md',
        'docs/measured.md',
        'docs/tutorials/first_mission.md',
        'examples/notebooks/train_and_see_it_fly.py',
    ],
)
def test_what_it_takes_is_the_same_wherever_it_is_said(path: str) -> None:
    words = (ROOT / path).read_text().replace('\n#', ' ').split()
    assert COMPILED_IN in ' '.join(words)


def test_short_ones_are_said_once_they_add_up() -> None:
    said: SimpleQueue[str] = SimpleQueue()
    now_s = 100.0
    compiling = Compilation(said.put, lambda: now_s)
    for _ in range(3):
        compiling.begin()
        now_s += 0.3
        compiling.end()
    assert said.empty()
    compiling.begin()
    now_s += 0.3
    assert said.get(timeout=HANG_S) == f'compiling kernels (once): this takes {COMPILED_IN}'
    assert compiling.duration_s == pytest.approx(1.2)
    compiling.end()


def test_a_slow_reader_of_the_line_delays_no_compiler() -> None:
    is_read, reads = Event(), Event()

    def read_slowly(_: str) -> None:
        reads.set()
        assert is_read.wait(HANG_S)

    now_s = 100.0
    compiling = Compilation(read_slowly, lambda: now_s)
    compiling.begin()
    now_s += 10.0
    assert reads.wait(HANG_S)
    compiling.end()  # would wait as long as the reader
    assert not compiling.is_going_on
    is_read.set()


def test_kernels_that_are_compiled_within_others_count_once() -> None:
    compiling = Compilation(lambda _: None)
    for _ in range(2):
        compiling.begin()
    compiling.end()
    assert compiling.is_going_on
    compiling.end()
    assert not compiling.is_going_on
    ended_s = compiling.duration_s
    assert compiling.duration_s == ended_s


@pytest.mark.skipif(not kernels_are_compiled(), reason='nothing is compiled')
def test_numba_tells_when_it_compiles() -> None:
    import numba
    from numba.core import event

    compiling = Compilation(lambda _: None)
    compiling.watch(event)
    assert compiling.duration_s == 0.0
    numba.njit(lambda number: number + 1)(1)
    assert compiling.duration_s > 0.0
    assert not compiling.is_going_on


WAYS = {
    'fly': 'import uav_collect; uav_collect.fly("paper_8x8", "sweep")',
    'evaluate': 'import uav_collect; uav_collect.evaluate("paper_8x8", "sweep", 2)',
    'pettingzoo': 'import uav_collect; uav_collect.env().reset(seed=0)',
}


@pytest.mark.skipif(not kernels_are_compiled(), reason='nothing is compiled')
@pytest.mark.parametrize('way', WAYS.values(), ids=WAYS)
def test_whoever_flies_from_python_hears_of_the_compiler(
    way: str, processes: Processes, tmp_path: Path
) -> None:
    environment = {'PYTHONPATH': str(ROOT), 'XDG_CACHE_HOME': str(tmp_path / 'cache')}
    flying = processes.run('fly', sys.executable, '-c', way, **environment)
    flying.wait_for(rf'^compiling kernels \(once\): this takes {COMPILED_IN}$')


def test_a_training_is_not_charged_for_what_is_compiled() -> None:
    meter = SpeedMeter(0, 0)
    compilation.begin()
    before_s = meter.lap_s()
    during_s = meter.lap_s()
    compilation.end()
    assert (before_s >= 0.0, during_s) == (True, 0.0)

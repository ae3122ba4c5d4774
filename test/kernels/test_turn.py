"""Processes that need the same kernels at once compile them once."""

from contextlib import suppress
from pathlib import Path
import signal
import sys

from processes import Processes
from uav_collect.kernels.turn import Turn

HOLDER = """
import signal
import sys
from pathlib import Path
from uav_collect.kernels.turn import Turn
Turn().take(Path(sys.argv[1]))
print('has it', flush=True)
signal.pause()
"""
COMPILER = """
import signal
import uav_collect.kernels.compile as c
def doubled(value): return 2 * value
kernel = c.kernel(doubled)
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])
print('ready', flush=True)
signal.sigwait([signal.SIGUSR1])
kernel(21)
print('compiled:', sum(kernel.stats.cache_misses.values()))
"""


def test_the_turn_is_one_process_s_until_that_ends(processes: Processes, tmp_path: Path) -> None:
    hold = (sys.executable, '-c', HOLDER, str(tmp_path))
    holder = processes.run('holder', *hold)
    holder.wait_for('has it')
    next_one = processes.run('next_one', *hold)
    first_word = next_one.wait_for('has it|waiting for another process that compiles')
    assert first_word[0] != 'has it'
    holder.kill()
    next_one.wait_for('has it')


def test_processes_that_need_a_kernel_at_once_compile_it_once(
    processes: Processes, tmp_path: Path
) -> None:
    script = tmp_path / 'doubled.py'
    script.write_text(COMPILER)
    compile_it = (sys.executable, '-c', f'import runpy; runpy.run_path({str(script)!r})')
    environment = {'XDG_CACHE_HOME': str(tmp_path), 'UAV_COLLECT_KERNELS': 'compiled'}
    started = [processes.run('compiler', *compile_it, **environment) for _ in range(3)]
    for process in started:
        process.wait_for('ready')
    for process in started:
        process.send(signal.SIGUSR1)
    assert sorted(process.wait_for(r'compiled: (\d)')[1] for process in started) == [*'001']


def test_a_kernel_that_cannot_be_compiled_gives_the_turn_back(
    processes: Processes, tmp_path: Path
) -> None:
    turn = Turn()
    with suppress(TypeError), turn.kept():
        with turn.kept():
            assert turn.take(tmp_path)
        assert not turn.take(tmp_path)  # it still has it, nobody else compiled
        raise TypeError
    processes.run('next_one', sys.executable, '-c', HOLDER, str(tmp_path)).wait_for('has it')


def test_a_folder_that_takes_no_file_lets_all_compile(tmp_path: Path) -> None:
    assert not Turn().take(tmp_path / 'missing')

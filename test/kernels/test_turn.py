"""Processes that need the same kernels at once compile them once."""

from contextlib import suppress
from pathlib import Path
import subprocess
import sys

import pytest
from uav_collect.kernels.turn import Turn

HOLDER = """
import sys
from pathlib import Path
from uav_collect.kernels.turn import Turn
Turn().take(Path(sys.argv[1]))
print('has it', flush=True)
sys.stdin.read()
"""
COMPILER = """
import uav_collect.kernels.compile as c
def doubled(value): return 2 * value
kernel = c.kernel(doubled)
print('ready', flush=True)
input()
kernel(21)
print(sum(kernel.stats.cache_misses.values()))
"""


def started(script: str, *arguments: str) -> 'subprocess.Popen[str]':
    return subprocess.Popen(
        [sys.executable, '-c', script, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def test_the_turn_is_one_process_s_until_that_ends(tmp_path: Path) -> None:
    with started(HOLDER, str(tmp_path)) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == 'has it\n'
        with started(HOLDER, str(tmp_path)) as next_one:
            assert next_one.stdout is not None
            holder.kill()
            assert next_one.stdout.readline() == 'has it\n'
            next_one.kill()


def test_processes_that_need_a_kernel_at_once_compile_it_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    monkeypatch.delenv('UAV_COLLECT_KERNELS', raising=False)
    script = tmp_path / 'doubled.py'
    script.write_text(COMPILER)
    run = f'import runpy; runpy.run_path({str(script)!r})'
    processes = [started(run) for _ in range(3)]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == 'ready\n'
    for process in processes:
        assert process.stdin is not None
        process.stdin.write('\n')
        process.stdin.flush()
    outputs = sorted(int(process.communicate()[0]) for process in processes)
    assert outputs == [0, 0, 1]


def test_a_kernel_that_cannot_be_compiled_gives_the_turn_back(tmp_path: Path) -> None:
    turn = Turn()
    with suppress(TypeError), turn.kept():
        with turn.kept():
            assert turn.take(tmp_path)
        assert not turn.take(tmp_path)  # it still has it, nobody else compiled
        raise TypeError
    with started(HOLDER, str(tmp_path)) as next_one:
        assert next_one.stdout is not None
        assert next_one.stdout.readline() == 'has it\n'
        next_one.kill()


def test_a_folder_that_takes_no_file_lets_all_compile(tmp_path: Path) -> None:
    assert not Turn().take(tmp_path / 'missing')

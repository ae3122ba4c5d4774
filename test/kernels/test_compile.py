"""Compiled kernels are kept for as long as no source changes, and are found by what they are."""

from collections.abc import Callable
from itertools import product
import os
from pathlib import Path
import sys

from processes import completed
import pytest
import uav_collect
from uav_collect.kernels.compile import kernels_are_cached, sources_digest
from uav_collect.missions import batch_kernels
from uav_collect.missions.batch_kernels import carry_out
from uav_collect.physics.radio import log_of_1_plus
from uav_collect.planning import bound

CHANGED = {
    'edited': lambda package: (package / 'studies' / 'flights.py').write_text('x = 2\n'),
    'added': lambda package: (package / 'studies' / 'more.py').write_text(''),
    'moved': lambda package: (package / 'studies' / 'flights.py').rename(package / 'flights.py'),
    'removed': lambda package: (package / 'studies' / 'flights.py').unlink(),
}


@pytest.mark.parametrize('change', CHANGED.values(), ids=CHANGED)
def test_a_source_of_a_sub_package_counts_for_the_digest(
    change: Callable[[Path], object], tmp_path: Path
) -> None:
    (tmp_path / 'studies').mkdir()
    (tmp_path / 'world.py').write_text('y = 1\n')
    (tmp_path / 'studies' / 'flights.py').write_text('x = 1\n')
    before = sources_digest.__wrapped__(tmp_path)
    change(tmp_path)
    assert sources_digest.__wrapped__(tmp_path) != before


def test_the_digest_is_that_of_the_whole_package() -> None:
    package = Path(uav_collect.__file__).parent
    assert sources_digest() == sources_digest.__wrapped__(package)
    assert [*package.glob('studies/jobs/*.py')]


def test_kernels_count_as_cached_once_they_were_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    assert not kernels_are_cached([log_of_1_plus])
    script = 'from uav_collect.physics import radio; radio.log_of_1_plus(0.5)'
    completed(sys.executable, '-c', script)
    assert kernels_are_cached([log_of_1_plus])
    assert not kernels_are_cached([log_of_1_plus, carry_out])


def doubled(tmp_path: Path, *, most_bytes: int | None = None, way: str = '.') -> tuple[str, str]:
    """What a process says that compiles a kernel, or finds it; on a disk that may be full.

    Args:
        way: through which folder it finds the kernel's file.
    """
    script = tmp_path / 'doubled.py'
    if not script.exists():  # its time is that of its kernel
        script.write_text(
            'import uav_collect.kernels.compile as c\n'
            'def doubled(value): return 2 * value\n'
            'print(c.kernel(doubled)(21))\n'
        )
    limit = [] if most_bytes is None else ['prlimit', f'--fsize={most_bytes}']
    environment = {
        **os.environ, 'PYTHONPATH': str(Path(uav_collect.__file__).parents[1]),
        'XDG_CACHE_HOME': str(tmp_path / 'cache'), 'PYTHONDONTWRITEBYTECODE': '1',
    }  # fmt: skip
    done = completed(*limit, sys.executable, tmp_path / way / script.name, env=environment)
    # How long that takes is said on a busy machine.
    said = done.stderr.splitlines(keepends=True)
    return done.stdout, ''.join(it for it in said if not it.startswith('compiling kernels'))


def test_a_disk_without_room_for_a_compiled_kernel_costs_a_line_and_no_result(
    tmp_path: Path,
) -> None:
    out, said = doubled(tmp_path, most_bytes=10)
    assert out == '42\n'
    assert said.endswith(': File too large: kernels are not kept, the next process compiles'
                         ' them again\n')  # fmt: skip
    assert said.startswith(str(tmp_path / 'cache'))
    assert said.count('\n') == 1
    left = [path for path in (tmp_path / 'cache').rglob('*') if path.is_file()]
    assert [(path.name, path.stat().st_size) for path in left] == [('compiling', 0)]  # its turn


@pytest.mark.nightly
def test_a_damaged_file_of_a_compiled_kernel_is_written_anew(tmp_path: Path) -> None:
    assert doubled(tmp_path) == ('42\n', '')
    damages = (b'', b'\0' * 100, b'\x80\x04\x95', b'nonsense')
    for kind, damage in product(('*.nbi', '*.nbc'), damages):
        [file] = (tmp_path / 'cache').rglob(kind)
        whole = file.read_bytes()
        file.write_bytes(damage)
        assert doubled(tmp_path) == ('42\n', '')
        assert len(file.read_bytes()) == len(whole)


def test_a_kernel_that_is_found_through_a_link_is_compiled_once(tmp_path: Path) -> None:
    (tmp_path / 'link').symlink_to(tmp_path)
    assert doubled(tmp_path) == doubled(tmp_path, way='link') == ('42\n', '')
    assert len([*(tmp_path / 'cache').rglob('*.nbc')]) == 1


MODULES = (batch_kernels, bound)


@pytest.mark.parametrize('module', MODULES, ids=lambda it: it.__name__)
def test_what_a_module_lists_are_kernels(module: object) -> None:
    for kernel in module.KERNELS:
        assert hasattr(kernel, 'py_func')


def test_a_way_to_run_kernels_that_there_is_none_of_is_refused() -> None:
    command = [sys.executable, '-m', 'uav_collect', 'evaluate', '--missions', '1']
    environment = {**os.environ, 'UAV_COLLECT_KERNELS': 'fast'}
    done = completed(*command, status=2, env=environment)
    words = "UAV_COLLECT_KERNELS is 'fast': must be compiled or interpreted"
    assert done.stderr == f'error: {words}\n'

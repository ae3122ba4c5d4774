"""Decides how kernels run: compiled by numba in batch processes, interpreted in ROS nodes.

A kernel is plain Python over floats, ints and 1-D sequences; both ways give the same bits, so a
mission flown by nodes equals the same mission flown in one process. A node handles one event at a
time: interpreted, it starts at once and needs 100 MB less.
"""

import atexit
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
import hashlib
import importlib.util
import inspect
import os
from pathlib import Path
import shutil
import stat
import tempfile
from typing import Any, TypeVar

from uav_collect.errors import ConfigError, in_one_line
from uav_collect.kernels.compilation import Compilation
from uav_collect.kernels.patience import say
from uav_collect.kernels.turn import Turn

_Kernel = TypeVar('_Kernel', bound=Callable[..., object])

_PACKAGE = Path(__file__).resolve().parents[1]
_SWITCH = 'UAV_COLLECT_KERNELS'
_OPTIONS = {'error_model': 'numpy', 'forceinline': True, 'no_cfunc_wrapper': True}
_NOT_KEPT = 'kernels are not kept, the next process compiles them again'
_is_left_plain = False  # in this process, not in those it starts
compilation = Compilation()  # of this process
turn = Turn()  # the same


def interpret_kernels() -> None:
    """Leave kernels as plain Python in this process; call it before importing any of them."""
    os.environ[_SWITCH] = 'interpreted'


def kernels_are_compiled() -> bool:
    """Whether kernels of this process run compiled.

    Raises:
        ConfigError: the environment asks for neither.
    """
    asked = os.environ.get(_SWITCH) or 'compiled'
    if asked not in ('compiled', 'interpreted'):
        shown = in_one_line(asked, 60)
        raise ConfigError(f'{_SWITCH} is {shown!r}: must be compiled or interpreted')
    return (
        asked == 'compiled'
        and not _is_left_plain
        and importlib.util.find_spec('numba') is not None
    )


def kernel(function: _Kernel) -> _Kernel:
    """Mark a function as a kernel: numba compiles it unless this process interprets.

    Kernels own no memory, so rows need no reference counts: counting, an atomic operation each
    time that a row is named, took nine tenths of a mission. Passed by value, a mission's rows are
    a kilobyte, so a kernel becomes part of those that call it.
    """
    return _compiled(function, counts=False)


def long_kernel(function: _Kernel) -> _Kernel:
    """Mark a kernel that Python calls and that may run for seconds: other threads run meanwhile.

    So somebody hears of signals. Others keep the interpreter to themselves: to give it away and
    get it back costs more than they take.
    """
    return _compiled(function, counts=False, nogil=True)


def float_kernel(function: _Kernel) -> _Kernel:
    """Mark a kernel over float32 tables that has no interpreted double, and may take milliseconds.

    A product and the sum it goes into are rounded once: what these compute is not compared to the
    bit with anything but themselves.
    """
    return _compiled(function, counts=False, nogil=True, fastmath={'contract'})


def allocating_kernel(function: _Kernel) -> _Kernel:
    """Mark a kernel that makes lists, or that is handed some."""
    return _compiled(function, counts=True)


def row_kernel(function: _Kernel) -> _Kernel:
    """Mark a kernel that returns rows of tables: compiled within kernels alone.

    Without reference counts numba could not hand a part of a table to Python, where the function
    runs as it stands.
    """
    if not kernels_are_compiled():
        return function
    from numba.extending import register_jitable

    _numba()
    part: _Kernel = register_jitable(**_OPTIONS, _nrt=False)(function)
    return part


@cache  # of what was loaded, whatever is edited meanwhile
def sources_digest(package: Path = _PACKAGE) -> str:
    """16 hex digits that change with any source of the package, its sub-packages' included."""
    digest = hashlib.sha256()
    for source in sorted(package.rglob('*.py')):
        digest.update(source.relative_to(package).as_posix().encode() + b'\0')
        digest.update(source.read_bytes() + b'\0')
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Where compiled kernels are kept, one folder per state of the sources and place of them.

    numba looks only at a kernel's own file when it judges a cached copy; a changed callee in
    another module would go unseen, so the name of the folder digests every source. By its path it
    looks, too: what the same sources have compiled elsewhere is of no use here.
    """
    place = hashlib.sha256(os.fsencode(_PACKAGE)).hexdigest()[:8]
    name = f'{sources_digest()}_{place}'
    wanted = Path(os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache'))
    folder = wanted / 'uav_collect' / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        is_usable = os.access(folder, os.W_OK)
    except OSError:
        is_usable = False
    return folder if is_usable else _temporary_folder() / name


@cache
def _temporary_folder() -> Path:
    """A folder of this user, for who has no home to write into.

    What is cached is run: a folder that others could have written is not used.
    """
    folder = Path(tempfile.gettempdir()) / f'uav_collect_{os.getuid()}'
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    about = folder.lstat()
    is_own = stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid()
    if is_own and not about.st_mode & 0o077:
        return folder
    say(f'{folder}: is not of this user alone: {_NOT_KEPT}')
    own = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, own, ignore_errors=True)
    return Path(own)


def interpret_unless_cached(kernel_name: str) -> bool:
    """Leave kernels as plain Python in this process if that is open, and nobody has compiled them.

    It is open until the first kernel is imported: compiled ones do not run with interpreted ones.

    Args:
        kernel_name: the last part of the module that has it and its own name: none is imported,
            as that settles how all of them run.

    Returns:
        Whether this was what made them run interpreted.
    """
    if os.environ.get(_SWITCH) or not kernels_are_compiled() or compilation.is_watched:
        return False
    if any(cache_folder().rglob(f'{kernel_name}-*.nbi')):
        return False
    global _is_left_plain
    _is_left_plain = True
    return True


def kernels_were_left_plain() -> bool:
    """Whether `interpret_unless_cached` made kernels run interpreted in this process."""
    return _is_left_plain


def kernels_are_cached(kernels: Iterable[Callable[..., object]]) -> bool:
    """Whether kernels were compiled before, from the same sources.

    Args:
        kernels: those that take long to compile, as a module's `KERNELS` lists them.
    """
    return all(map(_is_cached, kernels))


def _is_cached(kernel: Callable[..., object]) -> bool:
    function = inspect.unwrap(getattr(kernel, 'py_func', kernel))
    # So numba names the index of a kernel's compiled versions.
    name = f'{Path(inspect.getfile(function)).stem}.{function.__qualname__}-*.nbi'
    return any(cache_folder().rglob(name))


def _compiled(function: _Kernel, *, counts: bool, **more: Any) -> _Kernel:  # noqa: ANN401
    if not kernels_are_compiled():
        return function
    _name_own_file(function)
    options = {'cache': True, '_nrt': counts, **more, **_OPTIONS}
    compiled: Any = _numba().njit(**options)(function)
    _keep_if_possible(compiled._cache)
    compiled.compile = turn.kept()(compiled.compile)
    kernel_function: _Kernel = compiled
    return kernel_function


def _name_own_file(function: Callable[..., object]) -> None:
    """Let a kernel tell the file it is in, not a link to it: numba keeps kernels by that name.

    ROS finds the package by a link of colcon's, where a command in the checkout finds it as it is.
    """
    code = function.__code__
    function.__code__ = code.replace(co_filename=os.path.realpath(code.co_filename))


def _keep_if_possible(kept: Any) -> None:  # noqa: ANN401 - a cache of numba's
    """Let one process compile a kernel for all, and a bad cache cost time alone.

    What a damaged cache lacks is compiled, and what it has no room for is not kept.
    """
    load, save = kept.load_overload, kept.save_overload

    def load_or_none(*arguments: Any) -> Any:  # noqa: ANN401
        try:
            return load(*arguments)
        except Exception:  # a damaged pickle raises anything
            with suppress(OSError):
                kept.flush()
            return None

    def load_or_compile(*arguments: Any) -> Any:  # noqa: ANN401
        found = load_or_none(*arguments)
        if found is None and turn.take(cache_folder()):
            found = load_or_none(*arguments)  # whose turn it was may have compiled it
        return found

    def save_or_leave(*arguments: Any) -> None:  # noqa: ANN401
        try:
            save(*arguments)
        except Exception as error:  # of the disk; or of an index that could not be flushed
            _say_lost(str(getattr(error, 'strerror', None) or error))

    kept.load_overload, kept.save_overload = load_or_compile, save_or_leave


@cache
def _say_lost(reason: str) -> None:
    say(f'{cache_folder()}: {reason}: {_NOT_KEPT}')


def _numba() -> Any:  # noqa: ANN401 - the module itself
    import numba
    from numba.core import event

    compilation.watch(event)
    if not numba.config.CACHE_DIR:
        numba.config.CACHE_DIR = str(cache_folder())
    return numba

"""Decides how kernels run: compiled by numba in batch processes, interpreted in ROS nodes.

A kernel is plain Python over floats, ints and 1-D sequences; both ways give the same bits, so a
mission flown by nodes equals the same mission flown in one process. A node handles one event at a
time: interpreted, it starts at once and needs 100 MB less.
"""

from collections.abc import Callable
import hashlib
import importlib.util
import os
from pathlib import Path
from typing import Any, TypeVar

_Kernel = TypeVar('_Kernel', bound=Callable[..., object])

_SWITCH = 'UAV_COLLECT_KERNELS'


def interpret_kernels() -> None:
    """Leave kernels as plain Python in this process; call it before importing any of them."""
    os.environ[_SWITCH] = 'interpreted'


def kernels_are_compiled() -> bool:
    """Whether kernels of this process run compiled."""
    if os.environ.get(_SWITCH) == 'interpreted':
        return False
    return importlib.util.find_spec('numba') is not None


def kernel(function: _Kernel) -> _Kernel:
    """Mark a function as a kernel: numba compiles it unless this process interprets."""
    if not kernels_are_compiled():
        return function
    numba = _numba()
    compiled: _Kernel = numba.njit(cache=True, error_model='numpy')(function)
    return compiled


def cache_folder() -> Path:
    """Where compiled kernels are kept, one folder per state of the sources.

    numba looks only at a kernel's own file when it judges a cached copy; a changed callee in
    another module would go unseen, so the name of the folder digests every source.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob('*.py')):
        digest.update(source.read_bytes())
    root = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache')
    return root / 'uav_collect' / digest.hexdigest()[:16]


def _numba() -> Any:  # noqa: ANN401 - the module itself
    import numba

    if not numba.config.CACHE_DIR:
        numba.config.CACHE_DIR = str(cache_folder())
    return numba

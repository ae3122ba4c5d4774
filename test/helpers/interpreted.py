"""Runs a function of a test module in a process whose kernels are interpreted."""

from collections.abc import Callable
import os
from pathlib import Path
import sys

from processes import completed

_HELPERS = Path(__file__).parent
_ROOT = _HELPERS.parents[1]


def interpreted(function: Callable[[], str]) -> str:
    """What the function returns where kernels are plain Python."""
    source, name = Path(sys.modules[function.__module__].__file__ or ''), function.__name__
    paths = [str(_ROOT), str(_HELPERS), str(source.parent), os.environ.get('PYTHONPATH', '')]
    environment = os.environ | {
        'UAV_COLLECT_KERNELS': 'interpreted',
        'PYTHONPATH': os.pathsep.join(path for path in paths if path),
    }
    script = f'import {source.stem}; print({source.stem}.{name}(), end="")'
    return completed(sys.executable, '-c', script, env=environment).stdout

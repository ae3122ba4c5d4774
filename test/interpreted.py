"""Runs a function of a test module in a process whose kernels are interpreted."""

from collections.abc import Callable
import os
from pathlib import Path
import subprocess
import sys

_TESTS = Path(__file__).parent


def interpreted(function: Callable[[], str]) -> str:
    """What the function returns where kernels are plain Python."""
    module, name = Path(sys.modules[function.__module__].__file__ or '').stem, function.__name__
    paths = [str(_TESTS.parent), str(_TESTS), os.environ.get('PYTHONPATH', '')]
    environment = os.environ | {
        'UAV_COLLECT_KERNELS': 'interpreted',
        'PYTHONPATH': os.pathsep.join(path for path in paths if path),
    }
    script = f'import {module}; print({module}.{name}(), end="")'
    done = subprocess.run(
        [sys.executable, '-c', script], env=environment, check=True, capture_output=True, text=True
    )
    return done.stdout

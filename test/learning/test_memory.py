"""Memory that arrays leave behind is used again."""

import os
from pathlib import Path
import platform
import subprocess
import sys

import pytest

COUNT = """
import resource
import numpy as np
from uav_collect.learning.memory import keep_freed_memory

if {keeps}:
    keep_freed_memory()

def taken():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

for _ in range(3):
    pair = [np.ones(2_000_000) for _ in range(3)]
    del pair
before = taken()
for _ in range(10):
    pair = [np.ones(2_000_000) for _ in range(3)]
    del pair
print(taken() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != 'glibc', reason='malloc is not glibc')
def test_arrays_made_again_and_again_take_no_more_pages_from_the_system() -> None:
    environment = os.environ | {'PYTHONPATH': str(Path(__file__).parents[2])}
    pages = [
        int(
            subprocess.run(
                [sys.executable, '-c', COUNT.format(keeps=keeps)],
                env=environment, check=True, capture_output=True, text=True,
            ).stdout
        )
        for keeps in (False, True)
    ]  # fmt: skip
    assert pages[1] < 100 < pages[0]

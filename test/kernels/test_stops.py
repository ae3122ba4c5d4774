"""A signal ends a process also where Python does not come to handle it."""

from pathlib import Path
import signal
import sys

from processes import Processes
import pytest
from uav_collect.kernels.compile import kernels_are_compiled

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {'PYTHONPATH': str(ROOT)}
STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}

# A loop that would look at the signal, if only its step came to an end.
DEAF = """
import hashlib, signal
from uav_collect.commands.terminal import deferred_interruption
from uav_collect.kernels import stops
stops.DEAF_S = 0.1
with stops.obeyed_signals(lambda number: 128 + number), deferred_interruption() as interruption:
    print('begins', flush=True)
    while interruption.signal_number is None:
        hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)
"""

# Saving takes as long as it takes once the loop has looked.
SAVES = """
import time
from uav_collect.commands.terminal import deferred_interruption
from uav_collect.kernels import stops
stops.DEAF_S = 0.1
with stops.obeyed_signals(lambda number: 128 + number), deferred_interruption() as interruption:
    print('begins', flush=True)
    while interruption.signal_number is None:
        time.sleep(0.01)
    time.sleep(3 * stops.DEAF_S)
print('saved', flush=True)
"""


@pytest.mark.parametrize('number', STATUS, ids=lambda it: it.name)
def test_a_step_without_an_end_is_ended(number: signal.Signals, processes: Processes) -> None:
    process = processes.run('deaf', sys.executable, '-c', DEAF, **ENVIRONMENT)
    process.wait_for('begins')
    process.send(number)
    process.wait_for('stopped in a step .* what was saved before is whole')
    assert process.wait_for_exit() == STATUS[number]


def test_who_has_looked_at_the_signal_may_save(processes: Processes) -> None:
    process = processes.run('saves', sys.executable, '-c', SAVES, **ENVIRONMENT)
    process.wait_for('begins')
    process.send(signal.SIGTERM)
    process.wait_for('saved')
    assert process.wait_for_exit() == 0


@pytest.mark.skipif(not kernels_are_compiled(), reason='nothing is compiled')
@pytest.mark.parametrize('number', STATUS, ids=lambda it: it.name)
def test_a_training_that_compiles_obeys_a_signal(
    number: signal.Signals, processes: Processes, tmp_path: Path
) -> None:
    pytest.importorskip('torch', reason='training needs torch')
    cache = str(tmp_path / 'cache')
    train = (sys.executable, '-m', 'uav_collect', 'train', '--output', 'run')
    training = processes.run('train', *train, XDG_CACHE_HOME=cache, **ENVIRONMENT)
    training.wait_for('compiling kernels')
    training.send(number)
    training.wait_for('stopped while it compiled')
    assert training.wait_for_exit() == STATUS[number]


@pytest.mark.ros
@pytest.mark.skipif(not kernels_are_compiled(), reason='nothing is compiled')
def test_a_trainer_that_compiles_obeys_a_signal(processes: Processes, tmp_path: Path) -> None:
    pytest.importorskip('torch', reason='training needs torch')
    trainer = processes.start(
        'trainer', '--ros-args', '-p', 'output_dir:=run', XDG_CACHE_HOME=str(tmp_path / 'cache')
    )
    trainer.wait_for('compiling kernels')
    trainer.send(signal.SIGTERM)
    trainer.wait_for('stopped while it compiled')
    assert trainer.wait_for_exit() == 0


@pytest.mark.skipif(not kernels_are_compiled(), reason='nothing is compiled')
def test_an_evaluation_that_compiles_obeys_ctrl_c(processes: Processes, tmp_path: Path) -> None:
    command = (sys.executable, '-m', 'uav_collect', 'evaluate', '--missions', '1')
    flying = processes.run('fly', *command, XDG_CACHE_HOME=str(tmp_path / 'cache'), **ENVIRONMENT)
    flying.wait_for('compiling kernels')
    flying.send(signal.SIGINT)
    assert flying.wait_for_exit() == STATUS[signal.SIGINT]
    assert 'Traceback' not in flying.output

"""A signal ends a process also where Python does not come to handle it, but never who saves."""

import os
from pathlib import Path
import signal
import sys
from threading import Thread

from processes import DEADLINE_S, Processes
import pytest
from uav_collect.commands.terminal import deferred_interruption
from uav_collect.kernels import stops
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.kernels.stops import (
    DEAF_S,
    interrupts,
    kept_handlers,
    LookClock,
    Watchdog,
)
from uav_collect.limits import stop_signals

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {'PYTHONPATH': str(ROOT)}
STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}

# A loop that would look at the signal, if only its step came to an end.
DEAF = """
import hashlib
from uav_collect.commands.terminal import deferred_interruption
from uav_collect.kernels import stops
stops.DEAF_S = 0.1
with stops.obeyed_signals(lambda number: 128 + number), deferred_interruption() as interruption:
    while not interruption.acknowledge():
        print('begins', flush=True)
        hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)
"""


class Watched:
    """A process that a signal has asked to end at 100 s, on a clock of the test."""

    def __init__(self) -> None:
        self.now_s, self.is_compiling = 100.0, False
        self.watchdog = Watchdog(lambda: self.is_compiling, lambda: self.now_s)

    @property
    def why_ended(self) -> str | None:
        return self.watchdog.why_ended(100.0)


@pytest.fixture
def watched() -> Watched:
    return Watched()


def test_who_does_not_acknowledge_a_signal_is_ended_in_time(watched: Watched) -> None:
    watched.now_s = 99.9 + DEAF_S
    assert watched.why_ended is None
    watched.now_s = 100.0 + DEAF_S
    assert watched.why_ended == f'stopped in a step that took more than {DEAF_S:.0f} s'


def test_a_process_that_is_held_up_has_its_time_to_acknowledge_a_signal() -> None:
    clock_s = LookClock()
    watchdog = Watchdog(lambda: False, clock_s)
    asked_s = clock_s()
    assert watchdog.why_ended(asked_s) is None  # however late it is by the wall clock
    while watchdog.why_ended(asked_s) is None:
        clock_s.note_look()
    assert clock_s() == pytest.approx(DEAF_S)
    assert isinstance(stops.watchdog._clock_s, LookClock)


def test_who_compiles_is_ended_at_once(watched: Watched) -> None:
    watched.is_compiling = True
    assert watched.why_ended == 'stopped while it compiled'


def test_who_has_acknowledged_a_signal_may_take_long_and_compile(watched: Watched) -> None:
    watched.watchdog.acknowledge()
    watched.now_s, watched.is_compiling = 1e6, True
    assert watched.why_ended is None
    watched.watchdog.forget()
    assert watched.why_ended is not None


def test_nobody_acknowledges_a_signal_while_kernels_are_compiled(watched: Watched) -> None:
    watched.is_compiling = True
    watched.watchdog.acknowledge()
    assert watched.why_ended == 'stopped while it compiled'


def test_who_saves_when_a_signal_comes_is_not_ended_and_can_look_at_it(watched: Watched) -> None:
    with watched.watchdog.saving():
        with watched.watchdog.saving():
            watched.now_s = 1000.0
        watched.is_compiling = True
        assert watched.why_ended is None
    watched.is_compiling = False
    watched.now_s = 999.9 + DEAF_S
    assert watched.why_ended is None
    watched.now_s = 1000.0 + DEAF_S
    assert watched.why_ended is not None


@pytest.fixture
def own_watchdog(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> Watched:
    """What this process asks whether it is to be ended."""
    monkeypatch.setattr(stops, 'watchdog', watched.watchdog)
    monkeypatch.setattr('uav_collect.commands.terminal.watchdog', watched.watchdog)
    return watched


def test_to_see_a_signal_is_not_to_acknowledge_it(own_watchdog: Watched) -> None:
    own_watchdog.now_s = 1e6
    with deferred_interruption() as interruption:
        assert not interruption.acknowledge()
        signal.raise_signal(signal.SIGTERM)
        assert interruption.signal_number == signal.SIGTERM
        assert own_watchdog.why_ended is not None
        assert interruption.acknowledge()
        assert own_watchdog.why_ended is None


def test_a_second_signal_counts_as_an_interrupt_and_is_acknowledged(own_watchdog: Watched) -> None:
    own_watchdog.now_s, n_before = 1e6, interrupts.n_raised
    with deferred_interruption():
        signal.raise_signal(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
    assert interrupts.n_raised == n_before + 1
    assert own_watchdog.why_ended is None


def test_ctrl_c_is_counted_and_python_has_its_handler_back() -> None:
    n_before = interrupts.n_raised
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # none if started by `&`
    try:
        with pytest.raises(KeyboardInterrupt), interrupts.counted():
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert interrupts.n_raised == n_before + 1


def test_handlers_are_given_back_whatever_is_raised() -> None:
    before = {number: signal.getsignal(number) for number in stop_signals()}
    with pytest.raises(OSError, match='no cluster'), kept_handlers():
        for number in stop_signals():
            signal.signal(number, signal.SIG_IGN)
        raise OSError('no cluster')
    assert {number: signal.getsignal(number) for number in stop_signals()} == before


def test_handlers_that_are_not_pythons_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    before = {number: signal.getsignal(number) for number in stop_signals()}
    with monkeypatch.context() as patched:
        patched.setattr(signal, 'getsignal', lambda _: None)  # as for one that C code installed
        with kept_handlers():
            pass
    assert {number: signal.getsignal(number) for number in stop_signals()} == before


def test_handlers_are_nobodys_matter_outside_of_the_main_thread() -> None:
    came_through = []

    def pass_through() -> None:
        with kept_handlers(), interrupts.counted():
            came_through.append(os.getpid())

    thread = Thread(target=pass_through, daemon=True)
    thread.start()
    thread.join(DEADLINE_S)
    assert came_through == [os.getpid()]


@pytest.mark.parametrize('number', STATUS, ids=lambda it: it.name)
def test_a_step_without_an_end_is_ended(number: signal.Signals, processes: Processes) -> None:
    process = processes.run('deaf', sys.executable, '-c', DEAF, **ENVIRONMENT)
    process.wait_for('begins')
    process.send(number)
    process.wait_for('stopped in a step .* what was saved before is whole')
    assert process.wait_for_exit() == STATUS[number]


@pytest.mark.skipif(not kernels_are_compiled(), reason='nothing is compiled')
def test_a_training_that_compiles_obeys_a_signal(processes: Processes, tmp_path: Path) -> None:
    pytest.importorskip('torch', reason='training needs torch')
    cache = str(tmp_path / 'cache')
    train = (sys.executable, '-m', 'uav_collect', 'train', '--output', 'run')
    training = processes.run('train', *train, XDG_CACHE_HOME=cache, **ENVIRONMENT)
    training.wait_for('compiling kernels')
    training.send(signal.SIGTERM)
    training.wait_for('stopped while it compiled')
    assert training.wait_for_exit() == STATUS[signal.SIGTERM]


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
    assert trainer.wait_for_exit() == 1


@pytest.mark.skipif(not kernels_are_compiled(), reason='nothing is compiled')
def test_an_evaluation_that_compiles_obeys_ctrl_c(processes: Processes, tmp_path: Path) -> None:
    command = (sys.executable, '-m', 'uav_collect', 'evaluate', '--missions', '1')
    flying = processes.run('fly', *command, XDG_CACHE_HOME=str(tmp_path / 'cache'), **ENVIRONMENT)
    flying.wait_for('compiling kernels')
    flying.send(signal.SIGINT)
    assert flying.wait_for_exit() == STATUS[signal.SIGINT]
    assert 'Traceback' not in flying.output

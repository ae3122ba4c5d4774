"""Runs installed executables in tests, watches their output and leaves no process behind.

Use it through the fixture `processes`:

    world = processes.start('world_sim', '--ros-args', '-p', 'seed:=3')
    world.wait_for('waiting for UAV 1')
    world.send(signal.SIGINT)
    assert world.wait_for_exit() == 0
    assert processes.survivors() == []
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
import os
from pathlib import Path
import re
import select
import shlex
import signal
import subprocess
import time
from typing import Any
import uuid

# For what should take seconds: others may have the processor, or compile kernels for it first.
DEADLINE_S = 600.0
_POLL_S = 0.02
_LOOK_S = 0.005  # at what takes no time to judge
_PATIENCE = 9.0  # times as long as a condition takes to judge, until it is judged again
_TAIL_CHARACTERS = 4000
_MARK = 'UAV_COLLECT_TEST'  # inherited by every process of a test, however far down


def wait_until(
    condition: Callable[[], object],
    deadline_s: float = DEADLINE_S,
    *,
    meanwhile: Callable[[], object] | None = None,
) -> None:
    """Wait until something holds.

    Args:
        condition: whether it does.
        deadline_s: how long to wait [s].
        meanwhile: done before each next look, and takes a moment; sleeps if there is nothing.

    Raises:
        AssertionError: it did not in time.
    """
    end_s = time.monotonic() + deadline_s
    while (now_s := time.monotonic()) < end_s:
        if condition():
            return
        if meanwhile is not None:
            meanwhile()
            continue
        # Who reads files again and again would take the processor that others need to write them.
        time.sleep(max(_LOOK_S, _PATIENCE * (time.monotonic() - now_s)))
    raise AssertionError(f'not within {deadline_s} s')


def completed(
    *command: object,
    status: int | None = 0,
    **options: Any,  # noqa: ANN401
) -> 'subprocess.CompletedProcess[str]':
    """Run a command to its end; what it says comes back, or stands in the failure.

    Args:
        command: its words.
        status: with which it has to end; None: any.
        options: of `subprocess.run`.

    Raises:
        AssertionError: it ended otherwise, or not by the deadline.
    """
    words = [str(word) for word in command]
    try:
        done = subprocess.run(
            words, check=False, text=True, timeout=DEADLINE_S,
            **{'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE, **options},
        )  # fmt: skip
    except subprocess.TimeoutExpired as late:
        said = f'{late.stdout}\n{late.stderr}'
        raise AssertionError(f'{shlex.join(words)}\nruns after {DEADLINE_S} s; {said}') from None
    if status not in (None, done.returncode):
        said = f'{done.stdout or ""}{done.stderr or ""}'
        raise AssertionError(f'{shlex.join(words)}\nended with {done.returncode}:\n{said}')
    return done


def complaints(output: str) -> list[str]:
    """The lines of an output but those that say, on a busy machine, what is waited for."""
    return [line for line in output.splitlines() if not line.startswith('waiting for')]


def ros_environment(domain: int, log_folder: Path) -> dict[str, str]:
    """Return the variables that keep a test's ROS traffic to itself and its output plain."""
    return {
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',  # a killed process leaves no shared memory behind
        'ROS_LOG_DIR': str(log_folder),
        'RCUTILS_COLORIZED_OUTPUT': '0',
        'PYTHONUNBUFFERED': '1',
    }


def executable(name: str) -> Path | None:
    """Find an executable of uav_collect in the sourced prefixes, as ros2 run does."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        path = Path(prefix) / 'lib' / 'uav_collect' / name
        if prefix and path.is_file():
            return path
    return None


def hear_signals() -> None:
    """Let a process hear SIGHUP and SIGINT, though the tests may run under nohup or by `&`."""
    for number in (signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)


class RunningProcess:
    """A started executable; its output, both streams, goes to a file."""

    def __init__(self, name: str, popen: subprocess.Popen[bytes], output_file: Path) -> None:
        self.name = name
        self.pid = popen.pid
        self._popen = popen
        self._output_file = output_file
        self._matched_to = 0

    @property
    def output(self) -> str:
        """Everything written so far, as it was written."""
        return self._output_file.read_bytes().decode(errors='replace')

    @property
    def is_running(self) -> bool:
        """Whether it has not exited yet."""
        return self._popen.poll() is None

    def wait_for(self, pattern: str, deadline_s: float = DEADLINE_S) -> re.Match[str]:
        """Wait until the output matches, past what an earlier call matched.

        Args:
            pattern: regular expression, searched in complete lines.
            deadline_s: how long to wait [s].

        Raises:
            AssertionError: it exited or the deadline passed first; with the end of the output.
        """
        end_s = time.monotonic() + deadline_s
        while True:
            has_exited = not self.is_running
            output = self.output
            complete = len(output) if has_exited else output.rfind('\n') + 1
            match = re.compile(pattern, re.MULTILINE).search(output, self._matched_to, complete)
            if match:
                self._matched_to = match.end()
                return match
            if has_exited:
                raise AssertionError(self.described(f'exited before it wrote {pattern!r}'))
            if time.monotonic() > end_s:
                raise AssertionError(
                    self.described(f'did not write {pattern!r} in {deadline_s} s')
                )
            time.sleep(_POLL_S)

    def wait_for_exit(self, deadline_s: float = DEADLINE_S) -> int:
        """Wait until it exits and return its status: negative for the signal that ended it.

        Raises:
            AssertionError: it still runs at the deadline; with the end of the output.
        """
        try:
            return self._popen.wait(deadline_s)
        except subprocess.TimeoutExpired:
            raise AssertionError(self.described(f'still runs after {deadline_s} s')) from None

    def send(self, signal_number: signal.Signals) -> None:
        """Send a signal to the process alone."""
        self._popen.send_signal(signal_number)

    def kill(self) -> None:
        """End it as kill -9 does."""
        self._popen.kill()
        self._popen.wait()

    def close(self) -> None:
        """Kill whatever runs in its session, and reap it."""
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._popen.wait()

    def described(self, complaint: str = '') -> str:
        """The end of its output and how it fares, under a complaint."""
        tail = self.output[-_TAIL_CHARACTERS:]
        status = self._popen.poll()
        return f'{self.name} {complaint} (exit status {status}); its output ends:\n{tail}'


class Processes:
    """The processes of one test."""

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder = folder
        self._mark = uuid.uuid4().hex
        # The whole environment: the wheels' Python depends on what it has set for itself.
        self._environment = {**os.environ, **environment, _MARK: self._mark}
        self._started: list[RunningProcess] = []

    def start(self, name: str, *arguments: str, **environment: str) -> RunningProcess:
        """Start an executable of uav_collect in a session of its own.

        Args:
            name: the installed executable, 'uav_agent' for instance.
            arguments: its command line.
            environment: variables to set or change for it.
        """
        path = executable(name)
        assert path, f'{name} is not installed in a prefix of AMENT_PREFIX_PATH'
        return self.run(name, str(path), *arguments, **environment)

    def run(self, name: str, *command: str, **environment: str) -> RunningProcess:
        """Start any command, under a name for its output file and for failures."""
        output_file = self._folder / f'{len(self._started)}_{name}.txt'
        with output_file.open('wb') as output:
            popen = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**self._environment, **environment},
                cwd=self._folder,
                start_new_session=True,
                preexec_fn=hear_signals,
            )
        process = RunningProcess(name, popen, output_file)
        self._started.append(process)
        return process

    def survivors(self) -> list[int]:
        """Return the ids of the test's processes that run, children in any session included."""
        mark = f'{_MARK}={self._mark}'.encode()
        pids = []
        for environ in Path('/proc').glob('[0-9]*/environ'):
            with suppress(OSError):  # not ours, or gone by now
                if mark in environ.read_bytes().split(b'\0'):
                    pids.append(int(environ.parent.name))
        return pids

    def running(self, executable: str, *arguments: str) -> list[int]:
        """Those of them that run an executable, with arguments next to each other."""
        wanted = b'\0'.join(word.encode() for word in arguments)
        found = []
        for pid in self.survivors():
            with suppress(OSError):  # it has just ended
                words = Path(f'/proc/{pid}/cmdline').read_bytes()
                if f'/{executable}\0'.encode() in words and wanted in words:
                    found.append(pid)
        return found

    def outputs(self) -> str:
        """The ends of all outputs."""
        return '\n'.join(process.described() for process in self._started)

    def close(self) -> None:
        """Kill whatever still runs."""
        for process in self._started:
            process.close()
        while pids := self.survivors():  # one of them may just have started another one
            for pid in pids:
                with suppress(ProcessLookupError):
                    _kill_other(pid)


def _kill_other(pid: int) -> None:
    """Kill a process that is no child of ours and wait for its end."""
    handle = os.pidfd_open(pid)
    try:
        signal.pidfd_send_signal(handle, signal.SIGKILL)
        select.select([handle], [], [], DEADLINE_S)
    finally:
        os.close(handle)

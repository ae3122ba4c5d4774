"""The processes of a mission: the recorder, the world and one agent per UAV; and of a training."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

from uav_collect.commands.terminal import ignore_signals, interrupted_by_signals
from uav_collect.config.packages import ros_problem
from uav_collect.errors import FleetError, MissingPackageError
from uav_collect.kernels.patience import waiting_for

_STOP_S = 30.0  # how long a process may take to end after SIGINT; one that is deaf ends itself
_PARTICIPANTS = 30  # that find each other where discovery stays on this machine
_RESTARTS = 3  # of one process within _RESTART_S; more, and something is wrong with it
_RESTART_S = 60.0
_ERROR_LINE = re.compile(r'(?:error: |\[(?:ERROR|FATAL)\] \[[^]]*\] \[[^]]*\]: )(.+)')  # of a node


Arguments = Sequence[str] | Callable[[], Sequence[str]]  # those of every start, or of the next one


@dataclass(frozen=True, kw_only=True)
class _Start:
    """How a process was started, to start it again."""

    executable: str
    arguments: Arguments
    stop_s: float
    ends_last: bool


@dataclass(frozen=True, kw_only=True)
class FleetProcess:
    """One running executable."""

    name: str
    log: Path | None  # what it says; None: it says it here
    popen: 'subprocess.Popen[bytes]'
    start: _Start

    def log_lines(self) -> list[str]:
        """What it has said, if that went to a log."""
        return [] if self.log is None else self.log.read_text(errors='replace').splitlines()

    def log_tail(self) -> str:
        """What it said of its error, in one line, or else the last lines of its log."""
        lines = self.log_lines()
        if not lines:
            return ''
        if errors := [found[1] for found in map(_ERROR_LINE.match, lines) if found]:
            return f': {errors[-1]} ({self.log})'
        tail = '\n'.join(f'  {line}' for line in lines[-5:])
        return f'; its last words, from {self.log}:\n{tail}'


class Fleet:
    """Starts executables, restarts those that were killed, and ends them all."""

    def __init__(self, folder: Path, n_processes: int) -> None:
        """Keep the logs in a folder; so many processes will be started."""
        self._folder = folder
        self._environment = _environment(folder, n_processes)
        self._running: list[FleetProcess] = []
        self._restarts: list[tuple[str, float]] = []  # which process, when

    def start(
        self,
        executable: str,
        log_name: str,
        arguments: Arguments,
        *,
        stop_s: float = _STOP_S,
        is_shown: bool = False,
        ends_last: bool = False,
    ) -> FleetProcess:
        """Start an executable of uav_collect.

        Args:
            log_name: names the process and its log.
            arguments: of its command line; a function where each start has others.
            stop_s: how long it may take to end after SIGINT.
            is_shown: what it says goes where this process says things.
            ends_last: it ends after the others, to receive their last messages.

        Raises:
            FleetError: the package is not built, or not sourced.
        """
        start = _Start(
            executable=find_executable(executable),
            arguments=arguments,
            stop_s=stop_s,
            ends_last=ends_last,
        )
        log = None if is_shown else self._folder / f'{log_name}.log'
        return self._launch(log_name, log, start)

    def check(self, *, but: str = '') -> None:
        """Raise FleetError if a process failed, other than one by name."""
        for process in self._running:
            if process.name == but:
                continue
            status = process.popen.poll()
            if status not in (None, 0):
                what = f'{process.name} failed with exit status {status}'
                raise FleetError(f'{what}{process.log_tail()}')

    def restart_killed(self) -> list[str]:
        """Start again what was killed by a signal; the names.

        Raises:
            FleetError: a process failed by itself, or is killed again and again.
        """
        now_s = time.monotonic()
        self._restarts = [each for each in self._restarts if now_s - each[1] < _RESTART_S]
        killed = [it for it in self._running if (it.popen.poll() or 0) < 0]
        for process in killed:
            self._restarts.append((process.name, now_s))
            if sum(name == process.name for name, _ in self._restarts) > _RESTARTS:
                break
            self._running.remove(process)
            self._launch(process.name, process.log, process.start)
        self.check()
        return [process.name for process in killed]

    def status(self, name: str) -> int | None:
        """The exit status of a process; None while it runs."""
        [popen] = [process.popen for process in self._running if process.name == name]
        return popen.poll()

    def stop(self) -> None:
        """End what still runs: SIGINT, and SIGKILL for what does not listen."""
        for ends_last in (False, True):
            _end([it for it in self._running if it.start.ends_last == ends_last])

    def _launch(self, name: str, log: Path | None, start: _Start) -> FleetProcess:
        arguments = start.arguments() if callable(start.arguments) else start.arguments
        with log.open('ab') if log else nullcontext() as output:
            popen = subprocess.Popen(
                (start.executable, *arguments),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output and subprocess.STDOUT,
                env=self._environment,
                start_new_session=True,  # Ctrl-C is for this process, which ends them in order
            )
        process = FleetProcess(name=name, log=log, popen=popen, start=start)
        self._running.append(process)
        return process


def _end(processes: Sequence[FleetProcess]) -> None:
    for process in processes:
        if process.popen.poll() is None:
            process.popen.send_signal(signal.SIGINT)
    asked_s = time.monotonic()
    for process in sorted(processes, key=lambda it: it.start.stop_s):
        left_s = asked_s + process.start.stop_s - time.monotonic()
        try:
            process.popen.wait(max(0.0, left_s))
        except subprocess.TimeoutExpired:
            process.popen.kill()
            process.popen.wait()


def check_ros() -> None:
    """Make sure that nodes can be started.

    Raises:
        MissingPackageError: ROS or the messages are not there.
    """
    if problem := ros_problem():
        raise MissingPackageError(problem)


def ros_parameters(**values: object) -> list[str]:
    """ROS parameters on a command line; texts stay texts even if they read like numbers."""
    assigned = [f'{name}:={_yaml(value)}' for name, value in values.items()]
    return ['--ros-args', *(word for each in assigned for word in ('-p', each))]


@contextmanager
def running_fleet(folder: Path, n_processes: int) -> Iterator[Fleet]:
    """A fleet whose processes end with the context, however it is left.

    Raises:
        KeyboardInterrupt: a signal asked this process to end.
    """
    fleet = Fleet(folder, n_processes)
    with interrupted_by_signals():
        try:
            yield fleet
        finally:
            ignore_signals()  # impatience must not leave a process behind
            with waiting_for('the processes to end'):
                fleet.stop()


def _yaml(value: object) -> str:
    if isinstance(value, str | Path):
        return "'{}'".format(str(value).replace("'", "''"))
    if isinstance(value, list):
        return f'[{", ".join(map(_yaml, value))}]'
    return str(value)


def find_executable(executable: str) -> str:
    """The path of an executable of uav_collect in a sourced prefix, or where pip put it.

    Raises:
        FleetError: it is in none.
    """
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    for prefix in filter(None, [*prefixes, sys.prefix]):  # where pip has installed them, the last
        path = Path(prefix) / 'lib' / 'uav_collect' / executable
        if path.is_file():
            return str(path)
    raise FleetError(
        f'{executable} is not in AMENT_PREFIX_PATH: build with "make setup", then '
        'source install/setup.bash'
    )


def _environment(folder: Path, n_processes: int) -> Mapping[str, str]:
    # Missions of one machine stay on it, unless the user says otherwise.
    reach = 'LOCALHOST' if n_processes <= _PARTICIPANTS else 'SUBNET'
    defaults = {'ROS_AUTOMATIC_DISCOVERY_RANGE': reach, 'PYTHONUNBUFFERED': '1'}
    if not os.access(os.environ.get('HOME', ''), os.W_OK):  # where ROS would keep its log
        defaults['ROS_LOG_DIR'] = str(folder.absolute())
    # ROS takes no path of any other encoding, whatever that of the terminal.
    return {**defaults, **os.environ, 'PYTHONUTF8': '1', 'RCUTILS_COLORIZED_OUTPUT': '0'}

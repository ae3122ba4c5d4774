"""The processes of a mission: the recorder, the world and one agent per UAV."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
import signal
import subprocess
import time

_STOP_S = 5.0  # how long a process may take to end after SIGINT
_PARTICIPANTS = 30  # that find each other where discovery stays on this machine


class FleetError(RuntimeError):
    """A mission's processes cannot start, or one of them failed: which, and its last words."""


@dataclass(frozen=True, kw_only=True)
class FleetProcess:
    """One running executable; what it says goes to its log."""

    name: str
    log: Path
    popen: 'subprocess.Popen[bytes]'

    def last_words(self) -> str:
        """The end of its log."""
        lines = self.log.read_text(errors='replace').splitlines()
        return '\n'.join(f'  {line}' for line in lines[-5:])


class Fleet:
    """Starts executables and sees to their end."""

    def __init__(self, folder: Path, n_processes: int) -> None:
        """Keep the logs in a folder; so many processes will be started."""
        self._folder = folder
        self._environment = _environment(n_processes)
        self._running: list[FleetProcess] = []

    def start(self, executable: str, log_name: str, arguments: Sequence[str]) -> FleetProcess:
        """Start an executable of uav_collect.

        Raises:
            FleetError: the package is not built, or not sourced.
        """
        log = self._folder / f'{log_name}.log'
        with log.open('wb') as output:
            popen = subprocess.Popen(
                [_find(executable), *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=self._environment,
                start_new_session=True,  # Ctrl-C is for this process, which ends them in order
            )
        process = FleetProcess(name=log_name, log=log, popen=popen)
        self._running.append(process)
        return process

    def check(self) -> None:
        """Raise FleetError if a process failed."""
        for process in self._running:
            status = process.popen.poll()
            if status not in (None, 0):
                raise FleetError(
                    f'{process.name} failed with exit status {status}; its last words, '
                    f'from {process.log}:\n{process.last_words()}'
                )

    def stop(self) -> None:
        """End what still runs: SIGINT, and SIGKILL for what does not listen.

        What was started first, the recorder, ends last: it hears the last words of the others.
        """
        _end(self._running[1:])
        _end(self._running[:1])


def _end(processes: Sequence[FleetProcess]) -> None:
    for process in processes:
        if process.popen.poll() is None:
            process.popen.send_signal(signal.SIGINT)
    deadline_s = time.monotonic() + _STOP_S
    for process in processes:
        try:
            process.popen.wait(max(0.0, deadline_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.popen.kill()
            process.popen.wait()


@contextmanager
def running_fleet(folder: Path, n_processes: int) -> Iterator[Fleet]:
    """A fleet whose processes end with the context, however it is left.

    Raises:
        KeyboardInterrupt: SIGINT came, or SIGTERM.
    """
    fleet = Fleet(folder, n_processes)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield fleet
    finally:
        for number in before:  # impatience must not leave a process behind
            signal.signal(number, signal.SIG_IGN)
        fleet.stop()
        for number, handler in before.items():
            signal.signal(number, handler)


def _find(executable: str) -> str:
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    for prefix in filter(None, prefixes):
        path = Path(prefix) / 'lib' / 'uav_collect' / executable
        if path.is_file():
            return str(path)
    raise FleetError(
        f'{executable} is not in AMENT_PREFIX_PATH: build with "make setup", then '
        'source install/setup.bash'
    )


def _environment(n_processes: int) -> Mapping[str, str]:
    # Missions of one machine stay on it, unless the user says otherwise.
    reach = 'LOCALHOST' if n_processes <= _PARTICIPANTS else 'SUBNET'
    defaults = {'ROS_AUTOMATIC_DISCOVERY_RANGE': reach, 'PYTHONUNBUFFERED': '1'}
    return {**defaults, **os.environ, 'RCUTILS_COLORIZED_OUTPUT': '0'}

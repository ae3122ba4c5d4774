"""Does jobs in processes of this machine, each doing one after another."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
import math
import multiprocessing
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
import signal
from time import monotonic
from traceback import format_exc

from uav_collect.kernels import patience
from uav_collect.studies.jobs.worker_messages import (
    Advanced,
    failure_of,
    JobEnd,
    JobReport,
    Lost,
    Saved,
    Stopped,
    Stopping,
    WorkItem,
)

_STOP = 'stop'
_END_S = 5.0  # until a process that was asked to end is killed
_STOPPING_S = 6.0  # until one that does not say that it leaves its job is: it compiles
_SAVING_S = 60.0  # the same for one that is amidst its job: on a busy machine a step takes long


@dataclass(eq=False)
class _Worker:
    process: BaseProcess
    connection: Connection
    digest: str | None = None  # of the job that it does
    has_advanced: bool = False  # in that job, so there is something to lose


class ProcessEngine:
    """An engine that does each job in a process of this machine."""

    def __init__(self, n_slots: int) -> None:
        """Start no process yet: each is started when there is a job for it."""
        self._n_slots = n_slots
        self._workers: list[_Worker] = []
        self._stopped_s = math.inf
        self._answered: set[str] = set()  # digests
        self._context = multiprocessing.get_context('spawn')  # torch and numba have threads

    @property
    def n_slots(self) -> int:
        """How many jobs are done at once."""
        return self._n_slots

    def start(self, task: WorkItem) -> None:
        """Start a job in a process that is idle, or in a new one."""
        worker = next((it for it in self._workers if it.digest is None), None)
        if worker is None:
            worker = self._new_worker()
        worker.digest, worker.has_advanced = task.digest, False
        _send(worker, task)

    def wait(self, timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        """Reports of jobs; of one whose process is gone, that it is lost."""
        reports: list[tuple[str, JobReport]] = []
        by_connection = {worker.connection: worker for worker in self._workers}
        for connection in wait([*by_connection], timeout_s):
            worker = by_connection[connection]  # type: ignore[index]
            digest = worker.digest
            report = self._receive(worker)
            if digest is not None:
                reports.append((digest, report))
        self._kill_deaf()
        return reports

    def _kill_deaf(self) -> None:
        """Kill who was asked to leave its job long ago, and has said nothing that is not read."""
        for worker in self._workers:
            patience_s = _SAVING_S if worker.has_advanced else _STOPPING_S
            is_late = monotonic() >= self._stopped_s + patience_s
            is_asked = worker.digest not in (None, *self._answered)
            if is_late and is_asked and not worker.connection.poll():
                worker.process.kill()

    def stop(self) -> None:
        """Ask all processes to save and leave their jobs; who does not answer is killed."""
        self._stopped_s = monotonic()
        for worker in self._workers:
            if worker.digest is not None:
                _send(worker, _STOP)

    def close(self) -> None:
        """End the processes, after a while by force."""
        for worker in self._workers:
            worker.connection.close()  # what waits for jobs ends by itself
        until_s = monotonic() + _END_S
        for worker in self._workers:
            if worker.digest is not None:
                worker.process.kill()
            worker.process.join(max(0.0, until_s - monotonic()))
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
        self._workers.clear()

    def _new_worker(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_worker_loop, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        worker = _Worker(process, ours)
        self._workers.append(worker)
        return worker

    def _receive(self, worker: _Worker) -> JobReport:
        try:
            report: JobReport = worker.connection.recv()
        except (EOFError, OSError):
            self._workers.remove(worker)
            worker.connection.close()
            worker.process.join()
            if math.isfinite(self._stopped_s):
                return Stopped()
            return Lost(why=f'process {worker.process.pid} ended: {worker.process.exitcode}')
        worker.has_advanced |= isinstance(report, Advanced | Saved)
        if isinstance(report, Stopping) and worker.digest is not None:
            self._answered.add(worker.digest)
        if isinstance(report, JobEnd):
            worker.digest = None
        return report


def _send(worker: _Worker, what: WorkItem | str) -> None:
    with suppress(BrokenPipeError):  # it is gone, which `wait` will report
        worker.connection.send(what)


def _worker_loop(connection: Connection) -> None:
    """Do jobs until there is nobody who gives any."""
    patience.be_silent()  # the schedule says what this process does
    # Who started us says when to stop, whoever else in our group is asked to.
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    try:
        while True:
            task = connection.recv()
            if task != _STOP:  # which may come when the job is just done
                _do_job(task, connection)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def _do_job(task: WorkItem, connection: Connection) -> None:
    from uav_collect.studies.jobs.work import run_job

    asked = False

    def is_stopping() -> bool:
        nonlocal asked
        if not asked and connection.poll():
            asked = connection.recv() == _STOP
            connection.send(Stopping())
        return asked

    steps = run_job(task, is_stopping)
    last: JobReport | None = None
    while not isinstance(last, JobEnd):
        try:
            last = next(steps, Stopped())
        except Exception as error:  # whatever it is: it is said where it is seen
            last = failure_of(error, format_exc())
        connection.send(last)

"""Schedules jobs on an engine: those that are missing, long ones first, lost ones again."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol

from uav_collect.kernels.stops import watchdog
from uav_collect.studies.jobs.jobs import Job, job_inputs, POLICY
from uav_collect.studies.jobs.reservations import Reservations, reserving
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import (
    Advanced,
    Compiling,
    Failed,
    Finished,
    JobEnd,
    JobReport,
    Lost,
    Saved,
    Started,
    StateRefused,
    WorkItem,
)

_WAIT_S = 0.5
_MAX_LOSSES = 5  # of one job without a new state: then it is the job


class JobEngine(Protocol):
    """Does jobs, several at once."""

    @property
    def n_slots(self) -> int:
        """How many jobs it does at once."""

    def start(self, task: WorkItem) -> None:
        """Start a job."""

    def wait(self, timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        """Reports that came meanwhile, each with the digest of its job; none if the time is up."""

    def stop(self) -> None:
        """Ask all jobs to be left, saved where they can be; what does not answer is ended."""

    def close(self) -> None:
        """End all workers, whatever they do."""


@dataclass
class JobsStatus:
    """How many jobs are done, which ones run, and which ones failed."""

    total: int
    done: int = 0  # the ones found among them
    running: dict[str, float] = field(default_factory=dict)  # share done, by digest
    compiling: set[str] = field(default_factory=set)  # of them
    hosts: dict[str, str] = field(default_factory=dict)  # who does them
    elsewhere: set[str] = field(default_factory=set)  # another command does them
    n_lost: int = 0
    failures: dict[str, str] = field(default_factory=dict)  # why, by digest
    blocked: set[str] = field(default_factory=set)  # need what failed


Show = Callable[[JobsStatus], None]
_Turn = tuple[int, float]


@dataclass
class _Run:
    jobs: Mapping[str, Job]
    store: Store
    reserved: Reservations
    engine: JobEngine
    checkpoint_s: float
    status: JobsStatus
    waiting: list[str]
    n_losses: dict[str, int] = field(default_factory=dict)  # since their last states
    begun_anew: set[str] = field(default_factory=set)  # as their states were refused

    def start_ready(self) -> None:
        for digest in list(self.waiting):
            if len(self.status.running) >= self.engine.n_slots:
                return
            inputs = job_inputs(self.jobs[digest])
            if any(it in self.status.failures or it in self.status.blocked for it in inputs):
                self.waiting.remove(digest)
                self.status.blocked.add(digest)
            elif not self.store.missing(inputs):
                self.start_or_wait(digest)

    def start_or_wait(self, digest: str) -> None:
        if not self.reserved.take(digest):
            self.status.elsewhere.add(digest)
            return
        self.status.elsewhere.discard(digest)
        self.waiting.remove(digest)
        if self.store.has(digest):  # another command was faster
            self.reserved.free(digest)
            self.status.done += 1
        else:
            self.start(digest)

    def start(self, digest: str) -> None:
        job = self.jobs[digest]
        inputs = {it: self.store.read(it, POLICY) for it in job_inputs(job)}
        self.engine.start(
            WorkItem(
                digest=digest,
                job=job,
                inputs=inputs,
                state=self.store.state(digest),
                checkpoint_s=self.checkpoint_s,
            )
        )
        self.status.running[digest] = 0.0

    def handle(self, digest: str, report: JobReport) -> None:
        self.status.compiling.discard(digest)
        if isinstance(report, JobEnd):  # whether the disk takes what follows or not
            self.end(digest)
        match report:
            case Started(host=host):
                self.status.hosts[digest] = host
            case Compiling():
                self.status.compiling.add(digest)
            case Advanced(share_done=share_done):
                self.status.running[digest] = share_done
            case Saved(state=state, share_done=share_done):
                self.status.running[digest] = share_done
                self.store.save_state(digest, state)
                self.n_losses.pop(digest, None)  # it gets on
            case Finished(results=results, cost=cost):
                self.store.save(self.jobs[digest], results, cost)
                self.status.done += 1
            case Failed(why=why, trace=trace):
                self.fail(digest, why, trace)
            case StateRefused(why=why, trace=trace):
                self.store.drop_state(digest)
                self.begin_anew(digest, why, trace)
            case Lost(why=why):
                self.retry(digest, why)
        if isinstance(report, JobEnd):  # now that everything is kept
            self.reserved.free(digest)

    def fail(self, digest: str, why: str, trace: str) -> None:
        self.status.failures[digest] = why
        self.store.save_failure(digest, trace)

    def begin_anew(self, digest: str, why: str, trace: str) -> None:
        if digest in self.begun_anew:
            self.fail(digest, why, trace)
        else:
            self.begun_anew.add(digest)
            self.waiting.insert(0, digest)

    def retry(self, digest: str, why: str) -> None:
        self.status.n_lost += 1
        self.n_losses[digest] = self.n_losses.get(digest, 0) + 1
        if self.n_losses[digest] > _MAX_LOSSES:
            often = f'lost {self.n_losses[digest]} times: {why}'
            self.fail(digest, often, f'{often}\n')
        else:
            self.waiting.insert(0, digest)

    def end(self, digest: str) -> None:
        self.status.running.pop(digest, None)
        self.status.hosts.pop(digest, None)


def run_jobs(
    jobs: Mapping[str, Job],
    store: Store,
    engine: JobEngine,
    *,
    checkpoint_s: float,
    order: Callable[[Job], _Turn],
    is_stopping: Callable[[], bool],
    show: Show,
) -> JobsStatus:
    """Do all jobs that the store lacks.

    Args:
        jobs: by digest, those that others need among them.
        checkpoint_s: time between two states that are kept.
        order: of the jobs that could begin the smallest comes first.
        is_stopping: once it is true, jobs are left, saved where they can be.
        show: called with the status after each wait.

    Raises:
        OSError: the disk does not take what was found.
    """
    missing = store.missing(_needed_first(jobs, order))
    status = JobsStatus(total=len(jobs), done=len(jobs) - len(missing))
    try:
        with reserving(store.folder) as reserved:
            run = _Run(jobs, store, reserved, engine, checkpoint_s, status, missing)
            try:
                _do_all(run, is_stopping, show)
            except Exception:
                _save_what_runs(run)
                raise
    finally:
        engine.close()
    show(status)
    return status


def _do_all(run: _Run, is_stopping: Callable[[], bool], show: Show) -> None:
    while run.waiting or run.status.running:
        if is_stopping():
            _stop_and_wait(run, show)
            break
        with watchdog.saving():  # what is drawn may take longer than a signal may go unseen
            run.start_ready()
            show(run.status)
        for digest, report in run.engine.wait(_WAIT_S):
            run.handle(digest, report)


def _needed_first(jobs: Mapping[str, Job], order: Callable[[Job], _Turn]) -> Iterable[str]:
    return sorted(jobs, key=lambda digest: (order(jobs[digest]), digest))


def _save_what_runs(run: _Run) -> None:
    """Stop, and save what can be, after an error that ends the call."""
    with watchdog.saving():
        run.engine.stop()
        while run.status.running:
            for digest, report in run.engine.wait(_WAIT_S):
                with suppress(OSError):  # the first one is told
                    run.handle(digest, report)


def _stop_and_wait(run: _Run, show: Show) -> None:
    """Stop, and wait until what runs is saved."""
    run.engine.stop()
    while run.status.running:
        for digest, report in run.engine.wait(_WAIT_S):
            run.handle(digest, report)
        show(run.status)

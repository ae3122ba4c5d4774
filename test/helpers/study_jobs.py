"""Small jobs for tests of studies, who does them, and what may go wrong."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
import itertools
import os
from pathlib import Path
import signal

from episodes import small
import pytest
from tiny_world import tiny, uav
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.studies.jobs.jobs import digest_of, FlightsJob, Job, training_job
from uav_collect.studies.jobs.schedule import JobEngine, JobsStatus, run_jobs
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import JobReport, Saved, Started, WorkItem

FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)
FIELD = tiny(*FLEET)

needs_compiled_kernels = pytest.mark.skipif(
    not kernels_are_compiled(), reason='a checkpoint of lists cannot be set back'
)


def training(seed: int = 0, decisions: int = 1000, **changes: object) -> Job:
    return training_job(FIELD, small('strong', **changes), 'aqmix', seed, decisions)


def flights(*trainings: Job, n_missions: int = 3, **changes: object) -> FlightsJob:
    job = FlightsJob(
        scenario=FIELD.to_yaml(),
        policy='aqmix' if trainings else 'sweep',
        trainings=tuple(map(digest_of, trainings)),
        bandwidth='exact',
        first_seed=5,
        n_missions=n_missions,
        keeps_logs=False,
    )
    return replace(job, **changes)  # type: ignore[arg-type]


def by_digest(*jobs: Job) -> dict[str, Job]:
    return {digest_of(job): job for job in jobs}


def kept(store: Store) -> dict[str, bytes]:
    """All files that jobs gave, but for what they took."""
    folders = store.folder / 'jobs'
    return {
        str(path.relative_to(folders)): path.read_bytes()
        for path in sorted(folders.rglob('*'))
        if path.is_file() and path.name != 'cost.json'
    }


def done_by(
    engine: JobEngine,
    jobs: Mapping[str, Job],
    store: Store,
    *,
    checkpoint_s: float = 1e6,
    is_stopping: Callable[[], bool] = lambda: False,
    show: Callable[[JobsStatus], None] = lambda status: None,
) -> JobsStatus:
    return run_jobs(
        jobs,
        store,
        engine,
        checkpoint_s=checkpoint_s,
        order=lambda job: (0, 0.0),
        is_stopping=is_stopping,
        show=show,
    )


@dataclass
class Saboteur:
    """An engine of which the first worker that saved its job is killed."""

    engine: JobEngine
    at: dict[str, int] = field(default_factory=dict)  # processes by digest
    killed: list[str] = field(default_factory=list)

    @property
    def n_slots(self) -> int:
        return self.engine.n_slots

    def start(self, task: WorkItem) -> None:
        self.engine.start(task)

    def wait(self, timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        reports = self.engine.wait(timeout_s)
        for digest, report in reports:
            if isinstance(report, Started):
                self.at[digest] = report.process
            if isinstance(report, Saved) and not self.killed:
                self.killed.append(digest)
                os.kill(self.at[digest], signal.SIGKILL)
        return reports

    def stop(self) -> None:
        self.engine.stop()

    def close(self) -> None:
        self.engine.close()


def sabotaged(
    make_engine: Callable[[], JobEngine], jobs: Mapping[str, Job], folder: Path
) -> tuple[JobsStatus, Store, str]:
    """Do jobs, of which one loses its worker once it was saved; that job's digest.

    Where the job was done before its worker was killed, all begins anew.
    """
    for number in itertools.count():
        store, engine = Store(folder / str(number)), Saboteur(make_engine())
        status = done_by(engine, jobs, store, checkpoint_s=0.0)
        [killed] = engine.killed
        if store.cost(killed).n_interruptions:
            return status, store, killed
    raise RuntimeError('numbers have come to an end')

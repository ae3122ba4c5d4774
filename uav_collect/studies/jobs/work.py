"""Does a job in this process: a stream of events that ends with its results.

Every engine runs this one function, so results do not depend on the engine.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import islice
import os
import socket
from time import monotonic, process_time

from uav_collect.kernels.compile import (
    kernels_are_cached,
    kernels_are_compiled,
    sources_digest,
)
from uav_collect.learning.checkpoint import checkpoint_bytes, checkpoint_from_bytes
from uav_collect.learning.saved import SavedPart
from uav_collect.missions import batch_kernels
from uav_collect.planning import bound
from uav_collect.revision import git_revision, package_versions
from uav_collect.studies.jobs.flights import run_flights, run_plans
from uav_collect.studies.jobs.jobs import FlightsJob, Job, PlansJob, TrainingJob
from uav_collect.studies.jobs.worker_messages import (
    Advanced,
    Compiling,
    Cost,
    Finished,
    JobEvent,
    Saved,
    Started,
    WorkItem,
)


@dataclass
class _Meter:
    """Measures what a job takes, in this process and in those that it was resumed from."""

    before: Cost

    def __post_init__(self) -> None:
        self._cpu_s, self._wall_s = process_time(), monotonic()

    def cost(self) -> Cost:
        return replace(
            self.before,
            cpu_s=self.before.cpu_s + process_time() - self._cpu_s,
            wall_s=self.before.wall_s + monotonic() - self._wall_s,
            host=socket.gethostname(),
            revision=git_revision(),
            sources=sources_digest(),
            versions=package_versions(),
        )


def run_job(task: WorkItem, is_stopping: Callable[[], bool] = lambda: False) -> Iterator[JobEvent]:
    """Do a job.

    Args:
        task: the job; with a state it goes on from there.
        is_stopping: asked from time to time; where it is true the job is left, saved if it can be,
            without a `Finished`.

    Raises:
        ValueError: the job cannot be done: `ConfigError`, `PolicyMismatchError` and such.
    """
    return _compiling_said(task.job, _perform(task, is_stopping))


def _compiling_said(job: Job, events: Iterator[JobEvent]) -> Iterator[JobEvent]:
    """Events of a job; where its kernels are not compiled yet, that its first step does it."""
    if kernels_are_compiled() and not kernels_are_cached(kernels_of(job)):
        yield from islice(events, 1)
        yield Compiling()
    yield from events


def kernels_of(job: Job) -> tuple[Callable[..., object], ...]:
    """The kernels that do most of a job."""
    match job:
        case TrainingJob() | FlightsJob():
            return batch_kernels.KERNELS
        case PlansJob():
            return bound.KERNELS


def _perform(task: WorkItem, is_stopping: Callable[[], bool]) -> Iterator[JobEvent]:
    yield Started(host=socket.gethostname(), process=os.getpid(), sources=sources_digest())
    state, before = None, Cost()
    if task.state is not None:
        saved = SavedPart(checkpoint_from_bytes(task.state))
        state, before = saved.part('job'), _cost_of(saved.part('cost'))
        before = replace(before, n_interruptions=before.n_interruptions + 1)
    meter = _Meter(before)
    match task.job:
        case TrainingJob() as job:
            from uav_collect.studies.jobs.learning import run_training

            steps = run_training(job, state, task.checkpoint_s, is_stopping)
        case FlightsJob() as job:
            steps = run_flights(job, task.inputs, is_stopping)
        case PlansJob() as job:
            steps = run_plans(job, is_stopping)
    for step in steps:
        match step:
            case float():
                yield Advanced(share_done=step)
            case (float() as share_done, job_state):
                content = checkpoint_bytes({'job': job_state, 'cost': asdict(meter.cost())})
                yield Saved(state=content, share_done=share_done)
            case results:
                yield Finished(results=results, cost=meter.cost())


def _cost_of(cost: SavedPart) -> Cost:
    versions = cost.part('versions')
    return Cost(
        cpu_s=cost.number('cpu_s', low=0.0),
        wall_s=cost.number('wall_s', low=0.0),
        n_interruptions=cost.whole('n_interruptions'),
        host=cost.text('host'),
        revision=cost.text('revision'),
        sources=cost.text('sources'),
        versions={name: versions.text(name) for name in versions.names},
    )

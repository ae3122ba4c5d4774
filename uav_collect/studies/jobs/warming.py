"""Has kernels compiled by one process, while others that need them wait for its copy."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import fcntl

from uav_collect.kernels.compile import cache_folder, kernels_are_cached, kernels_are_compiled
from uav_collect.missions import rollout, vector_env
from uav_collect.planning import bound
from uav_collect.studies.jobs.jobs import FlightsJob, Job, PlansJob, TrainingJob
from uav_collect.studies.jobs.worker_messages import Began, Event


def in_turn(job: Job, events: Iterator[Event]) -> Iterator[Event]:
    """Events of a job; where its kernels are not compiled yet, up to the first step in turn."""
    if not kernels_are_compiled():
        yield from events
        return
    with _turn():
        if not kernels_are_cached(kernels_of(job)):
            for event in events:
                yield event
                if not isinstance(event, Began):
                    break
    yield from events


@contextmanager
def _turn() -> Iterator[None]:
    """Hold the lock of this machine's kernels."""
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / 'studies.lock').open('w') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def kernels_of(job: Job) -> tuple[Callable[..., object], ...]:
    """The kernels that do most of a job."""
    match job:
        case TrainingJob():
            return vector_env.KERNELS
        case FlightsJob(trainings=trainings):
            return vector_env.KERNELS if trainings else rollout.KERNELS
        case PlansJob():
            return bound.KERNELS

"""The messages between a scheduler and its workers, in one process or across machines."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from uav_collect.errors import CheckpointError
from uav_collect.studies.jobs.jobs import Job


@dataclass(frozen=True, kw_only=True)
class WorkItem:
    """A job with everything that a worker anywhere needs to do it."""

    digest: str
    job: Job
    inputs: Mapping[str, bytes]  # the policies' files, by the digest of their training
    state: bytes | None  # to go on from
    checkpoint_s: float  # time between two states that are reported


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What a job took, and who did it: nothing that its result depends on."""

    cpu_s: float = 0.0
    wall_s: float = 0.0
    n_interruptions: int = 0  # it went on from a state so many times
    host: str = ''
    revision: str = ''
    sources: str = ''  # digest of the modules
    versions: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Started:
    """A worker has started the job."""

    host: str
    process: int
    sources: str


@dataclass(frozen=True, kw_only=True)
class Compiling:
    """The worker compiles kernels, or waits for another one of its machine that does."""


@dataclass(frozen=True, kw_only=True)
class Advanced:
    """How far the job is."""

    share_done: float


@dataclass(frozen=True, kw_only=True)
class Saved:
    """A state that the job can be resumed from."""

    state: bytes
    share_done: float


@dataclass(frozen=True, kw_only=True)
class Finished:
    """The job is done: what came out, and what it took."""

    results: Mapping[str, bytes]  # files by name
    cost: Cost


JobEvent = Started | Compiling | Advanced | Saved | Finished


@dataclass(frozen=True, kw_only=True)
class Lost:
    """The worker is gone; another one can do the job."""

    why: str


@dataclass(frozen=True, kw_only=True)
class Failed:
    """The job failed, maybe for a reason that passes, as a full disk: its state stays."""

    why: str  # one line
    trace: str


@dataclass(frozen=True, kw_only=True)
class StateRefused:
    """The job cannot go on from the state that was kept of it; from its beginning it can."""

    why: str  # one line
    trace: str


@dataclass(frozen=True, kw_only=True)
class Stopping:
    """The worker knows that it is to leave the job, and saves it."""


@dataclass(frozen=True, kw_only=True)
class Stopped:
    """The worker left the job unfinished, as it was asked to."""


JobEnd = Finished | Lost | Failed | StateRefused | Stopped
JobReport = JobEvent | JobEnd | Stopping


def failure_of(error: BaseException, trace: str) -> Failed | StateRefused:
    """What is reported of a job that raised an error."""
    why = f'{type(error).__name__}: {error}'
    if isinstance(error, CheckpointError):
        return StateRefused(why=why, trace=trace)
    return Failed(why=why, trace=trace)

"""What is told between who hands out jobs and who does them, in one process or across machines."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from uav_collect.studies.jobs.jobs import Job


@dataclass(frozen=True, kw_only=True)
class WorkItem:
    """A job with all that is needed to do it anywhere."""

    digest: str
    job: Job
    inputs: Mapping[str, bytes]  # the policies' files, by the digest of their training
    state: bytes | None  # to go on from
    checkpoint_s: float  # time between two states that are told


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
    """The job is being done."""

    host: str
    process: int
    sources: str


@dataclass(frozen=True, kw_only=True)
class Advanced:
    """How far a job is."""

    share_done: float


@dataclass(frozen=True, kw_only=True)
class Saved:
    """What the job can go on from."""

    state: bytes
    share_done: float


@dataclass(frozen=True, kw_only=True)
class Finished:
    """What came out."""

    results: Mapping[str, bytes]  # files by name
    cost: Cost


Event = Started | Advanced | Saved | Finished


@dataclass(frozen=True, kw_only=True)
class Lost:
    """Who did the job is gone; another one can."""

    why: str


@dataclass(frozen=True, kw_only=True)
class Failed:
    """The job cannot be done: it would fail again."""

    why: str  # one line
    trace: str


@dataclass(frozen=True, kw_only=True)
class Stopped:
    """The job was left as it was asked to be."""


Report = Event | Lost | Failed | Stopped

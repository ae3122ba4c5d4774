"""Does jobs on a Ray cluster: on whatever machines it has, without a disk that they share.

A task streams the events of its job back, states and results as bytes, so losing a machine loses
what it did since its last state.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from time import sleep
from typing import Any

import ray
from ray.exceptions import (
    GetTimeoutError,
    NodeDiedError,
    ObjectLostError,
    OutOfMemoryError,
    RayError,
    RayTaskError,
    WorkerCrashedError,
)
import uav_collect
from uav_collect.kernels.compile import sources_digest
from uav_collect.kernels.patience import waiting_for
from uav_collect.kernels.stops import kept_handlers
from uav_collect.studies.jobs.cluster_address import check_address
from uav_collect.studies.jobs.work import run_job
from uav_collect.studies.jobs.worker_messages import (
    failure_of,
    JobEnd,
    JobEvent,
    JobReport,
    Lost,
    Started,
    Stopped,
    WorkItem,
)

_LOSSES = (
    WorkerCrashedError, NodeDiedError, ObjectLostError, OutOfMemoryError, GetTimeoutError,
)  # fmt: skip
_GET_S = 300.0  # for an event's bytes to come from where they are


class RayEngine:
    """An engine that does each job as a Ray task, on one core of the cluster."""

    def __init__(self, address: str | None, n_slots: int | None) -> None:
        """Connect to a cluster.

        Args:
            address: of its head, or 'auto'; None starts a cluster of this machine alone.
            n_slots: jobs at once; None: as many as the cluster has cores.
        """
        self._n_slots = n_slots
        options: dict[str, Any] = {'log_to_driver': False}
        if address is None:
            # Left out, the address would be that of whatever cluster was used last.
            options |= {'address': 'local', 'num_cpus': n_slots, 'include_dashboard': False}
        else:
            # The cluster's machines may have another version of this package, or none.
            folder = Path(uav_collect.__file__).parent
            modules = {'py_modules': [str(folder)]}
            options |= {'address': address, 'runtime_env': modules}
        self._is_ours = not ray.is_initialized()
        if self._is_ours:
            with waiting_for(f'the Ray cluster at {address}' if address else 'Ray to start'):
                if address is not None:
                    check_address(address)
                with kept_handlers():  # Ray takes them, and ends the process with a trace
                    ray.init(**options)
        self._perform = ray.remote(num_cpus=1, max_retries=0)(_performed)
        self._streams: dict[Any, str] = {}  # digest by stream of events
        self._is_stopped = False

    @property
    def n_slots(self) -> int:
        """How many jobs are done at once; the cluster may grow."""
        return self._n_slots or max(1, int(ray.cluster_resources().get('CPU', 1)))

    def start(self, task: WorkItem) -> None:
        """Start a job wherever the cluster has a free core."""
        self._streams[self._perform.remote(task, sources_digest())] = task.digest

    def wait(self, timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        """Reports of jobs; of one whose machine or process is gone, that it is lost."""
        if self._is_stopped:  # whoever reads a stream that was cancelled may wait for its task
            ended = [*self._streams.values()]
            self._streams.clear()
            return [(digest, Stopped()) for digest in ended]
        if not self._streams:
            sleep(timeout_s)
            return []
        streams = [*self._streams]
        ready, _ = ray.wait(streams, num_returns=1, timeout=timeout_s)
        more, _ = ray.wait(streams, num_returns=len(streams), timeout=0)
        reports = []
        for stream in dict.fromkeys([*ready, *more]):
            digest, report = self._streams[stream], self._next(stream)
            if isinstance(report, JobEnd):
                del self._streams[stream]
            if isinstance(report, Lost):  # it may go on where nobody hears of it
                ray.cancel(stream, force=True)
            reports.append((digest, report))
        return reports

    def stop(self) -> None:
        """End all jobs, whatever they do; what they did since their last states is lost."""
        self._is_stopped = True
        for stream in self._streams:  # one that compiles hears of nothing less
            ray.cancel(stream, force=True)

    def close(self) -> None:
        """Kill what still runs, and disconnect."""
        self.stop()
        self._streams.clear()
        if self._is_ours:
            ray.shutdown()

    def _next(self, stream: Any) -> JobReport:  # noqa: ANN401 - Ray's
        try:
            report: JobReport = ray.get(next(stream), timeout=_GET_S)
        except StopIteration:
            return Lost(why='it ended without a result')
        except _LOSSES as error:
            return Lost(why=_first_line(error))
        except RayTaskError as error:
            return failure_of(error.cause or error, str(error))
        except RayError as error:  # none that says that the job is at fault
            return Lost(why=_first_line(error))
        return report


def _first_line(error: BaseException) -> str:
    text = str(error).strip().splitlines()
    return f'{type(error).__name__}: {text[0] if text else ""}'


def _performed(task: WorkItem, sources: str) -> Iterator[JobEvent]:
    """The events of a job, on a machine of the cluster."""
    for event in run_job(task):
        if isinstance(event, Started) and event.sources != sources:
            raise RuntimeError(
                f'{event.host} has another version of uav_collect: sources {event.sources},'
                f' must be {sources}'
            )
        yield event

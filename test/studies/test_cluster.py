"""The same jobs on a real Ray cluster of this machine, with two workers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
import signal

from episodes import single_threaded_torch
import pytest
from study_jobs import (
    by_digest,
    done_by,
    flights,
    kept,
    needs_compiled_kernels,
    sabotaged,
    training,
)
from uav_collect.commands.terminal import deferred_interruption
from uav_collect.studies.jobs.jobs import Job
from uav_collect.studies.jobs.processes import ProcessEngine
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import Compiling, JobReport, Stopped

pytest.importorskip('ray', reason='needs what requirements/cluster.txt lists')
single_threaded_torch()
from uav_collect.studies.jobs.cluster import RayEngine

pytestmark = [needs_compiled_kernels, pytest.mark.long]


def jobs() -> Mapping[str, Job]:
    trainings = training(seed=0), training(seed=1)
    return by_digest(*trainings, flights(*trainings), flights(policy='nobody'))


# Ray leaves sockets to the garbage collector.
@pytest.mark.nightly
@pytest.mark.filterwarnings('ignore::ResourceWarning')
def test_a_cluster_that_loses_a_worker_gives_what_one_process_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Without an address a cluster of this machine is meant, whatever others there are.
    monkeypatch.setenv('RAY_ADDRESS', '127.0.0.1:1')
    here = Store(tmp_path / 'here')
    at_home = done_by(ProcessEngine(1), jobs(), here)
    abroad, there, killed = sabotaged(lambda: RayEngine(None, 2), jobs(), tmp_path / 'there')
    assert abroad.n_lost == 1
    assert there.cost(killed).n_interruptions == 1
    assert kept(there) == kept(here) != {}
    assert (abroad.done, abroad.failures.keys()) == (at_home.done, at_home.failures.keys())
    assert all('nobody' in why for why in abroad.failures.values())


# Ray leaves sockets to the garbage collector.
@pytest.mark.filterwarnings('ignore::ResourceWarning')
def test_ray_leaves_signals_to_whom_they_were_and_ends_what_compiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    with deferred_interruption() as interruption:
        engine, seen = RayEngine(None, 1), []
        wait_for_reports = engine.wait

        def wait(timeout_s: float) -> Sequence[tuple[str, JobReport]]:
            reports = wait_for_reports(timeout_s)
            seen.extend(report for _, report in reports)
            if Compiling() in seen and interruption.signal_number is None:
                signal.raise_signal(signal.SIGTERM)
            return reports

        engine.wait = wait  # type: ignore[method-assign]
        status = done_by(
            engine,
            by_digest(training()),
            Store(tmp_path),
            is_stopping=interruption.acknowledge,
        )
    assert (status.done, status.n_lost, status.failures) == (0, 0, {})
    assert seen[-1] == Stopped()

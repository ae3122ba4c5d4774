"""Processes do jobs: interrupted, killed or not, they give the same bytes."""

from collections.abc import Callable, Sequence
import itertools
import os
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
from uav_collect.studies.jobs.jobs import digest_of, FlightsJob, Job
from uav_collect.studies.jobs.processes import ProcessEngine
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import (
    Advanced,
    Compiling,
    JobReport,
    Started,
    Stopped,
)

pytestmark = pytest.mark.long


@pytest.fixture(scope='module')
def alone(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Two trainings and missions of the best of them, done by one process after another."""
    single_threaded_torch()
    store = Store(tmp_path_factory.mktemp('alone'))
    status = done_by(ProcessEngine(1), some_jobs(), store)
    assert (status.failures, status.done) == ({}, 4)
    return store


def some_jobs() -> dict[str, Job]:
    trainings = training(seed=0), training(seed=1)
    return by_digest(flights(*trainings), *trainings, flights())


@needs_compiled_kernels
def test_results_do_not_depend_on_how_many_work_nor_on_the_order(
    alone: Store, tmp_path: Path
) -> None:
    store = Store(tmp_path)
    done_by(ProcessEngine(2), dict(reversed(some_jobs().items())), store)
    assert kept(store) == kept(alone)


@pytest.mark.nightly
@needs_compiled_kernels
def test_a_process_that_is_killed_costs_no_more_than_what_followed_its_last_state(
    alone: Store, tmp_path: Path
) -> None:
    status, store, killed = sabotaged(lambda: ProcessEngine(2), some_jobs(), tmp_path)
    assert status.n_lost == 1
    assert store.cost(killed).n_interruptions == 1
    assert kept(store) == kept(alone)


@needs_compiled_kernels
def test_a_call_that_is_interrupted_saves_what_runs_and_the_next_one_goes_on(
    alone: Store, tmp_path: Path
) -> None:
    store, begun = interrupted(tmp_path)
    assert store.state(begun) is not None
    done_by(ProcessEngine(1), some_jobs(), store)
    assert store.cost(begun).n_interruptions == 1
    assert kept(store) == kept(alone)


def interrupted(folder: Path) -> tuple[Store, str]:
    """What a call leaves that is interrupted amidst its first job, and the job's digest.

    Where the job was done before that, all begins anew.
    """
    trainings = {it: job for it, job in some_jobs().items() if not isinstance(job, FlightsJob)}
    for number in itertools.count():
        store, engine = Store(folder / str(number)), ProcessEngine(1)
        begun: list[str] = []
        engine.wait = noting(engine.wait, begun)  # type: ignore[method-assign]
        status = done_by(engine, trainings, store, is_stopping=lambda begun=begun: bool(begun))
        if status.done == 0:
            return store, begun[0]
    raise RuntimeError('numbers have come to an end')


def noting(
    wait_for_reports: Callable[[float], Sequence[tuple[str, JobReport]]], begun: list[str]
) -> Callable[[float], Sequence[tuple[str, JobReport]]]:
    """Wait for reports, and note the jobs that have begun."""

    def wait(timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        reports = wait_for_reports(timeout_s)
        begun.extend(digest for digest, report in reports if isinstance(report, Advanced))
        return reports

    return wait


@needs_compiled_kernels
def test_a_process_that_compiles_is_ended_with_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    store, engine = Store(tmp_path), ProcessEngine(1)
    job, reports = training(), []
    wait_for_reports = engine.wait

    def wait(timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        reports.extend(wait_for_reports(timeout_s))
        return reports[-1:]

    engine.wait = wait  # type: ignore[method-assign]
    status = done_by(
        engine, by_digest(job), store, is_stopping=lambda: (digest_of(job), Compiling()) in reports
    )
    assert (status.done, status.n_lost, status.failures) == (0, 0, {})
    assert reports[-1] == (digest_of(job), Stopped())


def test_what_ends_a_whole_group_of_processes_leaves_it_to_the_caller_to_stop_jobs(
    tmp_path: Path,
) -> None:
    engine, job = ProcessEngine(1), flights()
    wait_for_reports = engine.wait

    def wait(timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        reports = wait_for_reports(timeout_s)
        for _, report in reports:
            if isinstance(report, Started):
                os.kill(report.process, signal.SIGTERM)
        return reports

    engine.wait = wait  # type: ignore[method-assign]
    status = done_by(engine, by_digest(job), Store(tmp_path))
    assert (status.done, status.n_lost) == (1, 0)


def test_a_job_that_cannot_be_done_says_why(tmp_path: Path) -> None:
    job = flights(policy='nobody')
    store = Store(tmp_path)
    status = done_by(ProcessEngine(1), by_digest(job), store)
    assert 'nobody' in status.failures[digest_of(job)]
    assert 'Traceback' in (tmp_path / 'failures' / f'{digest_of(job)}.txt').read_text()

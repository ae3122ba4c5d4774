"""Which job is done when, and what becomes of lost and failed ones."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
import subprocess
import sys

import pytest
from study_jobs import by_digest, done_by, flights, training
from uav_collect.studies.jobs.jobs import digest_of, POLICY
from uav_collect.studies.jobs.schedule import JobsStatus, run_jobs
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import (
    Advanced,
    Cost,
    Failed,
    Finished,
    JobReport,
    Lost,
    Saved,
    StateRefused,
    Stopped,
    WorkItem,
)


@dataclass
class Scripted:
    """An engine that answers each task as a script says, one report at a time."""

    script: Mapping[str, Sequence[Sequence[JobReport]]]  # by digest, for each time it is begun
    n_slots: int = 1
    begun: list[WorkItem] = field(default_factory=list)
    reports: list[tuple[str, JobReport]] = field(default_factory=list)
    is_closed: bool = False

    def start(self, task: WorkItem) -> None:
        times = sum(it.digest == task.digest for it in self.begun)
        self.begun.append(task)
        self.reports += [(task.digest, report) for report in self.script[task.digest][times]]

    def wait(self, timeout_s: float) -> Sequence[tuple[str, JobReport]]:
        del timeout_s
        return [self.reports.pop(0)] if self.reports else []

    def stop(self) -> None:
        running = {digest for digest, _ in self.reports}
        self.reports = [(digest, Stopped()) for digest in running]

    def close(self) -> None:
        self.is_closed = True


FOUND = Finished(results={POLICY: b'weights'}, cost=Cost(cpu_s=2.0))


def test_a_job_waits_for_what_it_needs_and_gets_it(tmp_path: Path) -> None:
    learn, fly = training(), flights(training())
    engine = Scripted({digest_of(learn): [[FOUND]], digest_of(fly): [[FOUND]]}, n_slots=2)
    status = done_by(engine, by_digest(fly, learn), Store(tmp_path))
    assert [task.job for task in engine.begun] == [learn, fly]
    assert engine.begun[1].inputs == {digest_of(learn): b'weights'}
    assert (status.done, status.total, engine.is_closed) == (2, 2, True)


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    store.save(job, FOUND.results, FOUND.cost)
    engine = Scripted({})
    assert done_by(engine, by_digest(job), store).done == 1
    assert engine.begun == []


def test_a_lost_job_goes_on_from_its_last_state(tmp_path: Path) -> None:
    job = training()
    saved = Saved(state=b'half', share_done=0.5)
    engine = Scripted({digest_of(job): [[saved, Lost(why='gone')], [FOUND]]})
    store = Store(tmp_path)
    status = done_by(engine, by_digest(job), store)
    assert [task.state for task in engine.begun] == [None, b'half']
    assert (status.done, status.n_lost) == (1, 1)
    assert store.state(digest_of(job)) is None


def test_a_job_that_is_lost_again_and_again_fails(tmp_path: Path) -> None:
    job = training()
    engine = Scripted({digest_of(job): [[Lost(why='gone')]] * 9})
    status = done_by(engine, by_digest(job), Store(tmp_path))
    assert status.failures == {digest_of(job): 'lost 6 times: gone'}
    assert 'gone' in (tmp_path / 'failures' / f'{digest_of(job)}.txt').read_text()


def test_a_job_may_be_lost_as_often_as_it_gets_on(tmp_path: Path) -> None:
    job = training()
    losses = [[Saved(state=b'more', share_done=0.1), Lost(why='spot')]] * 9
    engine = Scripted({digest_of(job): [*losses, [FOUND]]})
    assert done_by(engine, by_digest(job), Store(tmp_path)).done == 1


def test_a_failure_costs_no_state(tmp_path: Path) -> None:
    job, store = training(), Store(tmp_path)
    store.save_state(digest_of(job), b'hours')
    engine = Scripted({digest_of(job): [[Failed(why='No space left', trace='where')]]})
    done_by(engine, by_digest(job), store)
    assert store.state(digest_of(job)) == b'hours'


def test_a_job_whose_state_is_refused_begins_anew_once(tmp_path: Path) -> None:
    job, store = training(), Store(tmp_path)
    store.save_state(digest_of(job), b'damaged')
    refused = StateRefused(why='is damaged', trace='where')
    engine = Scripted({digest_of(job): [[refused], [FOUND]]})
    assert done_by(engine, by_digest(job), store).done == 1
    assert [task.state for task in engine.begun] == [b'damaged', None]
    again = Scripted({digest_of(job): [[refused], [refused]]})
    status = done_by(again, by_digest(job), Store(tmp_path / 'other'))
    assert status.failures == {digest_of(job): 'is damaged'}


def test_a_job_that_another_process_has_done_meanwhile_is_counted(tmp_path: Path) -> None:
    first, second = training(seed=0), training(seed=1)
    store = Store(tmp_path)

    class Beside(Scripted):
        def wait(self, timeout_s: float) -> Sequence[tuple[str, JobReport]]:
            for job in (first, second):
                store.save(job, FOUND.results, FOUND.cost)
            return super().wait(timeout_s)

    engine = Beside({digest_of(it): [[FOUND]] for it in (first, second)})
    assert done_by(engine, by_digest(first, second), store).done == 2
    assert len(engine.begun) == 1


def test_a_job_is_left_to_the_command_that_does_it_and_taken_over_when_that_is_gone(
    tmp_path: Path,
) -> None:
    first, second = training(seed=0), training(seed=1)
    doing = f"""
import sys
from pathlib import Path
from uav_collect.studies.jobs.reservations import reserving
with reserving(Path({str(tmp_path)!r})) as reserved:
    print(reserved.take({digest_of(first)!r}), flush=True)
    sys.stdin.read()
"""
    engine = Scripted({digest_of(it): [[FOUND]] for it in (first, second)}, n_slots=2)
    seen = []

    def show(status: JobsStatus) -> None:
        seen.append(len(status.elsewhere))
        if status.done == 1:  # of two: what can be done is
            other.kill()
            other.wait()

    with subprocess.Popen(
        (sys.executable, '-c', doing), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == 'True\n'
        status = done_by(engine, by_digest(first, second), Store(tmp_path), show=show)
    assert [task.job for task in engine.begun] == [second, first]
    assert (status.done, seen[0], seen[-1]) == (2, 1, 0)


def test_an_error_in_the_loop_saves_what_runs(tmp_path: Path) -> None:
    job, store = training(), Store(tmp_path)

    class Saving(Scripted):
        def stop(self) -> None:
            saved = Saved(state=b'half', share_done=0.5)
            self.reports = [(digest_of(job), it) for it in (saved, Stopped())]

    def show(status: JobsStatus) -> None:
        if status.running.get(digest_of(job)):
            raise OSError('no space for a figure')

    engine = Saving({digest_of(job): [[Advanced(share_done=0.1)]]})
    with pytest.raises(OSError, match='no space'):
        run_jobs(
            by_digest(job),
            store,
            engine,
            checkpoint_s=1.0,
            order=lambda _: (0, 0.0),
            is_stopping=lambda: False,
            show=show,
        )
    assert store.state(digest_of(job)) == b'half'
    assert engine.is_closed


def test_what_fails_blocks_what_needs_it_and_nothing_else(tmp_path: Path) -> None:
    learn, fly, other = training(), flights(training()), flights()
    failed = Failed(why='too small', trace='where')
    engine = Scripted({digest_of(learn): [[failed]], digest_of(other): [[FOUND]]})
    store = Store(tmp_path)
    status = done_by(engine, by_digest(learn, fly, other), store)
    assert status.failures == {digest_of(learn): 'too small'}
    assert status.blocked == {digest_of(fly)}
    assert store.has(digest_of(other))
    assert (tmp_path / 'failures' / f'{digest_of(learn)}.txt').read_text() == 'where'


def test_jobs_that_are_left_are_not_begun_again(tmp_path: Path) -> None:
    first, second = training(seed=0), training(seed=1)
    reports = [Advanced(share_done=0.1), Advanced(share_done=0.2), FOUND]
    engine = Scripted({digest_of(it): [reports] for it in (first, second)})
    looks: Iterator[bool] = iter([False, False, True])
    status = done_by(
        engine, by_digest(first, second), Store(tmp_path), is_stopping=lambda: next(looks)
    )
    assert len(engine.begun) == 1
    assert (status.done, status.running) == (0, {})

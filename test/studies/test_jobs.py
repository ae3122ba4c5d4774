"""Jobs, the store, who does them and in which order, and how statements are judged."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from episodes import single_threaded_torch
import numpy as np
import pytest
from study_jobs import (
    by_digest,
    done_by,
    FIELD,
    flights,
    kept,
    needs_compiled_kernels,
    Saboteur,
    training,
)
from uav_collect.errors import StoreError
from uav_collect.scenario.load import load, with_uavs
from uav_collect.studies import catalogue
from uav_collect.studies.claims import judging
from uav_collect.studies.claims.judging import ClaimStatus, Samples
from uav_collect.studies.comparisons import with_budget
from uav_collect.studies.jobs.costs import disk_bytes, rates_of, spent_cost
from uav_collect.studies.jobs.jobs import digest_of, FlightsJob, Job, MISSIONS, PlansJob, POLICY
from uav_collect.studies.jobs.processes import ProcessEngine
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import (
    Advanced,
    Cost,
    Failed,
    Finished,
    Lost,
    Report,
    Saved,
    Stopped,
    WorkItem,
)
from uav_collect.studies.requests import Requests
from uav_collect.studies.scale import load_scale, scale_names


@dataclass
class Scripted:
    """An engine that answers each task as a script says, one report at a time."""

    script: Mapping[str, Sequence[Sequence[Report]]]  # by digest, for each time it is begun
    n_slots: int = 1
    begun: list[WorkItem] = field(default_factory=list)
    told: list[tuple[str, Report]] = field(default_factory=list)
    is_closed: bool = False

    def start(self, task: WorkItem) -> None:
        times = sum(it.digest == task.digest for it in self.begun)
        self.begun.append(task)
        self.told += [(task.digest, report) for report in self.script[task.digest][times]]

    def wait(self, timeout_s: float) -> Sequence[tuple[str, Report]]:
        del timeout_s
        return [self.told.pop(0)] if self.told else []

    def stop(self) -> None:
        running = {digest for digest, _ in self.told}
        self.told = [(digest, Stopped()) for digest in running]

    def close(self) -> None:
        self.is_closed = True


FOUND = Finished(results={POLICY: b'weights'}, cost=Cost(cpu_s=2.0))


# Jobs.


def test_a_digest_changes_with_anything_that_the_result_depends_on() -> None:
    jobs = [
        training(),
        training(seed=1),
        training(decisions=2000),
        training(target__trace=0.5),
        flights(),
        flights(training()),
        flights(bandwidth='equal'),
        flights(first_seed=6),
        flights(scenario=with_budget(FIELD, 30.0).to_yaml()),
        PlansJob(
            scenario=FIELD.to_yaml(), bandwidth='exact', first_seed=5, n_missions=3, n_rounds=10
        ),
    ]
    assert len({digest_of(job) for job in jobs}) == len(jobs)


def test_a_digest_is_the_same_for_the_same_job() -> None:
    assert digest_of(training()) == digest_of(training())


# The store.


def test_what_is_kept_is_found_and_read_back(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    assert not store.has(digest_of(job))
    store.keep(job, {MISSIONS: b'rows'}, Cost(cpu_s=1.5, host='here'))
    assert store.read(digest_of(job), MISSIONS) == b'rows'
    assert store.cost(digest_of(job)) == Cost(cpu_s=1.5, host='here')
    assert store.missing([digest_of(job)]) == []


def test_a_job_that_was_kept_by_another_first_stays_as_it_is(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    store.keep(job, {MISSIONS: b'first'}, Cost())
    store.keep(job, {MISSIONS: b'second'}, Cost())
    assert store.read(digest_of(job), MISSIONS) == b'first'
    assert [path.name for path in (tmp_path / 'jobs').iterdir()] == [digest_of(job)]


def test_a_job_without_its_last_file_does_not_count_as_done(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    store.keep(job, {MISSIONS: b'rows'}, Cost())
    (tmp_path / 'jobs' / digest_of(job) / 'cost.json').unlink()
    assert not store.has(digest_of(job))


def test_a_file_that_no_job_gave_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r'abc/missions\.csv: cannot be read'):
        Store(tmp_path).read('abc', MISSIONS)


# Who does what, when.


def test_a_job_waits_for_what_it_needs_and_gets_it(tmp_path: Path) -> None:
    learn, fly = training(), flights(training())
    engine = Scripted({digest_of(learn): [[FOUND]], digest_of(fly): [[FOUND]]}, n_slots=2)
    standing = done_by(engine, by_digest(fly, learn), Store(tmp_path))
    assert [task.job for task in engine.begun] == [learn, fly]
    assert engine.begun[1].inputs == {digest_of(learn): b'weights'}
    assert (standing.done, standing.total, engine.is_closed) == (2, 2, True)


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    store.keep(job, FOUND.results, FOUND.cost)
    engine = Scripted({})
    assert done_by(engine, by_digest(job), store).done == 1
    assert engine.begun == []


def test_a_lost_job_goes_on_from_its_last_state(tmp_path: Path) -> None:
    job = training()
    saved = Saved(state=b'half', share_done=0.5)
    engine = Scripted({digest_of(job): [[saved, Lost(why='gone')], [FOUND]]})
    store = Store(tmp_path)
    standing = done_by(engine, by_digest(job), store)
    assert [task.state for task in engine.begun] == [None, b'half']
    assert (standing.done, standing.n_lost) == (1, 1)
    assert store.state(digest_of(job)) is None


def test_a_job_that_is_lost_again_and_again_fails(tmp_path: Path) -> None:
    job = training()
    engine = Scripted({digest_of(job): [[Lost(why='gone')]] * 9})
    standing = done_by(engine, by_digest(job), Store(tmp_path))
    assert standing.failures == {digest_of(job): 'lost 6 times: gone'}


def test_what_fails_blocks_what_needs_it_and_nothing_else(tmp_path: Path) -> None:
    learn, fly, other = training(), flights(training()), flights()
    failed = Failed(why='too small', trace='where')
    engine = Scripted({digest_of(learn): [[failed]], digest_of(other): [[FOUND]]})
    store = Store(tmp_path)
    standing = done_by(engine, by_digest(learn, fly, other), store)
    assert standing.failures == {digest_of(learn): 'too small'}
    assert standing.blocked == {digest_of(fly)}
    assert store.has(digest_of(other))
    assert (tmp_path / 'failures' / f'{digest_of(learn)}.txt').read_text() == 'where'


def test_jobs_that_are_left_are_not_begun_again(tmp_path: Path) -> None:
    first, second = training(seed=0), training(seed=1)
    reports = [Advanced(share_done=0.1), Advanced(share_done=0.2), FOUND]
    engine = Scripted({digest_of(it): [reports] for it in (first, second)})
    looks: Iterator[bool] = iter([False, False, True])
    standing = done_by(
        engine, by_digest(first, second), Store(tmp_path), is_stopping=lambda: next(looks)
    )
    assert len(engine.begun) == 1
    assert (standing.done, standing.running) == (0, {})


# Processes.


@pytest.fixture(scope='module')
def alone(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Two trainings and missions of the best of them, done by one process after another."""
    single_threaded_torch()
    store = Store(tmp_path_factory.mktemp('alone'))
    standing = done_by(ProcessEngine(1), some_jobs(), store)
    assert (standing.failures, standing.done) == ({}, 4)
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


@needs_compiled_kernels
def test_a_process_that_is_killed_costs_no_more_than_what_followed_its_last_state(
    alone: Store, tmp_path: Path
) -> None:
    store, engine = Store(tmp_path), Saboteur(ProcessEngine(2))
    standing = done_by(engine, some_jobs(), store, checkpoint_s=0.0)
    assert standing.n_lost == 1
    assert store.cost(engine.killed[0]).n_interruptions == 1
    assert kept(store) == kept(alone)


@needs_compiled_kernels
def test_a_call_that_is_interrupted_saves_what_runs_and_the_next_one_goes_on(
    alone: Store, tmp_path: Path
) -> None:
    store, engine = Store(tmp_path), ProcessEngine(1)
    begun: list[str] = []
    told = engine.wait

    def wait(timeout_s: float) -> Sequence[tuple[str, Report]]:
        reports = told(timeout_s)
        begun.extend(digest for digest, report in reports if isinstance(report, Advanced))
        return reports

    engine.wait = wait  # type: ignore[method-assign]
    trainings = {it: job for it, job in some_jobs().items() if not isinstance(job, FlightsJob)}
    standing = done_by(engine, trainings, store, is_stopping=lambda: bool(begun))
    assert standing.done == 0
    assert store.state(begun[0]) is not None
    done_by(ProcessEngine(1), some_jobs(), store)
    assert store.cost(begun[0]).n_interruptions == 1
    assert kept(store) == kept(alone)


def test_a_job_that_cannot_be_done_says_why(tmp_path: Path) -> None:
    job = flights(policy='nobody')
    store = Store(tmp_path)
    standing = done_by(ProcessEngine(1), by_digest(job), store)
    assert 'nobody' in standing.failures[digest_of(job)]
    assert 'Traceback' in (tmp_path / 'failures' / f'{digest_of(job)}.txt').read_text()


# What studies ask for.


@pytest.mark.parametrize('name', scale_names())
def test_every_study_of_every_scale_can_be_asked_for(name: str) -> None:
    requests = Requests(load_scale(name))
    studies = [catalogue.study(it, requests) for it in catalogue.names()]
    assert [study.figure for study in studies] == [*range(3, 14)]
    assert all(set(job.trainings) <= set(requests.jobs) for job in requests.jobs.values()
               if isinstance(job, FlightsJob))  # fmt: skip


def test_what_several_studies_need_is_asked_for_once() -> None:
    requests = Requests(load_scale('laptop'))
    catalogue.study('energy', requests)
    trainings = {it for it, job in requests.jobs.items() if not isinstance(job, FlightsJob)}
    catalogue.study('density', requests)
    again = {it for it, job in requests.jobs.items() if not isinstance(job, FlightsJob | PlansJob)}
    assert again <= trainings


def test_a_fleet_beyond_the_scenario_repeats_its_uavs() -> None:
    speeds = [it.speed_mps for it in with_uavs(load('paper_10x10'), 4).uavs]
    assert speeds == [5.0, 10.0, 5.0, 10.0]


def test_the_disk_is_asked_for_states_of_what_runs_at_once_only() -> None:
    jobs = [training(seed=seed) for seed in range(3)]
    (some, one), (same, all_three) = disk_bytes(jobs, 1), disk_bytes(jobs, 3)
    assert some == same > 0
    assert all_three == 3 * one > 0


def test_rates_come_from_what_is_done(tmp_path: Path) -> None:
    store, job = Store(tmp_path), training(decisions=1000)
    assert rates_of(spent_cost(by_digest(job), store)) is None
    store.keep(job, FOUND.results, Cost(cpu_s=2.0))
    rates = rates_of(spent_cost(by_digest(job), store))
    assert rates is not None
    assert rates.cost_s(training(seed=1, decisions=500)) == pytest.approx(1.0)


# How statements are judged.


def missions(*values: float) -> Samples:
    return Samples(value=np.array(values), noun='mission')


def seeds(*values: float) -> Samples:
    return Samples(value=np.array(values), noun='seed')


def test_a_paired_difference_decides_where_the_means_alone_could_not() -> None:
    low = np.array([1.0, 5.0, 9.0, 2.0, 7.0, 3.0])
    above = judging.is_above('it', 's', missions(*(low + 0.1)), missions(*low))
    assert (above.status, above.n) == (ClaimStatus.HOLDS, 6)
    assert above.estimate is not None
    assert above.estimate.mean == pytest.approx(0.1)


def test_what_differs_by_rounding_alone_decides_nothing() -> None:
    whole = missions(*[100.0] * 6)
    above = judging.is_above('data', '%', whole, missions(*[100.0 - 1.4e-14] * 6))
    assert above.status is ClaimStatus.OPEN
    assert above.estimate is not None
    assert (above.estimate.low, above.estimate.high) == (0.0, 0.0)


def test_a_difference_of_the_other_sign_does_not_hold() -> None:
    assert judging.is_above('it', 's', missions(1, 2), missions(2, 3)).status is ClaimStatus.FAILS


def test_a_difference_whose_interval_has_both_signs_is_open() -> None:
    evidence = judging.is_above('it', 's', missions(1, 2, 3), missions(3, 2, 1))
    assert evidence.status is ClaimStatus.OPEN


@pytest.mark.parametrize(('n_seeds', 'status'), [(5, ClaimStatus.OPEN), (6, ClaimStatus.HOLDS)])
def test_few_seeds_decide_nothing(n_seeds: int, status: ClaimStatus) -> None:
    high, low = seeds(*range(1, n_seeds + 1)), seeds(*range(n_seeds))
    assert judging.is_above('it', '1', high, low).status is status


def test_what_is_not_known_is_left_out_in_pairs() -> None:
    evidence = judging.is_above('it', 's', missions(2, np.nan, 4), missions(1, 1, np.nan))
    assert evidence.n == 1


@pytest.mark.parametrize(
    ('low', 'high', 'status'),
    [(0.0, 5.0, ClaimStatus.HOLDS), (5.0, 9.0, ClaimStatus.FAILS), (2.0, 9.0, ClaimStatus.OPEN)],
)
def test_a_mean_lies_in_a_span_with_its_whole_interval(
    low: float, high: float, status: ClaimStatus
) -> None:
    assert judging.is_within('it', '%', missions(1, 2, 3), low, high).status is status


def test_a_change_in_per_cent_is_the_ratio_of_the_means() -> None:
    changed = judging.changed_percent(missions(1, 2, 6), missions(4, 4, 4))
    assert changed.value.mean() == pytest.approx(100.0 * (3.0 / 4.0 - 1.0))


def test_a_ratio_that_is_the_same_in_every_mission_has_no_spread() -> None:
    changed = judging.changed_percent(missions(1, 2, 3), missions(2, 4, 6))
    assert changed.value == pytest.approx([-50.0] * 3)


@pytest.mark.parametrize(
    ('statuses', 'status'),
    [
        ((), ClaimStatus.NOT_RUN),
        ((ClaimStatus.HOLDS, ClaimStatus.HOLDS), ClaimStatus.HOLDS),
        ((ClaimStatus.HOLDS, ClaimStatus.OPEN), ClaimStatus.OPEN),
        ((ClaimStatus.OPEN, ClaimStatus.FAILS, ClaimStatus.HOLDS), ClaimStatus.FAILS),
    ],
)
def test_a_statement_holds_if_all_its_parts_do(
    statuses: Sequence[ClaimStatus], status: ClaimStatus
) -> None:
    part = judging.is_above('it', 's', missions(1, 2), missions(0, 1))
    assert judging.combined_status([replace(part, status=it) for it in statuses]) is status

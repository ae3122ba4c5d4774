"""The store keeps results whole, and gives them back."""

import os
from pathlib import Path

from full_disk import no_file_beyond
import pytest
from study_jobs import flights
from uav_collect.errors import StoreError
from uav_collect.studies.jobs.jobs import digest_of, MISSIONS
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import Cost


def test_what_is_kept_is_found_and_read_back(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    assert not store.has(digest_of(job))
    store.save(job, {MISSIONS: b'rows'}, Cost(cpu_s=1.5, host='here'))
    assert store.read(digest_of(job), MISSIONS) == b'rows'
    assert store.cost(digest_of(job)) == Cost(cpu_s=1.5, host='here')
    assert store.missing([digest_of(job)]) == []


def test_a_job_that_was_kept_by_another_first_stays_as_it_is(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    store.save(job, {MISSIONS: b'first'}, Cost())
    store.save(job, {MISSIONS: b'second'}, Cost())
    assert store.read(digest_of(job), MISSIONS) == b'first'
    assert [path.name for path in (tmp_path / 'jobs').iterdir()] == [digest_of(job)]


def test_a_job_without_its_last_file_does_not_count_as_done(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    store.save(job, {MISSIONS: b'rows'}, Cost())
    (tmp_path / 'jobs' / digest_of(job) / 'cost.json').unlink()
    assert not store.has(digest_of(job))
    store.save(job, {MISSIONS: b'anew'}, Cost())
    assert store.read(digest_of(job), MISSIONS) == b'anew'


def test_what_a_killed_process_with_our_number_left_is_in_nobodys_way(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    name = f'.{digest_of(job)}.{os.uname().nodename}.{os.getpid()}.part'
    (tmp_path / 'jobs' / name).mkdir(parents=True)
    store.save(job, {MISSIONS: b'rows'}, Cost())
    assert store.read(digest_of(job), MISSIONS) == b'rows'


def test_why_a_job_failed_is_forgotten_once_it_is_done(tmp_path: Path) -> None:
    store, job = Store(tmp_path), flights()
    store.save_failure(digest_of(job), 'where')
    store.save(job, {MISSIONS: b'rows'}, Cost())
    assert [*(tmp_path / 'failures').iterdir()] == []


def test_a_file_that_no_job_gave_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r'abc/missions\.csv: cannot be read'):
        Store(tmp_path).read('abc', MISSIONS)


def test_a_disk_that_is_full_leaves_nothing_of_a_job_and_its_last_state(tmp_path: Path) -> None:
    store, job = Store(tmp_path / 'store'), flights()
    digest = digest_of(job)
    store.save_state(digest, b'half')
    with no_file_beyond(10):
        with pytest.raises(OSError, match='File too large') as raised:
            store.save(job, {MISSIONS: b'rows'}, Cost())
        assert raised.value.filename == f'{tmp_path}/store/jobs/{digest}'
        with pytest.raises(OSError, match='File too large') as raised:
            store.save_state(digest, b'nearly all of it')
        assert raised.value.filename == f'{tmp_path}/store/states/{digest}'
    assert not store.has(digest)
    assert store.state(digest) == b'half'
    assert [*(tmp_path / 'store' / 'jobs').iterdir()] == []
    store.save(job, {MISSIONS: b'rows'}, Cost())
    assert store.read(digest, MISSIONS) == b'rows'


def test_a_store_where_none_can_be_is_named(tmp_path: Path) -> None:
    (tmp_path / 'store').touch()
    store, job = Store(tmp_path / 'store'), flights()
    with pytest.raises(NotADirectoryError) as raised:
        store.save(job, {MISSIONS: b'rows'}, Cost())
    assert str(raised.value.filename).startswith(f'{tmp_path}/store')

"""What jobs take on the disk and of a processor."""

from pathlib import Path

import pytest
from study_jobs import by_digest, training
from uav_collect.studies.jobs.costs import disk_bytes, rates_of, spent_cost
from uav_collect.studies.jobs.jobs import POLICY
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.worker_messages import Cost


def test_the_disk_is_asked_for_states_of_what_runs_at_once_only() -> None:
    jobs = [training(seed=seed) for seed in range(3)]
    (some, one), (same, all_three) = disk_bytes(jobs, 1), disk_bytes(jobs, 3)
    assert some == same > 0
    assert all_three == 3 * one > 0


def test_rates_come_from_what_is_done(tmp_path: Path) -> None:
    store, job = Store(tmp_path), training(decisions=1000)
    assert rates_of(spent_cost(by_digest(job), store)) is None
    store.save(job, {POLICY: b'weights'}, Cost(cpu_s=2.0))
    rates = rates_of(spent_cost(by_digest(job), store))
    assert rates is not None
    assert rates.cost_s(training(seed=1, decisions=500)) == pytest.approx(1.0)

"""The digest of a job names it."""

import pytest
from study_jobs import FIELD, flights, training
from uav_collect.errors import PolicyMismatchError
from uav_collect.studies.comparisons import with_budget
from uav_collect.studies.jobs.flights import run_flights
from uav_collect.studies.jobs.jobs import digest_of, PlansJob


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


@pytest.mark.parametrize(
    ('policy', 'wanted'),
    [('paper_10x10_n2_aqmix then', 'must be then'), ('paper_10x10_n2_aqmix', 'must be a rule')],
)
def test_another_shipped_policy_than_was_asked_for_flies_nothing(policy: str, wanted: str) -> None:
    job = flights(policy=policy)
    with pytest.raises(PolicyMismatchError, match=f'^policy paper_10x10_n2_aqmix is .*{wanted}'):
        next(run_flights(job, {}, lambda: False))

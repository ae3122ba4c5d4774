"""The digest of a job names it."""

from study_jobs import FIELD, flights, training
from uav_collect.studies.comparisons import with_budget
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

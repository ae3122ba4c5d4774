"""The jobs that studies ask for."""

import pytest
from uav_collect.scenario.load import load, with_uavs
from uav_collect.studies import catalogue
from uav_collect.studies.jobs.jobs import FlightsJob, PlansJob
from uav_collect.studies.requests import Requests
from uav_collect.studies.scale import load_scale, scale_names
from uav_collect.uav.policy import policy_named


@pytest.mark.parametrize('name', scale_names())
def test_every_study_of_every_scale_can_be_asked_for(name: str) -> None:
    requests = Requests(load_scale(name))
    studies = [catalogue.make_study(it, requests) for it in catalogue.study_names()]
    assert [study.figure for study in studies] == [*range(3, 14), None, None]
    assert all(set(job.trainings) <= set(requests.jobs) for job in requests.jobs.values()
               if isinstance(job, FlightsJob))  # fmt: skip


def test_what_several_studies_need_is_asked_for_once() -> None:
    requests = Requests(load_scale('laptop'))
    catalogue.make_study('energy', requests)
    trainings = {it for it, job in requests.jobs.items() if not isinstance(job, FlightsJob)}
    catalogue.make_study('density', requests)
    again = {it for it, job in requests.jobs.items() if not isinstance(job, FlightsJob | PlansJob)}
    assert again <= trainings


def test_shipped_policies_are_tested_without_any_training_and_named_with_their_version() -> None:
    requests = Requests(load_scale('smoke'))
    for name in ('loss', 'delay'):
        catalogue.make_study(name, requests)
    flights = [job for job in requests.jobs.values() if isinstance(job, FlightsJob)]
    assert len(flights) + 2 == len(requests.jobs)  # plans of 12 missions
    assert {job.policy for job in flights} == {'hert', 'sweep'} | {
        f'{name} {policy_named(name).version}'
        for name in ('paper_10x10_n2_aqmix', 'paper_10x10_n4_aqmix')
    }
    # Neither loss nor delay is the same scenario in both: three values, not four.
    assert len({job.scenario for job in flights}) == 2 * 3


def test_a_fleet_beyond_the_scenario_repeats_its_uavs() -> None:
    speeds = [it.speed_mps for it in with_uavs(load('paper_10x10'), 4).uavs]
    assert speeds == [5.0, 10.0, 5.0, 10.0]

"""The jobs that studies ask for."""

from collections.abc import Mapping

import pytest
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import names_in
from uav_collect.config.rules import Section
from uav_collect.scenario.load import load, with_uavs
from uav_collect.studies import catalogue
from uav_collect.studies.jobs.jobs import FlightsJob, job_config, PlansJob, TrainingJob
from uav_collect.studies.requests import Requests
from uav_collect.studies.scale import load_scale
from uav_collect.studies.study import LinesStudy
from uav_collect.training.config import load_preset
from uav_collect.uav.policy import policy_named


@pytest.mark.parametrize('name', names_in(shared_folders('studies')))
def test_every_study_of_every_scale_can_be_asked_for(name: str) -> None:
    requests = Requests(load_scale(name))
    studies = [catalogue.make_study(it, requests) for it in catalogue.study_names()]
    assert [study.figure for study in studies] == [*range(3, 14), None, None, None]
    assert all(set(job.trainings) <= set(requests.jobs) for job in requests.jobs.values()
               if isinstance(job, FlightsJob))  # fmt: skip


@pytest.mark.parametrize('name', ['laptop', 'paper'])
def test_all_trainings_have_the_presets_settings_but_for_what_the_figure_names(name: str) -> None:
    requests = Requests(load_scale(name))
    preset = settings_of(load_preset('strong', {}))
    for study_name in catalogue.study_names():
        study = catalogue.make_study(study_name, requests)
        jobs = [requests.jobs[digest] for digest in requests.take_new()]
        for job in jobs:
            if isinstance(job, TrainingJob):
                settings = settings_of(job_config(job))
                changed = {key for key, value in settings.items() if preset[key] != value}
                assert all(key in study.about for key in changed), (study_name, changed)
                assert 'preset strong' in study.about


def settings_of(config: Section) -> dict[str, object]:
    """Every value by its dotted path."""
    values: dict[str, object] = {}
    for key, value in config.as_mapping().items():
        inner = settings_of(getattr(config, key)) if isinstance(value, Mapping) else {'': value}
        values |= {f'{key}.{path}'.rstrip('.'): it for path, it in inner.items()}
    return values


def test_each_training_is_tested_for_itself() -> None:
    requests = Requests(load_scale('laptop'))
    study = catalogue.make_study('density', requests)
    assert isinstance(study, LinesStudy)
    for label, n_trainings in (('AQMIX', 6), ('HERT', 0)):
        [*tests] = study.line(label).tests
        assert {len(it.trainings) for it in tests} == {n_trainings}
        assert {len(it.digests) for it in tests} == {max(1, n_trainings)}


def test_qmix_is_trained_and_flown_as_aqmix_where_there_is_a_single_uav() -> None:
    requests = Requests(load_scale('laptop'))
    fleets = [with_uavs(load('paper_10x10'), n_uavs) for n_uavs in (1, 2)]
    for fleet, is_shared in zip(fleets, (True, False), strict=True):
        aqmix, qmix = (requests.train(label, fleet, 1000, 3) for label in ('AQMIX', 'QMIX'))
        assert (aqmix.digests == qmix.digests) == is_shared
        tests = [requests.fly(trained, fleet) for trained in (aqmix, qmix)]
        assert (tests[0] == tests[1]) == is_shared


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

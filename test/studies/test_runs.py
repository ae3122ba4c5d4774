"""The file of all trainings, as marl-eval asks for it."""

import json
import math

import numpy as np
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.runs import marl_eval_json
from uav_collect.studies.study import (
    LEARNED,
    MissionSet,
    RunsStudy,
    StudyTask,
    Suite,
    TrainedPolicies,
)


class Recorded:
    """Findings of trainings that are named by their length: 'a3' has validated three times."""

    def curve_rows(self, digest: str) -> list[dict[str, float]]:
        values = range(int(digest[1:]))
        keys = ('efficiency_kbit_per_j', 'completion_s', 'energy_kj', 'collected_share')
        return [{'n_decisions': 100.0 * it, **dict.fromkeys(keys, float(it))} for it in values]

    def numbers(self, tested: MissionSet, key: str) -> Floats:
        return np.arange(5.0 * len(tested.trainings)).reshape(-1, 5)


class Stranded(Recorded):
    """Training 'b2' had no UAV home in its second mission; 'c2' in none, nor when validated."""

    def curve_rows(self, digest: str) -> list[dict[str, float]]:
        rows = super().curve_rows(digest)
        return [row | {'completion_s': math.nan} for row in rows] if digest == 'c2' else rows

    def numbers(self, tested: MissionSet, key: str) -> Floats:
        values = super().numbers(tested, key)
        if key == 'completion_s':
            values[np.array(tested.trainings) == 'b2', 1] = math.nan
            values[np.array(tested.trainings) == 'c2'] = math.nan
        return values


def task(key: str, digests: tuple[str, ...]) -> StudyTask:
    trained = {
        it: TrainedPolicies(label=it, algorithm=LEARNED[it], digests=digests) for it in LEARNED
    }
    tests = {it: MissionSet(digests=(digests,), trainings=digests) for it in LEARNED}
    return StudyTask(label=key, key=key, trained=trained, tests=tests)


def test_every_run_of_an_environment_has_as_many_steps_and_every_task_as_many_runs() -> None:
    areas = Suite(
        **{'label': 'areas', 'key': 'areas'},
        tasks=(task('small', ('a3', 'b5', 'c7')), task('large', ('d4', 'e9'))),
    )
    fleets = Suite(label='fleets', key='fleets', tasks=(task('small', ('a3',)),))
    study = RunsStudy(name='runs', figure=None, title='', about='', suites=(areas, fleets))
    environments = json.loads(marl_eval_json(study, Recorded()))
    assert [*environments] == ['uav_collect_areas', 'uav_collect_fleets']
    for tasks in environments.values():
        assert {tuple(of_task) for of_task in tasks.values()} == {tuple(LEARNED)}
    runs = [
        of_algorithm
        for of_task in environments['uav_collect_areas'].values()
        for of_algorithm in of_task.values()
    ]
    assert {tuple(it) for it in runs} == {('seed_0', 'seed_1')}
    steps = {tuple(it) for of_algorithm in runs for it in of_algorithm.values()}
    assert steps == {('step_0', 'step_1', 'step_2', 'absolute_metrics')}
    longest = environments['uav_collect_areas']['large']['AQMIX']['seed_1']
    counts = [it['step_count'] for name, it in longest.items() if name != 'absolute_metrics']
    assert counts == [0, 400, 800]
    assert longest['absolute_metrics']['completion_s'] == [5.0, 6.0, 7.0, 8.0, 9.0]


def environment_of(*digests: str) -> dict[str, dict[str, dict[str, dict[str, list[float]]]]]:
    """What is written of AQMIX in the environment of one task, read as strict JSON."""
    suite = Suite(label='areas', key='areas', tasks=(task('small', digests),))
    study = RunsStudy(name='runs', figure=None, title='', about='', suites=(suite,))

    def refused(constant: str) -> None:
        raise AssertionError(f'{constant} is no JSON')

    written = json.loads(marl_eval_json(study, Stranded()), parse_constant=refused)
    return written['uav_collect_areas']['small']['AQMIX']


def test_a_mission_whose_uavs_did_not_all_land_has_no_completion_time() -> None:
    runs = environment_of('a2', 'b2')
    metrics = runs['seed_1']['absolute_metrics']
    assert metrics['completion_s'] == [5.0, 7.0, 8.0, 9.0]
    assert metrics['energy_kj'] == [5.0, 6.0, 7.0, 8.0, 9.0]


def test_where_a_run_has_no_completion_time_at_all_the_environment_has_none() -> None:
    runs = environment_of('a2', 'c2')
    kinds = {
        tuple(sorted(it.keys() - {'step_count'})) for run in runs.values() for it in run.values()
    }
    assert kinds == {('collected_share', 'efficiency_kbit_per_j', 'energy_kj')}

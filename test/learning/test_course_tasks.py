"""Training on courses: the same run every time, each course for a while, turns where they help."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from episodes import single_threaded_torch, small
import numpy as np
import pytest
from small_courses import small_courses, small_settings
from tiny_world import tiny
from uav_collect.errors import ConfigError
from uav_collect.learning.minibatch import Algorithm
from uav_collect.limits import MAX_CELLS_PER_SIDE
from uav_collect.scenario.load import load
from uav_collect.training.config import TrainingConfig
from uav_collect.training.courses import Courses, load_distribution
from uav_collect.training.panel import Condition, Panel
from uav_collect.uav.operating_domain import OperatingDomain
from uav_collect.uav.policy_file import policy_bytes, policy_from_bytes

torch = single_threaded_torch()
from trainer_states import differences, state_of
from uav_collect.learning.course_tasks import CourseTasks
from uav_collect.learning.trainer import Trainer
from uav_collect.training.progress import Budget, ValidationResult

DECISIONS = 2500
BUDGET = Budget(decisions=DECISIONS)


def trainer_of(algorithm: str = 'aqmix', seed: int = 0, **settings: object) -> Trainer:
    preset = 'imitation' if algorithm == 'imitation' else 'anywhere'
    config = small_settings(preset, **settings)
    return Trainer((), config, algorithm, seed, courses=small_courses())


def tasks_of(
    config: TrainingConfig | None = None, algorithm: Algorithm = Algorithm.AQMIX
) -> CourseTasks:
    distribution = small_courses().distribution
    return CourseTasks(distribution, config or small_settings(), algorithm, 0, 'cpu')


@dataclass(frozen=True, kw_only=True)
class Trained:
    """A training that is over, and its validations."""

    trainer: Trainer
    validations: list[ValidationResult]


@cache
def trained_by(algorithm: str) -> Trained:
    """The training of seed 0 by an algorithm, which tests look at and none goes on with."""
    trainer = trainer_of(algorithm)
    validations = [it.validation for it in trainer.run(BUDGET) if it.validation is not None]
    return Trained(trainer=trainer, validations=validations)


@pytest.fixture
def trained() -> Trained:
    return trained_by('aqmix')


def names(tasks: CourseTasks) -> list[str]:
    return [task.site.scenario.name for task in tasks.tasks]


@pytest.mark.parametrize('algorithm', ['aqmix', 'aiql', 'branches', 'imitation'])
def test_a_run_that_stopped_half_way_ends_as_the_one_that_went_on(
    algorithm: str, tmp_path: Path
) -> None:
    straight = trained_by(algorithm).trainer
    stopped, resumed = (trainer_of(algorithm) for _ in range(2))
    next(it for it in stopped.run(BUDGET) if it.n_decisions >= 2 * DECISIONS // 3)
    assert stopped._tasks[0].site.scenario.name != resumed._tasks[0].site.scenario.name
    stopped.save(tmp_path / 'half')
    resumed.load(tmp_path / 'half')
    list(resumed.run(BUDGET))
    one, other = state_of(straight, tmp_path / 'one'), state_of(resumed, tmp_path / 'other')
    assert differences(one, other) == []
    assert one['learner']['n_updates'] > stopped.n_updates > 0


def test_another_seed_draws_other_courses() -> None:
    first, second = (trainer_of(seed=seed)._tasks[0].site.scenario for seed in (0, 1))
    assert first.sensors != second.sensors


def test_a_course_is_left_after_its_updates_and_another_takes_its_place() -> None:
    tasks = tasks_of()
    assert names(tasks) == ['small-0', 'small-1', 'small-2']
    # The first ones are left one after another.
    for n_updates, place in ((2, 0), (3, 1), (4, 2)):
        for _ in range(n_updates):
            tasks.count_update(place)
    assert names(tasks) == ['small-3', 'small-4', 'small-5']
    for _ in range(3):
        tasks.count_update(1)
    assert names(tasks)[1] == 'small-4'
    tasks.count_update(1)
    assert names(tasks)[1] == 'small-6'
    assert tasks.tasks[1].replay.n_missions == 0


def test_what_was_collected_on_courses_that_are_left_still_counts(trained: Trained) -> None:
    trainer = trained.trainer
    held = sum(task.source.n_decisions for task in trainer._tasks)
    assert held < trainer.n_decisions
    assert trainer.n_decisions >= DECISIONS


def test_courses_on_which_more_is_to_be_learned_have_more_turns() -> None:
    tasks = tasks_of(small_settings(courses__least_need=0.1))
    for course, share in zip(tasks._courses, (1.2, 0.5, 0.0), strict=True):
        course.task.source.recent.add(share * course.mark_kbit_per_j, 0.0)
    turns = np.bincount([tasks.next_turn()[0] for _ in range(3200)], minlength=3)
    np.testing.assert_allclose(turns / 3200, np.array([0.1, 0.5, 1.0]) / 1.6, atol=0.03)


def test_an_update_learns_from_several_courses_each_once() -> None:
    tasks = tasks_of(small_settings(courses__per_update=2))
    for _ in range(20):
        assert len(set(tasks.next_turn())) == 2


def test_who_imitates_the_sweep_learns_from_it_unless_it_is_surpassed() -> None:
    settings = small_settings('imitation', imitation__teachers=['sweep'])
    tasks = tasks_of(settings, Algorithm.IMITATION)
    assert [tasks.teaches(place) for place in range(3)] == [True] * 3  # nothing is known yet
    for course, share in zip(tasks._courses, (1.2, 1.01, 0.0), strict=True):
        assert course.is_swept
        course.task.source.recent.add(share * course.mark_kbit_per_j, 0.0)
    assert [tasks.teaches(place) for place in range(3)] == [False, True, True]
    tasks._courses[0].is_swept = False
    assert tasks.teaches(0)


def test_a_validation_compares_each_condition_with_the_sweep(trained: Trained) -> None:
    validation = trained.validations[-1]
    assert [it.name for it in validation.conditions] == ['n2', 'n3']
    ratios = [it.sweep_ratio for it in validation.conditions]
    assert validation.sweep_ratio == pytest.approx(sum(ratios) / 2)
    assert validation.worst.sweep_ratio == min(ratios)
    assert trained.trainer.policy().header.validation.missions == 4


def test_the_best_policy_is_the_one_of_the_best_rank_in_the_panel(trained: Trained) -> None:
    best = max(trained.validations, key=lambda it: (it.rank, -it.n_updates))
    policy = trained.trainer.best_policy()
    assert policy is not None
    assert policy.header.updates == best.n_updates


def test_the_header_tells_the_spans_and_is_read_back(trained: Trained) -> None:
    policy = trained.trainer.policy()
    header = policy_from_bytes(policy_bytes(policy)).header
    assert header == policy.header
    assert header.learned_on == ()
    assert header.learned_within == (small_courses().distribution.learned_within,)
    assert (header.cells_per_side_min, header.cells_per_side_max) == (3, 5)
    assert (header.n_uavs_min, header.n_uavs_max) == (1, 3)


@pytest.mark.parametrize(
    ('settings', 'wrong'),
    [
        ({'courses': None}, 'preset small: courses is missing'),
        ({'mixer__kind': 'fleet'}, "mixer.kind is 'fleet': must be set to learn on courses"),
        (
            {
                'observation': 'paper',
                'network__advice_bonus': 0,
                'network__advice_bonus_last': 0,
                'exploration__advice_share': 0,
            },
            "observation is 'paper': must be one that no area changes",
        ),
        (
            {'courses__at_once': 3, 'courses__per_update': 4},
            'courses.per_update is 4: must be at most 3, the courses at once',
        ),
        (
            {'replay__decisions': 1000, 'courses__at_once': 8},
            r'replay.decisions is 1,000, room for 125 for each of 8, but a batch takes',
        ),
    ],
)
def test_settings_that_do_not_do_for_courses_are_refused(
    settings: dict[str, Any], wrong: str
) -> None:
    config = small_settings(name='small', **settings)
    with pytest.raises(ConfigError, match=wrong):
        tasks_of(config)


def test_courses_with_domains_need_an_observation_with_advice() -> None:
    distribution = replace(small_courses().distribution, domains=(OperatingDomain(n_uavs=(1, 2)),))
    of = {
        'observation': 'egocentric',
        'network__advice_bonus': 0,
        'network__advice_bonus_last': 0,
        'exploration__advice_share': 0,
    }
    with pytest.raises(ConfigError, match="observation is 'egocentric': must be relative for"):
        CourseTasks(distribution, small_settings(**of), Algorithm.AQMIX, 0, 'cpu')


def test_policies_have_the_domains_of_their_courses_and_may_fly_anything() -> None:
    courses, domain = small_courses(), OperatingDomain(n_uavs=(1, 2), data_share=(0.1, 0.5))
    within = replace(courses, distribution=replace(courses.distribution, domains=(domain,)))
    header = Trainer((), small_settings(), 'aqmix', 0, courses=within).snapshot().header
    assert header.domains == (domain,)
    assert (header.n_uavs_min, header.n_uavs_max) == (1, 16)
    assert (header.cells_per_side_min, header.cells_per_side_max) == (1, MAX_CELLS_PER_SIDE)


def test_fleets_that_the_observation_has_no_room_for_are_refused_before_training() -> None:
    courses, config = small_courses(), small_settings()
    fleet = replace(courses.distribution.fleet, n_uavs=(2, 17))
    large = replace(courses.distribution, fleet=fleet)
    wrong = r'courses small: fleet.n_uavs is \[2, 17\]: must end at 16 at most'
    with pytest.raises(ConfigError, match=wrong):
        CourseTasks(large, config, Algorithm.AQMIX, 0, 'cpu')


@pytest.mark.parametrize(
    ('uavs', 'values', 'wrong'),
    [
        (9, {}, 'it has 9 UAVs: must have 1 to 8, as the courses have'),
        (
            2,
            {'area.rows': 10, 'area.columns': 19},
            'it has 19 columns: must have 3 to 18, as the courses have',
        ),
        (
            2,
            {'area.rows': 2, 'area.columns': 10},
            'it has 2 rows: must have 3 to 18, as the courses have',
        ),
    ],
)
def test_a_panel_that_policies_of_these_courses_may_not_fly_is_refused_before_training(
    uavs: int, values: dict[str, object], wrong: str
) -> None:
    spans = {'area.cells_per_side': [3, 18], 'fleet.n_uavs': [1, 8]}
    fleet = {'fleet.uavs': [{'speed_mps': 5.0}] * uavs}
    condition = Condition(name='it', scenario=load('paper_10x10', {**values, **fleet}))
    courses = Courses(
        distribution=load_distribution('anywhere', spans),
        panel=Panel(name='mine', conditions=(condition,)),
    )
    with pytest.raises(ConfigError, match=f'panel mine: {wrong}'):
        Trainer([], small_settings(), 'aqmix', 0, courses=courses)


def test_a_scenario_that_cannot_hold_a_batch_is_refused_before_training() -> None:
    config = small('strong', replay__decisions=1000, replay__missions_per_batch=26)
    wrong = (
        r'replay.decisions is 1,000, room for 1,000, but a batch takes 26 missions of up to 40 '
        r'decisions in an area of 16 cells: must be at least 1,040, or'
    )
    with pytest.raises(ConfigError, match=wrong):
        Trainer([tiny()], config, 'aqmix', 0)

"""Courses: drawn the same every time, within what their distribution says, each one flyable."""

from dataclasses import replace
import math
from pathlib import Path
from typing import Any

import pytest
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import names_in
from uav_collect.errors import ConfigError
from uav_collect.missions.rollout import fly_for_metrics
from uav_collect.scenario.area import open_cells
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.course_draw import draw_course
from uav_collect.training.courses import (
    CourseDistribution,
    load_courses,
    load_distribution,
)
from uav_collect.training.panel import load_panel
from uav_collect.uav.learned_on import strangeness_within

N_COURSES = 100


def anywhere(**overrides: object) -> CourseDistribution:
    values = {name.replace('__', '.'): value for name, value in overrides.items()}
    return load_distribution('anywhere', values)


def drawn() -> list[Scenario]:
    distribution = anywhere()
    return [draw_course(distribution, 0, number) for number in range(N_COURSES)]


def problems_of(folder: Path, change: tuple[str, str]) -> str:
    """What is said of the shipped distribution with one text replaced by another."""
    text = anywhere().to_yaml()
    assert change[0] in text
    (folder / 'mine.yaml').write_text(text.replace(*change))
    with pytest.raises(ConfigError) as error:
        load_distribution(folder / 'mine.yaml')
    return str(error.value)


def test_every_shipped_distribution_is_valid_and_has_its_files_name() -> None:
    names = names_in(shared_folders('training/courses'))
    assert set(names) >= {'anywhere', 'taught'}
    assert tuple(load_courses(name).distribution.name for name in names) == names


def test_a_course_follows_from_distribution_seed_and_number() -> None:
    one = [draw_course(anywhere(), 5, number) for number in range(5)]
    again = [draw_course(anywhere(), 5, number) for number in reversed(range(5))]
    assert one == again[::-1]
    assert len({replace(it, name='same').to_yaml() for it in one}) == 5
    assert draw_course(anywhere(), 6, 0) != one[0]


def test_courses_lie_within_what_a_policy_has_learned_within() -> None:
    distribution = anywhere(area__no_fly_share=0.0)
    for number in range(N_COURSES // 4):
        course = draw_course(distribution, 1, number)
        assert strangeness_within(distribution.learned_within, course) == []


def test_a_domain_that_no_fleet_lies_within_is_refused(tmp_path: Path) -> None:
    domain = 'domains:\n  - {n_uavs: [2, 2], relative_speeds: [[1, 1], [1, 2], [2, 3]]}\n'
    (tmp_path / 'mine.yaml').write_text(f'extends: anywhere\n{domain}')
    with pytest.raises(ConfigError) as error:
        load_distribution(tmp_path / 'mine.yaml')
    why = 'domains.0.relative_speeds is of 3 UAVs: must be of as many as n_uavs says'
    assert str(error.value) == f'{tmp_path / "mine.yaml"}:3: {why}'
    (tmp_path / 'mine.yaml').write_text(f'extends: anywhere\n{domain}'.replace('1, 2', '4, 5'))
    with pytest.raises(ConfigError, match='must be a list that ascends'):
        load_distribution(tmp_path / 'mine.yaml')


def test_a_scenario_outside_the_distribution_is_strange() -> None:
    known = anywhere().learned_within
    assert strangeness_within(known, load('paper_10x10')) == []
    far = load('paper_10x10', {'area.cell_size_m': 900.0, 'fleet.uavs.0.speed_mps': 30.0})
    strange = strangeness_within(known, far)
    assert strange == [
        'cells of 900 m (learned: 30 to 300 m)', 'speeds 10 to 30 m/s (learned: 3 to 20 m/s)',
    ]  # fmt: skip


def test_courses_differ_in_all_that_the_distribution_lets_differ() -> None:
    courses = drawn()
    low, high = anywhere().fleet.n_uavs
    assert {course.n_uavs for course in courses} == {*range(low, high + 1)}
    sides = {side for it in courses for side in (it.area.n_rows, it.area.n_columns)}
    assert {6, 24} <= sides
    ranges_m = {course.radio.contact_range_m for course in courses}
    assert {0.0, math.inf} < ranges_m
    kinds: list[tuple[str, Any]] = [
        ('square', lambda it: it.area.n_rows == it.area.n_columns),
        ('with a zone', lambda it: it.area.no_fly is not None),
        ('all cells', lambda it: it.demand.cell_share == 'all'),
        ('known empty', lambda it: it.demand.is_empty_known),
        ('rough', lambda it: it.radio.loss_share is not None),
        ('alike', lambda it: len({uav.speed_mps for uav in it.uavs}) == 1),
        ('one home', lambda it: len({uav.home_m for uav in it.uavs}) == 1),
        ('faults', lambda it: it.faults is not None),
    ]
    for name, is_so in kinds:
        assert 0 < sum(map(is_so, courses)) < N_COURSES, name


def test_all_open_cells_of_a_course_with_a_zone_are_flown_to() -> None:
    distribution = anywhere(
        area__no_fly_share=1.0, area__cells_per_side=[4, 5], demand__cell_share=[1.0, 1.0],
        fleet__tight_share=0.0, faults__share=0.0,
    )  # fmt: skip
    for number in range(4):
        course = draw_course(distribution, 0, number)
        assert not open_cells(course.area).all()
        assert fly_for_metrics(build_site(course), [0], 'sweep', 'equal').is_complete.all()


@pytest.mark.parametrize(('budget', 'is_complete'), [([0.3, 0.3], False), ([3.0, 3.0], True)])
def test_budgets_are_multiples_of_what_a_course_needs(
    budget: list[float], is_complete: bool
) -> None:
    distribution = anywhere(
        fleet__tight=budget, fleet__tight_share=1.0, area__cells_per_side=[6, 7],
        faults__share=0.0,
    )  # fmt: skip
    for number in range(3):
        site = build_site(draw_course(distribution, 0, number))
        flown = fly_for_metrics(site, [0], 'sweep', 'equal')
        assert flown.is_complete.all() == is_complete


def test_a_distribution_written_out_reads_back_the_same(tmp_path: Path) -> None:
    distribution = anywhere(fleet__n_uavs=[2, 3])
    (tmp_path / 'mine.yaml').write_text(distribution.to_yaml())
    again = load_distribution(tmp_path / 'mine.yaml')
    assert again == distribution
    assert again.fingerprint == distribution.fingerprint != anywhere().fingerprint


def test_what_is_wrong_is_said_with_its_line(tmp_path: Path) -> None:
    line = problems_of(tmp_path, ('square_share: 0.4', 'square_share: 1.4'))
    assert line.endswith('area.square_share is 1.4: must be a number from 0 to 1')
    assert 'mine.yaml:' in line
    line = problems_of(tmp_path, ('square_share: 0.4', 'squares: 0.4'))
    assert 'area.squares is an unknown key' in line
    assert 'area.square_share is missing' in line


@pytest.mark.parametrize(
    ('key', 'value', 'wrong'),
    [
        ('fleet.n_uavs', [4, 2], r'fleet.n_uavs is \[4, 2\]: must be a list \[low, high\]'),
        ('area.cell_size_m', [30.0], r'area.cell_size_m is \[30.0\]'),
        ('faults.kinds', ['lost'], r"faults.kinds.0 is 'lost'"),
        ('base', 'nowhere', r"base is 'nowhere': scenario is 'nowhere': must be a .yaml file"),
    ],
)
def test_values_out_of_range_are_refused(key: str, value: object, wrong: str) -> None:
    with pytest.raises(ConfigError, match=wrong):
        load_distribution('anywhere', {key: value})


def test_courses_that_can_never_start_are_refused() -> None:
    distribution = anywhere(
        area__cells_per_side=[2, 2], fleet__n_uavs=[1, 1], fleet__tight=[0.1, 0.1],
        fleet__tight_share=1.0,
    )  # fmt: skip
    with pytest.raises(ConfigError, match='number 0 cannot be flown, drawn 100 times: scenario'):
        draw_course(distribution, 0, 0)


def test_the_panel_has_twenty_conditions_by_different_names() -> None:
    panel = load_panel('anywhere')
    assert len({condition.name for condition in panel.conditions}) == 20


def test_a_panel_written_out_reads_back_the_same(tmp_path: Path) -> None:
    panel = load_panel('anywhere')
    (tmp_path / 'mine.yaml').write_text(panel.to_yaml())
    assert load_panel(tmp_path / 'mine.yaml') == panel


@pytest.mark.parametrize(
    ('text', 'wrong'),
    [
        ('{name: one, scenario: nowhere}', "conditions.0.scenario is 'nowhere': scenario is"),
        ('{name: one, scenario: paper_8x8, uavs: 0}', 'conditions.0.uavs is 0: must be a whole'),
        ('{name: one, scenario: paper_8x8, set: 3}', 'conditions.0.set is 3: must be a mapping'),
        ('{name: one, scenario: paper_8x8, set: {radio.reach: 3}}', 'radio.reach is an unknown'),
        (
            '{name: one, scenario: paper_8x8, sets: {}}',
            'conditions.0.sets is an unknown key: must be one of name, scenario, set, uavs',
        ),
        ('{scenario: paper_8x8}', 'conditions.0.name is missing'),
        (
            '{name: one, scenario: paper_8x8}\n- {name: one, scenario: paper_8x8}',
            "conditions.1.name is 'one': must be unique",
        ),
    ],
)
def test_a_wrong_panel_is_refused_with_the_line(tmp_path: Path, text: str, wrong: str) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(f'conditions:\n- {text}\n')
    with pytest.raises(ConfigError, match=wrong) as error:
        load_panel(path)
    assert 'mine.yaml:' in str(error.value)


def test_taught_courses_have_fleets_that_teachers_know_over_fields_of_all_kinds() -> None:
    distribution = load_distribution('taught')
    courses = [draw_course(distribution, 0, number) for number in range(N_COURSES)]
    fleets = {it.speeds_mps for it in distribution.taught_fleets}
    assert {tuple(uav.speed_mps for uav in it.uavs) for it in courses} == fleets
    assert {it.area.n_rows for it in courses} == {8, 10, 12}
    assert any(it.faults for it in courses)
    assert any(math.isinf(it.radio.contact_range_m) for it in courses)
    assert len({it.sensors for it in courses}) == N_COURSES
    base = distribution.base
    n_of_field = sum(it.area.cell_size_m == base.area.cell_size_m for it in courses)
    assert 0.55 * N_COURSES < n_of_field < 0.85 * N_COURSES
    budget_kj = base.uavs[0].energy_budget_kj
    n_of_budget = sum(it.uavs[0].energy_budget_kj == budget_kj for it in courses)
    assert 0.35 * N_COURSES < n_of_budget < 0.65 * N_COURSES


def test_fleets_outside_of_the_spans_are_left_out_of_taught_courses() -> None:
    narrow = {'area.cells_per_side': [8, 9], 'fleet.n_uavs': [1, 8]}
    sides = {it.cells_per_side for it in load_distribution('taught', narrow).taught_fleets}
    assert sides == {8}
    without = load_distribution('taught', {'area.cells_per_side': [6, 7]})
    assert without.taught_fleets == ()
    fleets = [{'speeds_mps': [5.0, 9.0]}]
    (wide,) = load_distribution('taught', {'taught.fleets': fleets}).taught_fleets
    assert wide.cells_per_side is None
    odd = [draw_course(load_distribution('taught', {'taught.fleets': fleets}), 0, number).area
           for number in range(8)]  # fmt: skip
    assert any(it.n_rows != it.n_columns for it in odd)
    assert draw_course(without, 0, 0) == draw_course(replace(without, taught=None), 0, 0)

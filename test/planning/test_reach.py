"""How far a fleet's energy reaches: near what missions collect, silent where all is collected."""

from collections.abc import Callable
import re

import numpy as np
import odd_areas
import pytest
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.missions.rollout import fly
from uav_collect.planning.reach import energy_remark, reach_of, spare_remark, take_off_lines
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site

_BUDGET = 'fleet.default.energy_budget_kj'


def paper(budget_kj: float) -> Scenario:
    return load('paper_10x10', {_BUDGET: budget_kj})


def pipeline(budget_kj: float) -> Scenario:
    return odd_areas.pipeline(21, fleet__default__energy_budget_kj=budget_kj)


def wind_farm(budget_kj: float) -> Scenario:
    return load('lillgrund', {_BUDGET: budget_kj, 'demand.known_empty': 'sensors'})


def with_a_hole(budget_kj: float) -> Scenario:
    return odd_areas.with_a_hole(fleet__default__energy_budget_kj=budget_kj)


@pytest.mark.parametrize(
    ('field', 'budgets_kj'),
    [
        (paper, (12.0, 25.0, 30.0)),
        (pipeline, (15.0, 25.0, 35.0)),
        (wind_farm, (60.0, 100.0, 140.0)),
        (with_a_hole, (15.0, 25.0, 35.0)),
    ],
)
def test_the_estimate_is_within_a_dozen_points_of_what_the_sweep_collects(
    field: Callable[[float], Scenario], budgets_kj: tuple[float, ...]
) -> None:
    for budget_kj in budgets_kj:
        site = build_site(field(budget_kj))
        shares = [mission_metrics(log).collected_share for log in fly(site, range(4), 'sweep')]
        assert reach_of(site)[0] == pytest.approx(np.mean(shares), abs=0.12), budget_kj


@pytest.mark.parametrize(
    ('field', 'budget_kj'),
    [(paper, 40.0), (pipeline, 45.0), (wind_farm, 190.0), (with_a_hole, 60.0)],
)
def test_nothing_is_said_of_a_fleet_whose_missions_are_complete(
    field: Callable[[float], Scenario], budget_kj: float
) -> None:
    site = build_site(field(budget_kj))
    assert all(mission_metrics(log).is_complete for log in fly(site, range(3), 'sweep'))
    assert energy_remark(site) is None


@pytest.mark.parametrize('field', [paper, pipeline, wind_farm, with_a_hole])
def test_more_energy_reaches_further_and_as_much_as_is_said_reaches_all(
    field: Callable[[float], Scenario],
) -> None:
    reached = [reach_of(build_site(field(budget_kj)))[0] for budget_kj in (13.0, 20.0, 40.0, 80.0)]
    assert reached == sorted(reached)
    _, times = reach_of(build_site(field(30.0)))
    assert reach_of(build_site(field(30.0 * times)))[0] == 1.0
    assert times == 1.0 or reach_of(build_site(field(30.0 * times * 0.95)))[0] < 1.0


def test_the_remark_says_how_far_and_how_much_more_it_takes() -> None:
    remark = energy_remark(build_site(paper(25.0)))
    assert remark is not None
    assert re.fullmatch(
        r"the fleet's energy reaches about \d\d % of the cells that may hold data, \d\.\d times "
        'as much all of them: give more energy, more UAVs or a smaller area',
        remark,
    )
    assert take_off_lines(build_site(paper(25.0)))[1:] == [remark]
    for n_uavs, fleet in ((1, '1 UAV, '), (2, '2 UAVs, ')):
        site = build_site(with_uavs(paper(100.0), n_uavs))
        assert take_off_lines(site)[0].startswith(f'scenario paper_10x10: {fleet}')


def test_one_uav_is_said_to_do_where_half_its_energy_does_and_then_it_does() -> None:
    assert spare_remark(build_site(paper(40.0))) is None
    ample = paper(200.0)
    assert (spare_remark(build_site(ample)) or '').startswith('1 UAV would do, by an estimate')
    alone = build_site(with_uavs(ample, 1))
    assert spare_remark(alone) is None
    assert all(mission_metrics(log).is_complete for log in fly(alone, range(2), 'sweep'))

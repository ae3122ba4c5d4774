"""What the rules promise over fields that are no open squares: all data, and short ways."""

from collections.abc import Callable

import numpy as np
import odd_areas
import pytest
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import HOVER
from uav_collect.uav.briefing import brief

SLOW_AND_FAST = [{'speed_mps': 10.0}, {'speed_mps': 18.0}]
RULES = ('sweep', 'hert', 'hert-equal')
FIELDS: dict[str, Callable[..., Scenario]] = {
    'L with a hole': odd_areas.with_a_hole,
    'pipeline': lambda **overrides: odd_areas.pipeline(15, **overrides),
    'corridor': lambda **overrides: odd_areas.corridor(1, 12, **overrides),
    'maze': odd_areas.maze,
    'rectangle': lambda **overrides: odd_areas.corridor(5, 11, **overrides),
}


def logs(scenario: Scenario, rule: str, n_missions: int) -> list[MissionLog]:
    return fly(build_site(scenario), range(n_missions), rule, 'equal')


def cells_of(scenario: Scenario, log: MissionLog) -> list[int]:
    """The cells at whose centres the UAVs decided."""
    area = scenario.area
    rows = (log.events['y_m'] / area.cell_size_m).astype(int)
    columns = (log.events['x_m'] / area.cell_size_m).astype(int)
    cells: list[int] = (rows * area.n_columns + columns).tolist()
    return cells


@pytest.mark.parametrize('range_m', [0.0, 200.0])
@pytest.mark.parametrize('rule', RULES)
@pytest.mark.parametrize('field', FIELDS.values(), ids=FIELDS)
def test_the_rules_collect_everything_in_any_field(
    field: Callable[..., Scenario], rule: str, range_m: float
) -> None:
    for n_uavs in (1, 3):
        fleet = [{'speed_mps': 10.0 + uav} for uav in range(n_uavs)]
        scenario = field(radio__contact_range_m=range_m, fleet__uavs=fleet)
        is_open = brief(scenario).is_open
        for log in logs(scenario, rule, 1):
            assert mission_metrics(log).is_complete
            assert all(is_open[cell] for cell in cells_of(scenario, log))


def test_the_sweep_takes_little_longer_along_a_pipeline_than_anybody_needs() -> None:
    # The faster UAV has to come to the far end and back, and hovers; 18 m/s.
    scenario = odd_areas.pipeline(31)
    for log in logs(scenario, 'sweep', 1):
        assert mission_metrics(log).completion_s < 1.2 * 2 * 3000.0 / 18.0


def test_a_uav_serves_its_own_piece_before_it_helps_others() -> None:
    # Who hears the others trusts them as who hears nothing does; four gain over one.
    fleets = [(1, 0.0), (4, 0.0), (4, 2000.0)]
    alone_s, deaf_s, hearing_s = (
        mission_metrics(log).completion_s
        for n_uavs, range_m in fleets
        for log in logs(odd_areas.arms(n_uavs, radio__contact_range_m=range_m), 'sweep', 1)
    )
    assert hearing_s < 1.1 * deaf_s < 0.8 * alone_s


def test_the_sweep_gains_by_what_everybody_knows() -> None:
    known, unknown = (
        np.mean(
            [
                mission_metrics(log).efficiency_kbit_per_j
                for log in logs(odd_areas.pipeline(21, demand__known_empty=word), 'sweep', 1)
            ]
        )
        for word in ('sensors', 'none')
    )
    assert known > 2.0 * unknown


def test_where_all_is_known_whoever_is_done_lands_and_the_fleet_spends_less_than_herts() -> None:
    scenario = odd_areas.arms(2, fleet__uavs=SLOW_AND_FAST)
    sweep, hert = (mission_metrics(logs(scenario, rule, 1)[0]) for rule in ('sweep', 'hert'))
    assert sweep.is_complete
    assert sweep.energy_j < 0.9 * hert.energy_j
    assert sweep.completion_s < hert.completion_s
    first_s, last_s = sorted(uav.landed_s for uav in sweep.uavs)
    assert first_s < last_s - 5.0


def test_where_every_cell_is_known_to_hold_data_the_sweep_comes_to_each_and_lands() -> None:
    # Lanes are for those who look for data; here a slow UAV would wait for the fast one.
    places = [(column, row) for column in range(3) for row in range(4)]
    entries = [
        {'id': f's{column}{row}', 'x_m': 50.0 * column + 25.0, 'y_m': 50.0 * row + 25.0}
        for column, row in places
    ]
    sensors = {'kind': 'listed', 'entries': entries}
    fleet = [{'speed_mps': speed_mps} for speed_mps in (4.0, 4.0, 18.0)]
    known = {'cell_share': 'all', 'data_mbit': [0.1, 1.0], 'known_empty': 'sensors'}
    scenario = odd_areas.corridor(4, 3, sensors=sensors, fleet__uavs=fleet, demand=known)
    sweep, hert = (mission_metrics(logs(scenario, rule, 1)[0]) for rule in ('sweep', 'hert'))
    assert sweep.is_complete
    assert sweep.energy_j < 0.5 * hert.energy_j


@pytest.mark.parametrize('gone', [1, 2])
def test_where_a_uav_may_fail_the_sweep_waits_and_collects_everything(gone: int) -> None:
    faults = [{'uav': gone, 'kind': 'gone', 'at_s': 30.0}]
    scenario = odd_areas.arms(2, fleet__uavs=SLOW_AND_FAST, faults=faults)
    [log] = logs(scenario, 'sweep', 1)
    assert mission_metrics(log).is_complete


def test_hert_comes_to_no_cell_for_its_own_sake_that_holds_no_data() -> None:
    scenario = odd_areas.pipeline(15)
    for log in logs(scenario, 'hert', 3):
        decisions = len(log.events)
        assert (log.events['action'] == HOVER).sum() == 15
        assert decisions < 15 + 2 * (15 + 15 + 3)  # a hover in each column, two moves to the next


def test_hert_flies_as_well_along_a_field_that_lies_the_other_way() -> None:
    here, there = (
        np.mean([mission_metrics(log).completion_s for log in logs(scenario, 'hert', 10)])
        for scenario in (odd_areas.corridor(5, 9), odd_areas.corridor(9, 5))
    )
    assert here == pytest.approx(there, rel=0.15)

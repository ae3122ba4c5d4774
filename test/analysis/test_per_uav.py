"""What each UAV takes: by hand for two missions, and as a table that stays readable."""

from dataclasses import replace
from io import StringIO
import math

import pytest
from tiny_world import fly_scripts, tiny
from uav_collect.analysis.console import plain_console
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.analysis.per_uav import uav_columns, uav_figures, uav_table, uav_values
from uav_collect.analysis.statistics import estimates
from uav_collect.analysis.tables import evaluation_table
from uav_collect.uav.action_codes import FORWARD, HOVER, RIGHT


def shown(table: object, columns: int = 80) -> list[str]:
    text = StringIO()
    plain_console(file=text, width=columns).print(table)
    return text.getvalue().splitlines()


@pytest.fixture(scope='module')
def missions() -> tuple[MissionMetrics, MissionMetrics]:
    """UAV 1 reads A; UAV 2 stays in the first mission and flies on its own in the second."""
    scripts = [RIGHT, HOVER], [], [RIGHT, HOVER], [FORWARD, FORWARD]
    logs = [fly_scripts(tiny(), *scripts[:2]), fly_scripts(tiny(), *scripts[2:])]
    return mission_metrics(logs[0]), mission_metrics(logs[1])


def test_figures_are_means_and_mosts_of_each_uav(
    missions: tuple[MissionMetrics, MissionMetrics],
) -> None:
    first, second = uav_figures(missions)
    [one, _], [idle, flew] = missions[0].uavs, [mission.uavs[1] for mission in missions]
    assert (first.id, second.id) == (1, 2)
    assert first.energy_kj == first.most_energy_kj == pytest.approx(one.energy_j / 1e3)
    assert first.collected_mbit == 1.0
    assert idle.energy_j == 0.0
    assert second.energy_kj == pytest.approx(flew.energy_j / 2e3)
    assert second.most_energy_kj == flew.energy_j / 1e3
    assert second.most_energy_share == flew.energy_j / flew.energy_budget_j
    assert (second.landed_s, second.latest_landed_s) == (flew.landed_s / 2, flew.landed_s)


def test_the_values_of_a_row_stand_under_their_columns(
    missions: tuple[MissionMetrics, MissionMetrics],
) -> None:
    row = dict(zip(uav_columns(2), uav_values(missions[1]), strict=True))
    assert row['uav_2_energy_kj'] == missions[1].uavs[1].energy_j / 1e3
    assert row['uav_1_landed_s'] == missions[1].uavs[0].landed_s
    assert row['uav_1_collected_mbit'] == 1.0


def test_a_table_of_one_mission_has_no_mosts(
    missions: tuple[MissionMetrics, MissionMetrics],
) -> None:
    text = '\n'.join(shown(uav_table({'a': missions[:1]})))
    assert 'most' not in text
    assert f'{missions[0].uavs[0].landed_s:.1f}' in text
    assert 'most' in '\n'.join(shown(uav_table({'a': missions})))


def test_who_has_not_landed_has_no_time(missions: tuple[MissionMetrics, MissionMetrics]) -> None:
    uavs = [replace(uav, landed_s=math.nan) for uav in missions[0].uavs]
    lost = replace(missions[0], uavs=tuple(uavs))
    assert uav_figures([lost])[0].to_json()['landed_s'] is None
    [row] = [line.split() for line in shown(uav_table({'a': [lost]})) if line.split()[:1] == ['1']]
    assert row[-2] == '-'


def test_of_a_large_fleet_only_those_at_the_limit_are_shown(
    missions: tuple[MissionMetrics, MissionMetrics],
) -> None:
    first = missions[0].uavs[0]
    uavs = [replace(first, id=number, energy_j=1e3, landed_s=10.0) for number in range(1, 65)]
    uavs[16] = replace(uavs[16], energy_j=9e3)
    uavs[40] = replace(uavs[40], landed_s=99.0)
    lines = shown(uav_table({'a': [replace(missions[0], uavs=tuple(uavs))]}))
    numbers = [line.split()[0] for line in lines if line.strip() and line.split()[0].isdigit()]
    assert numbers == ['17', '41']
    assert 'of 64 UAVs, those that use most of their energy or land last' in lines


@pytest.mark.parametrize('columns', [20, 80, 200])
def test_no_figure_is_lost_on_a_narrow_terminal(
    missions: tuple[MissionMetrics, MissionMetrics], columns: int
) -> None:
    flown = {f'runs/a_long_way/to_a/policy_{name}.safetensors': missions for name in 'ab'}
    lines = shown(uav_table(flown, columns), max(columns, 80))
    assert '\u2026' not in ''.join(lines)
    assert sum(f'{uav_figures(missions)[0].energy_kj:.2f}' in line for line in lines) == 2


def test_measures_that_are_whole_in_every_mission_share_a_line(
    missions: tuple[MissionMetrics, MissionMetrics],
) -> None:
    whole = [replace(it, collected_bit=it.total_bit * (1 - 1e-16)) for it in missions]
    lines = shown(evaluation_table({'a': whole}, {'a': estimates(whole, 0)}))
    assert '100 % in every mission: data collected, complete missions, safe returns' in lines
    assert not any('[share]' in line for line in lines)
    lines = shown(evaluation_table({'a': missions}, {'a': estimates(missions, 0)}))
    assert '100 % in every mission: safe returns' in lines
    assert sum('[share]' in line for line in lines) == 2

"""Tables of missions beside the plans that they are compared with."""

from dataclasses import replace
from io import StringIO
import math

from bounds import bound, plans
import numpy as np
import pytest
from uav_collect.analysis.console import plain_console
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.plan_shares import efficiency_share, time_share
from uav_collect.analysis.statistics import Estimate, estimates
from uav_collect.analysis.tables import (
    comparison_table,
    difference_table,
    evaluation_table,
    mission_tables,
    mission_warnings,
    verdict,
)
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import HOME, HOVER

pytestmark = pytest.mark.usefixtures('bound_cache')


def shown(table: object, columns: int = 100) -> str:
    text = StringIO()
    plain_console(file=text, width=columns).print(table)
    return text.getvalue()


def test_tables_of_a_mission_tell_how_near_it_came() -> None:
    scenario = load('paper_8x8')
    [log] = fly(build_site(scenario), [4], 'sweep')
    mission, found = mission_metrics(log), bound(scenario, 4)
    lines = shown(mission_tables(log.header, mission, None, found)).splitlines()
    for name, share in (
        ('completion time', time_share(mission, found)),
        ('energy efficiency', efficiency_share(mission, found)),
    ):
        [line] = [line for line in lines if name in line]
        assert f'{math.floor(1000 * share) / 10:.1f} % of the clairvoyant plan' in line
    assert 'clairvoyant' not in shown(mission_tables(log.header, mission))
    rows = shown(comparison_table({'sweep': mission}, found))
    for name, plan in zip(('shortest', 'thriftiest'), plans(found), strict=True):
        [line] = [line for line in rows.splitlines() if f'{name} plan' in line]
        assert f'{plan.completion_s:.1f}' in line
        assert f'{plan.total_energy_j / 1e3:.2f}' in line


def test_names_stand_in_tables_as_they_are_but_on_one_line_and_not_too_long() -> None:
    [log] = fly(build_site(load('paper_8x8')), [4], 'sweep')
    named = {'a[/b]': 'a[/b]', '[red]x': '[red]x', ':cat:': ':cat:', 'a\x1b[2Jb': 'a\\x1b[2Jb'}
    named['n' * 1000] = f'{"n" * 61}...'
    for name, wanted in named.items():
        uavs = tuple(replace(uav, policy=name) for uav in log.header.uavs)
        header = replace(log.header, scenario=name, uavs=uavs)
        mission = mission_metrics(log)
        rows = {name: estimates([mission, mission], 0)}
        tables = [
            mission_tables(header, mission),
            comparison_table({name: mission}),
            evaluation_table({name: [mission, mission]}, rows),
            difference_table(name, rows),
        ]
        for table in tables:
            text = shown(table, 250)
            assert wanted in text
            assert max(map(len, text.splitlines())) <= 250
            assert '\x1b' not in text


def test_a_recording_that_lacks_events_is_not_said_to_have_left_data_behind() -> None:
    [log] = fly(build_site(load('paper_8x8')), [4], 'sweep')
    hover = int(np.flatnonzero(log.events['action'] == HOVER)[0])
    gappy = replace(log, events=np.delete(log.events, hover))
    [line] = mission_warnings(mission_metrics(gappy), ['S1'])
    left_mbit = log.events['collected_bit'][hover] / 1e6
    assert line == (
        f'of {left_mbit:.2f} Mbit it is not known whether they were collected:'
        ' events were not recorded'
    )


def test_a_uav_whose_way_home_was_not_recorded_is_not_said_to_fly() -> None:
    [log] = fly(build_site(load('paper_8x8')), [4], 'sweep')
    home = int(np.flatnonzero(log.events['action'] == HOME)[0])
    assert home < len(log.events) - 1
    number = log.events['uav'][home]
    gappy = replace(log, events=np.delete(log.events, home))
    mission = mission_metrics(gappy)
    line = f'of UAV {number} it is not known whether it landed: events were not recorded'
    assert mission_warnings(mission) == [line]
    text = shown(mission_tables(gappy.header, mission))
    [row] = [line.split() for line in text.splitlines() if line.split()[:1] == [str(number)]]
    assert row[4] == '-'
    assert row[-2:] == ['not', 'known']


def guarded(policy: str, guard_after: int = GUARD_AFTER) -> MissionLog:
    less = {'fleet.default.energy_budget_kj': 100.0}
    site = build_site(load('paper_8x8', less))
    [log] = fly(site, [4], policy, 'equal', guard_after)
    return log


def test_tables_count_what_the_guard_took_where_it_took_any() -> None:
    log = guarded('user_policies:Wanderer')
    mission = mission_metrics(log)
    assert all(unit.n_guarded > 0 for unit in mission.uavs)
    lines = shown(mission_tables(log.header, mission)).splitlines()
    assert f'{mission.n_guarded} by the guard' in next(line for line in lines if 'decis' in line)
    for unit in mission.uavs:
        [row] = [line.split() for line in lines if line.split()[:1] == [str(unit.id)]]
        assert row[7:9] == [str(unit.n_decisions), f'({unit.n_guarded})']
    without = guarded('user_policies:Wanderer', 0)
    assert 'guard' not in shown(mission_tables(without.header, mission_metrics(without)))


def test_an_evaluation_says_in_how_many_missions_guards_decided() -> None:
    flown = {
        name: [mission_metrics(guarded('user_policies:Wanderer', guard_after))]
        for name, guard_after in (('guarded', GUARD_AFTER), ('alone', 0))
    }
    rows = {name: estimates(missions, 4) for name, missions in flown.items()}
    text = shown(evaluation_table(flown, rows))
    n_guarded = flown['guarded'][0].n_guarded
    assert (
        f'guarded: the guard took {n_guarded} decisions, in 1 of 1 missions (first in seed 4)'
        in text
    )
    assert 'alone: the guard' not in text


def test_a_long_name_of_a_policy_is_shown_whole_on_a_narrow_terminal() -> None:
    scenario = load('paper_8x8')
    missions = [mission_metrics(log) for log in fly(build_site(scenario), [4, 5], 'sweep')]
    name = 'a_package.of_mine:a_policy_with_a_name_that_is_as_long_as_it_may'
    comparison = comparison_table({name: missions[0]}, bound(scenario, 4))
    evaluation = evaluation_table({name: missions}, {name: estimates(missions, 2)})
    for table in (comparison, evaluation):
        lines = shown(table, columns=80).splitlines()
        assert '\u2026' not in ''.join(lines)  # the sign for what was cut
        assert max(map(len, lines)) <= 80
        assert name in ''.join(word for line in lines for word in line.split() if word in name)


def test_names_of_twenty_letters_are_shown_whole_in_eighty_columns() -> None:
    missions = [mission_metrics(log) for log in fly(build_site(load('paper_8x8')), [4], 'sweep')]
    flown = dict.fromkeys(('my_own_policies:Rows', 'my_own_policies:Cols'), missions)
    rows = {name: estimates(missions, 2) for name in flown}
    lines = shown(evaluation_table(flown, rows), columns=80).splitlines()
    measured = lines[: next(at for at, line in enumerate(lines) if 'UAV' in line)]
    for name in flown:
        assert sum(f' {name} ' in line for line in measured) >= 3
    assert max(map(len, lines)) <= 80


def test_a_verdict_names_the_best_of_those_that_collect_most() -> None:
    def row(completion_s: float, energy_kj: float, collected_share: float) -> list[Estimate]:
        means = (1.0, completion_s, energy_kj, collected_share, 0.5, 1.0)
        return [Estimate(mean=mean, low=mean, high=mean, median=mean) for mean in means]

    rows = {'slow': row(300.0, 70.0, 1.0), 'fast': row(200.0, 80.0, 0.9999)}
    line = 'on average: quickest fast, 200.0 s; thriftiest slow, 70.00 kJ'
    assert verdict(rows).plain == line
    rows['lazy'] = row(10.0, 1.0, 0.5)  # it leaves data behind
    assert verdict(rows).plain == line.replace(':', ' of those that collect most:', 1)
    rows['same'] = rows['fast']
    assert 'quickest fast and same, 200.0 s; thriftiest slow,' in verdict(rows).plain

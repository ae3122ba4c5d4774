"""Tables of missions beside the plans that they are compared with."""

import math

from bounds import bound, plans
import pytest
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.plan_shares import efficiency_share, time_share
from uav_collect.analysis.tables import comparison_table, mission_tables
from uav_collect.missions.rollout import fly
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site

pytestmark = pytest.mark.usefixtures('bound_cache')


def shown(table: object) -> str:
    from io import StringIO

    from rich.console import Console

    text = StringIO()
    Console(file=text, width=100).print(table)
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

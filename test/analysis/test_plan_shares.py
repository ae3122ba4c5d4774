"""How near missions come to the clairvoyant plans."""

import math

from bounds import bound, flown, plans
import pytest
from tiny_world import fly_scripts, tiny
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.plan_shares import efficiency_share, plan_shares, time_share
from uav_collect.scenario.load import load

pytestmark = pytest.mark.usefixtures('bound_cache')


def test_a_share_is_1_where_a_mission_is_as_good_as_the_plan() -> None:
    scenario = load('paper_8x8')
    found = bound(scenario, 2)
    shortest, thriftiest = plans(found)
    assert time_share(flown(scenario, shortest, 2), found) == pytest.approx(1.0)
    assert efficiency_share(flown(scenario, thriftiest, 2), found) == pytest.approx(1.0)
    reached = plan_shares(flown(scenario, shortest, 2), found)
    assert reached['efficiency_share_of_shortest'] == pytest.approx(1.0)
    least_j = thriftiest.total_energy_j
    assert reached['efficiency_share'] == pytest.approx(least_j / shortest.total_energy_j)


def test_a_mission_that_left_data_behind_has_no_share() -> None:
    scenario = tiny()
    left = mission_metrics(fly_scripts(scenario, [], []))
    assert not left.is_complete
    assert all(map(math.isnan, plan_shares(left, bound(scenario)).values()))

"""The legs of a mission: they follow each other, and add up to what the log says."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from tiny_world import fly_scripts, MOVE_5_J, tiny, uav
from uav_collect.analysis.legs import (
    HOME_LEG,
    home_way_m,
    HOVER_LEG,
    mission_legs,
    MOVE_LEG,
    state_at,
)
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.kernels.arrays import row_of
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import FORWARD, HOVER, RIGHT
from uav_collect.uav.briefing import brief

ONE = tiny(uav(5.0))


@pytest.fixture(scope='module')
def log() -> MissionLog:
    return fly_scripts(ONE, [RIGHT, HOVER, FORWARD])


def test_each_action_is_a_leg_and_so_is_the_way_home(log: MissionLog) -> None:
    [legs] = mission_legs(log, ONE)
    assert [leg.kind for leg in legs] == [MOVE_LEG, HOVER_LEG, MOVE_LEG, HOME_LEG]
    assert [leg.start_m for leg in legs] == [
        (25.0, 25.0),
        (75.0, 25.0),
        (75.0, 25.0),
        (75.0, 75.0),
    ]
    assert legs[-1].end_m == (25.0, 25.0)
    assert [leg.length_m for leg in legs] == pytest.approx([50.0, 0.0, 50.0, 50.0 * 2**0.5])


def test_legs_of_a_mission_follow_each_other_and_add_up() -> None:
    scenario = load('paper_8x8')
    [flown] = fly(build_site(scenario), [1], 'sweep')
    uavs = mission_metrics(flown).uavs
    for own, metrics in zip(mission_legs(flown, scenario), uavs, strict=True):
        for leg, after in pairwise(own):
            assert leg.end_s == pytest.approx(after.start_s)
            assert leg.end_m == pytest.approx(after.start_m)
            assert leg.energy_left_j - leg.energy_j == pytest.approx(after.energy_left_j)
        assert sum(leg.energy_j for leg in own) == pytest.approx(metrics.energy_j)
        assert own[-1].end_s == pytest.approx(metrics.landed_s)
        flown_m = sum(leg.length_m for leg in own)
        assert flown_m == pytest.approx(metrics.flight_s * metrics.speed_mps)


def test_between_the_ends_of_a_leg_place_and_energy_change_evenly(log: MissionLog) -> None:
    [legs] = mission_legs(log, ONE)
    state = state_at(legs, 2.5)
    assert state.place_m == pytest.approx((37.5, 25.0))
    assert state.energy_left_j == pytest.approx(1e6 - MOVE_5_J / 4, rel=1e-6)
    assert state.leg == legs[0]
    assert state_at(legs, 10.0).leg == legs[1]  # a leg ends as the next one begins


def test_who_has_landed_stays_where_the_last_leg_ended(log: MissionLog) -> None:
    [legs] = mission_legs(log, ONE)
    state = state_at(legs, legs[-1].end_s)
    assert (state.place_m, state.leg) == ((25.0, 25.0), None)
    used_j = float(log.events['energy_j'].sum())
    assert state.energy_left_j == pytest.approx(ONE.uavs[0].energy_budget_j - used_j)


def test_a_way_home_has_the_corners_that_the_briefing_names() -> None:
    around = brief(ONE)
    via = [-1] * 16
    via[14] = 10  # from the third cell of the north row by that below it, then by cell 5
    via[10] = 5
    around = around._replace(has_obstacles=1, home_via=row_of(via))
    centres_m = [(125.0, 175.0), (125.0, 125.0), (75.0, 75.0)]
    assert home_way_m(around, 0, centres_m[0]) == (*centres_m, (25.0, 25.0))
    assert home_way_m(around, 0, (75.0, 25.0)) == ((75.0, 25.0), (25.0, 25.0))


def test_where_a_log_lacks_decisions_no_state_is_known(log: MissionLog) -> None:
    for lacking in (0, 1):
        kept = replace(log, events=np.delete(log.events, lacking))
        [legs], [whole] = mission_legs(kept, ONE), mission_legs(log, ONE)
        gap = whole[lacking]
        for time_s in (gap.start_s, (gap.start_s + gap.end_s) / 2):
            assert state_at(legs, time_s) is None
        assert state_at(legs, gap.end_s) == state_at(
            [replace(leg, is_after_gap=leg.event == gap.event + 1) for leg in whole], gap.end_s
        )

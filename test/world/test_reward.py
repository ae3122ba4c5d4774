import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from tiny_world import fly_scripts, HOVER_W, MOVE_10_J, rate_bps, tiny, uav
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.kernels.arrays import row_of
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOVER, LEFT, RIGHT
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.view import new_view_rows
from uav_collect.world.dynamics import look, Mission, mission_of, start_action
from uav_collect.world.mission_start import new_missions
from uav_collect.world.reward import interval_reward, reward_terms, RewardTerms
from uav_collect.world.sensor_field import lay_out, most_sensors

PENALTY = 0.01
LOG_GAMMA = math.log(0.99)


def integral(duration_s: float) -> float:
    """Of 0.99^t over a duration."""
    return (0.99**duration_s - 1.0) / LOG_GAMMA


def rewards(scenario: Scenario, *scripts: list[int]) -> list[float]:
    return fly_scripts(scenario, *scripts, allocator='equal').events['reward'].tolist()


def bonus(log: MissionLog, largest_budget_j: float = 1e6) -> float:
    """Of the mission's end, undiscounted: the budget times Mbit over J."""
    mission = mission_metrics(log)
    return largest_budget_j * mission.collected_bit / 1e6 / mission.energy_j


def test_a_mission_of_three_events_is_worth_what_was_worked_out_by_hand() -> None:
    # East for 5 s, 1 Mbit collected in 1 / 2.12 s, 5 s home; then the bonus of 1 MJ * 1 Mbit / E.
    scenario = tiny(uav(10.0), radio__system_bandwidth_mhz=0.5)
    rate = rate_bps(0.5e6)
    hover_s = 1e6 / rate
    energy_j = 2 * MOVE_10_J + HOVER_W * hover_s
    move, hover, home = rewards(scenario, [RIGHT, HOVER])
    assert move == pytest.approx(-PENALTY * integral(5.0), rel=1e-9)
    assert hover == pytest.approx(rate / 1e6 * integral(hover_s), rel=1e-6)
    assert home == pytest.approx(-PENALTY * integral(5.0) + 0.99**5.0 * 1e6 / energy_j, rel=1e-5)


def test_a_sensor_counts_until_its_data_is_up_not_until_the_hover_ends() -> None:
    scenario = tiny(uav(10.0, start=(2, 2)), radio__system_bandwidth_mhz=0.5)
    rate = rate_bps(0.25e6)  # of either sensor; one has 0.5 Mbit, the other 0.25
    hover = rewards(scenario, [HOVER])[0]
    worth = rate / 1e6 * (integral(0.5e6 / rate) + integral(0.25e6 / rate))
    assert hover == pytest.approx(worth, rel=1e-6)


def test_an_undiscounted_hover_is_worth_its_data() -> None:
    scenario = tiny(uav(10.0, start=(2, 2)), reward__discount_per_s=1.0)
    assert rewards(scenario, [HOVER, RIGHT])[0] == pytest.approx(0.75, rel=1e-12)


def test_a_hover_split_by_events_of_others_is_still_worth_its_data() -> None:
    # 40 Mbit take the slow one some 19 s; the fast one decides every 5 s meanwhile.
    fleet = [uav(5.0, start=(0, 1)), uav(10.0, start=(3, 3))]
    scenario = tiny(
        *fleet,
        sensors=[(75.0, 25.0, 40.0), (60.0, 25.0, 10.0)],
        reward__discount_per_s=1.0,
        reward__move_penalty_per_s=0.0,
    )
    log = fly_scripts(scenario, [HOVER], [LEFT, LEFT, LEFT, BACKWARD, RIGHT])
    assert len(log.events) > 6
    assert (log.events['reward'][:-1] > 0).sum() >= 5
    assert log.events['reward'].sum() - bonus(log) == pytest.approx(50.0, rel=1e-10)


@pytest.mark.parametrize('policy', ['hert', 'sweep'])
def test_undiscounted_rewards_sum_to_data_less_penalties_and_one_bonus(policy: str) -> None:
    site = build_site(
        load('paper_8x8', {'reward.discount_per_s': 1.0, 'radio.csi_error_variance': 0.01})
    )
    for log in fly(site, range(5), policy):
        mission = mission_metrics(log)
        flight_s = sum(unit.flight_s for unit in mission.uavs)
        expected = mission.collected_bit / 1e6 - PENALTY * flight_s + bonus(log)
        assert log.events['reward'].sum() == pytest.approx(expected, rel=1e-9)


def test_the_bonus_comes_once_at_the_end_discounted_over_the_last_interval() -> None:
    scenario = tiny(uav(5.0, start=(0, 1)), uav(10.0), reward__move_penalty_per_s=0.0)
    log = fly_scripts(scenario, [HOVER, RIGHT], [FORWARD, FORWARD], allocator='equal')
    worth = log.events['reward'] / np.maximum(log.events['interval_s'], 1e-9)
    hovering = log.events['time_s'] < log.events['duration_s'][0]
    assert (log.events['reward'][~hovering][:-1] == 0.0).all()
    assert (worth[hovering] < 3.0).all()
    last = log.events[-1]
    assert last['reward'] == pytest.approx(0.99 ** last['interval_s'] * bonus(log), rel=1e-9)


def test_the_bonus_is_scaled_by_the_largest_budget() -> None:
    fleet = [uav(5.0, start=(0, 1), energy_budget_kj=100.0), uav(10.0, energy_budget_kj=400.0)]
    scenario = tiny(*fleet, reward__discount_per_s=1.0, reward__move_penalty_per_s=0.0)
    log = fly_scripts(scenario, [HOVER], [])
    assert log.events['reward'].sum() == pytest.approx(1.0 + bonus(log, 400e3), rel=1e-9)


def test_without_any_data_there_is_no_bonus() -> None:
    log = fly_scripts(tiny(uav(10.0), reward__move_penalty_per_s=0.0), [FORWARD])
    assert log.events['reward'].tolist() == [0.0, 0.0]


def test_a_mission_that_uses_no_energy_has_no_bonus() -> None:
    assert rewards(tiny(uav(10.0)), []) == [0.0]


def test_every_moving_uav_is_fined_until_it_lands() -> None:
    # The first one flies home at once, for 30 s; the second one moves six times for 5 s.
    fleet = [uav(5.0, start=(0, 3), home_m=(25.0, 25.0)), uav(10.0)]
    scenario = tiny(*fleet, reward__discount_per_s=1.0)
    log = fly_scripts(scenario, [], [FORWARD, FORWARD, RIGHT, RIGHT, FORWARD, RIGHT])
    fines = (log.events['reward'] / PENALTY).tolist()
    assert fines[0] == 0.0  # both decide at the start
    assert fines[1:7] == pytest.approx([-10.0] * 6)  # two of them, 5 s each
    home_s = math.hypot(150.0, 150.0) / 10.0
    assert fines[7] == pytest.approx(-home_s)  # the first one has landed


def test_a_fine_ends_at_the_landing_even_within_an_interval() -> None:
    # The first one lands after 10 s, half way through the second one's first move.
    fleet = [uav(5.0, start=(0, 1), home_m=(25.0, 25.0)), uav(2.5)]
    fines = rewards(tiny(*fleet, reward__discount_per_s=1.0), [], [FORWARD])
    assert fines[1] == pytest.approx(-PENALTY * (10.0 + 20.0))


def test_nobody_is_fined_for_a_hover() -> None:
    scenario = tiny(uav(10.0, start=(0, 1)), reward__discount_per_s=1.0)
    assert rewards(scenario, [HOVER])[0] == pytest.approx(1.0, rel=1e-12)


def test_the_scale_divides_data_and_bonus_but_not_the_fine() -> None:
    plain = tiny(uav(10.0))
    scaled = tiny(uav(10.0), reward__scale_mbit=4.0)
    script = [RIGHT, HOVER]
    fine = -PENALTY * integral(5.0)
    for one, four in zip(rewards(plain, script), rewards(scaled, script), strict=True):
        is_hover = one > 0.0 and one < 2.0
        own_fine = 0.0 if is_hover else fine
        assert four - own_fine == pytest.approx((one - own_fine) / 4.0, rel=1e-9, abs=1e-12)


def test_imperfect_knowledge_of_the_channel_is_rewarded_by_the_rate_it_allows() -> None:
    scenario = tiny(
        uav(10.0, start=(0, 1)), radio__csi_error_variance=0.1, reward__discount_per_s=1.0
    )
    log = fly_scripts(scenario, [HOVER, RIGHT])
    assert log.events['reward'][0] == pytest.approx(1.0, rel=1e-12)
    plain = fly_scripts(tiny(uav(10.0, start=(0, 1))), [HOVER, RIGHT])
    assert log.events['duration_s'][0] > plain.events['duration_s'][0]


def in_flight() -> tuple[Briefing, RewardTerms, Mission]:
    """One UAV hovers over A for 0.94 s, the other one flies east for 10 s."""
    scenario = tiny(uav(5.0, start=(0, 1)), uav(5.0), sensors=[(75.0, 25.0, 2.0)])
    site = build_site(scenario)
    briefing, sensor_field = brief(scenario), lay_out(site)
    mission = mission_of(new_missions(briefing, sensor_field, [0]), 0)
    rows = new_view_rows(most_sensors(sensor_field))
    for unit, action in enumerate((HOVER, FORWARD)):
        view = look(briefing, sensor_field, mission, unit, rows)
        start_action(briefing, mission, unit, view, action, row_of([briefing.bandwidth_hz]))
    return briefing, reward_terms(site), mission


@settings(deadline=None, derandomize=True, database=None, max_examples=50)
@given(st.tuples(*[st.floats(0.0, 12.0)] * 3).map(sorted))
def test_two_intervals_are_worth_what_the_whole_is_worth(times_s: list[float]) -> None:
    start_s, middle_s, stop_s = times_s
    briefing, terms, mission = in_flight()

    def worth(from_s: float, to_s: float) -> float:
        return interval_reward(briefing, terms, mission, from_s, to_s)

    later = 0.99 ** (middle_s - start_s) * worth(middle_s, stop_s)
    assert worth(start_s, middle_s) + later == pytest.approx(worth(start_s, stop_s), abs=1e-12)


def test_an_empty_interval_is_worth_nothing() -> None:
    briefing, terms, mission = in_flight()
    assert interval_reward(briefing, terms, mission, 0.5, 0.5) == 0.0


def test_after_every_action_has_ended_nothing_is_earned_or_fined() -> None:
    briefing, terms, mission = in_flight()
    assert interval_reward(briefing, terms, mission, 10.0, 20.0) == 0.0

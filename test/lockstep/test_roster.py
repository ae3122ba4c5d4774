"""Who may fly which UAV."""

from dataclasses import replace

import pytest
from uav_collect.lockstep.roster import CONFIRM_S, JoinAnswer, Pilot, Roster

NOW_S = 100.0


def pilot(number: int, instance: str, policy: str = 'sweep', version: str = '1') -> Pilot:
    return Pilot(
        uav=number,
        instance=instance,
        host='here',
        pid=7,
        policy=policy,
        policy_version=version,
        allocator='exact',
    )


def joined(roster: Roster, asking: Pilot, now_s: float = NOW_S) -> JoinAnswer:
    """What an agent is told that asks to join and, if it may, greets and is alive."""
    answer = roster.join(asking)
    if not answer.accepted:
        return answer
    greeted = roster.greet(asking.uav, asking.instance, now_s)
    if greeted.accepted:
        roster.mark_alive(asking.uav)
    return greeted


@pytest.fixture
def roster() -> Roster:
    """Two UAVs; agent A flies the first, the second has none."""
    roster = Roster(2)
    assert joined(roster, pilot(1, 'A')).accepted
    return roster


@pytest.mark.parametrize('number', [0, 3, 255])
def test_an_unknown_uav_is_refused_for_good(number: int, roster: Roster) -> None:
    answer = joined(roster, pilot(number, 'B'))
    assert (answer.accepted, answer.retry) == (False, False)
    assert answer.reason == f'UAV {number} is unknown: the scenario has UAVs 1..2'


def test_a_uav_with_an_agent_takes_no_second_one_until_that_is_gone(roster: Roster) -> None:
    answer = joined(roster, pilot(1, 'B'))
    assert (answer.accepted, answer.retry) == (False, True)
    assert answer.reason == 'UAV 1 is flown by another agent, process 7 on here'
    lost = roster.mark_gone(1)
    assert lost is not None
    assert lost.instance == 'A'
    assert joined(roster, pilot(1, 'B')).accepted
    assert roster.is_flown_by(1, 'B')
    assert not roster.is_flown_by(1, 'A')


def test_an_agent_may_ask_again(roster: Roster) -> None:
    assert joined(roster, pilot(1, 'A')).accepted


def test_a_mission_in_flight_goes_on_with_the_policy_it_began_with(roster: Roster) -> None:
    roster.begin_mission()
    roster.mark_gone(1)
    answer = joined(roster, pilot(1, 'B', policy='hert'))
    assert (answer.accepted, answer.retry) == (False, False)
    assert "began the mission in flight with policy 'sweep'" in answer.reason
    answer = joined(roster, pilot(1, 'B', version='2'))
    assert "with policy 'sweep' (1), bandwidth 'exact', not policy 'sweep' (2)" in answer.reason
    assert joined(roster, pilot(1, 'B')).accepted
    roster.end_mission()
    roster.mark_gone(1)
    assert joined(roster, pilot(1, 'C', policy='hert')).accepted


def test_missing_are_those_without_a_living_agent(roster: Roster) -> None:
    assert roster.missing() == [2]
    roster.mark_gone(1)
    assert roster.missing() == [1, 2]
    roster.mark_alive(1, is_back=True)
    assert roster.missing() == [2]


def test_a_new_sign_of_life_does_not_bring_a_dead_agent_back(roster: Roster) -> None:
    roster.mark_gone(1)
    assert roster.join(pilot(1, 'B')).accepted
    roster.mark_alive(1)  # B's, before its greeting
    assert roster.greet(1, 'B', NOW_S).accepted
    assert roster.is_flown_by(1, 'B')


def test_nothing_is_lost_or_regained_where_nobody_was(roster: Roster) -> None:
    assert roster.mark_gone(2) is None
    roster.mark_alive(2, is_back=True)
    assert roster.missing() == [2]


def test_a_request_alone_keeps_nobody_out(roster: Roster) -> None:
    assert roster.join(pilot(2, 'forged')).accepted
    assert roster.missing() == [2]
    assert not roster.is_flown_by(2, 'forged')
    assert joined(roster, pilot(2, 'real')).accepted
    late = roster.greet(2, 'forged', NOW_S)
    assert (late.accepted, late.retry) == (False, True)
    assert roster.is_flown_by(2, 'real')


def test_a_flood_of_requests_keeps_nobody_out(roster: Roster) -> None:
    for number in range(1000):
        roster.join(pilot(2, f'forged {number}'))
    assert joined(roster, pilot(2, 'real')).accepted


def test_a_greeting_may_take_its_time(roster: Roster) -> None:
    assert roster.join(pilot(2, 'B')).accepted
    assert roster.greet(2, 'B', NOW_S + 100.0).accepted  # lost packets are sent again after 3 s
    assert roster.is_flown_by(2, 'B')


def test_who_greets_without_having_joined_flies_nothing(roster: Roster) -> None:
    assert not roster.greet(2, 'B', NOW_S).accepted
    assert not roster.greet(1, 'B', NOW_S).accepted
    assert not roster.greet(77, 'B', NOW_S).accepted
    assert roster.is_flown_by(1, 'A')


def test_an_agent_that_greeted_and_died_before_a_sign_of_life_is_gone(roster: Roster) -> None:
    assert roster.join(pilot(2, 'B')).accepted
    assert roster.greet(2, 'B', NOW_S).accepted
    assert roster.missing() == []
    assert roster.remove_silent(NOW_S + CONFIRM_S) == []
    assert [lost.instance for lost in roster.remove_silent(NOW_S + CONFIRM_S + 0.1)] == ['B']
    assert roster.missing() == [2]
    assert joined(roster, pilot(2, 'C')).accepted
    assert roster.remove_silent(NOW_S + 100.0) == []


def test_an_agent_that_was_given_up_and_lives_is_named(roster: Roster) -> None:
    roster.join(pilot(2, 'B'))
    roster.greet(2, 'B', NOW_S)
    assert roster.mark_alive(2) is None  # as it should be
    roster.mark_gone(2)
    lost = roster.mark_alive(2)  # heard anew, as if it had never been there
    assert lost is not None and lost.instance == 'B'
    assert roster.missing() == [2]
    assert roster.mark_alive(2, is_back=True) is None
    assert roster.missing() == []


def test_a_sign_of_life_may_come_before_the_greeting(roster: Roster) -> None:
    roster.mark_alive(2)
    assert roster.missing() == [2]
    roster.join(pilot(2, 'B'))
    roster.greet(2, 'B', NOW_S)
    assert roster.remove_silent(NOW_S + 100.0) == []


def test_an_agent_may_greet_again(roster: Roster) -> None:
    assert roster.greet(1, 'A', NOW_S + 100.0).accepted


def test_a_mission_goes_on_under_the_guard_that_it_began_with(roster: Roster) -> None:
    joined(roster, replace(pilot(2, 'B'), guard_after=12))
    roster.begin_mission()
    roster.mark_gone(2)
    answer = joined(roster, replace(pilot(2, 'C'), guard_after=5))
    assert not answer.accepted
    assert answer.reason.endswith("not policy 'sweep' (1), bandwidth 'exact', guard after 5")
    assert joined(roster, replace(pilot(2, 'C'), guard_after=12)).accepted


def test_an_agent_of_a_trainers_policy_joins_again_whatever_version_it_has_by_now() -> None:
    roster = Roster(1)
    assert joined(roster, pilot(1, 'A', policy='topic', version='')).accepted
    roster.begin_mission()
    assert joined(roster, pilot(1, 'A', policy='topic', version='run@20')).accepted


def test_the_fleet_of_another_scenario_joins_anew_and_who_lives_need_not_prove_it(
    roster: Roster,
) -> None:
    roster.join(pilot(2, 'B'))  # for the old one
    roster.change_fleet(3)
    assert roster.missing() == [1, 2, 3]
    assert not roster.greet(2, 'B', NOW_S).accepted
    assert roster.greet(1, 'A', NOW_S).retry
    assert joined(roster, pilot(3, 'C')).accepted
    roster.join(pilot(1, 'A', policy='hert'))
    assert roster.greet(1, 'A', NOW_S).accepted
    assert roster.remove_silent(NOW_S + 2.0 * CONFIRM_S) == []
    roster.change_fleet(1)
    assert roster.join(pilot(3, 'C')).reason == 'UAV 3 is unknown: the scenario has UAVs 1..1'

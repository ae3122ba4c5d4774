"""Who may fly which UAV."""

from dataclasses import replace

import pytest
from uav_collect.lockstep.roster import Pilot, Roster


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


@pytest.fixture
def roster() -> Roster:
    """Two UAVs; agent A flies the first, the second has none."""
    roster = Roster(2)
    assert roster.join(pilot(1, 'A')).accepted
    return roster


@pytest.mark.parametrize('number', [0, 3, 255])
def test_an_unknown_uav_is_refused_for_good(number: int, roster: Roster) -> None:
    answer = roster.join(pilot(number, 'B'))
    assert (answer.accepted, answer.retry) == (False, False)
    assert answer.reason == f'UAV {number} is unknown: the scenario has UAVs 1..2'


def test_a_uav_with_an_agent_takes_no_second_one_until_that_is_gone(roster: Roster) -> None:
    answer = roster.join(pilot(1, 'B'))
    assert (answer.accepted, answer.retry) == (False, True)
    assert answer.reason == 'UAV 1 is flown by another agent, process 7 on here'
    lost = roster.mark_gone(1)
    assert lost is not None
    assert lost.instance == 'A'
    assert roster.join(pilot(1, 'B')).accepted
    assert roster.is_flown_by(1, 'B')
    assert not roster.is_flown_by(1, 'A')


def test_an_agent_may_ask_again(roster: Roster) -> None:
    assert roster.join(pilot(1, 'A')).accepted


def test_a_mission_in_flight_goes_on_with_the_policy_it_began_with(roster: Roster) -> None:
    roster.begin_mission()
    roster.mark_gone(1)
    answer = roster.join(pilot(1, 'B', policy='hert'))
    assert (answer.accepted, answer.retry) == (False, False)
    assert "began the mission in flight with policy 'sweep'" in answer.reason
    answer = roster.join(pilot(1, 'B', version='2'))
    assert "with policy 'sweep' (1), bandwidth 'exact', not policy 'sweep' (2)" in answer.reason
    assert roster.join(pilot(1, 'B')).accepted
    roster.end_mission()
    roster.mark_gone(1)
    assert roster.join(pilot(1, 'C', policy='hert')).accepted


def test_missing_are_those_without_a_living_agent(roster: Roster) -> None:
    assert roster.missing() == [2]
    roster.mark_gone(1)
    assert roster.missing() == [1, 2]
    roster.mark_alive(1)
    assert roster.missing() == [2]


def test_nothing_is_lost_or_regained_where_nobody_was(roster: Roster) -> None:
    assert roster.mark_gone(2) is None
    roster.mark_alive(2)
    assert roster.missing() == [2]


def test_a_mission_goes_on_under_the_guard_that_it_began_with(roster: Roster) -> None:
    roster.join(replace(pilot(2, 'B'), guard_after=12))
    roster.begin_mission()
    roster.mark_gone(2)
    answer = roster.join(replace(pilot(2, 'C'), guard_after=5))
    assert not answer.accepted
    assert answer.reason.endswith("not policy 'sweep' (1), bandwidth 'exact', guard after 5")
    assert roster.join(replace(pilot(2, 'C'), guard_after=12)).accepted

"""A recorded mission flown again gives the log, and what its messages must say."""

from dataclasses import replace

import pytest
from random_policies import header, random_policy
from recordings import flown_with_injected
from tiny_world import tiny, uav
from uav_collect.errors import AllocationError
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.reflight import FlownBy, fly_again
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import FaultRecord, MissionLog
from uav_collect.recording.mission_messages import MessagePlace
from uav_collect.scenario.load import load
from uav_collect.scenario.model import FAULT_KINDS
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.action_codes import BY_POLICY, FAILSAFE, HOME, N_ACTIONS, NONE
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import Policy, policy_named
from uav_collect.uav.policy_network import LearnedPolicy


@pytest.fixture(scope='module')
def site() -> Site:
    return build_site(tiny(uav(), uav()))


@pytest.fixture(scope='module')
def log(site: Site) -> MissionLog:
    return fly(site, [0], 'hert')[0]


def crew(allocator: str = 'exact') -> list[FlownBy]:
    return [
        FlownBy(policy=policy_named('hert'), allocator=allocator, guard_after=NONE)
        for _ in range(2)
    ]


def test_the_log_is_the_recorded_one(site: Site, log: MissionLog) -> None:
    flown = fly_again(site, log.header, crew())
    assert flown.log.to_jsonl() == log.to_jsonl()
    assert flown.failure is None


def test_it_stops_after_as_many_events_as_are_wanted(site: Site, log: MissionLog) -> None:
    flown = fly_again(site, log.header, crew(), n_events=5)
    assert len(flown.log.events) == 5
    assert flown.log.events[:4].tobytes() == log.events[:4].tobytes()
    assert MessagePlace('epoch', 0, 4) in flown.messages
    assert MessagePlace('epoch', 0, 5) not in flown.messages


def test_where_the_failsafe_took_over_the_uav_says_nothing_more(
    site: Site, log: MissionLog
) -> None:
    events = log.events
    lost = int(events['event'][events['uav'] == 2][1])
    flown = fly_again(site, log.header, crew(), failsafes=[lost])
    assert flown.log.events['reason'][lost] == FAILSAFE
    assert flown.log.events[:lost].tobytes() == events[:lost].tobytes()
    assert MessagePlace('command', 2, 0) in flown.messages
    assert MessagePlace('command', 2, 1) not in flown.messages


def test_an_allocator_that_there_is_not_is_refused(site: Site, log: MissionLog) -> None:
    with pytest.raises(AllocationError, match="'none' is unknown"):
        fly_again(site, log.header, crew('none'))


def test_a_uav_that_its_policys_adviser_flies_home_is_flown_again() -> None:
    site = build_site(tiny(uav(), uav(), radio__contact_range_m=0.0))
    frozen = random_policy(header(Layout.RELATIVE, side=4, advice_bonus=1e6))
    [log] = fly(site, [0], lambda: LearnedPolicy('mine', frozen))
    home = log.events[(log.events['action'] == HOME) & (log.events['reason'] == BY_POLICY)]
    assert len(home) > 0
    by = FlownBy(policy=LearnedPolicy('mine', frozen), allocator='exact', guard_after=GUARD_AFTER)
    crew_again = [by, replace(by, policy=LearnedPolicy('mine', frozen))]
    flown = fly_again(site, log.header, crew_again, layouts=[Layout.RELATIVE])
    assert flown.log.to_jsonl() == log.to_jsonl()
    for event in home:
        place = MessagePlace('transition', int(event['uav']), int(event['decision']))
        seen = flown.messages[place]['observation']
        assert not any(seen[Layout.RELATIVE.label][-N_ACTIONS:])  # type: ignore[index]


class CountedPolicy:
    """A policy that counts the missions that it begins."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self.n_begun = policy, 0
        self.name, self.version = policy.name, policy.version
        self.choose = policy.choose

    def begin(self, briefing: Briefing, uav: int) -> None:
        self.n_begun += 1
        self._policy.begin(briefing, uav)


@pytest.mark.parametrize('kind', FAULT_KINDS)
@pytest.mark.parametrize('before', [0, 3])
def test_a_fault_that_was_injected_is_taken_from_the_record(
    site: Site, kind: str, before: int
) -> None:
    log = flown_with_injected(site, 'hert', before, (kind, 1))
    [fault] = log.faults
    assert fault.event == before
    flown = fly_again(site, log.header, crew(), faults=log.faults)
    assert flown.log.to_jsonl() == log.to_jsonl()
    assert [*flown.injected] == [fault]


def test_faults_that_were_injected_together_are_taken_together(site: Site) -> None:
    log = flown_with_injected(site, 'hert', 2, ('slow', 1), ('silent', 2), ('silent', 1))
    flown = fly_again(site, log.header, crew(), faults=log.faults)
    assert flown.log.to_jsonl() == log.to_jsonl()
    assert [*flown.injected] == [*log.faults]
    assert len(log.faults) == 3


def test_a_mission_is_flown_once_more_for_each_event_with_faults_however_many(site: Site) -> None:
    log = flown_with_injected(site, 'hert', 2, ('slow', 1), ('silent', 2), ('silent', 1))
    first, second = crew()
    counted = CountedPolicy(first.policy)
    fly_again(site, log.header, [replace(first, policy=counted), second], faults=log.faults)
    assert counted.n_begun == 2


def test_a_fault_of_no_known_kind_keeps_no_other_one_out(site: Site) -> None:
    log = flown_with_injected(site, 'hert', 3, ('silent', 1))
    unknown = replace(log.faults[0], event=1, fault='bored')
    flown = fly_again(site, log.header, crew(), faults=[unknown, *log.faults])
    assert flown.log.to_jsonl() == log.to_jsonl()


def test_a_fault_of_the_scenario_comes_by_itself() -> None:
    site = build_site(load('rough_10x10', {'faults.0.share': 1.0}))
    [log] = fly(site, [0], 'hert')
    assert log.faults != ()
    flown = fly_again(site, log.header, crew(), faults=log.faults)
    assert flown.log.to_jsonl() == log.to_jsonl()
    assert flown.injected == []


def test_a_fault_that_cannot_have_been_injected_so_stays_missing(
    site: Site, log: MissionLog
) -> None:
    impossible = FaultRecord(event=3, time_s=log.events['time_s'][2] + 0.5, uav=1, fault='silent')
    flown = fly_again(site, log.header, crew(), faults=[impossible])
    assert impossible not in flown.log.faults

"""Faults that a scenario or a user lets befall UAVs, over the tiny world."""

import pytest
from tiny_world import Flight, fly_scripts, MOVE_5_J, MOVE_10_J, tiny, uav
from uav_collect.analysis.metrics import check_log, mission_metrics
from uav_collect.analysis.tables import mission_warnings
from uav_collect.errors import ConfigError
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import FaultRecord, from_jsonl, MissionLog
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import FAULT, FORWARD, HOME, RIGHT

NORTH = [FORWARD] * 3


def flown(*faults: dict[str, object], scripts: int = 2, **values: object) -> MissionLog:
    scenario = tiny(faults=[*faults], **values)
    return fly_scripts(scenario, *[NORTH] * scripts)


def own(log: MissionLog, unit: int) -> MissionLog:
    return MissionLog(header=log.header, events=log.events[log.events['uav'] == unit])


def test_a_uav_whose_agent_is_gone_is_flown_home_at_its_next_decision() -> None:
    log = flown({'uav': 2, 'kind': 'gone', 'at_s': 7.0})
    last = own(log, 2).events[-1]
    assert (last['time_s'], last['action'], last['reason']) == (10.0, HOME, FAULT)
    # The first UAV decides at 10 s, too, and before it.
    assert log.faults == (FaultRecord(event=3, time_s=7.0, uav=2, fault='gone'),)
    assert last['event'] == 4
    assert len(own(log, 1).events) == 4  # the other flies on
    check_log(log)


def test_a_fault_at_a_decision_begins_there() -> None:
    log = flown({'uav': 1, 'kind': 'gone', 'at_decision': 2})
    last = own(log, 1).events[-1]
    assert (last['decision'], last['reason']) == (2, FAULT)
    assert log.faults[0].time_s == last['time_s'] == 20.0


def test_the_way_home_of_a_gone_uav_is_none_of_its_agents_failures() -> None:
    metrics = mission_metrics(flown({'uav': 1, 'kind': 'gone', 'at_decision': 0}))
    assert metrics.uavs[0].outcome == 'fault'
    assert not metrics.failsafe_used


def test_what_befell_a_uav_is_in_the_words_below_its_mission() -> None:
    metrics = mission_metrics(flown({'uav': 1, 'kind': 'slow', 'at_s': 10.0}))
    assert 'UAV 1 was slow from 10 s on, by a fault' in mission_warnings(metrics)


def test_a_silent_uav_neither_hears_nor_is_heard_from_then_on() -> None:
    log = flown({'uav': 2, 'kind': 'silent', 'at_s': 5.0}, radio__contact_range_m=float('inf'))
    heard = {float(event['time_s']): int(event['heard']) for event in log.events}
    assert [heard[time_s] != 0 for time_s in (0.0, 5.0, 10.0)] == [True, False, False]


def test_a_silent_uav_does_not_hear_what_was_under_way_to_it() -> None:
    # The second UAV's message of 0 s reaches the first at 7 s, which is silent by then, or is not.
    def heard(*faults: dict[str, object]) -> int:
        flight = Flight(tiny(radio__delay_s=[7.0, 0.0], faults=[*faults]))
        for action in (RIGHT, FORWARD, FORWARD):
            flight.step(action)
        event = flight.look()
        assert (event.uav, event.view.time_s) == (0, 10.0)
        return len(event.heard)

    assert heard({'uav': 1, 'kind': 'silent', 'at_s': 6.0}) == 0
    assert heard({'uav': 1, 'kind': 'silent', 'at_s': 8.0}) == 1
    assert heard() == 1


def test_what_a_slow_uav_does_takes_twice_as_long_at_the_same_power_but_its_way_home() -> None:
    log = flown({'uav': 1, 'kind': 'slow', 'at_s': 10.0})
    *moves, home = own(log, 1).events
    assert [move['duration_s'] for move in moves] == [10.0, 20.0, 20.0]
    assert [move['energy_j'] for move in moves] == pytest.approx(
        [MOVE_5_J, 2 * MOVE_5_J, 2 * MOVE_5_J], rel=1e-5
    )
    assert home['duration_s'] == 30.0
    check_log(log)


def test_a_slow_uav_still_comes_home_with_its_reserve() -> None:
    # Energy for a move and the way back, and a quarter of a move more.
    budget_kj = (2.25 * MOVE_5_J + 100.0) / 1e3
    alone = uav(5.0, energy_budget_kj=budget_kj, energy_margin_kj=0.1)
    scenario = tiny(alone, faults=[{'uav': 1, 'kind': 'slow', 'at_s': 0.0}])
    log = fly_scripts(scenario, [FORWARD])
    move, home = log.events
    assert move['duration_s'] == pytest.approx(12.5, rel=1e-4)
    assert home['energy_left_j'] - home['energy_j'] == pytest.approx(100.0, rel=1e-3)
    assert mission_metrics(log).uavs[0].is_safe


def test_an_injected_fault_begins_after_the_latest_event_and_stands_before_the_next() -> None:
    flight = Flight(tiny())
    flight.step(RIGHT)
    flight.step(FORWARD)
    flight.simulation.inject('silent', 0)
    event = flight.step(FORWARD)
    assert event.heard == ()
    assert flight.simulation.faults() == (FaultRecord(event=2, time_s=0.0, uav=1, fault='silent'),)


def test_a_log_with_faults_reads_back_as_it_was_written() -> None:
    log = flown({'uav': 1, 'kind': 'slow', 'at_s': 3.0}, {'uav': 2, 'kind': 'gone', 'at_s': 9.0})
    text = log.to_jsonl()
    again = from_jsonl(text)
    assert again.faults == log.faults
    assert again.to_jsonl() == text
    lines = text.decode().splitlines()
    place = next(number for number, line in enumerate(lines) if '"fault": "slow"' in line)
    assert f'"event": {log.faults[0].event},' in lines[place + 1]


def test_faults_that_are_drawn_differ_by_mission_and_not_by_batch() -> None:
    faults = [
        {'uav': 'any', 'kind': 'gone', 'at_s': [10, 200], 'share': 0.5},
        {'uav': 'any', 'kind': 'slow', 'at_decision': [3, 9]},
    ]
    site = build_site(load('paper_10x10', {'faults': faults}))
    together = fly(site, range(40), 'sweep', 'exact', guard_after=0)
    found = [log.faults for log in together]
    gone = [it for each in found for it in each if it.fault == 'gone']
    assert 10 < len(gone) < 30
    assert {it.uav for it in gone} == {1, 2}
    assert all(10.0 <= it.time_s <= 200.0 for it in gone)
    assert len({it.time_s for it in gone}) == len(gone)
    alone = fly(site, [17], 'sweep', 'exact', guard_after=0)
    assert alone[0].to_jsonl() == together[17].to_jsonl()


def test_a_smaller_fleet_has_the_faults_of_its_own_uavs_only() -> None:
    faults = [{'uav': 2, 'kind': 'gone', 'at_s': 1.0}, {'uav': 1, 'kind': 'slow', 'at_s': 1.0}]
    scenario = with_uavs(tiny(faults=faults), 1)
    assert [fault.uav for fault in scenario.faults or ()] == [1]
    assert with_uavs(tiny(faults=faults[:1]), 1) == with_uavs(tiny(), 1)


@pytest.mark.parametrize(
    ('fault', 'words'),
    [
        ({'uav': 3, 'kind': 'gone', 'at_s': 1.0}, r'faults.0.uav is 3: must be from 1 to 2'),
        ({'uav': 1, 'kind': 'dead', 'at_s': 1.0}, r"faults.0.kind is 'dead': must be 'gone'"),
        ({'uav': 1, 'kind': 'gone'}, r'must have one of at_s and at_decision'),
        ({'uav': 1, 'kind': 'gone', 'at_s': 1.0, 'at_decision': 1}, r'and not both'),
        ({'uav': 1, 'kind': 'gone', 'at_s': [5.0, 1.0]}, r'at_s is \[5.0, 1.0\]: must be'),
        ({'uav': 1, 'kind': 'gone', 'at_s': -1.0}, r'at_s is -1.0: must be a number from 0'),
        ({'uav': 1, 'kind': 'gone', 'at_decision': 1.5}, r'at_decision is 1.5: must be a whole'),
        ({'uav': 'all', 'kind': 'gone', 'at_s': 1.0}, r"uav is 'all': must be a whole number"),
        ({'uav': 1, 'kind': 'gone', 'at_s': 1.0, 'share': 2.0}, r'share is 2.0: must be'),
    ],
)
def test_a_fault_that_cannot_be_is_refused(fault: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        tiny(faults=[fault])


def test_the_other_uav_flies_as_before_when_one_is_slow_and_none_hears() -> None:
    log = flown({'uav': 1, 'kind': 'slow', 'at_s': 0.0}, radio__contact_range_m=0.0)
    moves = own(log, 2).events[:-1]
    assert [move['energy_j'] for move in moves] == pytest.approx([MOVE_10_J] * 3, rel=1e-5)

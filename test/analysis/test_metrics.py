from dataclasses import replace
import math

import numpy as np
import pytest
from scripted_logs import fly, header, uav
from uav_collect.analysis import metrics
from uav_collect.errors import MissionLogError
from uav_collect.recording.mission_log import from_jsonl, MissionLog
from uav_collect.uav.action_codes import HOME

# Cells of 50 m, so a step takes 5 s at 10 m/s and 10 s at 5 m/s; moving 100 W, hovering 200 W.
FAST = ['right', 'hover 4 0.5', 'right', 'home map complete']
SLOW = ['forward', 'hover 2 0.25', 'home energy reserve']


@pytest.fixture
def flown() -> MissionLog:
    fleet = [uav(1, speed_mps=10.0), uav(2, speed_mps=5.0)]
    return fly(header(fleet, total_bit=1e6), [FAST, SLOW])


def test_figures_are_those_computed_by_hand(flown: MissionLog) -> None:
    mission = metrics.mission_metrics(flown)
    assert mission.collected_bit == 0.75e6
    assert mission.collected_share == 0.75
    assert mission.uav_energy_j == (2_800.0, 2_400.0)  # 20 s + 4 s and 20 s + 2 s
    assert mission.energy_j == 5_200.0
    assert mission.completion_s == 24.0
    assert mission.efficiency_bit_per_j == pytest.approx(0.75e6 / 5_200.0, rel=1e-15)
    assert mission.efficiency_kbit_per_j == pytest.approx(0.75e3 / 5_200.0, rel=1e-15)
    assert mission.n_decisions == 5
    assert mission.is_safe
    assert mission.is_finished
    assert not mission.is_complete
    assert not mission.failsafe_used


def test_figures_of_each_uav_are_those_computed_by_hand(flown: MissionLog) -> None:
    fast, slow = metrics.mission_metrics(flown).uavs
    assert (fast.id, fast.flight_s, fast.hover_s, fast.landed_s) == (1, 20.0, 4.0, 24.0)
    assert (slow.id, slow.flight_s, slow.hover_s, slow.landed_s) == (2, 20.0, 2.0, 22.0)
    assert (fast.n_decisions, slow.n_decisions) == (3, 2)
    assert (fast.outcome, slow.outcome) == ('map complete', 'energy reserve')
    assert fast.energy_left_j == 50e3 - 2_800.0


def test_figures_come_from_the_log_file_alone(flown: MissionLog) -> None:
    assert metrics.mission_metrics(from_jsonl(flown.to_jsonl())) == metrics.mission_metrics(flown)


def test_the_mission_ends_when_the_last_uav_is_home_not_when_it_last_decides() -> None:
    late_but_short = ['hover 30 0', 'home']
    early_but_long = ['right'] * 3 + ['home']  # home from 150 m takes 30 s, from 15 * 2 s on
    fleet = [uav(1, speed_mps=10.0), uav(2, speed_mps=5.0)]
    mission = metrics.mission_metrics(fly(header(fleet), [late_but_short, early_but_long]))
    assert [row.landed_s for row in mission.uavs] == [30.0, 60.0]
    assert mission.completion_s == 60.0


def without(log: MissionLog, *events: int) -> metrics.MissionMetrics:
    return metrics.mission_metrics(replace(log, events=np.delete(log.events, events)))


def test_what_events_took_that_were_not_recorded_is_not_left(flown: MissionLog) -> None:
    for event, row in enumerate(flown.events[:-1]):
        is_end = row['action'] == HOME
        for whole, found in zip(
            metrics.mission_metrics(flown).uavs, without(flown, event).uavs, strict=True
        ):
            if not (is_end and row['uav'] == found.id):
                assert found.energy_left_j == whole.energy_left_j
                assert (found.outcome, found.is_safe) == (whole.outcome, whole.is_safe)


def test_it_is_not_known_how_a_uav_ended_whose_last_events_were_not_recorded(
    flown: MissionLog,
) -> None:
    assert not metrics.mission_metrics(flown).lacks_events
    is_home = (flown.events['uav'] == 2) & (flown.events['action'] == HOME)
    mission = without(flown, *np.flatnonzero(is_home))
    assert mission.lacks_events
    assert mission.uavs[1].outcome == metrics.UNKNOWN
    assert not mission.uavs[1].is_safe
    assert math.isnan(mission.uavs[1].energy_left_j)
    assert mission.uavs[0].outcome == 'map complete'


@pytest.mark.parametrize(('budget_j', 'safe'), [(3_800.0, True), (3_799.99, False)])
def test_safe_means_landed_with_the_margin(budget_j: float, safe: bool) -> None:
    mission = metrics.mission_metrics(fly(header([uav(1, budget_j=budget_j)]), [FAST]))
    assert mission.is_safe is safe


def test_a_failsafe_is_reported(flown: MissionLog) -> None:
    script = [*FAST[:-1], 'home failsafe']
    mission = metrics.mission_metrics(fly(flown.header, [script, SLOW]))
    assert mission.failsafe_used
    assert [row.outcome for row in mission.uavs] == ['failsafe', 'energy reserve']


def test_a_mission_cut_short_has_no_completion_and_is_not_safe() -> None:
    mission = metrics.mission_metrics(fly(header([uav(1), uav(2)]), [FAST, ['right']]))
    assert math.isnan(mission.completion_s)
    assert not mission.is_finished
    assert not mission.is_safe
    assert mission.uavs[1].outcome == metrics.UNFINISHED
    assert mission.energy_j == 3_300.0


def test_a_mission_without_a_single_event_has_figures(flown: MissionLog) -> None:
    mission = metrics.mission_metrics(replace(flown, events=flown.events[:0]))
    assert mission.efficiency_bit_per_j == 0.0
    assert mission.energy_j == 0.0
    assert not mission.is_finished


def test_a_mission_without_data_is_complete() -> None:
    mission = metrics.mission_metrics(fly(header([uav(1)], total_bit=0.0), [['home']]))
    assert mission.is_complete
    assert mission.collected_share == 1.0


def test_contacts_count_the_uavs_heard_at_every_event(flown: MissionLog) -> None:
    events = flown.events.copy()
    events['heard'][:3] = [0b10, 0b01, 1 << 63]
    assert metrics.mission_metrics(replace(flown, events=events)).n_heard == 3


def test_check_log_accepts_missions_whole_and_cut_short(flown: MissionLog) -> None:
    for n_events in range(len(flown.events) + 1):
        metrics.check_log(replace(flown, events=flown.events[:n_events]))


@pytest.mark.parametrize(
    ('field', 'change', 'problem'),
    [
        ('event', 1, 'record 3 says event 4'),
        ('uav', 5, 'event 3, UAV 6: is not in the header'),
        ('decision', 1, 'event 3, UAV 1: decision must be 2, got 3'),
        ('time_s', 1.0, 'event 3, UAV 1: time must be'),
        ('x_m', 50.0, 'event 3, UAV 1: x must be'),
        ('y_m', 1e-3, 'event 3, UAV 1: y must be'),
        ('energy_left_j', 1e-3, 'event 3, UAV 1: energy left must be'),
        ('energy_j', -1e9, 'event 3, UAV 1: energy_j must be finite'),
        ('duration_s', math.inf, 'event 3, UAV 1: duration_s must be finite'),
        ('collected_bit', 1.0, 'event 3, UAV 1: collected 1.0 bit without hovering'),
        ('interval_s', 1.0, 'event 4, UAV 2: time must be'),
    ],
)
def test_check_log_names_the_record_that_does_not_fit(
    flown: MissionLog, field: str, change: float, problem: str
) -> None:
    events = flown.events.copy()
    assert (events['uav'][3], events['decision'][3]) == (1, 2)
    events[field][3] += change
    with pytest.raises(MissionLogError, match=problem):
        metrics.check_log(replace(flown, events=events))


def test_check_log_finds_a_missing_record(flown: MissionLog) -> None:
    events = np.delete(flown.events, 2)
    with pytest.raises(MissionLogError, match='record 2 says event 3'):
        metrics.check_log(replace(flown, events=events))


def test_check_log_finds_more_data_than_there_was() -> None:
    log = fly(header([uav(1)], total_bit=0.4e6), [FAST])
    with pytest.raises(MissionLogError, match=r'collected 500000.0 bit of 400000.0 bit'):
        metrics.check_log(log)


def test_check_log_finds_a_decision_after_the_way_home() -> None:
    log = fly(header([uav(1)]), [['right', 'home', 'right']])
    with pytest.raises(MissionLogError, match='event 2, UAV 1: decides after it turned home'):
        metrics.check_log(log)

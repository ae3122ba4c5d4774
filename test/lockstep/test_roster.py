"""Who may fly which UAV, which mission comes next, and at what pace."""

from pathlib import Path

import pytest
from scripted_logs import fly, header, uav
from uav_collect.limits import MAX_SEED
from uav_collect.lockstep.roster import Pilot, Roster
from uav_collect.lockstep.schedule import Pace, Schedule
from uav_collect.recording.mission_folder import RunFolder
from uav_collect.recording.mission_log import read


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
    assert roster.ask(pilot(1, 'A')).accepted
    return roster


# Roster


@pytest.mark.parametrize('number', [0, 3, 255])
def test_an_unknown_uav_is_refused_for_good(number: int, roster: Roster) -> None:
    answer = roster.ask(pilot(number, 'B'))
    assert (answer.accepted, answer.retry) == (False, False)
    assert answer.reason == f'UAV {number} is unknown: the scenario has UAVs 1..2'


def test_a_uav_with_an_agent_takes_no_second_one_until_that_is_gone(roster: Roster) -> None:
    answer = roster.ask(pilot(1, 'B'))
    assert (answer.accepted, answer.retry) == (False, True)
    assert answer.reason == 'UAV 1 is flown by another agent, process 7 on here'
    lost = roster.lose(1)
    assert lost is not None
    assert lost.instance == 'A'
    assert roster.ask(pilot(1, 'B')).accepted
    assert roster.is_flown_by(1, 'B')
    assert not roster.is_flown_by(1, 'A')


def test_an_agent_may_ask_again(roster: Roster) -> None:
    assert roster.ask(pilot(1, 'A')).accepted


def test_a_mission_in_flight_goes_on_with_the_policy_it_began_with(roster: Roster) -> None:
    roster.begin()
    roster.lose(1)
    answer = roster.ask(pilot(1, 'B', policy='hert'))
    assert (answer.accepted, answer.retry) == (False, False)
    assert "began the mission in flight with policy 'sweep'" in answer.reason
    answer = roster.ask(pilot(1, 'B', version='2'))
    assert "with policy 'sweep' (1), bandwidth 'exact', not policy 'sweep' (2)" in answer.reason
    assert roster.ask(pilot(1, 'B')).accepted
    roster.end()
    roster.lose(1)
    assert roster.ask(pilot(1, 'C', policy='hert')).accepted


def test_missing_are_those_without_a_living_agent(roster: Roster) -> None:
    assert roster.missing() == [2]
    roster.lose(1)
    assert roster.missing() == [1, 2]
    roster.regain(1)
    assert roster.missing() == [2]


def test_nothing_is_lost_or_regained_where_nobody_was(roster: Roster) -> None:
    assert roster.lose(2) is None
    roster.regain(2)
    assert roster.missing() == [2]


# Schedule


def test_missions_in_a_row_count_their_seeds_up_and_end() -> None:
    schedule = Schedule(n_missions=3, next_seed=5)
    seeds = []
    while not schedule.is_over:
        seeds.append(schedule.begin())
        schedule.go_on(seeds[-1])
    assert seeds == [5, 6, 7]
    assert schedule.next_seed is None


def test_on_request_a_world_never_ends() -> None:
    schedule = Schedule(n_missions=0, next_seed=None)
    assert schedule.ask_for(9, is_flying=False)[0]
    assert schedule.begin() == 9
    schedule.go_on(9)
    assert schedule.next_seed is None
    assert not schedule.is_over


def test_one_mission_at_a_time() -> None:
    schedule = Schedule(n_missions=0, next_seed=None)
    assert not schedule.ask_for(1, is_flying=True)[0]
    assert schedule.ask_for(1, is_flying=False)[0]
    assert not schedule.ask_for(2, is_flying=False)[0]
    assert schedule.next_seed == 1


@pytest.mark.parametrize(('seed', 'fits'), [(0, True), (MAX_SEED, True), (MAX_SEED + 1, False)])
def test_a_seed_on_request_stays_within_bounds(seed: int, fits: bool) -> None:
    assert Schedule(n_missions=0, next_seed=None).ask_for(seed, is_flying=False)[0] is fits


def test_there_is_something_to_abort_in_flight_or_just_before() -> None:
    schedule = Schedule(n_missions=0, next_seed=None)
    assert not schedule.call_off(is_flying=False)[0]
    assert schedule.call_off(is_flying=True)[0]
    schedule.ask_for(1, is_flying=False)
    assert schedule.call_off(is_flying=False)[0]
    assert schedule.next_seed is None


# Pace


def test_simulated_time_passes_so_many_times_as_fast() -> None:
    now_s = [100.0]
    pace = Pace(4.0, lambda: now_s[0])
    pace.begin()
    assert pace.is_due(0.0)
    now_s[0] = 102.5
    assert pace.time_s == 10.0
    assert pace.is_due(10.0)
    assert not pace.is_due(10.1)


def test_without_a_pace_everything_is_due() -> None:
    pace = Pace(0.0, lambda: 0.0)
    pace.begin()
    assert pace.is_free
    assert pace.is_due(1e9)


# Files


def test_a_run_folder_keeps_scenario_and_logs(tmp_path: Path) -> None:
    log = fly(header([uav(1)]), [['right', 'home']])
    folder = RunFolder(str(tmp_path / 'a' / 'b'))
    assert folder.keep_scenario('name: x\n') is None
    assert folder.begin(log.header) is None
    assert folder.append(log.events) is None
    folder.end()
    assert (tmp_path / 'a' / 'b' / 'scenario.yaml').read_text() == 'name: x\n'
    assert read(tmp_path / 'a' / 'b' / 'mission_3.jsonl').to_jsonl() == log.to_jsonl()


def test_without_a_name_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    log = fly(header([uav(1)]), [['home']])
    folder = RunFolder('')
    assert folder.keep_scenario('name: x\n') is None
    assert folder.begin(log.header) is None
    assert folder.append(log.events) is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('at', ['header', 'events'])
def test_a_disk_that_is_full_is_named_once_per_mission(at: str, tmp_path: Path) -> None:
    log = fly(header([uav(1)]), [['home']])
    folder = RunFolder(str(tmp_path))
    file = tmp_path / 'mission_3.jsonl'
    file.symlink_to('/dev/full' if at == 'header' else '/dev/null')
    failures = [folder.begin(log.header)]
    if at == 'events':
        assert folder._log is not None
        folder._log.close()
        folder._log._file = open('/dev/full', 'w')  # noqa: SIM115 - the log closes it
    failures += [folder.append(log.events) for _ in range(3)]
    said = [failure for failure in failures if failure]
    assert len(said) == 1
    assert said[0].startswith('the mission log cannot be written: [Errno 28]')
    folder.end()


def test_a_folder_that_cannot_be_is_refused() -> None:
    with pytest.raises(OSError, match='Not a directory'):
        RunFolder('/dev/null/run')

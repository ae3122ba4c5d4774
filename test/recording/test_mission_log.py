from collections.abc import Callable
from dataclasses import replace
import json
import os
from pathlib import Path
import re

from hypothesis import given, strategies
import numpy as np
import pytest
from scripted_logs import fly, header, uav
from uav_collect.errors import MissionLogError
from uav_collect.recording import mission_log
from uav_collect.recording.log_model import EVENT_DTYPE
from uav_collect.recording.mission_log import from_jsonl, MissionLog
from uav_collect.uav.action_codes import ACTION_NAMES, REASON_NAMES

HEADER_LINE = (
    '{"format": "uav_collect mission log", "version": 1, "scenario": "scripted", '
    '"scenario_fingerprint": "0123456789abcdef", "mission_seed": 3, "cells_per_side": 4, '
    '"cell_size_m": 50.0, "total_bit": 1000000.0, "uavs": [{"id": 1, "speed_mps": 10.0, '
    '"energy_budget_j": 50000.0, "energy_margin_j": 1000.0, "policy": "script", '
    '"allocator": "exact"}]}'
)
HOME_LINE = (
    '{"event": 0, "time_s": 0.0, "uav": 1, "decision": 0, "x_m": 25.0, "y_m": 25.0, '
    '"action": "home", "reason": "energy reserve", "duration_s": 0.0, "energy_left_j": 50000.0, '
    '"energy_j": 0.0, "collected_bit": 0.0, "n_sensors": 0, "heard": [], "known_complete": 0, '
    '"interval_s": 0.0, "reward": 0.0}'
)


@pytest.fixture
def flown() -> MissionLog:
    fleet = [uav(1), uav(2, speed_mps=5.0)]
    return fly(header(fleet), [['right', 'hover 4 0.5', 'home'], ['forward', 'home failsafe']])


def same(one: MissionLog, other: MissionLog) -> bool:
    return one.header == other.header and one.events.tobytes() == other.events.tobytes()


def test_the_bytes_of_a_log_are_these() -> None:
    log = fly(header([uav(1)]), [['home energy reserve']])
    assert log.to_jsonl().decode() == f'{HEADER_LINE}\n{HOME_LINE}\n'


def test_every_line_stands_alone_as_json(flown: MissionLog) -> None:
    first, *rest = [json.loads(line) for line in flown.to_jsonl().splitlines()]
    assert first['format'] == mission_log.FORMAT
    assert {event['action'] for event in rest} <= set(ACTION_NAMES)
    assert {event['reason'] for event in rest} <= set(REASON_NAMES)
    assert all(tuple(event) == EVENT_DTYPE.names for event in rest)


def test_a_log_read_back_is_the_same(flown: MissionLog) -> None:
    back = from_jsonl(flown.to_jsonl())
    assert same(back, flown)
    assert back.to_jsonl() == flown.to_jsonl()


def test_a_log_without_events_reads_back(flown: MissionLog) -> None:
    empty = replace(flown, events=flown.events[:0])
    assert same(from_jsonl(empty.to_jsonl()), empty)


@given(
    number=strategies.floats(0.0, 1e18),
    heard=strategies.integers(0, 2**64 - 1),
    count=strategies.integers(0, 2**53),
)
def test_any_number_reads_back_to_the_last_bit(number: float, heard: int, count: int) -> None:
    fleet = [uav(number) for number in range(1, 65)]
    log = fly(header(fleet), [['home'], *[[]] * 63])
    log.events['energy_j'], log.events['heard'], log.events['decision'] = number, heard, count
    assert same(from_jsonl(log.to_jsonl()), log)


def test_heard_names_uavs_by_id_up_to_the_sixty_fourth() -> None:
    log = fly(header([uav(1)]), [['home']])
    log.events['heard'] = np.uint64(1 << 63 | 0b101)
    assert json.loads(log.to_jsonl().splitlines()[1])['heard'] == [1, 3, 64]


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (b'', 'line 1: no header'),
        (b'\n', 'line 1: no header'),
        (b'[]\n', 'line 1: no header'),
        (b'{"format": "other", "version": 1}\n', 'must be of format uav_collect mission log'),
        *(
            (HEADER_LINE.replace('"version": 1', f'"version": {it}').encode(), 'version 1')
            for it in ('2', 'true', '1.0')
        ),
        (HEADER_LINE.replace('"mission_seed": 3, ', '').encode(), 'mission_seed'),
        (HEADER_LINE.replace('"mission_seed"', '"seed"').encode(), 'seed'),
        (HEADER_LINE.replace('[{', '{').replace('}]', '}').encode(), 'line 1: no header'),
    ],
)
def test_a_bad_header_is_refused_by_name(text: bytes, problem: str) -> None:
    with pytest.raises(MissionLogError, match=problem):
        from_jsonl(text)


def with_value(name: str, value: str) -> str:
    return re.sub(rf'"{name}": ("[^"]*"|\[\]|[\d.]+)', f'"{name}": {value}', HOME_LINE)


SECOND = with_value('event', '1')


@pytest.mark.parametrize(
    ('line', 'problem'),
    [
        ('', 'no JSON, Expecting value at character 1'),
        (SECOND[:50], 'no JSON, '),
        ('\ufeff' + SECOND, 'begins with a byte order mark: must be UTF-8 text without one'),
        ('[]', 'no record but a list'),
        ('[' * 100_000, 'its values nest too deep'),
        ('7' * 5_000, 'a number has more than 4300 digits: must have at most 4300'),
        (SECOND.replace('"uav": 1, ', ''), 'uav is missing'),
        (SECOND.replace('{', '{"colour": 3, '), "'colour' is there: must be event, time_s"),
        (SECOND.replace('{', '{"reward": 3.0, '), "'reward' stands twice"),
        (HOME_LINE, 'event is 0: must be 1, they follow each other'),
    ],
)
def test_a_line_that_is_no_event_is_refused(line: str, problem: str) -> None:
    with pytest.raises(MissionLogError, match='line 3: no event of a mission log: ') as raised:
        from_jsonl(f'{HEADER_LINE}\n{HOME_LINE}\n{line}\n'.encode())
    assert problem in str(raised.value)


@pytest.mark.parametrize(
    ('name', 'value', 'problem'),
    [
        ('action', '"land"', "action is 'land': must be hover, forward, "),
        ('action', '5', 'action is 5: must be hover, forward, '),
        ('reason', '"fear"', "reason is 'fear': must be policy, map complete, "),
        ('time_s', '"late"', "time_s is 'late': must be a number"),
        ('time_s', 'true', 'time_s is true: must be a number'),
        ('time_s', '-1.0', 'time_s is -1.0: must be 0 to 1e+18'),
        ('time_s', 'NaN', 'NaN is no number'),
        ('reward', '-Infinity', '-Infinity is no number'),
        ('reward', '1e999', 'reward is .inf: must be -1e+18 to 1e+18'),
        ('energy_j', '1' + 400 * '0', 'energy_j is 1000'),
        ('duration_s', '[0.0]', 'duration_s is a list: must be a number'),
        ('uav', '2', 'uav is 2: must be 1'),
        ('uav', '-1', 'uav is -1: must be 1'),
        ('uav', '1.0', 'uav is 1.0: must be a whole number'),
        ('uav', '1' + 30 * '0', 'uav is 1000000000000000000000000000000: must be 1'),
        ('decision', '-1', 'decision is -1: must be 0 to 9007199254740992'),
        ('x_m', '200.5', 'x_m is 200.5: must be 0 to 200'),
        ('known_complete', '17', 'known_complete is 17: must be 0 to 16'),
        ('heard', '[0]', 'heard has 0: must be a list of ids from 1 to 1, each once, ascending'),
        ('heard', '[65]', 'heard has 65: must be a list of ids'),
        ('heard', '[3000000000]', 'heard has 3000000000: must be a list of ids'),
        ('heard', '[1, 1]', 'heard has 1: must be a list of ids'),
        ('heard', '["a"]', "heard has 'a': must be a list of ids"),
        ('heard', '3', 'heard is 3: must be a list of ids'),
    ],
)
def test_a_value_that_cannot_be_is_refused_with_what_is_allowed(
    name: str, value: str, problem: str
) -> None:
    line = re.sub('"event": 0', '"event": 1', with_value(name, value))
    with pytest.raises(MissionLogError, match='line 3: no event of a mission log: ') as raised:
        from_jsonl(f'{HEADER_LINE}\n{HOME_LINE}\n{line}\n'.encode())
    assert problem in str(raised.value)


@pytest.mark.parametrize(
    ('before', 'after', 'problem'),
    [
        (
            '"mission_seed": 3',
            '"mission_seed": "3"',
            "mission_seed is '3': must be a whole number",
        ),
        ('"mission_seed": 3', '"mission_seed": -3', 'mission_seed is -3: must be 0 to'),
        ('"cells_per_side": 4', '"cells_per_side": 65', 'cells_per_side is 65: must be 1 to 64'),
        ('"scenario": "scripted"', '"scenario": 7', 'scenario is 7: must be text'),
        ('"scripted"', '"a\\ud800"', 'must be printable text'),
        ('"cell_size_m": 50.0', '"cell_size_m": null', 'cell_size_m is empty: must be a number'),
        ('"total_bit": 1000000.0', '"total_bit": 1e300', 'total_bit is 1e+300: must be 0 to'),
        ('"uavs": [{', '"uavs": [3, {', 'uavs must be a list of objects'),
        ('"id": 1', '"id": 2', 'UAV 1: id is 2: must be 1'),
        ('"speed_mps": 10.0', '"speed_mps": 0.0', 'UAV 1: speed_mps is 0.0: must be'),
        ('"policy": "script"', '"policy": []', 'UAV 1: policy is a list: must be text'),
        ('"policy": "script", ', '', 'UAV 1: policy is missing'),
        ('"allocator": "exact"', '"allocator": "exact", "guard_after": -1', 'guard_after is -1'),
        ('"allocator": "exact"}]', '"allocator": "exact"}], "uavs": []', "'uavs' stands twice"),
    ],
)
def test_a_value_of_a_header_that_cannot_be_is_refused(
    before: str, after: str, problem: str
) -> None:
    assert before in HEADER_LINE
    with pytest.raises(MissionLogError, match='line 1: no header of a mission log: ') as raised:
        from_jsonl(f'{HEADER_LINE.replace(before, after)}\n'.encode())
    assert problem in str(raised.value)


@pytest.mark.parametrize(
    ('fault', 'problem'),
    [
        ('{"event": 0, "time_s": 0.0, "uav": 2, "fault": "gone"}', 'uav is 2: must be 1'),
        ('{"event": 0, "time_s": 0.0, "uav": 1, "fault": "flu"}', "fault is 'flu': must be"),
        ('{"event": 0, "time_s": 0.0, "uav": 1, "fault": ["gone"]}', 'fault is a list: must be'),
        ('{"event": 1, "time_s": 0.0, "uav": 1, "fault": "gone"}', 'event is 1: must be 0'),
        ('{"event": 0, "uav": 1, "fault": "gone"}', 'time_s is missing'),
    ],
)
def test_a_fault_that_cannot_be_is_refused(fault: str, problem: str) -> None:
    with pytest.raises(MissionLogError, match='line 2: no event of a mission log: ') as raised:
        from_jsonl(f'{HEADER_LINE}\n{fault}\n{HOME_LINE}\n'.encode())
    assert problem in str(raised.value)


def test_whole_numbers_are_numbers_and_keys_may_stand_in_any_order() -> None:
    line = HOME_LINE.replace('"time_s": 0.0, ', '').replace('}', ', "time_s": 0}')
    log = from_jsonl(f'{HEADER_LINE}\n{line}\n'.encode())
    assert log.to_jsonl().decode() == f'{HEADER_LINE}\n{HOME_LINE}\n'


@pytest.mark.parametrize('make', [Path.mkdir, os.mkfifo])
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / 'mission.jsonl')
    with pytest.raises(MissionLogError, match='must be a file'):
        mission_log.read_so_far(tmp_path / 'mission.jsonl')


def test_a_log_larger_than_any_is_refused_by_its_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flown: MissionLog
) -> None:
    path = tmp_path / 'mission.jsonl'
    path.write_bytes(flown.to_jsonl())
    monkeypatch.setattr(mission_log, 'MOST_LOG_BYTE', 100)
    with pytest.raises(MissionLogError, match=r'mission\.jsonl: .* at most 100'):
        mission_log.read(path)


@pytest.mark.parametrize('content', [b'\xff\xfe', HEADER_LINE.encode() + b'\nnonsense\n'])
def test_reading_a_bad_file_names_the_file(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / 'mission.jsonl'
    path.write_bytes(content)
    with pytest.raises(MissionLogError, match=r'mission\.jsonl'):
        mission_log.read(path)


def test_reading_a_missing_file_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(MissionLogError, match=r'mission\.jsonl'):
        mission_log.read(tmp_path / 'mission.jsonl')


def test_reading_a_file_gives_the_log(tmp_path: Path, flown: MissionLog) -> None:
    path = tmp_path / 'mission.jsonl'
    path.write_bytes(flown.to_jsonl())
    assert same(mission_log.read(path), flown)

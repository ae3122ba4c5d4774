from dataclasses import replace
import json
import math
from pathlib import Path

from hypothesis import given, strategies
import numpy as np
import pytest
from scripted_logs import fly, header, uav
from uav_collect.errors import MissionLogError
from uav_collect.recording import mission_log
from uav_collect.recording.mission_log import EVENT_DTYPE, from_jsonl, MissionLog
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
    number=strategies.floats(allow_nan=False),
    heard=strategies.integers(0, 2**64 - 1),
    count=strategies.integers(-(2**63), 2**63 - 1),
)
def test_any_number_reads_back_to_the_last_bit(number: float, heard: int, count: int) -> None:
    log = fly(header([uav(1)]), [['home']])
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
        (b'{"format": "other", "version": 1}\n', 'line 1: not a uav_collect mission log'),
        (HEADER_LINE.replace('"version": 1', '"version": 2').encode(), 'of version 1'),
        (HEADER_LINE.replace('"mission_seed": 3, ', '').encode(), 'mission_seed'),
        (HEADER_LINE.replace('"mission_seed"', '"seed"').encode(), 'seed'),
        (HEADER_LINE.replace('[{', '{').replace('}]', '}').encode(), 'line 1: no header'),
    ],
)
def test_a_bad_header_is_refused_by_name(text: bytes, problem: str) -> None:
    with pytest.raises(MissionLogError, match=problem):
        from_jsonl(text)


@pytest.mark.parametrize(
    ('line', 'problem'),
    [
        ('', 'Expecting value'),
        (HOME_LINE[:50], 'line 3'),
        ('[]', 'line 3'),
        (HOME_LINE.replace('"uav": 1, ', ''), 'uav'),
        (HOME_LINE.replace('"home"', '"land"'), 'not in tuple'),
        (HOME_LINE.replace('"energy reserve"', '"fear"'), 'not in tuple'),
        (HOME_LINE.replace('"time_s": 0.0', '"time_s": "late"'), 'late'),
        (HOME_LINE.replace('"heard": []', '"heard": [0]'), 'negative shift'),
        (HOME_LINE.replace('"heard": []', '"heard": ["a"]'), 'line 3'),
    ],
)
def test_a_bad_event_is_refused_with_its_line(line: str, problem: str) -> None:
    with pytest.raises(MissionLogError, match='line 3: no event') as raised:
        from_jsonl(f'{HEADER_LINE}\n{HOME_LINE}\n{line}\n'.encode())
    assert problem in str(raised.value)


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


def test_a_nan_reward_reads_back_as_nan(flown: MissionLog) -> None:
    flown.events['reward'][0] = math.nan
    assert math.isnan(from_jsonl(flown.to_jsonl()).events['reward'][0])

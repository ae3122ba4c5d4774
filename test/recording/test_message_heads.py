"""Fields of serialized messages, read without the rest of them."""

import random

from bags import definition_text, HandMadeMessages
import numpy as np
import pytest
from uav_collect.errors import UnreadableError
from uav_collect.recording.bag_writer import MessageTypes
from uav_collect.recording.message_heads import HeadReader

MESSAGES = HandMadeMessages()
TYPES = MessageTypes(definition_text)


def is_refused(head: HeadReader, content: bytes) -> bool:
    try:
        head.read(content)
    except UnreadableError as error:
        assert str(error).startswith('no uav_collect_msgs/msg/')
        assert len(str(error)) < 300
        return True
    return False


def reader(name: str, *wanted: str) -> HeadReader:
    return HeadReader(f'uav_collect_msgs/msg/{name}', wanted, TYPES.fields)


@pytest.mark.parametrize('mission_id', ['', 'a', 'abc', 'c504534f-12', 'ü' * 7])
def test_wanted_fields_are_read_whatever_the_alignment_of_those_before(mission_id: str) -> None:
    heard = np.array([1, 2, 64], dtype=np.uint8)
    content = MESSAGES.serialized(
        'Epoch', mission_id=mission_id, event=7, uav=2, reward=-0.25, heard=heard, terminal=True,
        policy_version='sweep',
    )  # fmt: skip
    wanted = ('mission_id', 'event', 'uav', 'heard', 'reward', 'terminal', 'policy_version')
    read = reader('Epoch', *wanted).read(content)
    assert read == (mission_id, 7, 2, bytes(heard), -0.25, True, 'sweep')


@pytest.mark.parametrize('n_sensors', [0, 1, 406])
def test_lists_and_texts_before_are_passed_over(n_sensors: int) -> None:
    content = MESSAGES.serialized(
        'Mission', mission_id='m', phase=1, log_header='{}' * n_sensors,
        demand_bit=np.ones(n_sensors), efficiency_bit_per_j=0.5, n_decisions=101, note='said',
    )  # fmt: skip
    wanted = ('phase', 'efficiency_bit_per_j', 'n_decisions', 'note', 'uavs')
    assert reader('Mission', *wanted).read(content) == (1, 0.5, 101, 'said', 0)


def test_a_list_of_a_fixed_length_is_passed_over() -> None:
    content = MESSAGES.serialized('Observation', previous_action=-1, n_radio_delivered=4)
    assert reader('Observation', 'previous_action', 'n_radio_delivered').read(content) == (-1, 4)


@pytest.mark.parametrize('wanted', ['nothing', 'uav_x_m_'])
def test_a_field_that_there_is_not_is_refused_at_once(wanted: str) -> None:
    with pytest.raises(ValueError, match=f'has no {wanted}'):
        reader('Epoch', wanted)


def test_what_is_cut_off_is_no_message_wherever_it_is_cut() -> None:
    content = MESSAGES.serialized('Epoch', mission_id='m', heard=np.ones(3, np.uint8))
    head = reader('Epoch', 'mission_id', 'heard', 'terminal')
    n_needed = 1 + max(n for n in range(len(content)) if is_refused(head, content[:n]))
    assert n_needed > 100
    assert all(is_refused(head, content[:n_byte]) for n_byte in range(n_needed))


@pytest.mark.parametrize('name', ['Epoch', 'Mission', 'Scenario', 'Observation', 'Transition'])
def test_random_bytes_are_read_or_refused_and_nothing_else(name: str) -> None:
    last = {'Epoch': 'terminal', 'Mission': 'uavs', 'Scenario': 'n_uavs',
            'Observation': 'terminated', 'Transition': 'peer_s'}[name]  # fmt: skip
    head, draw = reader(name, last), random.Random(3)
    whole = MESSAGES.serialized(name)
    for _ in range(2_000):
        content = bytearray(whole)
        for _ in range(draw.randrange(1, 8)):
            content[draw.randrange(len(content))] = draw.randrange(256)
        is_refused(head, bytes(content))
        is_refused(head, draw.randbytes(draw.randrange(200)))

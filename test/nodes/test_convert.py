"""Messages carry records there and back, field by field."""

from functools import partial
import math

import numpy as np
import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Pilots
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from tiny_world import tiny, uav
from uav_collect.analysis.metrics import OUTCOME_CODES, UNFINISHED
from uav_collect.kernels.arrays import row_of
from uav_collect.lockstep.inbox import Inbox
from uav_collect.lockstep.roster import Pilot
from uav_collect.missions.simulation import Event
from uav_collect.nodes import convert
from uav_collect.recording.log_model import EVENT_DTYPE
from uav_collect.uav import action_codes, messages
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.belief import Belief, BeliefRows, NEVER
from uav_collect.uav.briefing import brief
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.policy import policy_named
from uav_collect.uav.view import LocalView
from uav_collect_msgs.msg import Epoch, UavFigures
from uav_collect_msgs.srv import Join

REGION_BIT = [0.0, math.nan, 0.1, 1e6, 1.0 / 3.0, 0.0, 2.5, math.nan, 7.0]


def view(n_sensors: int = 2) -> LocalView:
    """A view whose rows are longer than what it holds, as the world's are."""
    return LocalView(
        time_s=100.0 / 3.0,
        x_m=75.0,
        y_m=1e-9,
        cell=11,
        energy_left_j=1e5 / 7.0,
        previous_action=action_codes.NONE,
        region_bit=row_of(REGION_BIT),
        n_sensors=n_sensors,
        sensor=row_of([4, 9, 0]),
        sensor_bit=row_of([1e5 / 3.0, 2e5, 0.0]),
        sensor_gain=row_of([1.2345678901234567e-9, 5e-324, 0.0]),
        sensor_error_gain=row_of([0.0, 1e-11, 0.0]),
    )


def sent(message):  # noqa: ANN001, ANN201 - a message of any type
    """The message after its way over the wire."""
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize('n_sensors', [0, 1, 2])
def test_a_local_view_arrives_to_the_bit(n_sensors: int) -> None:
    event = Event(index=17, uav=1, decision=5, view=view(n_sensors), heard=())
    message = sent(convert.observation_msg(event, 'm-0', 3))
    there = convert.view_from_msg(message)
    assert (message.mission_id, message.event, message.decision) == ('m-0', 17, 5)
    assert (message.n_radio_delivered, message.terminated) == (3, False)
    for name in LocalView._fields:
        value, expected = getattr(there, name), getattr(event.view, name)
        if name.startswith('sensor'):
            expected = expected[:n_sensors]
        np.testing.assert_array_equal(value, expected, err_msg=name)


@pytest.mark.parametrize(
    'decision',
    [
        Decision(action=action_codes.HOME, reason=action_codes.ENERGY_RESERVE),
        Decision(action=3, reason=action_codes.BY_POLICY),
        Decision(action=0, reason=0, sensor=(4, 9), share_hz=(1e5 / 3.0, 4e5)),
    ],
    ids=['home', 'move', 'hover'],
)
def test_a_decision_arrives_as_the_answer_to_its_observation(decision: Decision) -> None:
    observation = convert.observation_msg(
        Event(index=17, uav=1, decision=5, view=view(), heard=()), 'm-0', 0
    )
    message = sent(convert.command_msg(decision, observation))
    assert convert.decision_from_msg(message) == decision
    assert (message.mission_id, message.decision) == ('m-0', 5)
    assert message.stamp == observation.stamp


def test_a_radio_message_arrives_with_its_map() -> None:
    complete = [cell % 3 % 2 for cell in range(225)]
    said = RadioMessage(sender=1, complete=row_of(complete), x_m=0.1, y_m=75.0, time_s=1.0 / 3.0)
    message = sent(convert.radio_msg(said, 'm-0', sequence=8, delivery=2))
    heard = convert.radio_from_msg(message, 225)
    assert (message.sender, message.sequence, message.delivery) == (2, 8, 2)
    assert (heard.sender, heard.x_m, heard.y_m, heard.time_s) == (1, 0.1, 75.0, 1.0 / 3.0)
    assert list(heard.complete) == complete  # type: ignore[call-overload]


@given(st.lists(st.integers(0, 1), min_size=1, max_size=70))
def test_a_map_is_one_bit_per_cell(complete: list[int]) -> None:
    packed = messages.packed_map(row_of(complete))
    assert len(packed) == math.ceil(len(complete) / 8)
    for cell, flag in enumerate(complete):
        assert packed[cell // 8] >> cell % 8 & 1 == flag
    assert messages.unpacked_map(packed, len(complete)) == complete


@pytest.mark.parametrize('n_bytes', [0, 12, 14])
def test_a_map_of_another_size_is_refused(n_bytes: int) -> None:
    with pytest.raises(ValueError, match=f'a map of {n_bytes} bytes for 100 cells'):
        messages.unpacked_map(bytes(n_bytes), 100)


def test_maps_follow_each_other_each_in_its_own_bytes() -> None:
    joined = messages.packed_maps([row_of([1] * 9), row_of([0, 1] + [0] * 7)])
    assert list(joined) == [255, 1, 2, 0]


def test_an_epoch_has_every_field_of_the_log() -> None:
    events = np.zeros(1, dtype=EVENT_DTYPE)
    for number, name in enumerate(EVENT_DTYPE.names or (), start=1):
        events[name] = number
    events['heard'] = 0b101 | 1 << 63
    epoch = Epoch()
    convert.fill_epoch(epoch, events)
    epoch = sent(epoch)
    for number, name in enumerate(EVENT_DTYPE.names or (), start=1):
        assert name == 'heard' or getattr(epoch, name) == number
    assert list(epoch.heard) == [1, 3, 64]


def test_a_transition_arrives_with_what_the_policy_saw_and_believed() -> None:
    event = Event(index=17, uav=1, decision=5, view=view(), heard=())
    belief: Belief = BeliefRows(
        complete=row_of([1, 0, 0, 0, 0, 0, 0, 0, 1]),
        n_complete=row_of([2]),
        seen_bit=row_of([0.0, 5e-324, 0.0, 1e6, 0.0, 0.0, 0.0, 0.0, 0.0]),
        peer_x_m=row_of([1.0 / 3.0, 0.0]),
        peer_y_m=row_of([25.0, 0.0]),
        peer_s=row_of([7.5, NEVER]),
    )
    message = sent(
        convert.transition_msg(
            convert.observation_msg(event, 'm-0', 0),
            uav=1,
            layout='paper 1',
            scenario_fingerprint='f',
            policy_version='mine eps 0.5',
            belief=belief,
            encoded=row_of([0.5, 1.0]),
            legal=row_of([1, 0, 1, 0, 0]),
            action=2,
        )
    )
    assert (message.uav, message.event, message.decision, message.action) == (2, 17, 5, 2)
    assert (message.layout, message.scenario_fingerprint) == ('paper 1', 'f')
    assert message.policy_version == 'mine eps 0.5'
    assert (message.time_s, message.energy_left_j) == (100.0 / 3.0, 1e5 / 7.0)
    assert (message.cell, message.previous_action) == (11, action_codes.NONE)
    assert (list(message.complete), list(message.seen)) == ([1, 1], [0b1010, 0])
    assert list(message.peer_x_m) == [1.0 / 3.0, 0.0]
    assert list(message.peer_y_m) == [25.0, 0.0]
    assert list(message.peer_s) == [7.5, NEVER]
    assert list(message.observation) == [0.5, 1.0]
    assert list(message.legal) == [True, False, True, False, False]


def test_a_request_to_join_says_who_asks() -> None:
    pilot = Pilot(
        uav=3,
        instance='i',
        host='h',
        pid=42,
        policy='sweep',
        policy_version='sweep 1',
        allocator='equal',
        guard_after=5,
    )
    request = Join.Request(
        uav=3,
        agent_instance='i',
        host='h',
        pid=42,
        policy='sweep',
        policy_version='sweep 1',
        allocator='equal',
        guard_after=5,
    )
    assert convert.pilot_from_request(sent(request)) == pilot


def test_what_arrives_leads_an_agent_to_the_decisions_that_were_taken_without_messages() -> None:
    scenario = tiny(uav(5.0), uav(10.0))
    pilots, n_heard, n_decided = Pilots(scenario, 0, 'sweep'), 0, 0
    agent = Agent(brief(scenario), 0, policy_named('sweep'), allocator_named('exact'))
    inbox = Inbox(
        agent,
        'world',
        view_from=convert.view_from_msg,
        radio_from=partial(convert.radio_from_msg, n_cells=scenario.n_cells),
    )
    while (event := pilots.simulation.next_event()) is not None:
        n_delivered = len(pilots.radio[0]) + len(event.heard)
        observation = convert.observation_msg(event, 'world-0', n_delivered)
        decision = pilots.decide(event)
        pilots.simulation.start(event, decision)
        if event.uav == 0:
            inbox.add_observation(sent(observation))
            for message in pilots.radio[0][n_heard:n_delivered]:
                n_heard += 1
                radio = convert.radio_msg(message, 'world-0', sequence=0, delivery=n_heard)
                inbox.add_radio(sent(radio))
            awaited = inbox.next_observation()
            assert agent.decide(inbox.deliver(awaited)) == decision
            n_decided += 1
    assert n_heard > 2
    assert n_decided > 2


@pytest.mark.parametrize(
    ('time_s', 'sec', 'nanosec'),
    [(0.0, 0, 0), (1.5, 1, 500_000_000), (2.9999999999, 3, 0), (391.123456789, 391, 123_456_789)],
)
def test_a_stamp_is_rounded_to_the_nanosecond(time_s: float, sec: int, nanosec: int) -> None:
    stamp = convert.stamp(time_s)
    assert (stamp.sec, stamp.nanosec) == (sec, nanosec)


def test_a_request_that_tells_of_no_guard_has_none() -> None:
    assert convert.pilot_from_request(sent(Join.Request(uav=1))).guard_after == action_codes.NONE


def test_the_ends_of_uavs_have_the_codes_of_their_message() -> None:
    names = action_codes.REASON_NAMES
    assert {
        names[action_codes.MAP_COMPLETE]: UavFigures.MAP_COMPLETE,
        names[action_codes.ENERGY_RESERVE]: UavFigures.ENERGY_RESERVE,
        names[action_codes.BY_POLICY]: UavFigures.CHOSEN,
        names[action_codes.FAILSAFE]: UavFigures.FAILSAFE,
        UNFINISHED: UavFigures.ABORTED,
        names[action_codes.FAULT]: UavFigures.FAULT,
    } == OUTCOME_CODES

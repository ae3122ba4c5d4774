"""Messages: what an agent, a world and a learner do with those that are wrong, without any node.

A mission of two UAVs is flown once. What UAV 1 hears and answers, and what is reported to a
learner, then comes again with a few messages changed by field, cut, repeated, or out of order.
"""

from array import array
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, fields, replace
from functools import cache, partial
import hashlib
import math
from types import SimpleNamespace
from typing import Any

from fuzzing import check_lines, fuzzed
from hypothesis import strategies as st
import numpy as np
import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Pilots
from random_policies import header as policy_header
from random_policies import random_policy
from rclpy.serialization import deserialize_message, serialize_message
from reports import MissionSetup, reports_of
from tiny_world import tiny, uav
from uav_collect.errors import in_one_line, RefusedError
from uav_collect.ingest.from_messages import converter_for
from uav_collect.ingest.reports import FleetReport
from uav_collect.kernels.arrays import Row
from uav_collect.lockstep.checks import observation_problem, radio_problem
from uav_collect.lockstep.inbox import Inbox
from uav_collect.lockstep.published_policy import PolicyStore
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.nodes import convert
from uav_collect.uav.action_codes import HOME, NONE
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.briefing import brief
from uav_collect.uav.messages import Decision
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import policy_named
from uav_collect.uav.policy_file import policy_bytes
from uav_collect_msgs.msg import Policy

SCENARIO = tiny(uav(5.0), uav(10.0))
WORLD = '0123456789abcdef'
MISSION = f'{WORLD}-0'
N_EVENTS = 10
WHOLE = {'uint8': 2**8 - 1, 'uint16': 2**16 - 1, 'uint32': 2**32 - 1, 'uint64': 2**64 - 1,
         'int8': 2**7 - 1, 'int16': 2**15 - 1, 'int32': 2**31 - 1, 'int64': 2**63 - 1}  # fmt: skip
NAMES = st.one_of(
    st.sampled_from(['', MISSION, f'{WORLD}-1', f'{WORLD}-999999999', f'{WORLD}--1', '-0']),
    st.sampled_from(['x' * 5000, '\x1b[31m', '-' + '9' * 5000, '[/b]', '../..', '\u0661']),
    st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\x00'), max_size=20),
)
FLOATS = st.one_of(
    st.floats(), st.sampled_from([0.0, -0.0, 1e308, 5e-324, -1.0, math.nan, math.inf])
)


@dataclass(frozen=True, kw_only=True)
class Heard:
    """What one UAV receives and sends in the first events of a mission, as messages."""

    n_sensors: int
    received: tuple[tuple[str, Any], ...]  # 'radio' or 'observation', and the message
    answers: tuple[tuple[Simulation, Event, Any], ...]  # a world that waits for each Command


@cache
def heard() -> Heard:
    """The first events of a mission, as UAV 1 has them."""
    pilots, received, answers = Pilots(SCENARIO, 0, 'sweep'), [], []
    for _ in range(N_EVENTS):
        event = pilots.simulation.next_event()
        assert event is not None
        before = len(pilots.radio[0])
        decision = pilots.decide(event)
        for delivery, message in enumerate(pilots.radio[0][before:], start=before + 1):
            radio = convert.radio_msg(message, MISSION, sequence=delivery, delivery=delivery)
            received.append(('radio', radio))
        if event.uav == 0:
            n_delivered = before + len(event.heard)
            observation = convert.observation_msg(event, MISSION, n_delivered)
            received.append(('observation', observation))
            command = convert.command_msg(decision, observation)
            answers.append((deepcopy(pilots.simulation), deepcopy(event), command))
        pilots.simulation.start(event, decision)
    n_sensors = len(pilots.simulation.demand_bit)
    return Heard(n_sensors=n_sensors, received=tuple(received), answers=tuple(answers))


def value_of(kind: str) -> st.SearchStrategy[Any]:
    """Values that the wire can carry for a type of field."""
    name, bracket, length = kind.rstrip(']').partition('[')
    if kind.startswith('sequence<'):
        return st.lists(value_of(kind[len('sequence<') : -1]), max_size=12)
    if bracket:
        return st.lists(value_of(name), min_size=int(length), max_size=int(length))
    if kind in WHOLE:
        low = 0 if kind.startswith('u') else -WHOLE[kind] - 1
        edges = [low, WHOLE[kind], 0, 1, 2, 7, 64]
        return st.one_of(st.sampled_from(edges), st.integers(low, WHOLE[kind]))
    if kind in ('float', 'double'):
        return FLOATS if kind == 'double' else st.floats(width=32)
    if kind == 'boolean':
        return st.booleans()
    return NAMES


@st.composite
def changed(draw: st.DrawFn, message: Any) -> Any:  # noqa: ANN401
    """A message with one to three fields of plain types changed."""
    other = deserialize_message(serialize_message(message), type(message))
    kinds = {
        name: kind
        for name, kind in message.get_fields_and_field_types().items()
        if '/' not in kind
    }
    for name in draw(st.lists(st.sampled_from(sorted(kinds)), min_size=1, max_size=3)):
        setattr(other, name, draw(value_of(kinds[name])))
    return deserialize_message(serialize_message(other), type(message))


@st.composite
def histories(draw: st.DrawFn) -> list[tuple[str, Any]]:
    """What a UAV receives, with changed messages among it, some twice, some never."""
    history = [*heard().received]
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, len(history) - 1))
        kind, message = history[place]
        match draw(st.sampled_from(['add', 'replace', 'drop', 'repeat', 'swap'])):
            case 'add':
                history.insert(place, (kind, draw(changed(message))))
            case 'replace':
                history[place] = kind, draw(changed(message))
            case 'drop' if len(history) > 1:
                del history[place]
            case 'swap':
                other = draw(st.integers(0, len(history) - 1))
                history[place], history[other] = history[other], history[place]
            case _:
                history.insert(draw(st.integers(0, len(history))), (kind, message))
    return history


@fuzzed(share=0.3, history=histories())
def test_an_agent_refuses_a_message_in_one_line_or_decides_by_it(
    history: Sequence[tuple[str, Any]],
) -> None:
    briefing = brief(SCENARIO)
    agent = Agent(briefing, 0, policy_named('sweep'), allocator_named('exact'))
    radio_from = partial(convert.radio_from_msg, n_cells=SCENARIO.n_cells)
    inbox = Inbox(agent, WORLD, view_from=convert.view_from_msg, radio_from=radio_from)
    for kind, message in history:
        if kind == 'radio':
            problem = radio_problem(message, briefing, 0)
            if problem is None:
                inbox.add_radio(message)
        else:
            problem = observation_problem(message, briefing, 0, heard().n_sensors)
            problem = problem or inbox.add_observation(message)
        if problem is not None:
            check_lines([in_one_line(problem)])
        while (observation := inbox.next_observation()) is not None:
            decision = agent.decide(inbox.deliver(observation))
            inbox.note(decision)
            check_decision(decision, briefing.bandwidth_hz)


def check_decision(decision: Decision, bandwidth_hz: float) -> None:
    assert NONE < decision.action <= HOME
    assert all(share_hz >= 0.0 for share_hz in decision.share_hz)
    assert math.fsum(decision.share_hz) <= bandwidth_hz * (1.0 + 1e-9)


@fuzzed(share=0.2, data=st.data())
def test_a_world_refuses_a_command_in_one_line_or_carries_it_out(data: st.DataObject) -> None:
    simulation, event, command = data.draw(st.sampled_from(heard().answers))
    decision = convert.decision_from_msg(data.draw(changed(command)))
    problem = simulation.refusal(event, decision)
    if problem is not None:
        check_lines([in_one_line(problem)])
        return
    flown = deepcopy(simulation)
    flown.start(event, decision)
    flown.next_event()
    assert np.isfinite(np.array(flown.last_event().tolist()[0], dtype=np.float64)).all()


@fuzzed(share=0.1, data=st.data())
def test_a_policy_that_is_published_is_taken_whole_or_refused_in_one_line(
    data: st.DataObject,
) -> None:
    content = policy_bytes(flown_policy())
    message = Policy(
        version=flown_policy().header.version,
        trainer_instance='trainer',
        sequence=1,
        content=array('B', content),
        sha256=hashlib.sha256(content).hexdigest(),
        epsilon=0.1,
        hover_share=0.5,
        advice_share=0.1,
    )
    store = PolicyStore(brief(SCENARIO))
    problem = store.add(data.draw(changed(message)))
    assert (problem is None) == (store.latest is not None)
    if problem is not None:
        check_lines([in_one_line(problem)])


@cache
def flown_policy() -> Any:  # noqa: ANN401
    side = SCENARIO.area.n_rows
    return random_policy(policy_header(Layout.EGOCENTRIC, side, SCENARIO.n_uavs), seed=1)


@cache
def reported() -> tuple[FleetReport, ...]:
    """All that is reported to a learner of two missions."""
    return tuple(reports_of(SETUP, [0, 1]))


SETUP = MissionSetup(scenario=SCENARIO)


@st.composite
def changed_report(draw: st.DrawFn, report: FleetReport) -> FleetReport:
    """A report with one field changed to another value of its type."""
    field = draw(st.sampled_from(fields(report)))
    value = getattr(report, field.name)
    match value:
        case bool():
            other: Any = not value
        case int():
            other = draw(st.one_of(st.integers(-3, 70), st.integers(-(2**31), 2**64 - 1)))
        case float():
            other = draw(FLOATS)
        case bytes():
            other = draw(changed_bytes(value))
        case _:
            other = draw(NAMES) if isinstance(value, str) else draw(st.integers(0, 100))
    return replace(report, **{field.name: other})


@st.composite
def changed_bytes(draw: st.DrawFn, content: bytes) -> bytes:
    """Bytes of another length, or with numbers that are none among them."""
    if draw(st.booleans()) and len(content) >= 8:
        place = draw(st.integers(0, len(content) // 8 - 1)) * 8
        number = np.array(draw(FLOATS), dtype='<f8').tobytes()
        return content[:place] + number + content[place + 8 :]
    return draw(st.binary(max_size=64))


@fuzzed(share=0.4, data=st.data())
def test_a_learner_refuses_a_report_in_one_line_or_learns_finite_numbers(
    data: st.DataObject,
) -> None:
    reports = [*reported()]
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(reports) - 1))
        reports.insert(place, data.draw(changed_report(reports[place])))
        if data.draw(st.booleans()):
            del reports[place + 1]
    joiner = SETUP.joiner()
    for report in reports:
        try:
            joined = joiner.add(named(report))
        except RefusedError as error:
            check_lines([in_one_line(str(error))])
            continue
        if joined is not None:
            assert math.isfinite(joined.efficiency_kbit_per_j)
            for table in joined.episode.records:
                assert is_finite(table), joined.episode.records._fields


def named(report: FleetReport) -> FleetReport:
    """The report, if a message could have named its mission so."""
    found = converter_for('/world/mission')
    assert found is not None
    _, convert_mission = found
    world = getattr(report, 'world_instance', 'world')
    about = {'mission_id': report.mission_id, 'world_instance': world, 'seed': 0, 'phase': 0}
    convert_mission(SimpleNamespace(**about, scenario_fingerprint='', demand_bit=np.zeros(0)))
    return report


def is_finite(table: Row[float]) -> bool:
    values = np.asarray(table)
    return values.dtype.kind != 'f' or bool(np.isfinite(values).all())

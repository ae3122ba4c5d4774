"""Whatever comes on a topic, no node ends and the mission is flown as if nothing had come."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
import random
import time
from typing import Any

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from bag_player import BagPlayer
from fleets import Fleet, Listener, listener, logs, scenario_of
from fuzzing import N_TRIES, note_try
from fuzzing import SEED as FUZZ_SEED
from processes import DEADLINE_S, Processes, RunningProcess
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message, serialize_message
from steered_world import SteeredWorld
from uav_collect.nodes import topics
from uav_collect_msgs.msg import (
    Command,
    Observation,
    Policy,
    RadioMessage,
    RecorderStatus,
    Refusal,
    Scenario,
)
from uav_collect_msgs.srv import ControlMission, Join

pytestmark = [pytest.mark.ros, pytest.mark.long]

SEED = 6
# Simulated over wall-clock time: the mission takes longer than to send all that.
PACE = 5.0 * min(1.0, 2_000 / N_TRIES)
N_KINDS = 8  # of incidents in a node, each of which may fill 50 lines in ten seconds
_HEADER = 4  # bytes that every message begins with; the middleware drops what is shorter
FAR = 1_000_000  # decisions or deliveries ahead: what is changed at random must not fit by chance


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A mission of two UAVs in flight, and a node of the test that hears it."""

    fleet: Fleet
    world: RunningProcess
    agents: list[RunningProcess]
    listening: Listener
    expected: bytes  # log
    begun_s: float  # monotonic

    def heard(self, topic: Any) -> list[Any]:  # noqa: ANN401
        """The messages on a topic so far."""
        return self.listening.heard[topic.name]

    def end(self) -> None:
        """Hurry the mission to its end, which nothing may have changed."""
        steered = SteeredWorld(self.listening.node, self.listening.wait_until)
        steered.change('real_time_factor', 0.0)
        assert self.world.wait_for_exit() == 0
        assert self.fleet.log(SEED) == self.expected
        now_s = time.monotonic()
        for process in (self.world, *self.agents):
            assert 'Traceback' not in process.output
            assert process.output.count(']: ') < N_KINDS * 50 * (1 + (now_s - self.begun_s) / 10)
        assert all(agent.is_running for agent in self.agents)


@pytest.fixture
def flight(processes: Processes, tmp_path: Path) -> Iterator[Flight]:
    """A mission of eight minutes, unless it is hurried."""
    scenario = scenario_of(fleet__default__energy_budget_kj=400.0)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    (expected,) = logs(scenario, [SEED], 'random')
    own = [each for uav in (1, 2) for each in topics.topics_of_uav(uav)]
    begun_s = time.monotonic()
    with listener(topics.SCENARIO, topics.MISSION, *own) as listening:
        agents = fleet.start_agents('random')
        world = fleet.start_world(seed=SEED, real_time_factor=PACE)
        fleet.wait_for_events(SEED, 8)
        yield Flight(
            fleet=fleet,
            world=world,
            agents=agents,
            listening=listening,
            expected=expected,
            begun_s=begun_s,
        )


def mutated(draw: random.Random, content: bytes) -> bytes:
    """Bytes that resemble a message, or do not."""
    kind, changed = draw.random(), bytearray(content)
    if kind < 0.1:
        return draw.randbytes(draw.randrange(_HEADER, 300))
    if kind < 0.25:
        return bytes(changed[: draw.randrange(_HEADER, len(changed))])
    if kind < 0.35:
        return bytes(changed) + draw.randbytes(draw.randrange(100))
    for _ in range(draw.randrange(1, 9)):
        changed[draw.randrange(_HEADER, len(changed))] = draw.choice((0, 1, 127, 128, 255))
    return bytes(changed)


def sample(flight: Flight, topic: Any) -> bytes:  # noqa: ANN401
    """A message as it is sent on a topic, but for decisions and deliveries far ahead."""
    made = {
        Refusal: Refusal(what='command', reason='none', agent_instance='x'),
        RecorderStatus: RecorderStatus(recorder_instance='r', bag='b', waits_for=['x'] * 9),
        Policy: Policy(version='v', content=[1] * 100, sha256='0' * 64, trainer_instance='t'),
    }
    message = made.get(topic.message)
    if message is None:
        heard = flight.heard(topic)
        flight.listening.wait_until(lambda: bool(heard))
        message = deserialize_message(serialize_message(heard[-1]), topic.message)
    if isinstance(message, Observation | Command):
        message.decision += FAR
    elif isinstance(message, RadioMessage):
        message.delivery += FAR
        message.sequence += FAR
    elif isinstance(message, Scenario):
        message.stamp.sec -= 1000
        message.world_instance = 'x' + message.world_instance[1:]
    return serialize_message(message)


def test_fuzzed_messages_end_no_node_and_change_nothing(flight: Flight) -> None:
    own = [
        each
        for uav in (1, 2)
        for name in ('observation', 'radio_rx', 'command', 'radio_tx', 'refusal')
        for each in [getattr(topics.uav_topics(uav), name)]
    ]
    shared = (topics.SCENARIO, topics.POLICY, topics.RECORDER)
    draw, heard_topics = random.Random(int(FUZZ_SEED or 0)), (*own, *shared)
    samples = {topic.name: sample(flight, topic) for topic in heard_topics}
    publishers = {
        topic.name: topics.publisher(flight.listening.node, topic) for topic in heard_topics
    }
    for number in range(N_TRIES):  # on each topic
        note_try(number)
        for name, publisher in publishers.items():
            publisher.publish(mutated(draw, samples[name]))
        if number % 500 == 499:  # else histories overflow, and what nodes say would be lost
            assert all(
                it.wait_for_all_acked(Duration(seconds=DEADLINE_S)) for it in publishers.values()
            )
    assert flight.world.is_running
    flight.end()


def scenario(**values: object) -> Callable[[Flight], tuple[Any, Any]]:
    """A scenario that is changed."""

    def make(flight: Flight) -> tuple[Any, Any]:
        heard = flight.heard(topics.SCENARIO)
        flight.listening.wait_until(lambda: bool(heard))
        msg = deserialize_message(serialize_message(heard[0]), topics.SCENARIO.message)
        for name, value in {'world_instance': 'forged', **values}.items():
            setattr(msg, name, value)
        return topics.SCENARIO, msg

    return make


def of_uav(topic: str, **values: object) -> Callable[[Flight], tuple[Any, Any]]:
    """The latest message on a topic of UAV 1, changed."""

    def make(flight: Flight) -> tuple[Any, Any]:
        own = getattr(topics.uav_topics(1), topic)
        flight.listening.wait_until(lambda: bool(flight.heard(own)))
        msg = deserialize_message(serialize_message(flight.heard(own)[-1]), own.message)
        for name, value in values.items():
            setattr(msg, name, value(getattr(msg, name)) if callable(value) else value)
        return own, msg

    return make


def numbered(number: str) -> Callable[[str], str]:
    """The id of a mission with another number."""
    return lambda mission_id: f'{mission_id.partition("-")[0]}-{number}'


FAR_AHEAD = {'decision': 0, 'mission_id': numbered('1000000000')}
HOSTILE = {
    'a scenario of an earlier world': scenario(stamp=Scenario().stamp),
    'a scenario of nonsense': scenario(stamp=Scenario().stamp, yaml='nonsense: [', fingerprint=''),
    'a scenario with an impossible service': scenario(
        stamp=Scenario().stamp, vouch_service='no such name!'
    ),
    'an observation of mission 999...': of_uav('observation', mission_id=numbered('9' * 5000)),
    'an observation far ahead': of_uav('observation', **FAR_AHEAD),
    'an observation of the next mission': of_uav(
        'observation', decision=0, mission_id=numbered('1')
    ),
    'an observation of mission -1': of_uav('observation', mission_id=numbered('-1')),
    'unequal arrays': of_uav('observation', decision=lambda it: it + 1, sensor=[1, 2, 3]),
    'an unknown sensor': of_uav(
        'observation',
        decision=lambda it: it + 1,
        sensor=[2**32 - 1],
        sensor_demand_bit=[1.0],
        sensor_gain=[1.0],
        sensor_error_gain=[1.0],
    ),
    'a place outside': of_uav('observation', decision=lambda it: it + 1, x_m=-1e9),
    'a map of 3 bytes': of_uav('radio_rx', delivery=lambda it: it + 1, complete=[1, 2, 3]),
    'sender 200': of_uav('radio_rx', delivery=lambda it: it + 1, sender=200),
    'a command of 100,000 shares': of_uav(
        'command', sensor=[1] * 100_000, bandwidth_hz=[1.0] * 100_000
    ),
    'a name of a megabyte': of_uav('command', agent_instance='x' * 1_000_000),
    'a transmission of a megabyte': of_uav('radio_tx', complete=[255] * 1_000_000),
}


def test_hostile_messages_end_no_node_and_change_nothing(flight: Flight) -> None:
    for make in HOSTILE.values():
        topic, message = make(flight)
        publisher = topics.publisher(flight.listening.node, topic)
        for _ in range(3):
            publisher.publish(message)
        assert publisher.wait_for_all_acked(Duration(seconds=DEADLINE_S))
    flight.end()


def test_who_only_asks_to_join_keeps_no_agent_out(processes: Processes, tmp_path: Path) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(), folder=tmp_path / 'run')
    with listener(topics.SCENARIO) as listening:
        world = fleet.start_world(seed=SEED)
        scenarios = listening.heard[topics.SCENARIO.name]
        listening.wait_until(lambda: bool(scenarios))
        client = listening.node.create_client(Join, topics.JOIN_SERVICE)
        listening.wait_until(client.service_is_ready)
        futures = [
            client.call_async(
                Join.Request(
                    world_instance=scenarios[0].world_instance,
                    uav=uav,
                    agent_instance=instance,
                    policy='sweep',
                    policy_version='rule',
                    allocator='exact',
                )
            )
            for uav in (1, 2)
            for instance in ('', 'x', 'forged')
        ]
        listening.wait_until(lambda: all(future.done() for future in futures))
        assert [future.result().accepted for future in futures] == [True] * len(futures)
        fleet.start_agents()
        assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == logs(fleet.scenario, [SEED])[0]


def test_a_second_abort_leaves_a_row_of_missions_alone(
    processes: Processes, tmp_path: Path
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(), folder=tmp_path / 'run')
    with listener(topics.MISSION) as listening:
        world = fleet.start_world(seed=SEED, missions=-1)
        client = listening.node.create_client(ControlMission, topics.CONTROL_SERVICE)
        listening.wait_until(client.service_is_ready)
        abort = ControlMission.Request(command=ControlMission.Request.ABORT)
        futures = [client.call_async(abort) for _ in range(2)]
        listening.wait_until(lambda: all(future.done() for future in futures))
        assert not any(future.result().success for future in futures)
        fleet.start_agents()
        missions = listening.heard[topics.MISSION.name]
        listening.wait_until(lambda: len(missions) > 4)
        assert world.is_running
    assert fleet.log(SEED) == logs(fleet.scenario, [SEED])[0]


@pytest.mark.nightly
def test_a_recording_that_is_played_back_touches_no_mission(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of()
    recorded = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'recorded')
    recorder = recorded.start_recorder(stop_after_missions=1)
    agents = recorded.start_agents()
    assert recorded.start_world(seed=SEED + 1).wait_for_exit() == 0
    assert recorder.wait_for_exit() == 0
    for agent in agents:
        agent.kill()
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    with listener(topics.MISSION) as listening:
        player = BagPlayer(listening.node, recorded.bag, 2)
        assert player.play() > 100
        agents = fleet.start_agents()
        agents[0].wait_for('its world does not answer')
        world = fleet.start_world(seed=SEED, real_time_factor=40.0)
        fleet.wait_for_events(SEED, 8)
        player.play()
        assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == logs(scenario, [SEED])[0]
    assert all(agent.is_running for agent in agents)

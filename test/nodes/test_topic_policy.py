"""Agents that fly what a trainer publishes: a version a mission, the bytes of one process."""

from array import array
import hashlib
from pathlib import Path
import time
from typing import Any

from fleets import Fleet, listener, scenario_of
from policy_publisher import explored_logs, policy_fields, policy_publisher
from processes import Processes
import pytest
from random_policies import header, random_policy
from steered_world import SteeredWorld
from uav_collect.missions.simulation import Simulation
from uav_collect.recording.mission_log import from_jsonl
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.observation import Layout, observation_size
from uav_collect.uav.policy_file import policy_bytes
from uav_collect.uav.policy_network import flown_version, FrozenPolicy

pytest.importorskip('rclpy')
pytest.importorskip('uav_collect_msgs')

from uav_collect.nodes import convert, topics
from uav_collect.nodes.identity import scenario_msg, WorldIdentity
from uav_collect.nodes.topics import publisher
from uav_collect_msgs.msg import Mission, Policy
from uav_collect_msgs.srv import Join, Vouch

pytestmark = pytest.mark.ros

SEED = 3


def policy_of(number: int, layout: Layout = Layout.EGOCENTRIC) -> FrozenPolicy:
    return random_policy(header(layout, version=f'run@{number}'), seed=number)


@pytest.fixture
def fleet(processes: Processes, tmp_path: Path) -> Fleet:
    scenario = scenario_of(2, fleet__default__energy_budget_kj=20.0)  # some 40 events
    return Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')


def flown(log: bytes) -> str:
    """The version that a mission's log names; the same for all UAVs."""
    (version,) = {uav.policy for uav in from_jsonl(log).header.uavs}
    return version


def test_a_mission_is_flown_by_one_version_and_equals_the_same_mission_in_one_process(
    fleet: Fleet,
) -> None:
    policies = {1: policy_of(1), 2: policy_of(2), 3: policy_of(3, Layout.PAPER)}
    policies[4] = random_policy(header(Layout.RELATIVE, version='run@4', advice_bonus=0.1), seed=4)
    epsilons = {1: 0.3, 2: 0.0, 3: 1.0, 4: 0.5}
    advice_shares = {4: 0.3}
    names = {flown_version(f'run@{it}', epsilons[it]): it for it in policies}
    watched = (topics.EPOCH, topics.uav_topics(1).transition)
    with policy_publisher(*watched) as (trainer, listening):
        epochs = listening.heard[topics.EPOCH.name]
        agents = fleet.start_agents('topic')
        world = fleet.start_world(seed=SEED, missions=-1)
        for agent in agents:
            agent.wait_for('waiting for the first policy of a trainer on /trainer/policy')
        world.wait_for('waiting for UAV 1, UAV 2')
        for number, policy in policies.items():
            advice_share = advice_shares.get(number, 0.0)
            trainer.publish(policy, epsilons[number], advice_share=advice_share)
            version = flown_version(f'run@{number}', epsilons[number])
            listening.wait_until(lambda version=version: _flies(epochs, version, n_missions=2))
        n_missions = len({epoch.mission_id for epoch in epochs if epoch.terminal})
    seeds = range(SEED, SEED + n_missions)
    logs = {seed: fleet.log(seed) for seed in seeds}
    assert {flown(log) for log in logs.values()} == set(names)
    for seed, log in logs.items():
        number = names[flown(log)]
        [expected] = explored_logs(
            fleet.scenario,
            [seed],
            policies[number],
            epsilons[number],
            advice_share=advice_shares.get(number, 0.0),
        )
        assert log == expected, seed
    versions: dict[str, set[str]] = {}
    for topic in watched:
        for message in listening.heard[topic.name]:
            versions.setdefault(message.mission_id, set()).add(message.policy_version)
    assert {len(each) for each in versions.values()} == {1}
    by_layout = {(each.policy_version, each.layout) for each in listening.heard[watched[1].name]}
    assert by_layout == {
        (version, policies[number].header.layout.label) for version, number in names.items()
    }


def _flies(epochs: list[Any], version: str, n_missions: int) -> bool:
    whole = [epoch for epoch in epochs if epoch.terminal and epoch.policy_version == version]
    return len(whole) >= n_missions


def _misfit(policy: FrozenPolicy, scenario: Scenario) -> dict[str, dict[str, object]]:
    """Values of messages that are not to be flown, by a word of the refusal."""
    whole = policy_bytes(policy)

    def holding(content: bytes) -> dict[str, object]:
        return {'content': array('B', content), 'sha256': hashlib.sha256(content).hexdigest()}

    side = scenario.area.n_rows + 1
    size = observation_size(Layout.PAPER, side * side, 2)
    elsewhere = header(Layout.PAPER, side=side, observation_size=size, version='run@1')
    other_layout = whole.replace(b'egocentric/2', b'egocentric/1')
    return {
        'SHA-256': {'sha256': '0' * 64},
        'is not a whole safetensors file': holding(whole[:-10]),
        'must be paper/1 or egocentric': holding(other_layout),
        'area is 10 x 10 cells': holding(policy_bytes(random_policy(elsewhere, seed=1))),
        "its file is of version 'run@1'": {'version': 'run@9'},
        'epsilon is nan': {'epsilon': float('nan')},
    }


def test_a_policy_that_cannot_be_flown_is_refused_in_one_line_and_the_old_one_stays(
    fleet: Fleet,
) -> None:
    policy = policy_of(1)
    with policy_publisher(topics.MISSION) as (trainer, listening):
        missions = listening.heard[topics.MISSION.name]
        agents = fleet.start_agents('topic')
        world = fleet.start_world(seed=SEED, missions=2)
        for process in (world, *agents):
            process.wait_for('waiting for (UAV|the first policy)')
        bad = _misfit(policy, fleet.scenario)
        for word, values in bad.items():
            trainer.publish(policy, **values)
            for process in (world, *agents):
                process.wait_for(f'of the trainer is refused.*{word}')
        trainer.publish(policy)
        for word, values in bad.items():
            trainer.publish(policy_of(1), **values)
            for process in agents:
                process.wait_for(f'of the trainer is refused.*{word}')
        listening.wait_until(lambda: len(missions) == 4)
        assert world.wait_for_exit() == 0
    seeds = [SEED, SEED + 1]
    assert fleet.logs(seeds) == explored_logs(fleet.scenario, seeds, policy, 0.0)
    for agent in agents:
        assert agent.output.count('of the trainer is refused') == 2 * len(bad)
        assert 'Traceback' not in agent.output


@pytest.mark.nightly
def test_an_agent_killed_in_flight_takes_up_the_version_of_its_mission_though_all_else_is_gone(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(2, fleet__default__energy_budget_kj=80.0)  # some 180 events
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    first, second = policy_of(1), policy_of(2)
    [expected] = explored_logs(scenario, [SEED], first, 0.3)
    with policy_publisher(topics.MISSION) as (trainer, listening):
        missions = listening.heard[topics.MISSION.name]
        steered = SteeredWorld(listening.node, listening.wait_until)
        world = fleet.start_world(seed=SEED, missions=2)
        steered.pause()
        agents = fleet.start_agents('topic')
        trainer.publish(first, 0.3)
        steered.step(50)
        trainer.publish(second)
        trainer.wait_until_heard()
        steered.step(50)
        trainer.vanish()
        agents[0].kill()
        agents[0] = fleet.start_agent(1, 'topic')
        agents[0].wait_for('UAV 1 flies, policy topic')
        assert [it.phase for it in missions] == [Mission.STARTED]
        steered.resume()
        listening.wait_until(lambda: len(missions) == 4)
        assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == expected
    assert [fleet.log(SEED + 1)] == explored_logs(scenario, [SEED + 1], second, 0.0)


def test_an_agent_that_missed_the_policy_of_a_mission_asks_the_world_for_it(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(1)
    policies = [random_policy(header(n_uavs=1, version=f'run@{it}'), seed=it) for it in (1, 2)]
    published = [policy_fields(policy, it, 0.0) for it, policy in enumerate(policies, start=1)]
    site = build_site(scenario)
    simulation = Simulation(site, SEED)
    event = simulation.next_event()
    assert event is not None
    world = WorldIdentity(started_s=time.time(), instance='world-of-the-test')
    observation = convert.observation_msg(event, world.mission_id(0), 0)
    observation.exploration_key = SEED
    observation.policy_trainer, observation.policy_sequence = 'test-trainer', 2
    n_asked = 0

    def answer(request: Any, response: Any) -> Any:  # noqa: ANN401
        nonlocal n_asked
        n_asked += 1
        response.world_instance, response.accepted = world.instance, True
        response.mission_id = world.mission_id(0)
        response.policy = Policy(**published[n_asked > 1])
        if n_asked > 1:
            response.observations, response.decision_pending = [observation], True
        return response

    def vouch(request: Any, response: Any) -> Any:  # noqa: ANN401
        response.world_instance = world.instance
        return response

    command = topics.uav_topics(1).command
    with listener(command) as listening:
        listening.node.create_service(Join, topics.JOIN_SERVICE, answer)
        listening.node.create_service(Vouch, '/world/vouch_x', vouch)
        shown = publisher(listening.node, topics.uav_topics(1).observation)
        publisher(listening.node, topics.SCENARIO).publish(
            scenario_msg(world, site, '/world/vouch_x')
        )
        fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
        agent = fleet.start_agent(1, 'topic')
        listening.wait_until(lambda: n_asked == 1)
        shown.publish(observation)
        heard = listening.heard[command.name]
        listening.wait_until(lambda: any(each.mission_id for each in heard))
    assert n_asked == 2
    assert heard[-1].policy_version == 'run@2'
    assert agent.is_running

"""Agents and worlds that die at any moment: missions go on as if nothing had happened."""

from pathlib import Path
import signal

from fleets import Fleet, flown_without, listener, logs, scenario_of
import numpy as np
from processes import Processes
import pytest
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.tables import mission_warnings
from uav_collect.recording.mission_log import read

pytest.importorskip('rclpy')
UavFigures = pytest.importorskip('uav_collect_msgs.msg').UavFigures

from uav_collect.nodes import topics

pytestmark = pytest.mark.ros

SEED = 3
ENOUGH_S = 100.0  # no failsafe, however busy the machine is


@pytest.fixture
def fleet(processes: Processes, tmp_path: Path) -> Fleet:
    """Two UAVs that fly at random for some two thousand events."""
    scenario = scenario_of(fleet__default__energy_budget_kj=2000.0)
    return Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')


def events_of(log: bytes) -> int:
    return log.count(b'\n') - 1


@pytest.mark.parametrize(
    'victims', [[1], [2, 2, 1], [(1, 2)]], ids=['one', 'one after the other', 'both']
)
def test_agents_killed_at_any_event_and_started_again_change_nothing(
    victims: list[int | tuple[int, ...]], fleet: Fleet
) -> None:
    (expected,) = logs(fleet.scenario, [SEED], 'random')
    kill_at = np.random.default_rng(len(victims)).integers(events_of(expected) // 2, size=9)
    agents = fleet.start_agents('random')
    world = fleet.start_world(seed=SEED, decision_timeout_s=ENOUGH_S)
    for event, uavs in zip(sorted(kill_at[: len(victims)]), victims, strict=True):
        killed = uavs if isinstance(uavs, tuple) else (uavs,)
        fleet.wait_for_events(SEED, event)
        for uav in killed:
            agents[uav - 1].kill()
        assert event <= fleet.n_events(SEED) < events_of(expected)
        for uav in killed:
            agents[uav - 1] = fleet.start_agent(uav, 'random')
        for uav in killed:
            agents[uav - 1].wait_for(f'UAV {uav} flies')
    assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == expected


def test_an_agent_killed_before_it_answers_is_asked_again_when_it_is_back(fleet: Fleet) -> None:
    (expected,) = logs(fleet.scenario, [SEED], 'random')
    victim, _ = fleet.start_agents('random')
    world = fleet.start_world(seed=SEED, decision_timeout_s=ENOUGH_S)
    fleet.wait_for_events(SEED, 100)
    victim.send(signal.SIGSTOP)
    world.wait_for('UAV 1: its agent is gone')
    waiting_at = fleet.n_events(SEED)
    victim.kill()
    fleet.start_agent(1, 'random').wait_for('UAV 1 flies')
    assert 100 <= waiting_at < events_of(expected)
    assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == expected


@pytest.mark.parametrize('name', ['uav_agent', 'world_sim'])
def test_a_node_that_falls_silent_for_a_while_goes_on_where_it_was(
    name: str, fleet: Fleet
) -> None:
    seeds = [SEED, SEED + 1]
    agent, _ = fleet.start_agents('random')
    world = fleet.start_world(seed=SEED, missions=2, decision_timeout_s=ENOUGH_S)
    fleet.wait_for_events(SEED, 100)
    sleeper, watcher = (agent, world) if name == 'uav_agent' else (world, agent)
    sleeper.send(signal.SIGSTOP)
    watcher.wait_for('is gone')
    sleeper.send(signal.SIGCONT)
    assert world.wait_for_exit() == 0
    assert fleet.logs(seeds) == logs(fleet.scenario, seeds, 'random')


def test_a_uav_whose_agent_stays_away_is_flown_home_and_flies_again_in_the_next_mission(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(fleet__default__energy_budget_kj=150.0)  # some 1000 s, 10 s at 100 to 1
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    _, victim = fleet.start_agents('random')
    with listener(topics.MISSION) as listening:
        world = fleet.start_world(
            seed=SEED, missions=2, decision_timeout_s=2.0, real_time_factor=100.0
        )
        fleet.wait_for_events(SEED, 8)
        victim.kill()
        (decision,) = world.wait_for(r'UAV 2: no answer to decision (\d+).*failsafe').groups()
        victim = fleet.start_agent(2, 'random')
        world.wait_for('UAV 2: .* joined')
        assert 'ended' not in world.output  # it is back before the mission is over
        heard = listening.heard[topics.MISSION.name]
        listening.wait_until(lambda: len(heard) >= 2)
        assert world.wait_for_exit() == 0
    expected = flown_without(scenario, SEED, 'random', uav=1, since=int(decision))
    assert fleet.log(SEED) == expected.to_jsonl()
    assert [fleet.log(SEED + 1)] == logs(scenario, [SEED + 1], 'random')
    result = heard[1]
    assert result.failsafe_used
    assert result.note == 'the failsafe flew home: UAV 2'
    assert [uav.outcome == UavFigures.FAILSAFE for uav in result.uavs] == [False, True]
    warnings = '\n'.join(mission_warnings(mission_metrics(read(fleet.log_file(SEED)))))
    assert 'UAV 2 was flown home by the failsafe: its agent did not answer' in warnings


def test_an_agent_killed_as_it_joins_leaves_its_uav_to_the_next_one(fleet: Fleet) -> None:
    world = fleet.start_world(seed=SEED, decision_timeout_s=ENOUGH_S)
    fleet.start_agent(1, 'random')
    for _ in range(3):  # before it has shown a sign of life, the middleware does not miss it
        victim = fleet.start_agent(2, 'random')
        victim.wait_for('UAV 2 flies')
        victim.kill()
    fleet.start_agent(2, 'random')
    assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == logs(fleet.scenario, [SEED], 'random')[0]


def test_agents_of_a_killed_world_fly_for_the_next_one(fleet: Fleet) -> None:
    expected = logs(fleet.scenario, [SEED, SEED + 1], 'random')
    agents = fleet.start_agents('random')
    world = fleet.start_world(seed=SEED, decision_timeout_s=ENOUGH_S)
    fleet.wait_for_events(SEED, 100)
    world.kill()
    torn = fleet.log(SEED)
    world = fleet.start_world(seed=SEED + 1, decision_timeout_s=ENOUGH_S)
    assert world.wait_for_exit() == 0
    assert all(agent.is_running for agent in agents)
    assert fleet.log(SEED + 1) == expected[1]
    assert expected[0].startswith(torn[: torn.rfind(b'\n') + 1])
    assert 100 <= events_of(torn) < events_of(expected[0])

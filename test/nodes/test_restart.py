"""Agents and worlds that die at any moment: missions go on as if nothing had happened."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
import signal

from fleets import Fleet, flown_without, listener, logs, scenario_of
import numpy as np
from processes import DEADLINE_S, Processes, RunningProcess
import pytest
from steered_world import steered_world, SteeredWorld
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.tables import mission_warnings
from uav_collect.limits import UNUSABLE
from uav_collect.recording.mission_log import read

pytest.importorskip('rclpy')
UavFigures = pytest.importorskip('uav_collect_msgs.msg').UavFigures

from uav_collect.nodes import topics

pytestmark = [pytest.mark.ros, pytest.mark.long]

SEED = 3
ENERGY_KJ = 120.0
FAST = 0.0  # real-time factor: as fast as the fleet decides
HARDLY = 0.001  # the next event would take hours
LEISURELY = 20.0  # a mission takes a minute


@pytest.fixture
def fleet(processes: Processes, tmp_path: Path) -> Fleet:
    """Two UAVs that fly at random for some three hundred events."""
    scenario = scenario_of(fleet__default__energy_budget_kj=ENERGY_KJ)
    return Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')


@pytest.fixture
def steered(ros_domain: int) -> Iterator[SteeredWorld]:
    with steered_world() as there:
        yield there


def events_of(log: bytes) -> int:
    return log.count(b'\n') - 1


def start_paused(
    fleet: Fleet, steered: SteeredWorld, **values: object
) -> tuple[RunningProcess, list[RunningProcess]]:
    """A world that is paused before its mission starts, and agents that fly at random."""
    world = fleet.start_world(seed=SEED, **values)
    steered.pause()
    return world, fleet.start_agents('random')


@pytest.mark.parametrize(
    'victims',
    [
        pytest.param([1], id='one'),
        pytest.param([2, 2, 1], id='one after the other', marks=pytest.mark.nightly),
        pytest.param([(1, 2)], id='both', marks=pytest.mark.nightly),
    ],
)
def test_agents_killed_at_any_event_and_started_again_change_nothing(
    victims: list[int | tuple[int, ...]], fleet: Fleet, steered: SteeredWorld
) -> None:
    (expected,) = logs(fleet.scenario, [SEED], 'random')
    kill_at = np.random.default_rng(len(victims)).integers(1, 200, size=len(victims))
    world, agents = start_paused(fleet, steered)
    for n_events, uavs in zip(np.diff(np.sort(kill_at), prepend=0), victims, strict=True):
        killed = uavs if isinstance(uavs, tuple) else (uavs,)
        steered.step(int(n_events))  # of the last one an agent may still have to answer
        for uav in killed:
            agents[uav - 1].kill()
        for uav in killed:
            agents[uav - 1] = fleet.start_agent(uav, 'random')
        for uav in killed:
            agents[uav - 1].wait_for(f'UAV {uav} flies')
    steered.resume()
    assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == expected


def test_an_agent_killed_before_it_answers_is_asked_again_when_it_is_back(
    fleet: Fleet, steered: SteeredWorld
) -> None:
    (expected,) = logs(fleet.scenario, [SEED], 'random')
    world, (victim, _) = start_paused(fleet, steered)
    steered.step(100)
    fleet.wait_for_events(SEED, 100)
    victim.send(signal.SIGSTOP)
    steered.resume()
    world.wait_for('UAV 1: its agent is gone')
    waiting_at = fleet.n_events(SEED)
    victim.kill()
    fleet.start_agent(1, 'random').wait_for('UAV 1 flies')
    assert 100 <= waiting_at < events_of(expected)
    assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == expected


@pytest.mark.parametrize('name', ['uav_agent', 'world_sim'])
def test_a_node_that_falls_silent_for_a_while_goes_on_where_it_was(
    name: str, fleet: Fleet, steered: SteeredWorld
) -> None:
    seeds = [SEED, SEED + 1]
    world, (agent, _) = start_paused(fleet, steered, missions=2)
    steered.step(100)
    steered.change('real_time_factor', LEISURELY)
    steered.resume()
    sleeper, watcher = (agent, world) if name == 'uav_agent' else (world, agent)
    sleeper.send(signal.SIGSTOP)
    watcher.wait_for('is gone')
    sleeper.send(signal.SIGCONT)
    steered.change('real_time_factor', FAST)
    assert world.wait_for_exit() == 0
    assert fleet.logs(seeds) == logs(fleet.scenario, seeds, 'random')


@pytest.mark.nightly
def test_a_uav_whose_agent_stays_away_is_flown_home_and_flies_again_in_the_next_mission(
    processes: Processes, steered: SteeredWorld, tmp_path: Path
) -> None:
    scenario = scenario_of(fleet__default__energy_budget_kj=150.0)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    with listener(topics.MISSION) as listening:
        world, (_, victim) = start_paused(fleet, steered, missions=2)
        steered.step(8)
        victim.kill()
        steered.step_until('one event more, when UAV 2 has answered')
        steered.change('decision_timeout_s', 0.5)
        steered.change('real_time_factor', HARDLY)  # nobody else is asked meanwhile
        steered.resume()
        (decision,) = world.wait_for(r'UAV 2: no answer to decision (\d+).*failsafe').groups()
        steered.change('decision_timeout_s', DEADLINE_S)
        victim = fleet.start_agent(2, 'random')
        world.wait_for('UAV 2: .* joined')
        assert 'ended' not in world.output  # it is back before the mission is over
        steered.change('real_time_factor', FAST)
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


@pytest.mark.nightly
def test_an_agent_killed_as_it_joins_leaves_its_uav_to_the_next_one(fleet: Fleet) -> None:
    world = fleet.start_world(seed=SEED)
    fleet.start_agent(1, 'random')
    for _ in range(3):  # before it has shown a sign of life, the middleware does not miss it
        victim = fleet.start_agent(2, 'random')
        victim.wait_for('UAV 2 flies')
        victim.kill()
    fleet.start_agent(2, 'random')
    assert world.wait_for_exit() == 0
    assert fleet.log(SEED) == logs(fleet.scenario, [SEED], 'random')[0]


def test_agents_of_a_killed_world_fly_for_the_next_one(
    fleet: Fleet, steered: SteeredWorld
) -> None:
    expected = logs(fleet.scenario, [SEED, SEED + 1], 'random')
    world, agents = start_paused(fleet, steered)
    steered.step(101)
    fleet.wait_for_events(SEED, 100)
    world.kill()
    torn = fleet.log(SEED)
    refused = fleet.start_world(seed=SEED)
    assert refused.wait_for_exit() == UNUSABLE
    assert f'error: output_dir: {fleet.folder} holds logs of missions already' in refused.output
    assert fleet.log(SEED) == torn
    again = replace(fleet, folder=fleet.folder.with_name('again'))
    assert again.start_world(seed=SEED + 1).wait_for_exit() == 0
    assert all(agent.is_running for agent in agents)
    assert again.log(SEED + 1) == expected[1]
    assert expected[0].startswith(torn[: torn.rfind(b'\n') + 1])
    assert 100 <= events_of(torn) < events_of(expected[0])

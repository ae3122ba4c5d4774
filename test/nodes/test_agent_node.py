"""An agent that cannot fly, or go on flying, says why in one line and ends; the world goes on."""

from pathlib import Path

from fleets import Fleet, logs, scenario_of
from packages import without
from processes import Processes
import pytest
from random_policies import header, saved
from uav_collect.limits import UNUSABLE
from uav_collect.scenario.model import Scenario

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

pytestmark = pytest.mark.ros

SEED = 6


@pytest.fixture
def scenario() -> Scenario:
    """One UAV on a short mission."""
    return scenario_of(1, fleet__default__energy_budget_kj=40.0)


def test_an_agent_that_the_world_does_not_let_join_says_why_and_leaves_the_uav_to_another(
    processes: Processes, scenario: Scenario, tmp_path: Path
) -> None:
    policy = saved(tmp_path, 'x' * 201, header(n_uavs=1), seed=1)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    world = fleet.start_world(seed=SEED)
    refused = fleet.start_agent(1, str(policy))
    assert refused.wait_for_exit() == UNUSABLE
    *_, line = refused.output.splitlines()
    assert line.endswith('policy has 201 characters: must have at most 200')
    assert 'Traceback' not in refused.output
    assert 'starts, seed' not in world.output
    fleet.start_agent(1)
    assert world.wait_for_exit() == 0
    assert [fleet.log(SEED)] == logs(scenario, [SEED])


def test_an_agent_without_the_package_that_it_shares_bandwidth_by_says_so(
    processes: Processes, scenario: Scenario, tmp_path: Path
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    path = without(tmp_path, ['cvxpy'], {})['PYTHONPATH']
    flags = ('--id', '1', '--policy', 'sweep', '--bandwidth', 'cvxpy')
    world = fleet.start_world(seed=SEED)
    agent = processes.start('uav_agent', *flags, PYTHONPATH=path)
    assert agent.wait_for_exit() == UNUSABLE
    *_, line = agent.output.splitlines()
    assert line.endswith('cvxpy is missing: pip install cvxpy')
    assert 'Traceback' not in agent.output
    assert 'joined' not in world.output  # it has taken no UAV from others
    fleet.start_agent(1)
    assert world.wait_for_exit() == 0
    assert [fleet.log(SEED)] == logs(scenario, [SEED])

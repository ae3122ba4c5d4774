"""Two fleets in one ROS domain: who is told of one world takes nothing of another one."""

from pathlib import Path
import uuid

from fleets import Fleet, logs, scenario_of
from processes import Processes
import pytest
from uav_collect.limits import UNUSABLE
from uav_collect.recording.bag_reader import read_missions

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

pytestmark = pytest.mark.ros

OTHER, OWN = str(uuid.UUID(int=1)), str(uuid.UUID(int=2))  # they begin alike
SEEDS = {OTHER: 5, OWN: 6}


def fleet_of(processes: Processes, folder: Path) -> Fleet:
    scenario = scenario_of(1, fleet__default__energy_budget_kj=40.0)
    return Fleet(processes=processes, scenario=scenario, folder=folder)


def test_a_fleet_records_its_own_mission_whoever_flew_before(
    processes: Processes, tmp_path: Path
) -> None:
    other, own = (fleet_of(processes, tmp_path / name) for name in ('other', 'own'))
    recorder = own.start_recorder(stop_after_missions=1, world_instance=OWN)
    (agent,) = own.start_agents('random', world_instance=OWN)
    others_agents = other.start_agents(world_instance=OTHER)
    world = other.start_world(seed=SEEDS[OTHER], world_instance=OTHER)
    assert world.wait_for_exit() == 0
    assert agent.wait_for('another world than world_instance names')
    assert recorder.is_running
    assert own.start_world(seed=SEEDS[OWN], world_instance=OWN, recorders=1).wait_for_exit() == 0
    assert recorder.wait_for_exit() == 0
    assert [own.log(SEEDS[OWN])] == logs(own.scenario, [SEEDS[OWN]], 'random')
    assert [other.log(SEEDS[OTHER])] == logs(other.scenario, [SEEDS[OTHER]])
    [recorded] = read_missions(own.bag)
    assert recorded.is_complete
    assert recorded.log.to_jsonl() == own.log(SEEDS[OWN])
    assert all(it.is_running for it in others_agents)


@pytest.mark.parametrize('executable', ['world_sim', 'uav_agent', 'recorder', 'viewer'])
def test_an_instance_that_is_no_uuid_is_refused(executable: str, processes: Processes) -> None:
    flags = ['--id', '1'] if executable == 'uav_agent' else []
    given = ['--ros-args', '-p', 'world_instance:=mine']
    process = processes.start(executable, *flags, *given)
    assert process.wait_for_exit() == UNUSABLE
    assert "world_instance is 'mine': must be a UUID" in process.output

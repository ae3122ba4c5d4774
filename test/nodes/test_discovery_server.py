"""Nodes that a discovery server introduces: plain clients, which cannot ask for the graph."""

from pathlib import Path
import sys

from fleets import Fleet, logs, scenario_of
from processes import Processes
import pytest
from uav_collect.recording.bag_reader import read_missions

pytestmark = pytest.mark.ros

SERVER = Path(__file__).parents[1] / 'helpers' / 'discovery_server_node.py'


def own_port(domain: int) -> int:
    """A port of the test's own domain, which so many participants would have to share."""
    base, domain_gain, n_participants = 7400, 250, 45
    return base + domain_gain * domain + 10 + 2 * n_participants


def test_a_mission_is_flown_and_recorded_by_clients_of_a_discovery_server(
    ros_domain: int, processes: Processes, tmp_path: Path
) -> None:
    port = own_port(ros_domain)
    server = processes.run('server', sys.executable, str(SERVER), str(port))
    server.wait_for('serving')
    clients = Processes(tmp_path, {'ROS_DISCOVERY_SERVER': f'127.0.0.1:{port}'})
    try:
        fleet = Fleet(processes=clients, scenario=scenario_of(), folder=tmp_path / 'run')
        recorder = fleet.start_recorder(stop_after_missions=1)
        fleet.start_agents()
        world = fleet.start_world(recorders=1)
        assert world.wait_for_exit() == 0, clients.outputs()
        assert recorder.wait_for_exit() == 0, recorder.output
    finally:
        clients.close()
    (mission,) = read_missions(fleet.bag)
    assert mission.is_complete
    assert mission.n_radio_messages > 0
    assert [mission.log.to_jsonl()] == logs(fleet.scenario, [0])

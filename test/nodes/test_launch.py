"""The launch file, the parameters it hands out and the view it opens.

`launch` is not to be had from PyPI: without it, what the file asks for is recorded.
"""

import importlib
from pathlib import Path
import re
import sys

from launch_recorder import (
    defaults,
    described_by,
    entities,
    given,
    Made,
    nodes,
    NODES_FILE,
    ROOT,
    started,
)
from processes import Processes
import pytest
from uav_collect.errors import ConfigError
from uav_collect.missions.simulation import Simulation
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site
import yaml

LAUNCH_FILE = ROOT / 'launch' / 'mission.launch.py'
RVIZ_FILE = ROOT / 'config' / 'rviz' / 'mission.rviz'


@pytest.fixture
def description(monkeypatch: pytest.MonkeyPatch) -> Made:
    """What the launch file describes."""
    return described_by(LAUNCH_FILE, monkeypatch)


# The launch file


def test_the_launch_file_declares_its_arguments_with_the_defaults_of_the_nodes(
    description: Made,
) -> None:
    assert defaults(description) == {
        'scenario': 'paper_10x10',
        'seed': '0',
        'missions': '1',
        'real_time_factor': '0.0',
        'policy': 'sweep',
        'bandwidth': 'exact',
        'output_dir': '',
        'rviz': 'false',
    }
    for argument in entities(description, 'DeclareLaunchArgument'):
        assert argument.options['description']


def test_it_starts_executables_that_are_installed(description: Made) -> None:
    installed = set(re.findall(r"'(\w+) = uav_collect", (ROOT / 'setup.py').read_text()))
    own = {
        node.options['executable']
        for node in started(description)
        if node.kind == 'Node' and node.options['package'] == 'uav_collect'
    }
    assert own == {'world_sim', 'uav_agent', 'recorder'}
    assert own <= installed


@pytest.mark.parametrize(('scenario', 'n_uavs'), [('paper_10x10', 2), ('four', 4)])
def test_it_starts_one_agent_per_uav_of_the_scenario(
    description: Made, scenario: str, n_uavs: int, tmp_path: Path
) -> None:
    four = tmp_path / 'four.yaml'
    base = ROOT / 'config' / 'scenarios' / 'paper_10x10.yaml'
    fleet = 'fleet:\n  uavs:\n' + '    - speed_mps: 5.0\n' * 4
    four.write_text(f'extends: {base}\n{fleet}')
    chosen = str(four) if scenario == 'four' else scenario
    agents = nodes(description, 'uav_agent', scenario=chosen)
    ids = [agent.options['arguments'] for agent in agents]
    assert ids == [['--id', str(number)] for number in range(1, n_uavs + 1)]


def test_a_scenario_that_is_not_there_is_named(description: Made) -> None:
    with pytest.raises(ConfigError, match='no_such'):
        started(description, scenario='no_such')


def test_every_node_gets_the_shipped_parameters_and_then_what_was_chosen(
    description: Made,
) -> None:
    for executable in ('world_sim', 'uav_agent', 'recorder'):
        for node in nodes(description, executable):
            shipped, chosen = node.options['parameters']
            assert Path(shipped) == NODES_FILE
            assert isinstance(chosen, dict)


def test_arguments_reach_the_nodes_that_they_are_for_in_their_type(description: Made) -> None:
    (world,) = nodes(description, 'world_sim')
    assert given(world, 'scenario') == ('scenario', str)
    assert given(world, 'seed') == ('seed', int)
    assert given(world, 'missions') == ('missions', int)
    assert given(world, 'real_time_factor') == ('real_time_factor', float)
    for agent in nodes(description, 'uav_agent'):
        assert given(agent, 'policy') == ('policy', str)
        assert given(agent, 'bandwidth') == ('bandwidth', str)


def test_bag_and_logs_go_to_one_folder(description: Made, tmp_path: Path) -> None:
    folder = str(tmp_path / '2024')
    (world,) = nodes(description, 'world_sim', output_dir=folder)
    (recorder,) = nodes(description, 'recorder', output_dir=folder)
    assert given(world, 'output_dir') == (folder, str)
    assert given(recorder, 'output_dir') == (f'{folder}/bag', str)
    (recorder,) = nodes(description, 'recorder')
    assert given(recorder, 'output_dir') == ('', str)


def test_rviz_starts_on_request_with_the_shipped_view(description: Made) -> None:
    (rviz,) = nodes(description, 'rviz2')
    assert rviz.options['condition'].kind == 'IfCondition'
    assert rviz.options['condition'].args[0].args == ('rviz',)
    assert [Path(argument) for argument in rviz.options['arguments']] == [Path('-d'), RVIZ_FILE]


def test_the_end_of_the_world_ends_all(description: Made) -> None:
    parts = started(description)
    (world,) = (part for part in parts if part.options.get('executable') == 'world_sim')
    (handler,) = (part.args[0] for part in parts if part.kind == 'RegisterEventHandler')
    assert handler.kind == 'OnProcessExit'
    assert handler.options['target_action'] is world
    assert [action.options['event'].kind for action in handler.options['on_exit']] == ['Shutdown']


@pytest.mark.ros
def test_launch_flies_a_mission_and_leaves_nothing_behind(
    processes: Processes, tmp_path: Path
) -> None:
    pytest.importorskip('launch_ros', reason='launch is part of a ROS distribution')
    arguments = {'seed': '7', 'policy': 'hert', 'output_dir': str(tmp_path / 'run')}
    script = f"""
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
included = IncludeLaunchDescription({str(LAUNCH_FILE)!r}, launch_arguments={arguments}.items())
service = LaunchService()
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""
    launched = processes.run('launch', sys.executable, '-c', script)
    assert launched.wait_for_exit() == 0
    assert processes.survivors() == []
    assert (tmp_path / 'run' / 'mission_7.jsonl').stat().st_size > 0
    assert (tmp_path / 'run' / 'bag' / 'metadata.yaml').is_file()


# The parameters


@pytest.mark.parametrize(
    ('node', 'module_name'),
    [
        ('world_sim', 'world.settings'),
        ('uav_agent', 'agent.node'),
        ('recorder', 'recorder.node'),
        ('trainer', 'trainer.settings'),
    ],
)
def test_the_shipped_parameters_are_those_of_the_node_at_their_defaults(
    node: str, module_name: str
) -> None:
    pytest.importorskip('rclpy')
    module = importlib.import_module(f'uav_collect.nodes.{module_name}')
    shipped = {
        key.rpartition('/')[2]: section['ros__parameters']
        for key, section in yaml.safe_load(NODES_FILE.read_text()).items()
    }[node]
    declared = {parameter.name: parameter.default for parameter in module.PARAMETERS}
    declared.pop('uav', None)  # an agent's id is its own
    assert shipped == declared
    assert {name: type(value) for name, value in shipped.items()} == {
        name: type(value) for name, value in declared.items()
    }


# The view


def displays() -> dict[str, dict]:
    view = yaml.safe_load(RVIZ_FILE.read_text())['Visualization Manager']
    return {display['Class'].rpartition('/')[2]: display for display in view['Displays']}


@pytest.mark.parametrize(
    ('display', 'name'), [('MarkerArray', 'MARKERS'), ('Map', 'COMPLETED_CELLS')]
)
def test_rviz_shows_the_topics_of_the_world_as_they_are_published(display: str, name: str) -> None:
    pytest.importorskip('rclpy')
    topics = importlib.import_module('uav_collect.nodes.topics')
    topic, shown = getattr(topics, name), displays()[display]['Topic']
    assert displays()[display]['Enabled'] is True
    assert shown['Value'] == topic.name
    assert shown['Durability Policy'].replace(' ', '_').upper() == topic.qos.durability.name
    assert shown['Reliability Policy'].upper() == topic.qos.reliability.name


def test_rviz_can_switch_every_kind_of_marker() -> None:
    pytest.importorskip('rclpy')
    viewers = importlib.import_module('uav_collect.nodes.world.markers')
    site = build_site(load('paper_8x8'))
    drawn = viewers.MissionMarkers(site)
    drawn.begin(Simulation(site, 0))
    markers = drawn.markers(0.0, viewers.Header().stamp).markers[1:]
    namespaces = displays()['MarkerArray']['Namespaces']
    assert set(namespaces) == {marker.ns for marker in markers}
    assert all(namespaces.values())


def test_rviz_looks_down_on_the_middle_of_the_default_area() -> None:
    view = yaml.safe_load(RVIZ_FILE.read_text())
    manager, window = view['Visualization Manager'], view['Window Geometry']
    camera = manager['Views']['Current']
    assert manager['Global Options']['Fixed Frame'] == 'map'
    assert camera['Class'] == 'rviz_default_plugins/TopDownOrtho'
    assert (camera['X'], camera['Y'], camera['Angle']) == (250, 250, 0)
    assert 500 * camera['Scale'] < min(window['Height'], window['Width'])

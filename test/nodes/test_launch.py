"""The launch file, the parameters it hands out and the view it opens.

`launch` is not to be had from PyPI: without it, what the file asks for is recorded.
"""

import importlib
import os
from pathlib import Path
import re
import signal
import sys
from types import SimpleNamespace

from launch_recorder import (
    defaults,
    described_by,
    ended,
    entities,
    exit_handler,
    given,
    Made,
    nodes,
    NODES_FILE,
    ROOT,
    started,
)
from processes import Processes, RunningProcess, wait_until
import pytest
from tiny_world import tiny, uav
from uav_collect.analysis.choice_file import read_choice
from uav_collect.errors import ConfigError, FleetError
from uav_collect.missions.simulation import Simulation
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site
import yaml

pytest.importorskip('rclpy')

from uav_collect.nodes import launching

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
        'candidates': '',
        'bandwidth': 'exact',
        'guard_after': '12',
        'output_dir': '',
        'rviz': 'false',
        'view': 'false',
    }
    for argument in entities(description, 'DeclareLaunchArgument'):
        assert argument.options['description']


def test_it_starts_executables_that_are_installed(description: Made) -> None:
    [nodes_of_setup] = re.findall(
        r'^NODES = \((.*)\)$', (ROOT / 'setup.py').read_text(), re.MULTILINE
    )
    installed = set(re.findall(r"'(\w+)'", nodes_of_setup))
    own = {
        node.options['executable']
        for node in started(description)
        if node.kind == 'Node' and node.options['package'] == 'uav_collect'
    }
    assert own == {'world_sim', 'uav_agent', 'recorder'}
    assert own <= installed


def test_a_page_shows_the_mission_on_request(description: Made) -> None:
    assert nodes(description, 'viewer') == []
    assert len(nodes(description, 'viewer', view='true')) == 1


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
    assert given(world, 'scenario') == ('paper_10x10', str)
    assert given(world, 'seed') == (0, int)
    assert given(world, 'missions') == (1, int)
    assert given(world, 'real_time_factor') == (0.0, float)
    assert given(world, 'recorders') == (1, int)
    for agent in nodes(
        description, 'uav_agent', policy='hert', bandwidth='equal', guard_after='0'
    ):
        assert given(agent, 'policy') == ('hert', str)
        assert given(agent, 'bandwidth') == ('equal', str)
        assert given(agent, 'guard_after') == (0, int)


def test_the_best_policy_is_chosen_once_and_named_to_all_agents(
    description: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('UAV_COLLECT_KERNELS', 'interpreted')
    small, run = tmp_path / 'small.yaml', tmp_path / 'run'
    small.write_text(tiny(uav(), uav(10.0)).to_yaml())
    wanted = {'policy': 'best', 'candidates': 'random,hert-equal', 'output_dir': str(run)}
    made = started(description, scenario=str(small), **wanted)
    of = {node.options['executable']: node for node in made if node.kind == 'Node'}
    choice = read_choice(run)
    assert choice is not None
    assert [it.policy for it in choice.tried] == ['sweep', 'hert', 'random', 'hert-equal']
    assert given(of['uav_agent'], 'policy') == (choice.policy, str)
    assert given(of['uav_agent'], 'candidates') == ('', str)
    assert given(of['recorder'], 'choice') == (choice.why, str)


def test_candidates_without_a_choice_are_refused(description: Made) -> None:
    with pytest.raises(ConfigError, match='candidates:=random: must come with policy:=best'):
        started(description, candidates='random')


def test_all_nodes_take_the_mission_of_the_world_that_is_started_with_them(
    description: Made,
) -> None:
    made = started(description, view='true')
    own = {
        dict(node.options['parameters'][1])['world_instance'].args[0]
        for node in made
        if node.kind == 'Node'
    }
    assert len(own) == 1


def test_bag_and_logs_go_to_one_folder(description: Made, tmp_path: Path) -> None:
    folder = str(tmp_path / '2024')
    (world,) = nodes(description, 'world_sim', output_dir=folder)
    (recorder,) = nodes(description, 'recorder', output_dir=folder)
    assert given(world, 'output_dir') == (folder, str)
    assert given(recorder, 'output_dir') == (f'{folder}/bag', str)
    (recorder,) = nodes(description, 'recorder')
    assert given(recorder, 'output_dir') == ('', str)


def test_rviz_starts_on_request_with_the_shipped_view(
    description: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert nodes(description, 'rviz2') == []
    monkeypatch.setattr(launching, 'get_package_prefix', lambda package: package)
    (rviz,) = nodes(description, 'rviz2', rviz='true')
    assert [Path(argument) for argument in rviz.options['arguments']] == [Path('-d'), RVIZ_FILE]


def test_the_end_of_the_world_ends_all_and_so_does_a_failure_of_any(description: Made) -> None:
    parts = started(description)
    on_exit, running = exit_handler(parts), SimpleNamespace(is_shutdown=False)
    recorder, world, *agents = (part for part in parts if part.kind == 'Node')
    assert world.options['executable'] == 'world_sim'
    (end,) = on_exit(ended(world, 0), running)
    assert end.options['event'].kind == 'Shutdown'
    for node in (recorder, *agents):
        assert on_exit(ended(node, 0), running) == []
    for node in (recorder, world, *agents):
        with pytest.raises(FleetError, match='it-1 failed with exit status 2'):
            on_exit(ended(node, 2), running)


@pytest.mark.parametrize('status', [-signal.SIGINT, -signal.SIGTERM])
def test_who_is_asked_to_end_may_do_so_by_the_signal(description: Made, status: int) -> None:
    parts = started(description)
    on_exit, ending = exit_handler(parts), SimpleNamespace(is_shutdown=True)
    assert on_exit(ended(parts[1], status), ending) == []
    with pytest.raises(FleetError):  # such as a recorder whose bag lacks something
        on_exit(ended(parts[1], 1), ending)


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('policy', 'nope', "policy 'nope' is unknown"),
        ('bandwidth', 'x', "allocator 'x' is unknown"),
        ('seed', 'abc', 'must be a whole number from 0'),
        ('seed', '-1', 'must be a whole number from 0'),
        ('guard_after', '10001', 'must be a whole number from 0 to 10,000'),
        ('missions', '1.5', 'must be a whole number from -1 to 1,000,000'),
        ('real_time_factor', 'nan', 'must be a number from 0.0 to 1,000.0'),
        ('real_time_factor', '1e9', 'must be a number from 0.0 to 1,000.0'),
        ('rviz', 'maybe', 'must be true or false'),
        ('view', 'yes', 'must be true or false'),
        ('rviz', 'true', 'the package rviz2 is not installed'),
    ],
)
def test_a_wrong_argument_is_named_before_anything_starts(
    description: Made, name: str, text: str, words: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    with pytest.raises(ConfigError) as refused:
        started(description, **{name: text})
    assert str(refused.value).startswith(f'{name}:={text}: ')
    assert words in str(refused.value)


def test_all_that_is_wrong_is_named_at_once(description: Made, tmp_path: Path) -> None:
    (tmp_path / 'bag').mkdir()
    with pytest.raises(ConfigError) as refused:
        started(description, seed='abc', scenario='no_such', output_dir=str(tmp_path))
    seed, scenario, folder = str(refused.value).split('; ')
    assert seed.startswith('seed:=abc')
    assert scenario.startswith('scenario:=no_such')
    assert folder.endswith(f'{tmp_path}/bag exists already')


def test_a_folder_with_logs_of_another_world_is_refused_before_anything_starts(
    description: Made, tmp_path: Path
) -> None:
    (tmp_path / 'mission_3.jsonl').touch()
    with pytest.raises(ConfigError, match='holds logs of missions already'):
        started(description, output_dir=str(tmp_path))


LAUNCH = f"""
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
given = [argument.split(':=') for argument in sys.argv[1:]]
included = IncludeLaunchDescription({str(LAUNCH_FILE)!r}, launch_arguments=given)
service = LaunchService()
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""


def launch(processes: Processes, **arguments: object) -> RunningProcess:
    pytest.importorskip('launch_ros', reason='launch is part of a ROS distribution')
    given = [f'{name}:={value}' for name, value in arguments.items()]
    return processes.run('launch', sys.executable, '-c', LAUNCH, *given)


@pytest.mark.ros
def test_launch_starts_nothing_with_a_wrong_argument(processes: Processes) -> None:
    launched = launch(processes, seed='abc')
    assert launched.wait_for_exit() == 1
    assert 'process started' not in launched.output
    assert processes.survivors() == []


@pytest.mark.ros
def test_launch_passes_on_that_a_node_has_failed(processes: Processes, tmp_path: Path) -> None:
    folder = tmp_path / 'run'
    launched = launch(processes, real_time_factor=20.0, output_dir=folder)
    log = folder / 'mission_0.jsonl'
    wait_until(log.exists)
    (pid,) = re.findall(r'uav_agent-3\]: process started with pid \[(\d+)\]', launched.output)
    os.kill(int(pid), signal.SIGKILL)
    assert launched.wait_for_exit() == 1
    assert 'uav_agent-3 failed with exit status -9' in launched.output
    assert processes.survivors() == []
    assert (folder / 'bag' / 'metadata.yaml').is_file()


@pytest.mark.ros
def test_launch_that_is_interrupted_leaves_a_closed_bag(
    processes: Processes, tmp_path: Path
) -> None:
    folder = tmp_path / 'run'
    launched = launch(processes, real_time_factor=20.0, output_dir=folder)
    wait_until((folder / 'mission_0.jsonl').exists)
    os.killpg(launched.pid, signal.SIGINT)  # as a terminal does
    launched.wait_for_exit()
    assert processes.survivors() == []
    assert (folder / 'bag' / 'metadata.yaml').is_file()
    assert 'failed' not in launched.output


@pytest.mark.ros
def test_launch_flies_a_mission_and_leaves_nothing_behind(
    processes: Processes, tmp_path: Path
) -> None:
    launched = launch(processes, seed=7, policy='hert', output_dir=tmp_path / 'run')
    assert launched.wait_for_exit() == 0
    assert processes.survivors() == []
    assert (tmp_path / 'run' / 'mission_7.jsonl').stat().st_size > 0
    assert (tmp_path / 'run' / 'bag' / 'metadata.yaml').is_file()


# The parameters


@pytest.mark.parametrize(
    ('node', 'module_name'),
    [
        ('world_sim', 'world.settings'),
        ('uav_agent', 'agent.settings'),
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

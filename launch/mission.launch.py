"""Flies a mission: the world, one agent per UAV of its scenario, the recorder, RViz on request.

ros2 launch uav_collect mission.launch.py scenario:=lillgrund policy:=hert seed:=7 rviz:=true

All end when the world does, which is after its last mission.
"""

from pathlib import Path

from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from uav_collect.scenario.load import load
import yaml

from launch import LaunchContext, LaunchDescription

_CONFIG = Path(__file__).absolute().parent.parent / 'config'
_NODES = _CONFIG / 'nodes.yaml'  # all other parameters, and the defaults of those below

# Launch arguments: of which node, with defaults in nodes.yaml; the type; what each does.
_ARGUMENTS = {
    'scenario': ('world_sim', str, 'name of a shipped scenario, or path of a YAML file'),
    'seed': ('world_sim', int, 'mission seed; each further mission adds 1'),
    'missions': ('world_sim', int, 'missions to fly in a row'),
    'real_time_factor': (
        'world_sim',
        float,
        'simulated over wall-clock time; 0: as fast as the fleet decides',
    ),
    'policy': (
        'uav_agent',
        str,
        'what decides: hert, hert-equal, sweep, random, a learned policy or its file, '
        'module:name or strong',
    ),
    'bandwidth': ('uav_agent', str, 'how bandwidth is shared: exact, equal or cvxpy'),
}
_OUTPUT_HELP = 'folder for the bag and the mission logs; empty: a bag named by the time, no logs'


def generate_launch_description() -> LaunchDescription:
    nodes = yaml.safe_load(_NODES.read_text())
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value=str(nodes[f'/**/{owner}']['ros__parameters'][name]),
            description=description,
        )
        for name, (owner, _, description) in _ARGUMENTS.items()
    ]
    return LaunchDescription(
        [
            *arguments,
            DeclareLaunchArgument('output_dir', default_value='', description=_OUTPUT_HELP),
            DeclareLaunchArgument(
                'rviz', default_value='false', description='true: show the mission in RViz'
            ),
            OpaqueFunction(function=_start),
        ]
    )


def _start(context: LaunchContext) -> list:
    """Start what the arguments ask for; the recorder and the agents may come before the world."""
    output_dir = LaunchConfiguration('output_dir').perform(context)
    scenario = load(LaunchConfiguration('scenario').perform(context))
    world = _node('world_sim', {**_chosen('world_sim'), 'output_dir': _text(output_dir)})
    bag = str(Path(output_dir) / 'bag') if output_dir else ''
    return [
        _node('recorder', {'output_dir': _text(bag)}),
        world,
        *(_agent(number) for number in range(1, scenario.n_uavs + 1)),
        Node(
            package='rviz2',
            executable='rviz2',
            arguments=['-d', str(_CONFIG / 'rviz' / 'mission.rviz')],
            parameters=[{'use_sim_time': True}],
            condition=IfCondition(LaunchConfiguration('rviz')),
        ),
        RegisterEventHandler(
            OnProcessExit(
                target_action=world,
                on_exit=[EmitEvent(event=Shutdown(reason='the world has ended'))],
            )
        ),
    ]


def _agent(number: int) -> Node:
    """The agent of one UAV; it names its namespace itself."""
    return _node('uav_agent', _chosen('uav_agent'), arguments=['--id', str(number)])


def _node(executable: str, parameters: dict, **options) -> Node:
    return Node(
        package='uav_collect',
        executable=executable,
        output='screen',
        parameters=[str(_NODES), parameters],  # the later ones count
        **options,
    )


def _chosen(owner: str) -> dict:
    """The parameters of a node that are launch arguments, each of its type."""
    return {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (node, kind, _) in _ARGUMENTS.items()
        if node == owner
    }


def _text(value: str) -> ParameterValue:
    """A string parameter, which stays one even if it reads like a number."""
    return ParameterValue(value, value_type=str)

"""Flies a mission: the world, one agent per UAV, the recorder; a page or RViz on request.

ros2 launch uav_collect mission.launch.py scenario:=lillgrund policy:=hert seed:=7 rviz:=true

All end when the world does, which is after its last mission, or when any of them fails; `ros2
launch` then returns 1. Wrong arguments are refused before anything starts.
"""

import os
from pathlib import Path
import uuid

from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from uav_collect.analysis.choice_file import keep_choice
from uav_collect.commands.choice_process import ChoiceRequest, started_choice
from uav_collect.kernels.patience import say
from uav_collect.limits import BEST
from uav_collect.nodes.agent import settings as agent
from uav_collect.nodes.launching import ending_with, LaunchArguments, node_options, parameter_of
from uav_collect.nodes.world import settings as world
from uav_collect.recording.mission_folder import BAG_FOLDER, check_without_logs
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.uav.agent import allocator_named
from uav_collect.uav.own_policy import own_policies
from uav_collect.uav.policy import policy_for, TOPIC
import yaml

from launch import LaunchContext, LaunchDescription

_CONFIG = Path(__file__).absolute().parent.parent / 'config'
_NODES = _CONFIG / 'nodes.yaml'  # all other parameters, and the defaults of those below

# Launch arguments that are parameters of the world, with defaults in nodes.yaml; what each does.
_OF_WORLD = {
    'scenario': 'name of a shipped scenario, or path of a YAML file',
    'seed': 'mission seed; each further mission adds 1',
    'missions': 'missions to fly in a row',
    'real_time_factor': 'simulated over wall-clock time; 0: as fast as the fleet decides',
}
_OF_AGENTS = {
    'policy': 'what decides: hert, hert-equal, sweep, random, a learned policy or its file, '
    'module:name, lookahead:RULE, strong or best',
    'candidates': 'policies, separated by commas, among which best is chosen besides those '
    'shipped for the scenario or refined for it, sweep and hert',
    'bandwidth': 'how bandwidth is shared: exact, equal or cvxpy',
    'guard_after': 'decisions without news after which a guard takes over from a learned policy '
    'or a function; 0: never',
}
_OTHERS = {
    'output_dir': ('', 'folder for bag and mission logs; empty: a bag named by the time, no logs'),
    'rviz': ('false', 'true: show the mission in RViz'),
    'view': ('false', 'true: show the mission in a browser; the viewer says where'),
}


def generate_launch_description() -> LaunchDescription:
    nodes = yaml.safe_load(_NODES.read_text())
    known = {}
    for owner, arguments in (('world_sim', _OF_WORLD), ('uav_agent', _OF_AGENTS)):
        defaults = nodes[f'/**/{owner}']['ros__parameters']
        known |= {name: (str(defaults[name]), what) for name, what in arguments.items()}
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=what)
        for name, (default, what) in {**known, **_OTHERS}.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    """Start what the arguments ask for; the recorder and the agents may come before the world."""
    names = (*_OF_WORLD, *_OF_AGENTS, *_OTHERS)
    arguments = LaunchArguments({n: LaunchConfiguration(n).perform(context) for n in names})
    of_world = {n: arguments.value(parameter_of(world.PARAMETERS, n)) for n in _OF_WORLD}
    of_agents = {n: arguments.value(parameter_of(agent.PARAMETERS, n)) for n in _OF_AGENTS}
    output_dir = arguments['output_dir']
    bag = str(Path(output_dir) / BAG_FOLDER) if output_dir else ''
    scenario = arguments.made('scenario', lambda: load(of_world['scenario']))
    is_best = of_agents['policy'] == BEST
    if scenario is not None and of_agents['policy'] not in (BEST, TOPIC):
        arguments.made('policy', lambda: policy_for(of_agents['policy'], scenario))
    if of_agents['candidates'] and not is_best:
        arguments.refuse('candidates', f'must come with policy:={BEST}')
    arguments.made('bandwidth', lambda: allocator_named(of_agents['bandwidth']))
    if bag:
        arguments.new_folder('output_dir', Path(bag))
        arguments.made('output_dir', lambda: check_without_logs(Path(output_dir)))
    has_rviz, has_viewer = arguments.flag('rviz'), arguments.flag('view')
    if has_rviz:
        arguments.package('rviz', 'rviz2')
    arguments.check()
    choice = _choice(of_world['scenario'], scenario, of_agents, output_dir) if is_best else ''
    own = {'world_instance': str(uuid.uuid4())}  # who else is in the ROS domain counts for nobody
    where = {'output_dir': output_dir, 'recorders': 1}
    world_node = _node('world_sim', {**of_world, **where, **own})
    end = EmitEvent(event=Shutdown(reason='the world has ended'))
    return [
        RegisterEventHandler(OnProcessExit(on_exit=ending_with(world_node, end))),
        _node('recorder', {'output_dir': bag, 'choice': choice, **own}),
        world_node,
        *(
            _node('uav_agent', {**of_agents, **own}, arguments=['--id', str(number)])
            for number in range(1, scenario.n_uavs + 1)
        ),
        *([_rviz()] if has_rviz else []),
        *([_node('viewer', own)] if has_viewer else []),
    ]


def _choice(name: str, scenario: Scenario, of_agents: dict, output_dir: str) -> str:
    """Let the best policy fly, chosen once for all agents; why that one, in a line."""
    request = ChoiceRequest(
        scenario=scenario.to_yaml(),
        candidates=of_agents['candidates'],
        allocator=of_agents['bandwidth'],
        guard_after=of_agents['guard_after'],
        own=tuple(own_policies(name, scenario.n_uavs)),
    )
    with started_choice(request, os.environ) as answer:
        choice, left_out = answer()
    of_agents |= {'policy': choice.policy, 'candidates': ''}
    for line in (*left_out, str(choice)):
        say(line)
    if output_dir:
        keep_choice(choice, Path(output_dir))
    return choice.why


def _rviz() -> Node:
    return Node(
        package='rviz2',
        executable='rviz2',
        arguments=['-d', str(_CONFIG / 'rviz' / 'mission.rviz')],
        parameters=[{'use_sim_time': True}],
    )


def _node(executable: str, parameters: dict, **options: list[str]) -> Node:
    return Node(**node_options(executable, parameters, _NODES, ParameterValue), **options)

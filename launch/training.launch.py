"""Lets a fleet learn while it flies: worlds, the agents of their UAVs, the trainer, recorders.

ros2 launch uav_collect training.launch.py scenario:=paper_8x8 worlds:=2 minutes:=60.0 \
    output_dir:=runs/learned

All end when the trainer does, which is after so many minutes, or when any of them fails; `ros2
launch` then returns 1. Wrong arguments are refused before anything starts. Started again with the
same folder, it goes on.
"""

from pathlib import Path

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
from uav_collect.commands.train_fleet import MAX_WORLDS, unused_folder, world_names
from uav_collect.limits import RECORDED
from uav_collect.nodes.launching import ending_with, LaunchArguments, node_options, parameter_of
from uav_collect.nodes.parameters import Parameter
from uav_collect.nodes.trainer.settings import PARAMETERS
from uav_collect.scenario.load import load
from uav_collect.training.config import load_preset
from uav_collect.training.plug_ins import check_fleet_algorithm
from uav_collect.training.seeds import next_training_seed
import yaml

from launch import LaunchContext, LaunchDescription

_NODES = Path(__file__).absolute().parent.parent / 'config' / 'nodes.yaml'
_SAVE_S = '120'  # how long the trainer may take to save before it is killed

# Launch arguments that are the trainer's parameters, with defaults in nodes.yaml; what each does.
_OF_TRAINER = {
    'scenario': 'name of a shipped scenario, or path of a YAML file',
    'algorithm': 'how it learns: aqmix, aiql, or module:Name of a class of yours',
    'preset': 'settings of the training: paper, strong, refine or a YAML file',
    'seed': 'of weights and missions',
    'minutes': 'how long to train [min]; 0: 60',
    'output_dir': 'folder of the run, needed; one that holds the same run is continued',
}
_WORLDS = Parameter(
    name='worlds',
    default=1,
    description='worlds to fly in at once, each with a fleet of its own',
    low=1,
    high=MAX_WORLDS,
)
_OTHERS = {
    'worlds': ('1', _WORLDS.description),
    'record': (
        'false',
        'true: keep every message, in a bag for each world beside the folder; learning: keep what'
        ' trainer --from-bag needs',
    ),
}
# What the recorder keeps, by the argument.
_RECORDED = {'false': None, 'true': RECORDED[0], RECORDED[1]: RECORDED[1]}


def generate_launch_description() -> LaunchDescription:
    defaults = yaml.safe_load(_NODES.read_text())['/**/trainer']['ros__parameters']
    known = {name: (str(defaults[name]), what) for name, what in _OF_TRAINER.items()}
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=what)
        for name, (default, what) in {**known, **_OTHERS}.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    """Start what the arguments ask for; whatever comes first waits for the others."""
    names = (*_OF_TRAINER, *_OTHERS)
    arguments = LaunchArguments({n: LaunchConfiguration(n).perform(context) for n in names})
    of_trainer = {n: arguments.value(parameter_of(PARAMETERS, n)) for n in _OF_TRAINER}
    arguments.made('algorithm', lambda: check_fleet_algorithm(of_trainer['algorithm']))
    arguments.needed('output_dir')
    scenario = arguments.made('scenario', lambda: load(of_trainer['scenario']))
    config = arguments.made('preset', lambda: load_preset(of_trainer['preset']))
    worlds = world_names(arguments.value(_WORLDS))
    arguments.one_of('record', _RECORDED)
    arguments.check()
    recorded = _RECORDED[arguments['record']]
    world = {
        'scenario': of_trainer['scenario'],
        'missions': -1,
        'max_decisions': config.max_decisions(scenario.n_cells),
        'viewer_rate_hz': 0.0,
        'sample_rate_hz': 0.0,
        'recorders': int(recorded is not None),
    }
    agent = {'policy': 'topic', 'bandwidth': config.rollout.bandwidth}
    folder, nodes = Path(of_trainer['output_dir']), []
    for number, name in enumerate(worlds):
        named = ['--world', name] if name else []
        # Missions that no earlier launch of the run has flown.
        seed = next_training_seed(folder, of_trainer['seed'], number)
        nodes.append(_node('world_sim', {**world, 'seed': seed}, named))
        for uav in range(1, scenario.n_uavs + 1):
            nodes.append(_node('uav_agent', agent, [*named, '--id', str(uav)]))
        if recorded is not None:
            bag = unused_folder(Path(f'{folder}_bag{name and "_"}{name}'))
            nodes.append(_node('recorder', {'output_dir': str(bag), 'topics': recorded}, named))
    trainer = _node('trainer', {**of_trainer, 'worlds': worlds}, [], sigterm_timeout=_SAVE_S)
    end = EmitEvent(event=Shutdown(reason='the trainer has ended'))
    handler = RegisterEventHandler(OnProcessExit(on_exit=ending_with(trainer, end)))
    return [handler, *nodes, trainer]


def _node(executable: str, parameters: dict, arguments: list[str], **options: str) -> Node:
    made = node_options(executable, parameters, _NODES, ParameterValue)
    return Node(**made, arguments=arguments, **options)

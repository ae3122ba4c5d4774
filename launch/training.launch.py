"""Lets a fleet learn while it flies: worlds, the agents of their UAVs, the trainer, recorders.

ros2 launch uav_collect training.launch.py scenario:=paper_8x8 worlds:=2 minutes:=60.0 \
    output_dir:=runs/learned

All end when the trainer does, which is after so many minutes. Started again with the same folder,
it goes on.
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
from uav_collect.commands.train_fleet import unused_folder, world_names
from uav_collect.scenario.load import load
from uav_collect.training.config import load_preset
from uav_collect.training.seeds import first_training_seed, next_training_seed
import yaml

from launch import LaunchContext, LaunchDescription

_NODES = Path(__file__).absolute().parent.parent / 'config' / 'nodes.yaml'
_SAVE_S = '120'  # how long the trainer may take to save before it is killed

# Launch arguments that are the trainer's parameters, with defaults in nodes.yaml; the type; what
# each does.
_ARGUMENTS = {
    'scenario': (str, 'name of a shipped scenario, or path of a YAML file'),
    'algorithm': (str, 'how it learns: aqmix or aiql'),
    'preset': (str, 'settings of the training: paper, strong, refine or a YAML file'),
    'seed': (int, 'of weights and missions'),
    'minutes': (float, 'how long to train [min]; 0: 60'),
}
_OTHERS = {
    'output_dir': ('', 'folder of the run, needed; one that holds the same run is gone on with'),
    'worlds': ('1', 'worlds to fly in at once, each with a fleet of its own'),
    'record': ('false', 'true: keep every message, in a bag for each world beside the folder'),
}


def generate_launch_description() -> LaunchDescription:
    defaults = yaml.safe_load(_NODES.read_text())['/**/trainer']['ros__parameters']
    known = {name: (str(defaults[name]), what) for name, (_, what) in _ARGUMENTS.items()} | _OTHERS
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=what)
        for name, (default, what) in known.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    """Start what the arguments ask for; whatever comes first waits for the others."""

    def chosen(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    scenario, config = load(chosen('scenario')), load_preset(chosen('preset'))
    names = world_names(int(chosen('worlds')))
    world = {
        'scenario': _text(chosen('scenario')),
        'missions': -1,
        'max_decisions': config.max_decisions(scenario.n_cells),
        'viewer_rate_hz': 0.0,
    }
    agent = {'policy': 'topic', 'bandwidth': config.rollout.bandwidth}
    nodes = []
    for number, name in enumerate(names):
        named = ['--world', name] if name else []
        seed = _next_seed(chosen('output_dir'), int(chosen('seed')), number)
        nodes.append(_node('world_sim', {**world, 'seed': seed}, named))
        for uav in range(1, scenario.n_uavs + 1):
            nodes.append(_node('uav_agent', agent, [*named, '--id', str(uav)]))
        if chosen('record') == 'true':
            bag = unused_folder(Path(f'{chosen("output_dir")}_bag{name and "_"}{name}'))
            nodes.append(_node('recorder', {'output_dir': _text(str(bag))}, named))
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (kind, _) in _ARGUMENTS.items()
    }
    values = {**given, 'worlds': names, 'output_dir': _text(chosen('output_dir'))}
    trainer = _node('trainer', values, [], sigterm_timeout=_SAVE_S)
    is_over = EmitEvent(event=Shutdown(reason='the trainer has ended'))
    handler = OnProcessExit(target_action=trainer, on_exit=[is_over])
    return [*nodes, trainer, RegisterEventHandler(handler)]


def _next_seed(output_dir: str, seed: int, world: int) -> int:
    """Missions that no earlier launch of the run has flown; the trainer refuses one without."""
    if not output_dir:
        return first_training_seed(seed, world)
    return next_training_seed(Path(output_dir), seed, world)


def _node(executable: str, parameters: dict, arguments: list[str], **options: str) -> Node:
    return Node(
        package='uav_collect',
        executable=executable,
        output='screen',
        parameters=[str(_NODES), parameters],  # the later ones count
        arguments=arguments,
        **options,
    )


def _text(value: str) -> ParameterValue:
    """A string parameter, which stays one even if it reads like a number."""
    return ParameterValue(value, value_type=str)

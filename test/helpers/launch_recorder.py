"""Takes the place of `launch`, which is not to be had from PyPI: records what a file asks for."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
import runpy
import sys
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).parents[2]
NODES_FILE = ROOT / 'config' / 'nodes.yaml'
LAUNCH_MODULES = (
    *('launch', 'launch.actions', 'launch.event_handlers', 'launch.events'),
    *('launch.substitutions', 'launch_ros', 'launch_ros.actions'),
    'launch_ros.parameter_descriptions',
)


@dataclass
class Made:
    """Something of `launch` as it was constructed."""

    kind: str
    args: tuple
    options: dict = field(default_factory=dict)

    def perform(self, context: dict[str, str]) -> str:
        """The value, if this is a LaunchConfiguration."""
        return context[self.args[0]]


class RecordingModule(ModuleType):
    """A module of which every name constructs a record."""

    def __getattr__(self, name: str) -> object:
        if name.startswith('__'):
            raise AttributeError(name)
        return lambda *args, **options: Made(name, args, options)


def described_by(file: Path, monkeypatch: pytest.MonkeyPatch) -> Made:
    """What a launch file describes."""
    for name in LAUNCH_MODULES:
        monkeypatch.setitem(sys.modules, name, RecordingModule(name))
    made: Made = runpy.run_path(str(file))['generate_launch_description']()
    return made


def entities(description: Made, kind: str) -> Iterator[Made]:
    return (entity for entity in description.args[0] if entity.kind == kind)


def defaults(description: Made) -> dict[str, str]:
    declared = entities(description, 'DeclareLaunchArgument')
    return {argument.args[0]: argument.options['default_value'] for argument in declared}


def started(description: Made, **chosen: str) -> list[Made]:
    (start,) = entities(description, 'OpaqueFunction')
    made: list[Made] = start.options['function']({**defaults(description), **chosen})
    return made


def nodes(description: Made, executable: str, **chosen: str) -> list[Made]:
    made = [part for part in started(description, **chosen) if part.kind == 'Node']
    return [node for node in made if node.options['executable'] == executable]


def given(node: Made, name: str) -> tuple[object, type]:
    """What a node is given for a parameter, and as which type."""
    value = node.options['parameters'][-1][name]
    if not isinstance(value, Made):
        return value, type(value)
    return value.args[0], value.options['value_type']


def exit_handler(made: list[Made]) -> Callable[[object, object], list]:
    """What is done when a process ends; it must be known before any process starts."""
    assert made[0].kind == 'RegisterEventHandler'
    (handler,) = made[0].args
    assert handler.kind == 'OnProcessExit'
    on_exit: Callable[[object, object], list] = handler.options['on_exit']
    return on_exit


def ended(action: Made, status: int) -> object:
    """The event of a process that has ended."""
    return SimpleNamespace(action=action, returncode=status, process_name='it-1')

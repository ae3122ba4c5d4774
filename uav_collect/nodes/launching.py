"""What launch files share: arguments checked before anything starts, failures that end all.

`launch` is part of a ROS distribution and not to be had from PyPI, so nothing of it is imported
here: the files in launch/ hand in what they get.
"""

from collections.abc import Callable, Iterable, Mapping
import math
from pathlib import Path
import signal
from typing import Any

from ament_index_python.packages import get_package_prefix, PackageNotFoundError
from uav_collect.errors import ConfigError, FleetError, UavCollectError
from uav_collect.nodes.parameters import Parameter

_ASKED_TO_END = (-signal.SIGINT, -signal.SIGTERM)  # exit statuses of what launch has stopped


class LaunchArguments:
    """The arguments of a launch file, as texts; what is wrong with them is collected."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        """Check nothing yet.

        Args:
            texts: by name.
        """
        self._texts = texts
        self._problems: list[str] = []

    def __getitem__(self, name: str) -> str:
        """An argument as it was given."""
        return self._texts[name]

    def value(self, parameter: Parameter) -> Any:
        """The argument for a parameter of a node, in its type; its default where it is wrong."""
        default, text = parameter.default, self._texts[parameter.name]
        if not isinstance(default, int | float):
            return text
        try:
            value = type(default)(text)
        except ValueError:
            value = math.nan
        low, high = parameter.low, parameter.high
        if low is None or high is None or low <= value <= high:
            return value
        noun = 'a whole number' if isinstance(default, int) else 'a number'
        self._problem(parameter.name, f'must be {noun} from {low:,} to {high:,}')
        return default

    def flag(self, name: str) -> bool:
        """An argument that is true or false."""
        text = self._texts[name].lower()
        if text not in ('true', 'false'):
            self._problem(name, 'must be true or false')
        return text == 'true'

    def one_of(self, name: str, known: Iterable[str]) -> None:
        """Refuse an argument that is none of those known."""
        if self._texts[name] not in known:
            self._problem(name, f'must be one of {", ".join(known)}')

    def made(self, name: str, make: Callable[[], Any]) -> Any:
        """What something makes of an argument; None where it refuses."""
        try:
            return make()
        except (UavCollectError, ValueError) as error:
            self._problem(name, ' '.join(str(error).split()))
        return None

    def new_folder(self, name: str, path: Path) -> None:
        """Refuse an argument by which a folder is to be made that there is already."""
        if path.exists():
            self._problem(name, f'{path} exists already')

    def package(self, name: str, package: str) -> None:
        """Refuse an argument that needs a ROS package which is not installed."""
        try:
            get_package_prefix(package)
        except PackageNotFoundError:
            self._problem(name, f'the package {package} is not installed')

    def refuse(self, name: str, what: str) -> None:
        """Refuse an argument, and say what it must be."""
        self._problem(name, what)

    def needed(self, name: str) -> None:
        """Refuse an argument that is empty."""
        if not self._texts[name]:
            self._problem(name, 'must be given')

    def check(self) -> None:
        """Go on only if nothing was wrong.

        Raises:
            ConfigError: naming all that is wrong.
        """
        if self._problems:
            raise ConfigError('; '.join(self._problems))

    def _problem(self, name: str, what: str) -> None:
        self._problems.append(f'{name}:={self._texts[name]}: {what}')


def parameter_of(parameters: Iterable[Parameter], name: str) -> Parameter:
    """The parameter with a name."""
    (parameter,) = [it for it in parameters if it.name == name]
    return parameter


def node_options(
    executable: str, parameters: Mapping[str, Any], defaults: Path, text: Callable[..., Any]
) -> dict[str, Any]:
    """What launch_ros's `Node` takes to start a node of this package.

    Args:
        executable: its name.
        parameters: with their values; a text stays one even if it reads like a number.
        defaults: file of all other parameters.
        text: launch_ros's `ParameterValue`.
    """
    typed = {
        name: text(value, value_type=str) if isinstance(value, str) else value
        for name, value in parameters.items()
    }
    return {
        'package': 'uav_collect',
        'executable': executable,
        'output': 'screen',
        'parameters': [str(defaults), typed],  # the later ones count
    }


def ending_with(last: Any, end: Any) -> Callable[[Any, Any], list[Any]]:
    """What to do whenever a process has ended.

    Args:
        last: action of the process whose end ends all.
        end: action that ends all.

    Returns:
        A handler for `OnProcessExit`: launch ends all others and returns 1 when it raises.
    """

    def on_exit(event: Any, context: Any) -> list[Any]:
        is_asked = context.is_shutdown and event.returncode in _ASKED_TO_END
        if event.returncode and not is_asked:
            name, status = event.process_name, event.returncode
            raise FleetError(f'{name} failed with exit status {status}: all others are stopped')
        return [end] if event.action is last else []

    return on_exit

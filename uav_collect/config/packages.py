"""What Python packages there must be besides this one, how old at most, and how to get them.

World and agents run on what Ubuntu 24.04 offers by apt; package.xml says the same to rosdep.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
import os
from pathlib import Path
import re
import sys

from uav_collect.errors import MissingPackageError

MESSAGES = 'uav_collect_msgs'
_BY_PIP = 'pip install "uav-collect[ros]" (Python 3.11, 3.12)'


@dataclass(frozen=True, kw_only=True)
class Package:
    """A package of Python."""

    name: str  # by which pip knows it
    module: str  # by which Python does
    apt: str = ''  # its package in Ubuntu 24.04; '': it comes from pip alone
    oldest: str = ''  # version that was tested; '': others work, too, as far as is known
    only_for: str = ''  # what alone needs it; '': a mission over ROS does

    @property
    def top_module(self) -> str:
        """The first part of the module's name."""
        return self.module.partition('.')[0]

    @property
    def version(self) -> str:
        """The version that is installed; '' if nothing tells."""
        try:
            return metadata.version(self.name)
        except metadata.PackageNotFoundError:
            return ''

    @property
    def problem(self) -> str:
        """That it is missing or too old, and how to get it, in one line; '' if it can be used."""
        if not is_there(self.module):
            return f'{self.name} is missing: {self._remedy}'
        version = self.version
        if not version or _numbers(version) >= _numbers(self.oldest):
            return ''
        return f'{self.name} is {version}: must be {self.oldest} or newer: {self._remedy}'

    @property
    def _remedy(self) -> str:
        wanted = f'"{self.name}>={self.oldest}"' if self.oldest else self.name
        by_pip = f'pip install {wanted}'
        return f'apt install {self.apt}, or {by_pip}' if self.apt else by_pip


PACKAGES = {
    it.name: it
    for it in (
        Package(name='numpy', module='numpy', apt='python3-numpy', oldest='1.26'),
        Package(name='PyYAML', module='yaml', apt='python3-yaml', oldest='6.0'),
        Package(name='rich', module='rich', apt='python3-rich', oldest='13.7'),
        Package(name='matplotlib', module='matplotlib', apt='python3-matplotlib', oldest='3.6'),
        Package(name='pillow', module='PIL', apt='python3-pil', oldest='10.2', only_for='films'),
        Package(name='websockets', module='websockets', oldest='13.0', only_for='viewer'),
        Package(name='rosbags', module='rosbags', oldest='0.11.9'),
        Package(name='backports.zstd', module='backports.zstd'),
        Package(name='lz4', module='lz4'),
        Package(name='openpyxl', module='openpyxl', only_for='lists of sensors in .xlsx'),
        Package(name='defusedxml', module='defusedxml', only_for='lists of sensors in KML'),
        Package(name='pyproj', module='pyproj', only_for='sensors by a map grid (crs)'),
        Package(name='numba', module='numba', only_for='compiled kernels'),
        Package(name='cvxpy', module='cvxpy', only_for='--bandwidth cvxpy'),
        Package(name='clarabel', module='clarabel', only_for='--bandwidth cvxpy'),
        Package(name='scipy', module='scipy', only_for='--bandwidth cvxpy'),
        Package(name='torch', module='torch', only_for='training'),
        Package(name='tensorboard', module='tensorboard', only_for='training'),
        Package(name='gymnasium', module='gymnasium', only_for='PettingZoo'),
        Package(name='pettingzoo', module='pettingzoo', only_for='PettingZoo'),
        Package(name='ray', module='ray', only_for='figures --engine ray'),
    )
}

# Packages of a ROS distribution that nodes import.
ROS_PACKAGES = (
    *('ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs'),
    *('rcl_interfaces', 'rclpy', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs', 'tf2_msgs'),
    'visualization_msgs',
)

# What each executable loads in any case.
_ON_BOARD = ('numpy', 'PyYAML')
_SHOWING = (*_ON_BOARD, 'rich')
_BAGS = ('rosbags', 'backports.zstd', 'lz4')
NEEDED = {
    'world_sim': _ON_BOARD,
    'uav_agent': _ON_BOARD,
    'recorder': (*_ON_BOARD, *_BAGS),
    'trainer': (*_SHOWING, *_BAGS, 'torch'),
    'control': _ON_BOARD,
    'field': (*_SHOWING, 'matplotlib'),
    'viewer': (*_ON_BOARD, 'websockets'),
    'mission': (*_SHOWING, 'matplotlib', *_BAGS),
    'report': (*_SHOWING, 'matplotlib', *_BAGS),
    'export': (*_SHOWING, 'matplotlib', *_BAGS),
    'verify': (*_ON_BOARD, *_BAGS),
    'evaluate': _SHOWING,
    'size': (*_SHOWING, 'matplotlib'),
    'bound': _SHOWING,
    'train': (*_SHOWING, 'matplotlib'),
    'tune': (*_SHOWING, 'matplotlib'),
    'refine': _SHOWING,
    'train-fleet': _SHOWING,
    'curves': (*_SHOWING, 'matplotlib'),
    'figures': (*_SHOWING, 'matplotlib'),
    'list': _ON_BOARD,
    'messages': (),
    'doctor': (),
}


@contextmanager
def packages_of(executable: str) -> Iterator[None]:
    """Load or run an executable, if the packages that it needs are there.

    Raises:
        MissingPackageError: packages are missing or too old.
    """
    problems = [PACKAGES[name].problem for name in NEEDED[executable]]
    if any(problems):
        raise MissingPackageError('\n'.join(filter(None, problems)))
    with late_packages():
        yield


@contextmanager
def late_packages() -> Iterator[None]:
    """Run something that loads packages late.

    Raises:
        MissingPackageError: one of them is missing.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        problem = _missing(error)
        if not problem:
            raise  # a mistake of ours
        raise MissingPackageError(problem) from error


def extra_remedy(extra: str, command: str) -> str:
    """How to get the packages of an extra, in a clone by a command."""
    return f'"{command}" in a clone, or pip install "uav-collect[{extra}]"'


def ros_problem() -> str:
    """Why nothing can fly over ROS here, as far as can be seen from afar; '' if all is there."""
    missing = [name for name in ('rclpy', MESSAGES) if not is_there(name)]
    return f'{missing[0]} is missing: {ros_remedy(missing[0])}' if missing else ''


def ros_remedy(*packages: str) -> str:
    """How to get packages of ROS, or this one's messages."""
    here = Path(__file__).resolve().parents[1]
    if packages == (MESSAGES,):
        return messages_remedy(here)
    if 'rclpy' in packages:
        by_pip = f'{_BY_PIP} and run "uav-collect messages"'
        by_make = 'run "make setup" and source install/setup.bash'
        return f'source a ROS 2 Jazzy, or {by_pip if is_by_pip(here) else by_make}'
    names = ' '.join(f'ros-jazzy-{package.replace("_", "-")}' for package in packages)
    built = 'uav-collect messages' if is_by_pip(here) else 'make setup'
    return f'apt install {names}, or run "{built}"'


def is_by_pip(package: Path) -> bool:
    """Whether pip has put a Python package, by its folder, into the environment that runs it."""
    return Path(sys.prefix).resolve() in package.parents[3:4]


def messages_remedy(package: Path) -> str:
    """How to get this package's messages.

    Args:
        package: folder of the Python package, in a checkout or where colcon has installed it.
    """
    if is_by_pip(package):
        return 'run "uav-collect messages"'
    workspace, checkout = _workspace(package)
    installed = workspace / 'install'
    if any((installed / inside / MESSAGES).is_dir() for inside in ('', 'share')):
        is_sourced = str(installed) in os.environ.get('AMENT_PREFIX_PATH', '')
        return f'build {workspace} anew' if is_sourced else f'source {installed}/setup.bash'
    if workspace == checkout:
        return f'run "make setup" in {checkout}, then source install/setup.bash'
    return (
        'colcon does not look inside a package for another: run "colcon build --base-paths src '
        f'src/{checkout.name}/msg_defs" in {workspace}, or copy colcon_defaults.yaml there first'
    )


def _workspace(package: Path) -> tuple[Path, Path]:
    """The folder that colcon builds in, and the checkout in it."""
    checkout = package.parent
    if checkout.name == 'site-packages':  # PREFIX/lib/python3.x/site-packages
        prefix = checkout.parents[2]
        workspace = prefix.parents[1] if prefix.parent.name == 'install' else prefix.parent
        return workspace, workspace / 'src' / package.name
    return checkout.parents[1] if checkout.parent.name == 'src' else checkout, checkout


def _missing(error: ModuleNotFoundError) -> str:
    """What to say of a module that is not there; '' if it is none of those known here."""
    name = (error.name or '').partition('.')[0]
    if name in (*ROS_PACKAGES, MESSAGES):
        return f'{name} is missing: {ros_remedy(name)}'
    return next((it.problem for it in PACKAGES.values() if it.top_module == name), '')


def is_there(module: str) -> bool:
    """Whether Python finds a module, without loading it."""
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):  # kept out, or half of it was imported
        return False


def _numbers(version: str) -> tuple[int, ...]:
    """What a version begins with: (1, 26, 4) of 1.26.4+dfsg."""
    release = re.match(r'[0-9.]*[0-9]', version)
    return tuple(map(int, release[0].split('.'))) if release else ()

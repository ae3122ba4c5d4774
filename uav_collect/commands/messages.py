"""Builds the ROS messages of this package into the environment that pip has installed it into."""

import argparse
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import sysconfig
from tempfile import TemporaryDirectory

from uav_collect.config.packages import is_by_pip, is_there, MESSAGES, messages_remedy, ros_remedy
from uav_collect.errors import FleetError, MissingPackageError
from uav_collect.kernels.patience import waiting_for

_DESCRIPTION = """
Builds the ROS messages into the virtual environment of "pip install 'uav-collect[ros]'", so that
missions fly over ROS 2 from any folder. Takes a minute, a C++ compiler and Python's headers. In a
clone, "make setup" does the same.
"""
_STAND_INS = ('tf2_msgs',)  # that no wheel has; where ROS has it, its own is used
_SHOWN_LINES = 15  # of what a build said that failed
# ROS's CMake files take other bytes for the end of a path.
_PATH = re.compile(r'[A-Za-z0-9/._+@,=~-]+')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, which takes no arguments."""
    parser.description = _DESCRIPTION


def run(arguments: argparse.Namespace) -> int:
    """Build them; returns the exit status.

    Raises:
        MissingPackageError: something that builds them is missing.
        FleetError: they are built elsewhere, or cannot be built here.
    """
    prefix = Path(sys.prefix)
    with TemporaryDirectory(prefix='uav_collect-') as folder:
        _check(prefix, Path(folder))
        with waiting_for('the messages'):
            done = _built(prefix, Path(folder))
    if done.returncode:
        tail = '\n'.join(f'  {line}' for line in done.stdout.splitlines()[-_SHOWN_LINES:])
        raise FleetError(f'the messages cannot be built; the last words of colcon:\n{tail}')
    print(f'messages: in {prefix}; "uav-collect mission" flies')
    return 0


def _check(prefix: Path, folder: Path) -> None:
    """Say now what a compiler would say in a hundred lines."""
    package = Path(__file__).resolve().parents[1]
    if not is_by_pip(package):
        raise FleetError(f'this builds messages where pip has installed it: {_elsewhere(package)}')
    for path in (prefix, folder):
        if not _PATH.fullmatch(str(path)):
            allowed = 'its path must be of A-Z, a-z, 0-9 and . _ + @ , = ~ - only'
            raise FleetError(f'{path}: ROS cannot build there: {allowed}')
    if not is_there('rclpy'):
        raise MissingPackageError(f'rclpy is missing: {ros_remedy("rclpy")}')
    if not (prefix / 'bin' / 'colcon').exists():
        raise MissingPackageError('colcon is missing: pip install "uav-collect[ros]"')
    compiler = os.environ.get('CXX', 'c++')
    if shutil.which(compiler) is None:
        raise FleetError(f'there is no C++ compiler, {compiler} (Debian, Ubuntu: apt install g++)')
    if not Path(sysconfig.get_path('include'), 'Python.h').exists():
        what = 'has no headers, Python.h (Debian, Ubuntu: apt install python3-dev)'
        raise FleetError(f'{sys.executable} {what}')


def _elsewhere(package: Path) -> str:
    return 'they are there' if is_there(MESSAGES) else messages_remedy(package)


def _built(prefix: Path, folder: Path) -> 'subprocess.CompletedProcess[str]':
    sources = prefix / 'share' / 'uav_collect'
    stand_ins = [sources / 'stand_ins' / it for it in _STAND_INS if not is_there(it)]
    to_places = ('--merge-install', '--install-base', prefix, '--build-base', folder / 'build')
    return subprocess.run(
        [
            *(str(prefix / 'bin' / 'colcon'), '--log-base', str(folder / 'log'), 'build'),
            *map(str, to_places),
            *('--base-paths', *map(str, (sources / 'msg_defs', *stand_ins))),
        ],
        cwd=folder,
        env={
            **os.environ,
            **{name: _with(prefix, name) for name in ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH')},
            'PATH': _with(prefix / 'bin', 'PATH'),
            **{'ROS_DISTRO': 'jazzy', 'ROS_VERSION': '2', 'ROS_PYTHON_VERSION': '3'},
        },
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors='replace',
        check=False,
    )


def _with(folder: Path, variable: str) -> str:
    """A list of folders in the environment, this one in front."""
    return os.pathsep.join(filter(None, (str(folder), os.environ.get(variable, ''))))

"""Says whether a mission can fly on this machine, and what support needs to know about it."""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
import os
from pathlib import Path
import platform
import subprocess
import sys

import uav_collect
from uav_collect.kernels.compile import cache_folder, kernels_are_cached

_DESCRIPTION = """
Prints the versions, paths and settings that missions depend on, then one line per problem. Exits
with 0 if a mission can fly and with 1 if not.
"""
_PYTHONS = ((3, 11), (3, 12))
_DISTRIBUTION = 'jazzy'
_NEEDED = ('numpy', 'numba', 'PyYAML', 'rich', 'matplotlib', 'rosbags')
_OPTIONAL = {  # and what needs it
    'cvxpy': '--bandwidth cvxpy',
    'clarabel': '--bandwidth cvxpy',
    'torch': 'train',
    'tensorboard': 'train',
}
_MAX_DOMAIN = 232  # the DDS port numbers end there
_RANGES = ('SUBNET', 'LOCALHOST', 'SYSTEM_DEFAULT')  # OFF leaves every node alone
_IMPORT_TIMEOUT_S = 60.0

# In processes of their own: a library that does not load may end the whole process.
_TRY_RCLPY = 'import rclpy; print(rclpy.get_rmw_implementation_identifier())'
_TRY_MESSAGES = """
from rclpy.type_support import check_for_type_support
from uav_collect_msgs.msg import Observation
import uav_collect_msgs
check_for_type_support(Observation)
print(uav_collect_msgs.__path__[0])
"""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One line of the report."""

    topic: str
    found: str
    problem: str = ''  # '' if a mission can fly with it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command; it has no arguments."""
    parser.description = _DESCRIPTION


def run(arguments: argparse.Namespace) -> int:
    """Examine the machine and print what was found; returns the exit status."""
    del arguments
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    findings = list(examine(os.environ))
    console = Console()
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for finding in findings:
        style = 'bold red' if finding.problem else ''
        table.add_row(Text(finding.topic, style), Text(finding.found, style))
    console.print(table)
    problems = [finding for finding in findings if finding.problem]
    for finding in problems:
        console.print(Text(f'problem: {finding.topic}: {finding.problem}', 'bold red'))
    if not problems:
        console.print('a mission can fly', style='green')
    return 1 if problems else 0


def examine(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Examine everything that a mission depends on, environment variables included."""
    yield Finding(
        topic='uav_collect',
        found=f'{uav_collect.__version__} in {Path(uav_collect.__file__).parent}',
    )
    yield _python(sys.version_info[:2])
    yield Finding(topic='machine', found=f'{platform.platform()}, {_n_cores()} cores')
    yield from (_package(name) for name in _NEEDED)
    yield from (_package(name, user) for name, user in _OPTIONAL.items())
    yield _distribution(environment)
    yield _imported('rclpy', _TRY_RCLPY, 'source a ROS 2 Jazzy, or run make setup')
    yield _imported('messages', _TRY_MESSAGES, 'run make setup, then source install/setup.bash')
    yield _domain(environment)
    yield _discovery(environment)
    yield _ros_log(environment)
    yield _scenarios()
    yield _kernel_cache()


def _python(version: tuple[int, int]) -> Finding:
    known = ' or '.join(f'{major}.{minor}' for major, minor in _PYTHONS)
    return Finding(
        topic='python',
        found=f'{platform.python_version()} at {sys.executable}',
        problem='' if version in _PYTHONS else f'must be {known}',
    )


def _n_cores() -> int:
    return len(os.sched_getaffinity(0))


def _package(name: str, only_user: str = '') -> Finding:
    try:
        return Finding(topic=name, found=metadata.version(name))
    except metadata.PackageNotFoundError:
        if only_user:
            return Finding(topic=name, found=f'missing; only {only_user} needs it')
        return Finding(topic=name, found='missing', problem='must be installed: make setup')


def _distribution(environment: Mapping[str, str]) -> Finding:
    name = environment.get('ROS_DISTRO', '')
    return Finding(
        topic='ROS distribution',
        found=name or 'none sourced',
        problem=f'must be {_DISTRIBUTION}' if name not in ('', _DISTRIBUTION) else '',
    )


def _imported(topic: str, program: str, remedy: str) -> Finding:
    """What a program that imports something prints, or why it fails."""
    command = [sys.executable, '-c', program]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_IMPORT_TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        problem = f'did not load within {_IMPORT_TIMEOUT_S:.0f} s'
        return Finding(topic=topic, found='stuck', problem=problem)
    if done.returncode == 0:
        return Finding(topic=topic, found=done.stdout.strip())
    reason = (done.stderr.strip().splitlines() or [f'exit status {done.returncode}'])[-1]
    return Finding(topic=topic, found='does not load', problem=f'{reason}; {remedy}')


def _domain(environment: Mapping[str, str]) -> Finding:
    text = environment.get('ROS_DOMAIN_ID') or '0'
    is_valid = text.isdecimal() and int(text) <= _MAX_DOMAIN
    problem = '' if is_valid else f'ROS_DOMAIN_ID must be a number from 0 to {_MAX_DOMAIN}'
    return Finding(topic='domain', found=text, problem=problem)


def _discovery(environment: Mapping[str, str]) -> Finding:
    variable = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
    reach = environment.get(variable) or 'SUBNET'
    peers = environment.get('ROS_STATIC_PEERS', '')
    is_valid = reach in _RANGES or (reach == 'OFF' and peers)
    return Finding(
        topic='discovery',
        found=f'{reach}, peers {peers}' if peers else reach,
        problem='' if is_valid else f'{variable} must be one of {", ".join(_RANGES)}',
    )


def _ros_log(environment: Mapping[str, str]) -> Finding:
    home = environment.get('ROS_HOME') or (
        f'{environment["HOME"]}/.ros' if environment.get('HOME') else ''
    )
    folder = environment.get('ROS_LOG_DIR') or (f'{home}/log' if home else '')
    problem = 'HOME or ROS_LOG_DIR must be set' if not folder else _unwritable(Path(folder))
    return Finding(topic='ROS log', found=folder or 'nowhere', problem=problem)


def _scenarios() -> Finding:
    from uav_collect.scenario.load import scenario_names

    names = scenario_names()
    return Finding(
        topic='scenarios',
        found=', '.join(names) or 'none',
        problem='' if names else 'the folder config/scenarios must be installed',
    )


def _kernel_cache() -> Finding:
    from uav_collect.missions.batch_kernels import KERNELS

    folder = cache_folder()
    state = 'warm' if kernels_are_cached(KERNELS) else 'cold: the first flight compiles'
    return Finding(topic='kernels', found=f'{state}, in {folder}', problem=_unwritable(folder))


def _unwritable(folder: Path) -> str:
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    return '' if os.access(existing, os.W_OK) else f'{existing} must be writable'

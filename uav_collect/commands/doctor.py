"""Says whether a mission can fly on this machine, and what support needs to know about it."""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
import os
from pathlib import Path
import platform
import subprocess
import sys

import uav_collect
from uav_collect.config.packages import (
    is_there,
    MESSAGES,
    NEEDED,
    Package,
    PACKAGES,
    ROS_PACKAGES,
    ros_remedy,
)
from uav_collect.errors import NodeError
from uav_collect.kernels.compile import cache_folder, kernels_are_cached, kernels_are_compiled
from uav_collect.limits import FAILED
from uav_collect.lockstep.seals import KEY_FILE, read_secret

_DESCRIPTION = """
Prints the versions, paths and settings that missions depend on, then one line per problem. Exits
with 0 if a mission can fly and with 1 if not.
"""
_PYTHONS = ((3, 11), (3, 12))
_DISTRIBUTION = 'jazzy'
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
    """Describe the command and add its argument."""
    parser.description = _DESCRIPTION
    parser.add_argument(
        '--on-board',
        action='store_true',
        help='ask only for what world and agents need: they neither record nor show missions',
    )


def run(arguments: argparse.Namespace) -> int:
    """Examine the machine and print what was found; returns the exit status."""
    findings = list(examine(os.environ, is_on_board=arguments.on_board))
    width = max(len(finding.topic) for finding in findings)
    for finding in findings:
        print(f'{finding.topic:{width}}  {finding.found}')
    problems = [finding for finding in findings if finding.problem]
    for finding in problems:
        print(f'problem: {finding.topic}: {finding.problem}')
    if not problems:
        print('a mission can fly')
    return FAILED if problems else 0


def examine(environment: Mapping[str, str], *, is_on_board: bool = False) -> Iterator[Finding]:
    """Examine everything that a mission depends on, environment variables included."""
    yield Finding(
        topic='uav_collect',
        found=f'{uav_collect.__version__} in {Path(uav_collect.__file__).parent}',
    )
    yield _python(sys.version_info[:2])
    yield Finding(topic='machine', found=f'{platform.platform()}, {_n_cores()} cores')
    on_board = {*NEEDED['world_sim'], *NEEDED['uav_agent']}
    for package in PACKAGES.values():
        is_needed = package.name in on_board if is_on_board else not package.only_for
        yield _package(package, is_needed=is_needed)
    yield _distribution(environment)
    yield _ros_packages()
    yield _imported('rclpy', _TRY_RCLPY, ros_remedy('rclpy'))
    yield _imported('messages', _TRY_MESSAGES, ros_remedy(MESSAGES))
    yield _domain(environment)
    yield _discovery(environment)
    yield _key(environment)
    yield _ros_log(environment)
    if not PACKAGES['PyYAML'].problem:
        yield _scenarios()
        if not PACKAGES['numpy'].problem:
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


def _package(package: Package, *, is_needed: bool) -> Finding:
    name, problem = package.name, package.problem
    if not problem:
        return Finding(topic=name, found=package.version or 'of an unknown version')
    if not is_needed:
        user = package.only_for or 'recorder and commands'
        return Finding(topic=name, found=f'missing; only for {user}')
    return Finding(topic=name, found=package.version or 'missing', problem=problem)


def _ros_packages() -> Finding:
    missing = [name for name in ROS_PACKAGES if not is_there(name)]
    return Finding(
        topic='ROS packages',
        found=f'{len(ROS_PACKAGES) - len(missing)} of {len(ROS_PACKAGES)}',
        problem=f'{", ".join(missing)} missing: {ros_remedy(*missing)}' if missing else '',
    )


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
            command, capture_output=True, check=False, timeout=_IMPORT_TIMEOUT_S,
            encoding='utf-8', errors='backslashreplace',
        )  # fmt: skip
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


def _key(environment: Mapping[str, str]) -> Finding:
    try:
        secret = read_secret(environment)
    except NodeError as error:
        return Finding(topic='key', found='none', problem=str(error))
    if secret is None:
        return Finding(topic='key', found=f'{KEY_FILE} is not set: anyone in the domain can steer')
    whose = ', open to other users' if secret.is_readable_by_others else ''
    return Finding(topic='key', found=f'{secret.file}{whose}')


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
    if not kernels_are_compiled():
        return Finding(topic='kernels', found='interpreted: many missions at once take their time')
    state = 'warm' if kernels_are_cached(KERNELS) else 'cold: the first flight compiles'
    return Finding(topic='kernels', found=f'{state}, in {folder}', problem=_unwritable(folder))


def _unwritable(folder: Path) -> str:
    existing = next(place for place in (folder, *folder.parents) if os.path.exists(place))
    return '' if os.access(existing, os.W_OK) else f'{existing} must be writable'

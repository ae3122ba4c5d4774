"""What users set of a node: its world, and ROS parameters with range and description."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial
import re
from textwrap import wrap
from typing import Any
import uuid

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
import rclpy.parameter
from uav_collect.errors import NodeError

_INDENT = 6  # of what `--help` says of a parameter
_WIDTH = 80 - _INDENT
_ALIKE = 0.6  # of names; less is no misspelling
_OF_ROS = ('qos_overrides.',)  # prefixes of parameters that ROS itself looks for


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter: its name with its unit, its default, what it does, what it may be."""

    name: str
    default: bool | int | float | str | list[str]
    description: str
    low: float | None = None  # for numbers, bounds included
    high: float | None = None
    in_flight: bool = False  # whether it may change while the node runs

    @property
    def descriptor(self) -> ParameterDescriptor:
        """What ROS shows of it, and checks; for numbers that may be whole, `problem` does."""
        descriptor = ParameterDescriptor(
            description=self.description,
            read_only=not self.in_flight,
            dynamic_typing=isinstance(self.default, float),
        )
        if self.low is None or self.high is None:
            return descriptor
        if isinstance(self.default, int):
            bounds = IntegerRange(from_value=int(self.low), to_value=int(self.high))
            descriptor.integer_range = [bounds]
        else:
            bounds = FloatingPointRange(from_value=float(self.low), to_value=float(self.high))
            descriptor.floating_point_range = [bounds]
        return descriptor

    def problem(self, value: Any) -> str | None:
        """What is wrong with a value of a number that may be given as a whole one, or None."""
        if not isinstance(self.default, float):
            return None  # ROS has checked it
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if self.low is None or self.high is None:
            return None if is_number else f'{self.name} is {value!r}: must be a number'
        if is_number and self.low <= value <= self.high:
            return None
        return f'{self.name} is {value!r}: must be a number from {self.low:,} to {self.high:,}'

    @property
    def help(self) -> str:
        """Its lines of `--help`: name, default, description, bounds."""
        default = str(self.default).lower() if isinstance(self.default, bool) else self.default
        shown = f"'{default}'" if isinstance(self.default, str) else str(default)
        bounds = '' if self.low is None else f' ({self.low:,} to {self.high:,})'
        change = '; may change in flight' if self.in_flight else ''
        lines = wrap(self.description + bounds + change, _WIDTH)
        return '\n'.join(
            [f'  {self.name}:={shown}', *(f'{" " * _INDENT}{line}' for line in lines)]
        )


WORLD_INSTANCE = Parameter(
    name='world_instance',
    default='',
    description='UUID of the only world process to heed, its world_instance; empty: any',
)


def add_world_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that names one of several worlds in a ROS domain."""
    parser.add_argument(
        '--world',
        type=_namespace,
        default='',
        metavar='NAME',
        help='name of the world, if several share the ROS domain: a namespace for all topics',
    )


def declare(node: Node, parameters: Sequence[Parameter]) -> None:
    """Declare parameters, and warn of those that were given and are none.

    Most are fixed once the node runs. Those that are none only earn a warning: a file may hold
    parameters for many nodes, in a section for all of them.
    """
    known = {parameter.name: parameter for parameter in parameters}
    node.add_on_set_parameters_callback(partial(_checked, known))
    for parameter in parameters:
        node.declare_parameter(parameter.name, parameter.default, parameter.descriptor)
    with node.handle:
        given = node.handle.get_parameters(rclpy.parameter.Parameter)
    for name in sorted(given):
        if not node.has_parameter(name) and not name.startswith(_OF_ROS):
            node.get_logger().warning(_unknown(name, known))


def values_of(node: Node, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """The values of declared parameters, in the types of their defaults."""
    values = {each.name: node.get_parameter(each.name).value for each in parameters}
    numbers = {each.name for each in parameters if isinstance(each.default, float)}
    return {name: float(it) if name in numbers else it for name, it in values.items()}


def world_instance_of(node: Node) -> str:
    """The UUID in the parameter `world_instance`; empty if the node has none or it is empty.

    Raises:
        NodeError: it is no UUID.
    """
    name = WORLD_INSTANCE.name
    text: str = node.get_parameter(name).value if node.has_parameter(name) else ''
    try:
        is_uuid = not text or str(uuid.UUID(text)) == text
    except ValueError:
        is_uuid = False
    if not is_uuid:
        form = '32 lower-case hexadecimal digits with dashes'
        raise NodeError(f'{name} is {text!r}: must be a UUID ({form}) or empty')
    return text


def wrapped(description: str) -> str:
    """What a node does, in lines that `--help` shows as they are."""
    return '\n'.join(wrap(description.strip(), _WIDTH + _INDENT))


def help_text(parameters: Sequence[Parameter]) -> str:
    """The part of `--help` about parameters."""
    lines = ['ROS parameters (--ros-args -p NAME:=VALUE), with their defaults:']
    return '\n'.join([*lines, *(parameter.help for parameter in parameters)])


def is_namespace(text: str) -> bool:
    """Whether a text may be the name of a world, as a or north/a; '' is that of one without."""
    return not text or bool(re.fullmatch(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', text, re.ASCII))


def _namespace(text: str) -> str:
    if not is_namespace(text):
        raise argparse.ArgumentTypeError(f'{text!r} must be a ROS name, as a or north/a')
    return text


def _checked(known: Mapping[str, Parameter], given: Sequence[Any]) -> SetParametersResult:
    """Refuse parameters, as ROS sets them, one of which has a wrong value."""
    own = [each for each in given if each.name in known]
    problems = filter(None, (known[each.name].problem(each.value) for each in own))
    problem = next(problems, None)
    return SetParametersResult(successful=problem is None, reason=problem or '')


def _unknown(name: str, known: Mapping[str, Parameter]) -> str:
    alike = get_close_matches(name, known, n=1, cutoff=_ALIKE)
    nearest = f'{alike[0]} is the nearest one' if alike else '--help lists those that are'
    return f'parameter {name} is none of this node and changes nothing: {nearest}'

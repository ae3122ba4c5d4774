"""What users set of a node: its world, and ROS parameters with range and description."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
import re
from textwrap import wrap

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

_WIDTH = 80  # of a description in `--help`


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter: its name with its unit, its default, what it does, what it may be."""

    name: str
    default: bool | int | float | str | list[str]
    description: str
    low: float | None = None  # for numbers, bounds included
    high: float | None = None

    @property
    def descriptor(self) -> ParameterDescriptor:
        """What ROS shows of it, and checks."""
        descriptor = ParameterDescriptor(description=self.description, read_only=True)
        if self.low is None or self.high is None:
            return descriptor
        if isinstance(self.default, int):
            bounds = IntegerRange(from_value=int(self.low), to_value=int(self.high))
            descriptor.integer_range = [bounds]
        else:
            bounds = FloatingPointRange(from_value=float(self.low), to_value=float(self.high))
            descriptor.floating_point_range = [bounds]
        return descriptor

    @property
    def help(self) -> str:
        """Its lines of `--help`: name, default, description, bounds."""
        default = str(self.default).lower() if isinstance(self.default, bool) else self.default
        shown = f"'{default}'" if isinstance(self.default, str) else str(default)
        bounds = '' if self.low is None else f' ({self.low:,} to {self.high:,})'
        lines = wrap(self.description + bounds, _WIDTH)
        return '\n'.join([f'  {self.name}:={shown}', *(f'      {line}' for line in lines)])


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
    """Declare parameters; they are fixed once the node runs."""
    for parameter in parameters:
        node.declare_parameter(parameter.name, parameter.default, parameter.descriptor)


def help_text(parameters: Sequence[Parameter]) -> str:
    """The part of `--help` about parameters."""
    lines = ['ROS parameters (--ros-args -p NAME:=VALUE), with their defaults:']
    return '\n'.join([*lines, *(parameter.help for parameter in parameters)])


def _namespace(text: str) -> str:
    if text and not re.fullmatch(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', text, re.ASCII):
        raise argparse.ArgumentTypeError(f'{text!r} must be a ROS name, as a or north/a')
    return text

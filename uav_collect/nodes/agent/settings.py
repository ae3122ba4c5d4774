"""What users set of the agent node."""

import argparse
from collections.abc import Callable

from uav_collect.config.arguments import Parser
from uav_collect.limits import ALLOCATOR_NAMES, GUARD_AFTER, MAX_GUARD_AFTER, MAX_UAVS
from uav_collect.nodes.parameters import (
    add_world_option,
    help_text,
    Parameter,
    WORLD_INSTANCE,
    wrapped,
)

_DESCRIPTION = """
Flies one UAV: decides by a policy what it does next, from what it sees and hears, and shares its
bandwidth among the sensors it serves. Learns the scenario from the world; start it in any order
with the world and the other agents.
"""

PARAMETERS = (
    Parameter(name='uav', default=0, description='id of the UAV (--id)', low=0, high=MAX_UAVS),
    Parameter(
        name='policy',
        default='sweep',
        description='hert, hert-equal, sweep or random, a learned policy by name or .safetensors '
        'file, a function or class as module:name, lookahead:RULE: a rule that looks ahead, '
        'strong: the one shipped for the scenario, '
        'best: which of them does best in sampled missions of the scenario, or topic: what a '
        'trainer publishes on /trainer/policy (--policy)',
    ),
    Parameter(
        name='candidates',
        default='',
        description='policies, separated by commas, among which best is chosen besides those '
        'shipped for the scenario or refined for it, sweep and hert (--candidates)',
    ),
    Parameter(
        name='bandwidth',
        default='exact',
        description='how bandwidth is shared: exact, equal or cvxpy (--bandwidth)',
    ),
    Parameter(
        name='guard_after',
        default=GUARD_AFTER,
        description='decisions without news of a completed cell after which the guard takes over '
        'from a learned policy or a function, until the UAV knows more: it hovers where it '
        'may, else makes for the nearest incomplete cell; 0: never (--guard-after)',
        low=0,
        high=MAX_GUARD_AFTER,
    ),
    Parameter(
        name='observation_layout',
        default='',
        description='layout (paper, egocentric or relative) in which each decision is published '
        'for learners on /uav_N/transition; empty: none is, or with --policy topic that of the '
        'policy',
    ),
    WORLD_INSTANCE,
)


def argument_parser() -> Parser:
    """What an agent takes on its command line."""
    parser = Parser(
        prog='uav_agent',
        description=wrapped(_DESCRIPTION),
        epilog=help_text(PARAMETERS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--id', type=_whole_number(1, MAX_UAVS), metavar='N', help='id of the UAV, from 1'
    )
    parser.add_argument(
        '--policy',
        metavar='NAME|FILE|MODULE:NAME',
        help='hert, hert-equal, sweep, random, a .safetensors file, a shipped policy, a function'
        ' or class as module:name, lookahead:RULE, strong, best, or topic',
    )
    parser.add_argument(
        '--candidates', metavar='NAME,...', help='further ones among which best is chosen'
    )
    parser.add_argument(
        '--bandwidth', choices=ALLOCATOR_NAMES, help='how bandwidth is shared among sensors'
    )
    parser.add_argument(
        '--guard-after',
        type=_whole_number(0, MAX_GUARD_AFTER),
        metavar='K',
        help='decisions without news after which the guard takes over; 0: never',
    )
    add_world_option(parser)
    return parser


def _whole_number(low: int, high: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            allowed = f'a whole number from {low} to {high}'
            raise argparse.ArgumentTypeError(f'{text!r} must be {allowed}')
        return int(text)

    return parse

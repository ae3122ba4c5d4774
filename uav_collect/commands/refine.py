"""Goes on from a policy on the user's own field, and keeps what flies it better."""

import argparse
from pathlib import Path

from uav_collect import files
from uav_collect.commands import options
from uav_collect.config.layers import is_path
from uav_collect.errors import ConfigError
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import MAX_SEED

_DESCRIPTION = """
Trains on your field, beginning with the policy that flies it best, of those that are shipped and
what was refined for it before. Each minute it prints how the best so far compares with the better
of sweep and HERT, in missions that play no part in any choice. As soon as a policy is better than
all that it could start from, it is kept beside the scenario, as NAME.safetensors, where "--policy
best" finds it. Training ends when the time is up, or, after half of the time, when a quarter of it
has brought no improvement. Ctrl-C ends it, too, and keeps what was found.
"""
_MINUTES = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    options.add_scenario_options(parser)
    options.add_budget_options(parser, _MINUTES, 'how long to learn')
    parser.add_argument(
        '--start-from',
        metavar='NAME|FILE',
        help='learn on from a shipped policy or a .safetensors file (default: what flies the field'
        ' best of the shipped ones and of what was refined for it before)',
    )
    parser.add_argument(
        '--seed',
        type=options.whole_number(0, MAX_SEED),
        default=0,
        metavar='SEED',
        help='of exploration and missions (default: %(default)s)',
    )
    options.add_assignments(parser, '--override', 'replace values of the training')
    parser.add_argument(
        '--output',
        type=options.output,
        metavar='FILE',
        help='where the policy is kept (default: beside the scenario, NAME.safetensors)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Refine a policy; returns the exit status."""
    options.check_torch('refine', 'policy')
    scenario, output = options.scenario_of(arguments), _output(arguments)
    files.check_writable(output)
    if arguments.minutes is None and arguments.decisions is None:
        arguments.minutes = _MINUTES
    with waiting_for('torch to load'):
        from uav_collect.commands.refine_session import refine

    return refine(arguments, scenario, output)


def _output(arguments: argparse.Namespace) -> Path:
    """The file that the policy is kept in.

    Raises:
        ConfigError: the scenario has no file that it could lie beside, or its name is no policy's.
    """
    from uav_collect.uav.own_policy import own_policy_file
    from uav_collect.uav.policy import checked_name
    from uav_collect.uav.policy_file import SUFFIX

    output: Path | None = arguments.output
    if output is None:
        if not is_path(arguments.scenario):
            raise ConfigError(
                f'--output: must be given, as {arguments.scenario} is a shipped scenario, and no'
                ' file of yours that the policy could lie beside'
            )
        output = own_policy_file(Path(arguments.scenario).absolute(), arguments.uavs)
    if output.suffix != SUFFIX:
        raise ConfigError(f'--output: {output}: must end in {SUFFIX}')
    checked_name(output)
    return output

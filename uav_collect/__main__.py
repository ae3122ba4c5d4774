"""The commands without a node: `uav-collect COMMAND`, or `python -m uav_collect COMMAND`."""

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
import os
import sys
from typing import NoReturn

import uav_collect
from uav_collect import files
from uav_collect.config.arguments import error_lines, Parser, program_name
from uav_collect.config.packages import packages_of
from uav_collect.errors import UavCollectError
from uav_collect.kernels.stops import obeyed_signals
from uav_collect.limits import FAILED, INTERRUPTED, UNUSABLE

# One line each, here: help must not load what flies missions.
SUMMARIES = {
    'list': 'list the scenarios, policies and presets that there are',
    'field': 'turn a list of loggers into a scenario: cells, base and fleet',
    'mission': 'fly a mission over ROS 2, every UAV a process, and record it',
    'evaluate': 'fly many missions in this process: means with 95 % intervals',
    'size': 'say how many UAVs and how much battery a site takes',
    'train': 'learn a policy for a scenario, from missions in this process',
    'tune': 'train with each combination of settings, say which did best',
    'refine': 'improve, on your own field, the policy that flies it best',
    'train-fleet': 'let a fleet learn over ROS 2 while it flies',
    'curves': 'draw the learning curves of trainings, mean and deviation',
    'bound': 'plan missions whose demand is known: the least they can take',
    'figures': "draw the figures of the paper's evaluation",
    'report': 'show tables and pictures of missions that were flown',
    'export': 'export flights for ground stations, maps and tables',
    'verify': 'fly recorded missions again, and prove every byte of them',
    'messages': 'build the ROS messages where pip has installed this',
    'doctor': 'say whether a mission can fly on this machine',
}


@dataclass(frozen=True, kw_only=True)
class Command:
    """What a user types: its options, and what runs with them."""

    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the arguments name; its exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments and arguments[0] in SUMMARIES:
        return _ended(lambda: _perform(arguments[0], arguments[1:]))
    return _ended(lambda: _misuse(arguments))


def _misuse(arguments: Sequence[str]) -> NoReturn:
    """Say what commands there are."""
    width = max(map(len, SUMMARIES))
    lines = [f'  {name:{width}}  {summary}' for name, summary in SUMMARIES.items()]
    parser = Parser(
        prog=program_name(),
        description='Fleets of UAVs that collect data from ground sensors.',
        epilog='\n'.join(['commands:', *lines, '', 'COMMAND --help says more.']),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage='%(prog)s [-h] [--version] COMMAND ...',
    )
    parser.add_argument('--version', action='version', version=uav_collect.__version__)
    parser.add_argument('command', choices=SUMMARIES, metavar='COMMAND', help=argparse.SUPPRESS)
    parser.parse_args(arguments)
    raise RuntimeError('a known command was not dispatched')


def _perform(name: str, argv: Sequence[str]) -> int:
    with packages_of(name):
        command = command_named(name)
        parser = Parser(prog=f'{program_name()} {name}')
        command.add_arguments(parser)
        return command.run(parser.parse_args(argv))


def _ended(perform: Callable[[], int]) -> int:
    """The exit status of what is performed; a failure is said in a line."""
    files.mend_standard_streams()
    try:
        try:
            with obeyed_signals(lambda number: 128 + number):
                status = perform()
        finally:  # a full disk shows here, not at exit
            _flush_unless_failed()
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # who read the output has left, and needs no word of it
        _drop_output()
        return FAILED
    except (OSError, UavCollectError) as error:  # any other is ours and shows its traceback
        sys.stderr.write(error_lines(error))
        _drop_output()
        return UNUSABLE
    return status


def _flush_unless_failed() -> None:
    """Flush what was said by a command that has ended, by itself or by argparse."""
    if sys.exc_info()[0] in (None, SystemExit):
        sys.stdout.flush()


def _drop_output() -> None:
    """What a full disk did not take must not be tried, and complained about, again at exit."""
    with suppress(OSError, ValueError), open(os.devnull, 'wb') as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


def command_named(name: str) -> Command:
    """The command of a name in `SUMMARIES`."""
    match name:
        case 'list':
            from uav_collect.commands.list import add_arguments, run
        case 'field':
            from uav_collect.commands.field import add_arguments, run
        case 'mission':
            from uav_collect.commands.mission import add_arguments, run
        case 'evaluate':
            from uav_collect.commands.evaluate import add_arguments, run
        case 'size':
            from uav_collect.commands.size import add_arguments, run
        case 'train':
            from uav_collect.commands.train import add_arguments, run
        case 'tune':
            from uav_collect.commands.tune import add_arguments, run
        case 'refine':
            from uav_collect.commands.refine import add_arguments, run
        case 'train-fleet':
            from uav_collect.commands.train_fleet import add_arguments, run
        case 'curves':
            from uav_collect.commands.curves import add_arguments, run
        case 'bound':
            from uav_collect.commands.bound import add_arguments, run
        case 'figures':
            from uav_collect.commands.figures import add_arguments, run
        case 'report':
            from uav_collect.commands.report import add_arguments, run
        case 'export':
            from uav_collect.commands.export import add_arguments, run
        case 'verify':
            from uav_collect.commands.verify import add_arguments, run
        case 'messages':
            from uav_collect.commands.messages import add_arguments, run
        case 'doctor':
            from uav_collect.commands.doctor import add_arguments, run
        case _:
            raise RuntimeError(f'no command is called {name!r}')
    return Command(add_arguments=add_arguments, run=run)


if __name__ == '__main__':
    sys.exit(main())

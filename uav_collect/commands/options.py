"""Options that several commands share, and the checks that argparse leaves to them."""

import argparse
from collections.abc import Callable, Sequence
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.config.packages import extra_remedy, is_there
from uav_collect.errors import ConfigError, TrainingRunError
from uav_collect.limits import (
    ALLOCATOR_NAMES,
    BEST,
    GUARD_AFTER,
    is_code_name,
    MAX_DECISIONS,
    MAX_GUARD_AFTER,
    MAX_SEED,
    MAX_UAVS,
)

if TYPE_CHECKING:  # loaded when needed, so that --help answers at once
    from uav_collect.scenario.model import Scenario

DEFAULT_SCENARIO = 'paper_10x10'
DEFAULT_ALLOCATOR = 'exact'


def add_scenario_options(parser: argparse.ArgumentParser) -> None:
    """Add what chooses a scenario and changes it; `scenario_of` reads it."""
    add_unmanned_options(parser)
    parser.add_argument(
        '--uavs',
        type=whole_number(1, MAX_UAVS),
        metavar='N',
        help="fly N UAVs, the scenario's in turn (default: as the scenario has)",
    )


def add_unmanned_options(parser: argparse.ArgumentParser) -> None:
    """Add what chooses a scenario and changes it, but for the number of UAVs."""
    parser.add_argument(
        '--scenario',
        default=DEFAULT_SCENARIO,
        metavar='NAME|FILE',
        help=f'a shipped scenario or a YAML file (default: {DEFAULT_SCENARIO})',
    )
    _add_set_option(parser)


def add_scenarios_options(parser: argparse.ArgumentParser) -> None:
    """Add what chooses one or several scenarios; `scenarios_of` reads it."""
    parser.add_argument(
        '--scenario',
        nargs='+',
        metavar='NAME|FILE',
        help=f'shipped scenarios or YAML files (default: {DEFAULT_SCENARIO})',
    )
    _add_set_option(parser)
    parser.add_argument(
        '--uavs',
        nargs='+',
        type=whole_number(1, MAX_UAVS),
        metavar='N',
        help="fly N UAVs, the scenario's in turn; several N: each scenario with each of them"
        ' (default: as the scenario has)',
    )


def _add_set_option(parser: argparse.ArgumentParser) -> None:
    example = 'demand.cell_share=0.5 fleet.uavs.0.speed_mps=8'
    add_assignments(parser, '--set', f'replace values of the scenario, as {example}')


def add_assignments(parser: argparse.ArgumentParser, option: str, what: str) -> None:
    """Add an option that takes values by dotted path; it may be given several times."""
    parser.add_argument(
        option, action='extend', nargs='+', default=[], metavar='KEY=VALUE', help=what
    )


def overrides_of(assignments: Sequence[str]) -> dict[str, object]:
    """The values of `add_assignments` by dotted path.

    Raises:
        ConfigError: one is no KEY=VALUE.
    """
    from uav_collect.scenario.load import parse_override

    return dict(map(parse_override, assignments))


def scenario_of(arguments: argparse.Namespace) -> 'Scenario':
    """The scenario that the options choose.

    Raises:
        ConfigError: it is not there, not valid, or an override does not fit.
    """
    from uav_collect.scenario.load import load, with_uavs

    scenario = load(arguments.scenario, overrides_of(arguments.set))
    return scenario if arguments.uavs is None else with_uavs(scenario, arguments.uavs)


def scenarios_of(arguments: argparse.Namespace) -> 'tuple[Scenario, ...]':
    """The scenarios that the options choose, at least one.

    Raises:
        ConfigError: one is not there, not valid, or an override does not fit.
    """
    from uav_collect.scenario.load import load, with_uavs

    overrides = overrides_of(arguments.set)
    scenarios = [load(name, overrides) for name in arguments.scenario or [DEFAULT_SCENARIO]]
    if not arguments.uavs:
        return tuple(scenarios)
    return tuple(with_uavs(one, n_uavs) for one in scenarios for n_uavs in arguments.uavs)


def add_seed_option(parser: argparse.ArgumentParser, what: str) -> None:
    """Add the seed of the first mission."""
    parser.add_argument(
        '--seed',
        type=whole_number(0, MAX_SEED),
        default=0,
        metavar='SEED',
        help=f'{what}: demand and channels follow from it (default: %(default)s)',
    )


def add_file_options(
    parser: argparse.ArgumentParser,
    json: str = 'write means and intervals',
    csv: str = 'write one row per mission',
) -> None:
    """Add the files that numbers are written into; `check_files` looks at them."""
    parser.add_argument('--json', type=output, metavar='FILE', help=json)
    parser.add_argument('--csv', type=output, metavar='FILE', help=csv)


def check_files(arguments: argparse.Namespace) -> None:
    """Refuse files, before anything is flown, that could not be written; `check_outputs`."""
    check_outputs(arguments.json, arguments.csv)


def check_outputs(*paths: Path | None) -> None:
    """Refuse files that could not be written, or one file for two things.

    Args:
        paths: of each thing that may be written; None: it is not.

    Raises:
        ConfigError: one would replace the other.
        OSError: a file could not be written, naming it.
    """
    given = [path for path in paths if path is not None]
    for path in given:
        files.check_writable(path)
    apart = [os.path.realpath(path) for path in given if not files.is_stream(path)]
    for number, name in enumerate(apart):
        if name in apart[:number]:
            raise ConfigError(f'{name}: is given for two files: must be another one for each')


def add_budget_options(parser: argparse.ArgumentParser, default_minutes: float, what: str) -> None:
    """Add how long to train, by time or by decisions; without a default.

    Args:
        parser: of the command.
        default_minutes: how long it trains if neither is given.
        what: begins the help of the first option.
    """
    budget = parser.add_mutually_exclusive_group()
    budget.add_argument(
        '--minutes', type=minutes, metavar='M', help=f'{what} (default: {default_minutes:g})'
    )
    budget.add_argument(
        '--decisions',
        type=whole_number(1, MAX_DECISIONS),
        metavar='D',
        help='or how many decisions to learn from',
    )


def add_allocator_option(
    parser: argparse.ArgumentParser,
    *,
    several: bool = False,
    choices: Sequence[str] = ALLOCATOR_NAMES,
) -> None:
    """Add what shares a UAV's bandwidth; one, or a list of several to fly one after the other."""
    by_solver = ' or cvxpy (exact by a general solver, slow)' if 'cvxpy' in choices else ''
    parser.add_argument(
        '--bandwidth',
        choices=choices,
        metavar='RULE',
        nargs='+' if several else None,
        default=[DEFAULT_ALLOCATOR] if several else DEFAULT_ALLOCATOR,
        help='how a hovering UAV shares its bandwidth: exact (shortest hover), equal (as much for'
        f' each sensor){by_solver} (default: {DEFAULT_ALLOCATOR})',
    )


def add_candidates_option(parser: argparse.ArgumentParser) -> None:
    """Add who may fly besides those whom `--policy best` knows; `check_candidates` looks at it."""
    parser.add_argument(
        '--candidates',
        default='',
        metavar='NAME,...',
        help=f'with --policy {BEST}: policies to choose from, named as for --policy, besides those'
        ' shipped for the scenario, what was refined for it, sweep and hert',
    )


def check_candidates(arguments: argparse.Namespace, policies: Sequence[str]) -> None:
    """Refuse candidates of which none would be chosen.

    Args:
        policies: those that are asked for.

    Raises:
        ConfigError: the best of the candidates is not one of them.
    """
    if arguments.candidates and BEST not in policies:
        raise ConfigError(f'--candidates: must come with --policy {BEST}')


def add_guard_option(parser: argparse.ArgumentParser) -> None:
    """Add when guards step in."""
    parser.add_argument(
        '--guard-after',
        type=whole_number(0, MAX_GUARD_AFTER),
        default=GUARD_AFTER,
        metavar='K',
        help='decisions without news of a completed cell after which the guard takes over from a'
        ' learned policy or a function, until the UAV knows more: it hovers where it may, else'
        ' heads for the nearest incomplete cell; 0: never (default: %(default)s)',
    )


def add_pace_option(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the option for how fast a world flies; None where it is not given.

    Args:
        default: what holds then, for people.
    """
    parser.add_argument(
        '--real-time-factor',
        type=float,
        metavar='X',
        help=f'simulated over wall-clock time; 0: as fast as possible (default: {default})',
    )


def output(text: str) -> Path:
    """A type for argparse: what is written where this was typed, wherever user code goes then."""
    return Path(text).absolute()


def algorithm(known: Sequence[str]) -> Callable[[str], str]:
    """A parser of the name of an algorithm, one of some or a user's module:Name."""

    def parse(text: str) -> str:
        if text not in known and not is_code_name(text):
            allowed = f'{", ".join(known)} or module:Name'
            raise argparse.ArgumentTypeError(f'is {text!r}: must be {allowed}')
        return text

    return parse


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """A type for argparse: a whole number from low to high."""

    def parse(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = low - 1
        if not low <= number <= high:
            allowed = f'a whole number from {low} to {high}'
            raise argparse.ArgumentTypeError(f'{text!r} must be {allowed}')
        return number

    return parse


def number_from(low: float, high: float, unit: str = '') -> Callable[[str], float]:
    """A type for argparse: a number from low to high, of a unit."""

    def parse(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not low <= number <= high:
            allowed = f'a number from {low:g} to {high:g} {unit}'.rstrip()
            raise argparse.ArgumentTypeError(f'{text!r} must be {allowed}')
        return number

    return parse


def minutes(text: str) -> float:
    """A type for argparse: a time in minutes."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text!r} must be a number of minutes above 0')
    return value


def check_torch(command: str, target: str = 'train') -> None:
    """Make sure that what a command learns with is there.

    Args:
        command: which it is.
        target: what of make installs it, and goes on with the command.

    Raises:
        TrainingRunError: naming what is missing.
    """
    missing = [name for name in ('torch', 'tensorboard') if not is_there(name)]
    if missing:
        raise TrainingRunError(
            f'{command} needs {" and ".join(missing)}: {extra_remedy("train", f"make {target}")}'
        )

"""Lets a fleet learn over ROS 2 while it flies, every node a process of its own."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
import itertools
from pathlib import Path
import string
import time
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options
from uav_collect.commands.ros_processes import check_ros, Fleet, ros_parameters, running_fleet
from uav_collect.commands.terminal import say
from uav_collect.errors import FleetError
from uav_collect.limits import FAILED, FLEET_ALGORITHMS, INTERRUPTED, RECORDED
from uav_collect.recording.mission_folder import SCENARIO_FILE
from uav_collect.training.seeds import next_training_seed

if TYPE_CHECKING:  # loaded when training, so that --help answers at once
    from uav_collect.scenario.model import Scenario

_DESCRIPTION = """
Starts world_sims that fly mission after mission, their uav_agents, and the trainer, as processes
that talk over DDS. The agents fly the policy that the trainer publishes; the trainer learns from
what they report, shows its progress and keeps a run folder as train does. Ctrl-C saves; the same
command continues. Processes that are killed are started again.
"""
_PRESET = 'strong'
_MINUTES = 60.0
RUNS = Path('runs', 'train_fleet')
MAX_WORLDS = 16
_PROCESSES = 'processes'  # of a run folder: what they say
_LOOK_S = 0.2
_SIZE_PERIOD_S = 60.0  # between two lines that say how much was recorded
_SAVE_S = 120.0  # how long the trainer may take to save


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    options.add_scenario_options(parser)
    parser.add_argument(
        '--worlds',
        type=options.whole_number(1, MAX_WORLDS),
        default=1,
        metavar='N',
        help='worlds to fly in at once, each with a fleet of its own (default: %(default)s)',
    )
    parser.add_argument(
        '--algorithm',
        type=options.algorithm(FLEET_ALGORITHMS),
        default=FLEET_ALGORITHMS[0],
        metavar='NAME|MODULE:NAME',
        help=f'how it learns: {" or ".join(FLEET_ALGORITHMS)}, or a class of yours'
        ' (default: %(default)s)',
    )
    parser.add_argument(
        '--preset',
        default=_PRESET,
        metavar='NAME|FILE',
        help='settings of the training: paper, strong, refine or a YAML file'
        ' (default: %(default)s)',
    )
    options.add_assignments(parser, '--override', 'replace values of the preset')
    options.add_seed_option(parser, 'of weights and missions')
    options.add_budget_options(parser, _MINUTES, 'how long to train')
    options.add_pace_option(parser, '0')
    parser.add_argument(
        '--record',
        nargs='?',
        choices=RECORDED,
        const=RECORDED[0],
        metavar='TOPICS',
        help='keep messages in bags: all (the default), or learning: what'
        ' trainer --from-bag needs; how much that is, is said every minute',
    )
    parser.add_argument(
        '--output',
        type=Path,
        metavar='FOLDER',
        help='run folder; one that holds the same run already is continued'
        f' (default: {RUNS}/SCENARIO_nUAVS_ALGORITHM_PRESET_sSEED)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Start the fleet and the trainer, and see them to their end; returns the exit status."""
    from uav_collect.training.config import load_preset
    from uav_collect.training.plug_ins import check_fleet_algorithm, short_name
    from uav_collect.uav.named_code import trust

    options.check_torch('train-fleet', 'train-fleet')
    check_fleet_algorithm(arguments.algorithm)
    scenario = options.scenario_of(arguments)
    config = load_preset(arguments.preset, options.overrides_of(arguments.override))
    check_ros()
    trust([label.partition('@')[0] for label in config.code])
    folder = arguments.output or RUNS / (
        f'{scenario.name}_n{scenario.n_uavs}_{short_name(arguments.algorithm)}_{config.name}_s{arguments.seed}'
    )
    said = _new_folder(folder / _PROCESSES)
    n_participants = 1 + arguments.worlds * (1 + scenario.n_uavs + bool(arguments.record))
    try:
        with running_fleet(said, n_participants) as fleet:
            _start(fleet, folder, said, scenario, arguments, allocator=config.rollout.bandwidth,
                   max_decisions=config.max_decisions(scenario.n_cells))  # fmt: skip
            _supervise(fleet, said if arguments.record else None)
    except KeyboardInterrupt:
        say(f'interrupted; the same command goes on with {folder}')
        return INTERRUPTED
    except FleetError as error:
        say(f'error: {error}')
        return FAILED
    say(f'learned; the policy is in {folder}')
    return 0


def _start(
    fleet: Fleet,
    folder: Path,
    said: Path,
    scenario: 'Scenario',
    arguments: argparse.Namespace,
    *,
    allocator: str,
    max_decisions: int,
) -> None:
    scenario_file, text = said / SCENARIO_FILE, scenario.to_yaml().encode()
    files.write_atomically(scenario_file, text)
    if not (folder / SCENARIO_FILE).exists():  # shows the trainer that the folder is for a run
        files.write_atomically(folder / SCENARIO_FILE, text)
    names = world_names(arguments.worlds)
    for number, name in enumerate(names):
        named, suffix = (['--world', name], f'_{name}') if name else ([], '')
        if arguments.record:
            bag = partial(_bag_arguments, named, said / f'bag{suffix}', arguments.record)
            fleet.start('recorder', f'recorder{suffix}', bag, ends_last=True)
        flown = partial(
            _world_arguments,
            named,
            partial(next_training_seed, folder, arguments.seed, number),
            scenario=scenario_file,
            max_decisions=max_decisions,
            real_time_factor=arguments.real_time_factor or 0.0,
            recorders=int(bool(arguments.record)),
        )
        fleet.start('world_sim', f'world_sim{suffix}', flown)
        for uav in range(1, scenario.n_uavs + 1):
            flags = ['--id', str(uav), '--policy', 'topic', '--bandwidth', allocator]
            fleet.start('uav_agent', f'uav_{uav}{suffix}', [*named, *flags])
    values = ros_parameters(
        scenario=scenario_file,
        algorithm=arguments.algorithm,
        preset=arguments.preset,
        overrides=arguments.override or [''],
        seed=arguments.seed,
        worlds=names,
        output_dir=folder,
        minutes=float(arguments.minutes or (0.0 if arguments.decisions else _MINUTES)),
        decisions=arguments.decisions or 0,
    )
    fleet.start('trainer', 'trainer', values, is_shown=True, stop_s=_SAVE_S)


def _bag_arguments(named: Sequence[str], first: Path, recorded: str) -> list[str]:
    """Of a recorder, with a bag of its own for each start."""
    bag = unused_folder(first)
    return [*named, '--output', str(bag), *ros_parameters(topics=recorded)]


def _world_arguments(
    named: Sequence[str], next_seed: Callable[[], int], **values: object
) -> list[str]:
    """Of a world, with missions of its own for each start."""
    fixed: dict[str, object] = {'missions': -1, 'viewer_rate_hz': 0.0, 'sample_rate_hz': 0.0}
    return [*named, *ros_parameters(seed=next_seed(), **fixed, **values)]


def _supervise(fleet: Fleet, recorded: Path | None) -> None:
    """Keep all processes running until the trainer has had its time.

    Args:
        recorded: folder that bags grow in, if any do; how fast is said now and then.
    """
    begun_s = said_s = time.monotonic()
    while fleet.status('trainer') != 0:
        for name in fleet.restart_killed():
            say(f'{name} was killed and is started again')
        time.sleep(_LOOK_S)
        now_s = time.monotonic()
        if recorded is not None and now_s - said_s >= _SIZE_PERIOD_S:
            said_s = now_s
            per_minute = _recorded_mb(recorded) / (now_s - begun_s) * 60.0
            say(f'{_size_text(recorded)}, {per_minute:,.1f} MB a minute')
    if recorded is not None:
        say(_size_text(recorded))


def _size_text(folder: Path) -> str:
    return f'recorded {_recorded_mb(folder):,.1f} MB in {folder}'


def _recorded_mb(folder: Path) -> float:
    """Size of all bags in a folder."""
    return sum(path.stat().st_size for path in folder.glob('bag*/*.mcap')) / 1e6


def world_names(n_worlds: int) -> list[str]:
    """One world has no name, so that its topics are the usual ones."""
    return [''] if n_worlds == 1 else [*string.ascii_lowercase[:n_worlds]]


def unused_folder(first: Path) -> Path:
    """`first`, or where that is used, the first of first_2, first_3, ... that is not."""
    later = (first.with_name(f'{first.name}_{number}') for number in itertools.count(2))
    return next(each for each in itertools.chain((first,), later) if not each.exists())


def _new_folder(parent: Path) -> Path:
    """1, 2, ...: one for each start of the command."""
    parent.mkdir(parents=True, exist_ok=True)
    numbers = [int(path.name) for path in parent.iterdir() if path.name.isdecimal()]
    folder = parent / str(max(numbers, default=0) + 1)
    folder.mkdir()
    return folder

"""Trains a policy for a scenario, one run for each seed, in this process."""

import argparse
from pathlib import Path

from uav_collect.commands import options
from uav_collect.commands.terminal import deferred_interruption, say, say_error
from uav_collect.commands.training_plan import plan_training, TrainingPlan
from uav_collect.errors import DivergedError, InterruptedRunError, TrainingRunError
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import ALGORITHMS, DEVICES, FAILED, MAX_SEED

_DESCRIPTION = """
Trains a policy for a fleet by flying missions of a scenario, or of several in turn, and keeps the
version that did best in fixed validation missions. The run folder holds the policy, all settings,
tables and curves of the training, and a checkpoint: Ctrl-C saves and says how to continue.
"""
_PRESET = 'strong'
_COURSES_PRESET = 'anywhere'
_ALGORITHM = 'aqmix'
_COURSES_ALGORITHM = 'branches'
_MINUTES = 30.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments; what is None was not given."""
    parser.description = _DESCRIPTION
    options.add_scenarios_options(parser)
    parser.add_argument(
        '--courses',
        metavar='NAME|FILE',
        help='learn on courses that are drawn anew all the time, in place of scenarios: anywhere'
        ' or taught (with --algorithm imitation), or a YAML file (with --preset anywhere, or one'
        ' that extends it)',
    )
    add_learning_options(parser)
    options.add_budget_options(parser, _MINUTES, 'how long to train each seed')
    add_checkpoint_option(parser)
    parser.add_argument(
        '--output',
        type=Path,
        metavar='FOLDER',
        help='run folder; of several seeds FOLDER_s0, FOLDER_s1, ...'
        ' (default: runs/train/SCENARIO_nUAVS_ALGORITHM_PRESET_sSEED)',
    )
    parser.add_argument(
        '--resume',
        type=Path,
        metavar='RUN',
        help='go on with an interrupted run, and with the other seeds that were to come',
    )


def add_checkpoint_option(parser: argparse.ArgumentParser) -> None:
    """Add how often a run is saved."""
    parser.add_argument(
        '--checkpoint-minutes',
        type=options.minutes,
        default=5.0,
        metavar='M',
        help='how often to save all that --resume needs (default: %(default)g)',
    )


def add_learning_options(parser: argparse.ArgumentParser) -> None:
    """Add how to learn, and where from; `fill_in` gives them their defaults."""
    parser.add_argument(
        '--algorithm',
        type=options.algorithm(ALGORITHMS),
        metavar='NAME|MODULE:NAME',
        help=f'how it learns: {", ".join(ALGORITHMS)}, or a class of yours'
        f' (default: {_ALGORITHM}; on courses {_COURSES_ALGORITHM})',
    )
    parser.add_argument(
        '--preset',
        metavar='NAME|FILE',
        help='settings of the training: a name that list shows, as strong, paper, refine (to'
        ' go on from a policy), anywhere and imitation (for courses), or a YAML file'
        f' (default: {_PRESET}; of courses {_COURSES_PRESET})',
    )
    options.add_assignments(parser, '--override', 'replace values of the preset')
    parser.add_argument(
        '--start-from',
        '--from',
        metavar='NAME|FILE',
        help='start from the weights of a shipped policy or of a .safetensors file instead of'
        ' random ones',
    )
    parser.add_argument(
        '--seed',
        nargs='+',
        type=options.whole_number(0, MAX_SEED),
        metavar='SEED',
        help='of weights, exploration and missions; several are trained one after another'
        ' (default: 0)',
    )
    parser.add_argument(
        '--device', choices=DEVICES, help='what computes the updates (default: cpu)'
    )


def run(arguments: argparse.Namespace) -> int:
    """Train one run for each seed; returns the exit status."""
    options.check_torch('train')
    if arguments.resume is None:
        fill_in(arguments)
    training = plan_training(arguments)
    _check_device(training.runs[0].record.device)
    status = _train_all(training, arguments.checkpoint_minutes * 60.0)
    if len(training.folders) > 1 and status == 0:
        _draw_together(training)
    return status


def _train_all(training: TrainingPlan, checkpoint_s: float) -> int:
    from uav_collect.commands.training_session import train_with_display

    status = 0
    with deferred_interruption() as interruption:
        for one in training.runs:
            try:
                train_with_display(one, checkpoint_s, interruption)
            except InterruptedRunError as stopped:
                say(str(stopped))
                return interruption.exit_status
            except DivergedError as error:  # the other seeds may do better
                say_error(error)
                status = FAILED
    return status


def fill_in(arguments: argparse.Namespace) -> None:
    """Fill in the defaults of options that were not given."""
    for name, default in (
        ('algorithm', _ALGORITHM if arguments.courses is None else _COURSES_ALGORITHM),
        ('preset', _PRESET if arguments.courses is None else _COURSES_PRESET),
        ('seed', [0]),
        ('device', 'cpu'),
    ):
        if getattr(arguments, name) is None:
            setattr(arguments, name, default)
    if arguments.minutes is None and arguments.decisions is None:
        arguments.minutes = _MINUTES
    if len(set(arguments.seed)) < len(arguments.seed):
        raise TrainingRunError(f'--seed {" ".join(map(str, arguments.seed))}: names one twice')


def _check_device(device: str) -> None:
    with waiting_for('torch to load'):
        import torch
        from uav_collect.learning.learner import keep_freed_memory

    if device == 'cuda' and not torch.cuda.is_available():
        raise TrainingRunError(f'--device cuda: torch {torch.__version__} finds no CUDA device')
    torch.set_num_threads(1)  # measured: more threads on busy cores are several times slower
    keep_freed_memory()


def _draw_together(training: TrainingPlan) -> None:
    """Draw the curve of several seeds beside their folders."""
    from uav_collect.commands.training_session import draw_curve

    first = training.runs[0]
    picture = training.folders[0].with_name(f'{first.record.training}.png')
    table = picture.with_suffix('.csv')
    draw_curve(training.folders, picture, table, title=first.title)
    print(f'curve of {len(training.folders)} seeds: {picture}, {table}')

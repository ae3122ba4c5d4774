"""Flies one mission over ROS 2, every node a process of its own, and shows the result."""

import argparse
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
import json
import os
from pathlib import Path
import subprocess
import time
from typing import TYPE_CHECKING
import uuid

from uav_collect import files
from uav_collect.commands import options, report
from uav_collect.commands.choice_process import ChoiceRequest, started_choice
from uav_collect.commands.live_page import live_page
from uav_collect.commands.ros_processes import (
    check_ros,
    Fleet,
    FleetProcess,
    ros_parameters,
    running_fleet,
)
from uav_collect.commands.terminal import interrupted_by_signals, say, say_reach
from uav_collect.errors import counted, FleetError
from uav_collect.kernels.compile import interpret_kernels
from uav_collect.kernels.patience import repeated_line, waiting_for
from uav_collect.limits import BEST, FAILED, INTERRUPTED
from uav_collect.recording.mission_folder import BAG_FOLDER, log_name, SCENARIO_FILE

if TYPE_CHECKING:  # loaded when flying, so that --help answers at once
    from uav_collect.analysis.choice import Choice
    from uav_collect.scenario.model import Scenario
    from uav_collect.uav.policy import NamedPolicy

_DESCRIPTION = """
Starts recorder, world_sim and one uav_agent per UAV as processes that talk over DDS, shows the
progress of the mission, then its results beside those of rules in the same mission, and
leaves a run folder with the bag, the mission log, the resolved scenario, a picture of the
trajectories, a film for a browser and the output of every process.
"""
_LOOK_S = 0.05
_ANSWER_S = 60.0  # for an agent to decide: one that dies ends the mission at once
_LINE_EVERY_S = 10.0
_RULES = ('hert', 'sweep')  # that every mission is compared with
_RECORDER = 'recorder'  # a mission does without it
_GAP = 'not recorded: '  # before what a recorder names as missing
_MOST_GAPS = 3  # named
_VIEWED_PACE = 10.0  # at which people can follow a mission
_RECORDER_S = 60.0  # how long the recorder may take to close the bag; for messages it waits 30 s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    options.add_scenario_options(parser)
    parser.add_argument(
        '--policy',
        metavar='POLICY',
        default=BEST,
        help='hert, hert-equal, sweep, random, a shipped policy, a .safetensors file, a function'
        ' or class as module:name, lookahead:RULE, strong, the policy shipped for the scenario,'
        ' or best, which of them does best in sampled missions of the scenario'
        ' (default: %(default)s)',
    )
    options.add_candidates_option(parser)
    options.add_seed_option(parser, 'seed of the mission')
    options.add_allocator_option(parser)
    options.add_guard_option(parser)
    options.add_pace_option(parser, f'0, with --view {_VIEWED_PACE:g}')
    parser.add_argument(
        '--view', action='store_true', help='show it in a browser as it flies, until Ctrl-C'
    )
    parser.add_argument(
        '--control',
        action='store_true',
        help='--view, and let the page start, pause, step, abort and pace missions',
    )
    parser.add_argument(
        '--output',
        type=options.output,
        metavar='FOLDER',
        help='run folder (default: runs/TIME_SCENARIO)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Fly the mission; returns the exit status."""
    options.check_candidates(arguments, [arguments.policy])
    scenario = options.scenario_of(arguments)
    environment = dict(os.environ)  # says how kernels run where the policy is chosen
    interpret_kernels()  # all of one mission in this process takes less than to load compiled ones
    policy, choice = arguments.policy, None
    if policy == BEST:
        check_ros()  # rather than after the choice, which takes its time
        choice = _choice(arguments, scenario, environment)
        policy = choice.policy
    flown = _checked_policy(policy, scenario)
    check_ros()
    folder = _make_folder(arguments.output, scenario.name)
    _keep_policy(flown, folder)
    why = '' if choice is None else _keep_choice(choice, folder)
    say(f'{scenario.name}, seed {arguments.seed}, {counted(scenario.n_uavs, "UAV")}: {policy}')
    say_reach(scenario)
    own = {'world_instance': str(uuid.uuid4())}  # who else is in the ROS domain counts for nobody
    if not _is_viewed(arguments):
        return _fly_and_show(folder, scenario, policy, why, own, arguments)
    flags = [*(['--control'] if arguments.control else []), *ros_parameters(**own)]
    try:
        with live_page(folder, scenario.n_uavs + 2, flags) as stay:
            status = _fly_and_show(folder, scenario, policy, why, own, arguments)
            if status != INTERRUPTED:
                stay()
    except KeyboardInterrupt:
        return INTERRUPTED
    except FleetError as error:
        say(f'error: {error}')
        return FAILED
    return status


def _fly_and_show(
    folder: Path,
    scenario: 'Scenario',
    policy: str,
    why: str,
    own: Mapping[str, str],
    arguments: argparse.Namespace,
) -> int:
    """Fly the mission, and show what came of it; the exit status."""
    start_s = time.monotonic()
    try:
        with running_fleet(folder, scenario.n_uavs + 2) as fleet:
            gap = _fly(fleet, folder, scenario, policy, why, own, arguments)
    except KeyboardInterrupt:
        say(f'interrupted; what was flown is in {folder}')
        return INTERRUPTED
    except FleetError as error:
        say(f'error: {error}')
        return FAILED
    say(f'flown in {time.monotonic() - start_s:.1f} s\n')
    if gap:
        say(f'the bag is not whole: {gap}')
    status = _report(folder)
    if status == INTERRUPTED:
        return status
    _compare(folder / log_name(arguments.seed), scenario, arguments.bandwidth)
    return status or int(bool(gap))


def _report(folder: Path) -> int:
    """Show the mission that was flown, and leave its picture and film; the exit status."""
    shown = {'readings': False, 'csv': None, 'gif': None, 'mp4': None, 'html': True}
    try:
        return report.show_missions(argparse.Namespace(path=folder, pictures=None, **shown))
    except KeyboardInterrupt:
        again = f'"report {folder} --html" makes them again'
        say(f'interrupted; the mission is recorded, its picture or its film is missing: {again}')
        return INTERRUPTED


def _choice(
    arguments: argparse.Namespace, scenario: 'Scenario', environment: Mapping[str, str]
) -> 'Choice':
    """Let candidates fly sampled missions, show what came of it; who is to fly.

    Raises:
        PolicyMismatchError: a candidate that the user names cannot fly.
    """
    from uav_collect.uav.own_policy import own_policies

    request = ChoiceRequest(
        scenario=scenario.to_yaml(),
        candidates=arguments.candidates,
        allocator=arguments.bandwidth,
        guard_after=arguments.guard_after,
        own=tuple(own_policies(arguments.scenario, scenario.n_uavs)),
    )
    with interrupted_by_signals(), started_choice(request, environment) as answer:
        from uav_collect.analysis.console import plain_console

        with waiting_for('candidates that fly sampled missions'):
            choice, left_out = answer()
    for line in left_out:
        say(line)
    plain_console().print(f'{choice}\n', soft_wrap=True)
    return choice


def _checked_policy(name: str, scenario: 'Scenario') -> 'NamedPolicy':
    """A policy, and a word of what whoever flies it should know of it.

    Raises:
        PolicyMismatchError: it does not fit.
    """
    from uav_collect.uav.policy import policy_for, remarks

    policy = policy_for(name, scenario)
    for line in remarks(policy, scenario):
        say(line)
    return policy


def _keep_choice(choice: 'Choice', folder: Path) -> str:
    """Leave the choice in the run folder; why its policy flies."""
    from uav_collect.analysis.choice_file import keep_choice

    keep_choice(choice, folder)
    return choice.why


def _keep_policy(policy: 'NamedPolicy', folder: Path) -> None:
    """Leave a learned policy in the run folder, so that the mission can be flown again."""
    from uav_collect.uav.policy_file import save_policy, SUFFIX
    from uav_collect.uav.policy_network import LearnedPolicy

    if isinstance(policy, LearnedPolicy):
        save_policy(folder / f'{policy.name}{SUFFIX}', policy.frozen)


def _compare(log: Path, scenario: 'Scenario', bandwidth: str) -> None:
    """Show the mission's figures beside those of rules, flown here in the same mission."""
    from uav_collect.analysis.console import plain_console
    from uav_collect.analysis.metrics import mission_metrics
    from uav_collect.analysis.tables import comparison_table
    from uav_collect.missions.rollout import fly
    from uav_collect.recording.mission_log import read
    from uav_collect.scenario.site import build_site

    try:
        flown = read(log)
        name, seed = flown.header.uavs[0].policy, flown.header.mission_seed
        missions, site = {name: mission_metrics(flown)}, build_site(scenario)
        for rule in _RULES:
            if rule != name:
                [other] = fly(site, [seed], rule, bandwidth)
                missions[rule] = mission_metrics(other)
        bound = report.mission_bound(flown.header, site)
        console = plain_console()
        console.print(comparison_table(missions, bound, console.width))
        [as_planned] = fly(site, [seed], _RULES[0], bandwidth)
        planned = {(fault.uav, fault.fault) for fault in as_planned.faults}
        if any((fault.uav, fault.fault) not in planned for fault in flown.faults):
            say('faults were injected; the rules and the clairvoyant plan are without them')
    # Whatever it is: the mission itself was flown, recorded and reported.
    except Exception as error:
        say(f'the mission could not be compared with rules: {error}')
    except KeyboardInterrupt:
        say('interrupted; the mission is not compared with rules')


def _fly(
    fleet: Fleet,
    folder: Path,
    scenario: 'Scenario',
    policy: str,
    why: str,
    own: Mapping[str, str],
    arguments: argparse.Namespace,
) -> str:
    """Fly the mission; what its recording lacks, in words, or nothing."""
    scenario_file = folder / SCENARIO_FILE
    files.write_atomically(scenario_file, scenario.to_yaml().encode())
    recorder = fleet.start(
        'recorder',
        _RECORDER,
        [
            '--output',
            str(folder / BAG_FOLDER),
            *ros_parameters(stop_after_missions=1, choice=why, **own),
        ],
        ends_last=True,
    )
    world = fleet.start(
        'world_sim',
        'world_sim',
        ros_parameters(
            scenario=scenario_file,
            seed=arguments.seed,
            output_dir=folder,
            real_time_factor=_pace_of(arguments),
            decision_timeout_s=_ANSWER_S,
            recorders=1,
            **own,
        ),
    )
    for uav in range(1, scenario.n_uavs + 1):
        flags = ['--id', str(uav), '--policy', policy, '--bandwidth', arguments.bandwidth]
        flags += ['--guard-after', str(arguments.guard_after), *ros_parameters(**own)]
        fleet.start('uav_agent', f'uav_{uav}', flags)
    _follow(fleet, world, folder / log_name(arguments.seed))
    return _gap_after(recorder)


def _pace_of(arguments: argparse.Namespace) -> float:
    """Simulated over wall-clock time, as wanted, or so that who looks can follow."""
    if arguments.real_time_factor is not None:
        return float(arguments.real_time_factor)
    return _VIEWED_PACE if _is_viewed(arguments) else 0.0


def _is_viewed(arguments: argparse.Namespace) -> bool:
    return bool(arguments.view or arguments.control)


def _follow(fleet: Fleet, world: FleetProcess, log: Path) -> None:
    """Show the progress by the growing mission log, until the world has ended."""
    from rich.progress import BarColumn, Progress
    from uav_collect.analysis.console import plain_column, plain_console

    phase, line = plain_column('{task.fields[phase]}'), plain_column('{task.description}')
    console, said = plain_console(stderr=True), 'starting'
    lines = (
        nullcontext()
        if console.is_terminal
        else repeated_line(lambda _: said, every_s=_LINE_EVERY_S)
    )
    bar = Progress(
        phase, BarColumn(), line, console=console, transient=True, disable=not console.is_terminal
    )
    with lines, bar as progress:
        task = progress.add_task('', total=1.0, phase='starting')
        for share, said in _progress(world, log):
            progress.update(task, completed=share, description=said, phase='flying')
            fleet.check(but=_RECORDER)
            time.sleep(_LOOK_S)
    fleet.check(but=_RECORDER)


def _progress(world: FleetProcess, log: Path) -> Iterator[tuple[float, str]]:
    """Share of the data collected, and a line about it, as the log grows."""
    while not log.exists():
        if world.popen.poll() is not None:
            return
        yield 0.0, 'waiting for the fleet'
    total_bit = collected_bit = 0.0
    n_events = 0
    with log.open(encoding='utf-8') as lines:
        pending, time_s = '', 0.0
        while True:
            has_ended = world.popen.poll() is not None
            pending += lines.read()
            *whole, pending = pending.split('\n')
            for record in map(json.loads, whole):
                total_bit = record.get('total_bit', total_bit)
                collected_bit += record.get('collected_bit', 0.0)
                time_s = record.get('time_s', time_s)
                n_events += 'action' in record
            share = collected_bit / total_bit if total_bit else 0.0
            yield share, f'{share:.0%} of the data, {n_events} events, {time_s:.0f} s simulated'
            if has_ended:
                return


def _gap_after(recorder: FleetProcess) -> str:
    """What the recording lacks when its recorder has ended, in words, or nothing."""
    try:
        with waiting_for('the recorder to close the bag'):
            status = recorder.popen.wait(_RECORDER_S)
    except subprocess.TimeoutExpired:
        return f'the recorder did not close it within {_RECORDER_S:g} s'
    if status == 0:
        return ''
    lines = recorder.log_lines()
    gaps = [line.partition(_GAP)[2] for line in lines if _GAP in line]
    if not gaps:
        return f'the recorder failed with exit status {status}{recorder.log_tail()}'
    more = f' and {len(gaps) - _MOST_GAPS} more' if len(gaps) > _MOST_GAPS else ''
    return f'{"; ".join(gaps[:_MOST_GAPS])}{more}'


def _make_folder(wanted: Path | None, scenario_name: str) -> Path:
    folder = wanted or Path('runs') / f'{time.strftime("%Y-%m-%d_%H-%M-%S")}_{scenario_name}'
    folder.mkdir(parents=True)
    return folder

"""One run of the command refine: where it starts from, what it says, and what it keeps."""

import argparse
from pathlib import Path

from uav_collect.analysis.against_rules import better_rule
from uav_collect.analysis.metrics import percent
from uav_collect.commands import options
from uav_collect.commands.terminal import deferred_interruption, Interruption, say_error
from uav_collect.errors import DivergedError, PolicyMismatchError
from uav_collect.kernels.patience import waiting_for
from uav_collect.learning.refinement import (
    Attempt,
    compute_as_trainings_do,
    PRESETS,
    refinement,
    start_for,
    Trials,
    why_no_start,
)
from uav_collect.learning.trainer import Trainer
from uav_collect.limits import FAILED
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import load_preset, TrainingConfig
from uav_collect.training.progress import Budget
from uav_collect.training.time_left import minutes_text
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.own_policy import own_policies
from uav_collect.uav.policy import frozen_policy, shipped_policies
from uav_collect.uav.policy_file import load_policy, save_policy
from uav_collect.uav.policy_network import FrozenPolicy

_PRESET_FROM_NOTHING = 'field_anywhere'
_FROM_NOTHING = 'from nothing: no policy that is there has a network for this fleet'
_N_CHOOSING, _N_JUDGING = 100, 200  # missions
_TELL_EVERY_S = 60.0


def refine(arguments: argparse.Namespace, scenario: Scenario, output: Path) -> int:
    """Learn a scenario on, into a file; returns the exit status.

    Args:
        arguments: those of the command.
    """
    compute_as_trainings_do()
    trials = Trials(build_site(scenario), _N_CHOOSING, _N_JUDGING)
    _tell_rules(scenario, trials)
    with waiting_for('policies to fly the field'):
        start, known = _start(arguments, scenario, trials), _known(output, scenario, trials)
    print(f'from {start.name}: {_standing(trials, start)}' if start else _FROM_NOTHING, flush=True)
    print('learning; a line follows each minute', flush=True)
    best = max((it for it in (start, known) if it is not None), key=_rank, default=None)
    with deferred_interruption() as interruption:
        try:
            trainer = _trainer(arguments, scenario, start)
            kept = _refine(arguments, trainer, trials, best, output, interruption)
        except DivergedError as error:
            say_error(error)
            return FAILED
    _report(trials, kept, best, output)
    return 0 if interruption.signal_number is None else interruption.exit_status


def _tell_rules(scenario: Scenario, trials: Trials) -> None:
    means = [f'{name} {flown.mean_kbit_per_j:.3f}' for name, flown in trials.rules.items()]
    fleet = f'{scenario.n_uavs} UAV{"s" if scenario.n_uavs > 1 else ""}'
    print(
        f'{scenario.name}, {fleet}: {", ".join(means)} kbit/J in {_N_JUDGING} missions', flush=True
    )


def _start(arguments: argparse.Namespace, scenario: Scenario, trials: Trials) -> Attempt | None:
    """What to learn on from: what the user names, or else what flies the field best; if any does.

    Raises:
        PolicyMismatchError: the one that the user names has another network.
    """
    given: str | None = arguments.start_from
    own = own_policies(arguments.scenario, scenario.n_uavs)
    names = [given] if given is not None else [*own, *shipped_policies()]
    found = [
        tried
        for name in names
        if (tried := _tried(name, frozen_policy(name), scenario, trials)) is not None
    ]
    if given is not None and not found:
        raise PolicyMismatchError(
            f'--start-from {given}: {why_no_start(frozen_policy(given), scenario)}'
        )
    return max(found, key=_rank, default=None)


def _known(output: Path, scenario: Scenario, trials: Trials) -> Attempt | None:
    """What the file holds already, which only a better one replaces.

    Raises:
        PolicyMismatchError: it is no policy that could fly the field.
    """
    if not output.is_file():
        return None
    tried = _tried(str(output), load_policy(output), scenario, trials)
    if tried is None:
        raise PolicyMismatchError(f'{output}: is of another network: choose another --output')
    return tried


def _tried(name: str, policy: FrozenPolicy, scenario: Scenario, trials: Trials) -> Attempt | None:
    start = start_for(policy, scenario)
    return None if start is None else trials.tried(name, start)


def _rank(tried: Attempt) -> tuple[float, float]:
    return tried.rank


def _config(arguments: argparse.Namespace, start: Attempt | None) -> TrainingConfig:
    """How to learn on from a policy; from nothing, if there is none."""
    overrides = options.overrides_of(arguments.override)
    if start is None:
        return load_preset(_PRESET_FROM_NOTHING, overrides)
    header = start.policy.header
    network: dict[str, object] = {'network.hidden_size': header.hidden_size}
    if header.layout.adviser != NONE:
        network['network.advice_bonus'] = header.advice_bonus
    return load_preset(PRESETS[header.layout.base], {**network, **overrides})


def _trainer(arguments: argparse.Namespace, scenario: Scenario, start: Attempt | None) -> Trainer:
    initial = None if start is None else start.policy
    with waiting_for('the replay and the first missions to begin'):
        config = _config(arguments, start)
        algorithm = 'aqmix' if config.branches is None else 'branches'
        trainer = Trainer([scenario], config, algorithm, arguments.seed, initial=initial)
        trainer.warm_up()
    return trainer


def _refine(
    arguments: argparse.Namespace,
    trainer: Trainer,
    trials: Trials,
    best: Attempt | None,
    output: Path,
    interruption: Interruption,
) -> Attempt | None:
    """Learn on, and keep what is better than the best so far; what is kept in the end."""
    budget = Budget(minutes=arguments.minutes, decisions=arguments.decisions)
    kept: Attempt | None = None
    said, said_s = best, 0.0
    standing = 'none' if best is None else _standing(trials, best)
    for step in refinement(trainer, trials, best, budget, interruption.acknowledge):
        if step.is_better and step.best is not None:
            kept = step.best
            save_policy(output, kept.policy)
        if step.trained_s - said_s >= _TELL_EVERY_S:
            news = 'nothing better than ' if step.best is said else ''
            if step.best is not None and step.best is not said:
                said, standing = step.best, _standing(trials, step.best)
            said_s = step.trained_s
            n_decisions = f'{step.n_decisions:,} decisions'
            print(f'{minutes_text(said_s)}: {news}{standing}, {n_decisions}', flush=True)
        if step.has_stalled:
            print(f'{minutes_text(step.trained_s)}: a quarter of the time brought nothing better')
    return kept


def _standing(trials: Trials, tried: Attempt) -> str:
    """How a policy stands to the better rule, in missions that nothing is chosen by."""
    flown, standing = trials.judged(tried.policy)
    rule = better_rule(trials.rules)
    percent_of = 100.0 / trials.rules[rule].mean_kbit_per_j
    mean, low, high = (
        f'{percent_of * value:+.1f}'
        for value in (standing.difference.mean, standing.difference.low, standing.difference.high)
    )
    complete = flown.n_complete / flown.metrics.n_missions
    left = f', {percent(complete)} complete' if complete < 1.0 else ''
    return f'{flown.mean_kbit_per_j:.3f} kbit/J, {mean} % ({low} to {high}) beside {rule}{left}'


def _report(trials: Trials, kept: Attempt | None, best: Attempt | None, output: Path) -> None:
    """Say what came of it."""
    if kept is None:
        than = 'nothing' if best is None else best.name
        print(f'nothing better than {than} came: no file is written')
        return
    print(f'policy: {output}: {_standing(trials, kept)}')

"""Averages the weights of policies that learned one from another, into one policy of some courses.

python tools/average_policies.py OUTPUT FILE[=WEIGHT] FILE[=WEIGHT] ... [--courses NAME|FILE]

What trainings that go on from each other forget and learn anew cancels out in their mean (Wortsman
et al., Model soups, 2022). The policy has the domains of the courses and is validated in their
panel; all else in its header is the last file's.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
import math
from pathlib import Path
import sys

import numpy as np
from uav_collect.commands import options, terminal
from uav_collect.errors import ConfigError, PolicyMismatchError
from uav_collect.learning.headers import check_same_network, header_validation, learned_on_courses
from uav_collect.learning.validation import PanelValidator
from uav_collect.limits import UNUSABLE
from uav_collect.training.courses import Courses, load_courses
from uav_collect.training.progress import ValidationResult
from uav_collect.uav.policy_file import load_policy, save_policy
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy, weights_digest

_N_MISSIONS = 16  # in each condition of the panel


def averaged(policies: Sequence[FrozenPolicy], shares: Sequence[float]) -> FrozenPolicy:
    """The policy of mean weights, with the last one's header.

    Args:
        shares: of each policy in the mean, up to a factor.

    Raises:
        PolicyMismatchError: their networks differ.
    """
    last, parts = policies[-1], np.array(shares) / sum(shares)
    for policy in policies:
        if policy.header.n_networks > 1:
            raise PolicyMismatchError(
                f'{policy.header.version}: has several networks: must be one'
            )
        check_same_network(policy, last.header)
    weights = {
        name: np.einsum('p,p...->...', parts, [it.weights[name] for it in policies])
        for name in last.weights
    }
    return FrozenPolicy(last.header, {key: it.astype(np.float32) for key, it in weights.items()})


def of_courses(policy: FrozenPolicy, courses: Courses, n_missions: int) -> FrozenPolicy:
    """A policy as one that learned on courses: with their domains, validated in their panel."""
    learned = learned_on_courses(courses.distribution)
    digest = weights_digest(policy.weights)[:8]
    header = replace(
        policy.header,
        version=f'{learned.run}_mean-{digest}',
        **learned.header_fields,
    )
    validator = PanelValidator(courses.panel, n_missions, learned)
    pilot = LearnedPolicy('mean', FrozenPolicy(header, policy.weights))
    result = ValidationResult(
        n_decisions=header.decisions, n_updates=header.updates, wall_s=0.0,
        **validator.measured(pilot, None),
    )  # fmt: skip
    validation = header_validation(result, validator.n_missions)
    return FrozenPolicy(replace(header, validation=validation), policy.weights)


def _weighted(text: str) -> tuple[Path, float]:
    """A file and what it weighs in the mean, 1 if that is not said."""
    name, _, said = text.rpartition('=')
    if not name or Path(text).is_file():
        return Path(text), 1.0
    try:
        weight = float(said)
    except ValueError:
        weight = math.nan
    if not (weight > 0.0 and math.isfinite(weight)):
        raise argparse.ArgumentTypeError(f'{name}={said}: the weight must be a number above 0')
    return Path(name), weight


def main(words: Sequence[str] | None = None) -> int:
    """Write the mean; returns the exit status."""
    parser = argparse.ArgumentParser(description='Averages the weights of policies.')
    parser.add_argument('output', type=options.output)
    parser.add_argument('files', nargs='+', type=_weighted, metavar='FILE[=WEIGHT]')
    parser.add_argument('--courses', default='taught', metavar='NAME|FILE')
    arguments = parser.parse_args(words)
    try:
        policies = [load_policy(path) for path, _ in arguments.files]
        mean = averaged(policies, [weight for _, weight in arguments.files])
        options.check_outputs(arguments.output)  # before missions are flown
        policy = of_courses(mean, load_courses(arguments.courses), _N_MISSIONS)
        save_policy(arguments.output, policy)
    except (ConfigError, PolicyMismatchError, OSError) as error:
        terminal.say_error(error)
        return UNUSABLE
    print(f'{policy.header.version}: {policy.header.validation}')
    return 0


if __name__ == '__main__':
    sys.exit(main())

"""Joins policies that decide in different domains into one of several networks.

python tools/join_policies.py OUTPUT FILE FILE [FILE ...] [--panel NAME|FILE]

Each file has one network, and domains in which it decides. Where domains overlap, the network of
the file that is named first decides. The joint policy is validated in the panel; of its decisions
and updates there are as many as of all files together, and all else in its header is the first
file's.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import sys

from uav_collect.commands import options, terminal
from uav_collect.errors import ConfigError, PolicyMismatchError
from uav_collect.learning.headers import check_same_network, header_validation, Learned
from uav_collect.learning.validation import PanelValidator
from uav_collect.limits import UNUSABLE
from uav_collect.training.panel import load_panel, Panel
from uav_collect.training.progress import ValidationResult
from uav_collect.uav.operating_domain import MAX_NETWORKS
from uav_collect.uav.policy_file import load_policy, save_policy
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy, weights_digest

_N_MISSIONS = 16  # in each condition of the panel


def joined(policies: Sequence[FrozenPolicy]) -> FrozenPolicy:
    """The policy of all networks, each in its own domains.

    Raises:
        PolicyMismatchError: one has no domains, or their networks differ in kind.
    """
    first = policies[0].header
    if not 2 <= len(policies) <= MAX_NETWORKS:
        raise PolicyMismatchError(f'policies are {len(policies)}: must be 2 to {MAX_NETWORKS}')
    for policy in policies:
        header = policy.header
        if header.n_networks > 1:
            raise PolicyMismatchError(
                f'{header.version}: has {header.n_networks} networks: must be one'
            )
        check_same_network(policy, first)
        if not header.domains:
            raise PolicyMismatchError(f'{header.version}: has no domains: it would fly everywhere')
        if header.advice_bonus != first.advice_bonus:
            raise PolicyMismatchError(
                f'{header.version}: advice_bonus is {header.advice_bonus:g}: must be'
                f' {first.advice_bonus:g}, as of the first'
            )
    parts = [*enumerate(policies, start=1)]
    header = replace(
        first,
        domains=tuple(
            replace(it, network=number) for number, each in parts for it in each.header.domains
        ),
        cells_per_side_min=min(each.header.cells_per_side_min for each in policies),
        cells_per_side_max=max(each.header.cells_per_side_max for each in policies),
        n_uavs_min=min(each.header.n_uavs_min for each in policies),
        n_uavs_max=max(each.header.n_uavs_max for each in policies),
        learned_within=tuple(
            dict.fromkeys(it for each in policies for it in each.header.learned_within)
        ),
        decisions=sum(each.header.decisions for each in policies),
        updates=sum(each.header.updates for each in policies),
    )
    weights = {
        f'{number}/{name}': tensor
        for number, each in parts
        for name, tensor in each.weights.items()
    }
    version = f'{first.scenario}_joint-{weights_digest(weights)[:8]}'
    return FrozenPolicy(replace(header, version=version), weights)


def validated_in(policy: FrozenPolicy, panel: Panel, n_missions: int) -> FrozenPolicy:
    """A policy with what it achieves in the conditions of a panel."""
    header = policy.header
    learned = Learned(
        run=header.scenario,
        scenario=header.scenario,
        fingerprint=header.fingerprint,
        cells_per_side=(header.cells_per_side_min, header.cells_per_side_max),
        n_uavs=(header.n_uavs_min, header.n_uavs_max),
    )
    validator = PanelValidator(panel, n_missions, learned)
    result = ValidationResult(
        n_decisions=header.decisions, n_updates=header.updates, wall_s=0.0,
        **validator.measured(LearnedPolicy('joint', policy), None),
    )  # fmt: skip
    validation = header_validation(result, validator.n_missions)
    return FrozenPolicy(replace(header, validation=validation), policy.weights)


def main(words: Sequence[str] | None = None) -> int:
    """Write the joint policy; returns the exit status."""
    parser = argparse.ArgumentParser(description='Joins policies of different domains into one.')
    parser.add_argument('output', type=options.output)
    parser.add_argument('files', nargs='+', type=Path, metavar='FILE')
    parser.add_argument('--panel', default='anywhere', metavar='NAME|FILE')
    arguments = parser.parse_args(words)
    try:
        joint = joined([load_policy(file) for file in arguments.files])
        options.check_outputs(arguments.output)  # before missions are flown
        policy = validated_in(joint, load_panel(arguments.panel), _N_MISSIONS)
        save_policy(arguments.output, policy)
    except (ConfigError, PolicyMismatchError, OSError) as error:
        terminal.say_error(error)
        return UNUSABLE
    print(f'{policy.header.version}: {policy.header.validation}')
    return 0


if __name__ == '__main__':
    sys.exit(main())

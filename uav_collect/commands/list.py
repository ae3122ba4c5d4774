"""Shows what there is to choose from: scenarios, policies, presets of trainings, scales."""

import argparse
from collections.abc import Iterator, Mapping
from textwrap import shorten

_DESCRIPTION = """
Lists what comes with the package, one per line: scenarios (--scenario), policies (--policy),
presets of trainings (--preset) and scales of the paper's figures (--scale). In place of each, the
options also take the path of a file of your own.
"""
_COLUMNS = 80  # of a line
# What else --policy takes: rules, and words that stand for one of all.
_RULES = {
    'best': 'whichever does best in sampled missions of the scenario',
    'strong': 'the learned policy that is shipped for the scenario',
    'sweep': 'the UAVs share a tour from which they see every cell',
    'hert': "the paper's rule: each UAV visits the cells of its part",
    'hert-equal': 'the same with parts of equal size',
    'random': 'any legal action',
}
_OWN = {
    'lookahead:RULE': 'a rule that tries what may follow before it acts',
    'module:name': 'a function or class of your own',
    'FILE.safetensors': 'a policy that you have trained',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, which takes no arguments."""
    parser.description = _DESCRIPTION


def run(arguments: argparse.Namespace) -> int:
    """Print the tables; returns the exit status."""
    from uav_collect.config.installed import shared_folders
    from uav_collect.config.layers import titles_in

    tables: dict[str, Mapping[str, str]] = {
        'scenarios (--scenario)': titles_in(shared_folders('scenarios')),
        'policies (--policy)': {**_RULES, **dict(_learned()), **_OWN},
        'presets of trainings (--preset)': titles_in(shared_folders('training')),
        'scales of the figures (--scale)': titles_in(shared_folders('studies')),
    }
    for kind, table in tables.items():
        width = max(map(len, table), default=0)
        print(f'{kind}:')
        for name, line in table.items():
            room = _COLUMNS - width - 4
            print(f'  {name:{width}}  {shorten(line, room, placeholder="...")}'.rstrip())
    return 0


def _learned() -> Iterator[tuple[str, str]]:
    """Each shipped policy, and what it learned on."""
    from uav_collect.uav.policy import frozen_policy, shipped_policies

    for name in shipped_policies():
        header = frozen_policy(name).header
        least, most = header.n_uavs_min, header.n_uavs_max
        uavs = f'{least} UAV' if least == most else f'{least} to {most} UAV'
        learned = f'{header.algorithm} on {header.scenario}, {uavs}{"s" if most > 1 else ""}'
        yield name, f'{learned}, {header.decisions:,} decisions'

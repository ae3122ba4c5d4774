"""Compares learners by what they come to after as many decisions each.

python bench/learners.py [--decisions N] [--seeds N] [--only NAME ...] [--quick]

Each learner trains with the preset strong on paper_10x10, in this process on one thread, once for
each seed; its policy that validated best then flies missions that nothing was learned or chosen
by, with equal bandwidth and without a guard. VDN and QFIX are users' mixers, `examples/vdn.py` and
`examples/qfix.py`. The interval is that of the mean over all missions of all seeds (bootstrap,
95 %); with few seeds it says nothing of other seeds, so the seeds' own means stand beside it.
QMIX's missions take longer, as its UAVs wait for each other: as many decisions are fewer missions.
With --quick the fleet flies a tiny area, to see that all of it runs. Ctrl-C ends it with the
learners that were done. It takes hours: `make bench` leaves it out.
"""

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
import sys
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
import torch
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.analysis.statistics import Estimate, estimates, mission_seeds
from uav_collect.learning.learner import keep_freed_memory
from uav_collect.learning.trainer import Trainer
from uav_collect.missions.rollout import fly
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import load_preset
from uav_collect.training.progress import Budget
from uav_collect.training.seeds import VALIDATION_SEED
from uav_collect.uav.policy_network import LearnedPolicy

EXAMPLES = Path(__file__).resolve().parents[1] / 'examples'
HELD_OUT_SEED = VALIDATION_SEED + 2**32
DECISIONS, N_SEEDS, N_MISSIONS = 1_000_000, 3, 300
LEARNERS = {  # algorithm, and the mixer if it is not the usual one
    'AQMIX': ('aqmix', None),
    'QMIX': ('qmix', None),
    'AIQL': ('aiql', None),
    'VDN': ('aqmix', 'vdn:Vdn'),
    'QFIX': ('aqmix', 'qfix:QFix'),
}
RULES = ('hert', 'sweep')
QUICK = {
    'network.hidden_size': 8, 'mixer.embedding_size': 4, 'mixer.hypernetwork_size': 6,
    'replay.decisions': 2000, 'replay.missions_per_batch': 4, 'rollout.missions_at_once': 4,
    'validation.missions': 2, 'validation.every_updates': 10,
}  # fmt: skip


class Plan(NamedTuple):
    """What is measured."""

    scenario: Scenario
    settings: dict[str, object]  # of the preset, by dotted path
    n_decisions: int
    n_seeds: int
    n_missions: int  # held out


class Learned(NamedTuple):
    """What one training came to."""

    trained_s: float  # validations left out
    n_decisions: int
    n_updates: int
    validated_kbit_per_j: float  # of the best policy
    held_out: list[MissionMetrics]


def learn(plan: Plan, algorithm: str, mixer: str | None, seed: int) -> Learned:
    """Train once, and fly what came of it in the held-out missions."""
    own = {} if mixer is None else {'mixer.kind': mixer}
    config = load_preset('strong', {**plan.settings, **own})
    trainer = Trainer([plan.scenario], config, algorithm, seed)
    trainer.warm_up()
    *_, last = trainer.run(Budget(decisions=plan.n_decisions))
    best = trainer.best_policy() or trainer.policy()
    return Learned(
        trained_s=last.wall_s,
        n_decisions=trainer.n_decisions,
        n_updates=trainer.n_updates,
        validated_kbit_per_j=best.header.validation.efficiency_kbit_per_j,
        held_out=flown(plan, LearnedPolicy('best', best)),
    )


def flown(plan: Plan, policy: LearnedPolicy | str) -> list[MissionMetrics]:
    """The held-out missions, by a policy."""
    site, seeds = build_site(plan.scenario), mission_seeds(HELD_OUT_SEED, plan.n_missions)
    by = policy if isinstance(policy, str) else lambda: policy
    return [mission_metrics(log) for log in fly(site, seeds, by, 'equal', 0)]


def row_of_learner(name: str, runs: list[Learned]) -> tuple[str, ...]:
    """A learner's line of the table: means over its seeds."""
    held_out = [mission for run in runs for mission in run.held_out]
    own = ' '.join(f'{_efficiency(run.held_out).mean:.3f}' for run in runs)
    return (
        name,
        f'{np.mean([run.trained_s for run in runs]):,.0f}',
        f'{np.mean([run.n_decisions for run in runs]):,.0f}',
        f'{np.mean([run.n_updates for run in runs]):,.0f}',
        f'{np.mean([run.validated_kbit_per_j for run in runs]):.3f}',
        *_result(held_out),
        own,
    )


def row_of_rule(name: str, missions: list[MissionMetrics]) -> tuple[str, ...]:
    """A rule's line, which learns nothing."""
    return name, *([''] * 4), *_result(missions), ''


def _result(missions: list[MissionMetrics]) -> tuple[str, ...]:
    mean = _efficiency(missions)
    complete = np.mean([mission.is_complete for mission in missions])
    return f'{mean.mean:.3f}', f'{mean.low:.3f} to {mean.high:.3f}', f'{complete:.1%}'


def _efficiency(missions: list[MissionMetrics]) -> Estimate:
    return estimates(missions, HELD_OUT_SEED)[0]


def rows(plan: Plan, names: list[str], console: Console) -> Iterator[tuple[str, ...]]:
    """The table, line by line; what is being done is said meanwhile."""
    for rule in RULES:
        yield row_of_rule(rule, flown(plan, rule))
    for name in names:
        runs = []
        for seed in range(plan.n_seeds):
            console.print(f'{name}, seed {seed}: {plan.n_decisions:,} decisions', style='dim')
            runs.append(learn(plan, *LEARNERS[name], seed))
        yield row_of_learner(name, runs)


def plan_of(arguments: Namespace) -> Plan:
    """What the command line asks for."""
    if not arguments.quick:
        sizes = arguments.decisions, arguments.seeds, N_MISSIONS
        return Plan(load('paper_10x10'), {}, *sizes)
    scenario = load('paper_8x8', {'area.cells_per_side': 4, 'fleet.default.energy_budget_kj': 40})
    return Plan(scenario, dict(QUICK), 2000, 1, 10)


def parse_arguments() -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--decisions', type=int, default=DECISIONS, help='(%(default)s)')
    parser.add_argument('--seeds', type=int, default=N_SEEDS, help='(%(default)s)')
    parser.add_argument('--only', nargs='+', choices=LEARNERS, default=[*LEARNERS])
    parser.add_argument('--quick', action='store_true', help='a tiny area, to see that all runs')
    return parser.parse_args()


def main() -> None:
    """Measure and print."""
    arguments = parse_arguments()
    sys.path.append(str(EXAMPLES))
    torch.set_num_threads(1)
    keep_freed_memory()
    plan = plan_of(arguments)
    table = Table(
        title=f'{plan.scenario.name}, {plan.scenario.n_uavs} UAVs, strong: after'
        f' {plan.n_decisions:,} decisions, {plan.n_seeds} seeds',
        caption=f'{plan.n_missions} held-out missions for each seed, equal bandwidth, no guard;'
        ' kbit/J with the 95 % interval of the mean over missions',
    )
    table.add_column('learner')
    for heading in (
        'training s', 'decisions', 'updates', 'validated', 'held out', 'interval', 'complete',
        'by seed',
    ):  # fmt: skip
        table.add_column(heading, justify='right')
    with suppress(KeyboardInterrupt):
        for row in rows(plan, arguments.only, Console(stderr=True)):
            table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else 132).print(table)


if __name__ == '__main__':
    main()

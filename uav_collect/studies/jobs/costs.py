"""What jobs take: what those took that are done, and what that says of the others."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache

from uav_collect.learning.replay import replay_bytes
from uav_collect.scenario.load import from_yaml
from uav_collect.studies.jobs.jobs import FlightsJob, Job, job_config, job_kind, TrainingJob
from uav_collect.studies.jobs.store import Store
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import observation_size
from uav_collect.uav.policy_header import weight_shapes

_ROW_BYTES = 150  # of a CSV
_FOLDER_BYTES = 20_000  # job.json with its scenario, cost.json, blocks of the disk
_H_PER_S = 1.0 / 3600.0


@dataclass
class SpentCost:
    """What the jobs that are done took, in all."""

    n_jobs: Counter[str] = field(default_factory=Counter)  # by kind
    cpu_s: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    units: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    n_interrupted: int = 0
    revisions: Counter[str] = field(default_factory=Counter)

    def text(self) -> str:
        """For people: how many jobs, how many core-hours, of which revision."""
        parts = [
            f'{n} {kind} jobs in {self.cpu_s[kind] * _H_PER_S:.2f} core-hours'
            for kind, n in sorted(self.n_jobs.items(), reverse=True)
        ]
        revisions = ', '.join(sorted(self.revisions)) or 'none'
        hours = sum(self.cpu_s.values()) * _H_PER_S
        return (
            f'{"; ".join(parts)}; {hours:.2f} core-hours in all, {self.n_interrupted} jobs went on'
            f' from a checkpoint; revision {revisions}'
        )


def units_of(job: Job) -> float:
    """How large a job is among those of its kind, roughly: decisions to learn from, or missions.

    A decision counts as many cells as the mixer's state has: measured, learning from one takes 2.3
    times as long on 15 x 15 cells as on 10 x 10.
    """
    if isinstance(job, TrainingJob):
        return float(job.decisions * _n_cells(job.scenario))
    return float(job.n_missions)


@cache
def _n_cells(scenario: str) -> int:
    return from_yaml(scenario).n_cells


def spent_cost(jobs: Mapping[str, Job], store: Store) -> SpentCost:
    """Add up what the jobs took that are done."""
    total = SpentCost()
    for digest, job in jobs.items():
        if store.has(digest):
            cost, kind = store.cost(digest), job_kind(job)
            total.n_jobs[kind] += 1
            total.cpu_s[kind] += cost.cpu_s
            total.units[kind] += units_of(job)
            total.n_interrupted += cost.n_interruptions > 0
            total.revisions[cost.revision] += 1
    return total


@dataclass(frozen=True, kw_only=True)
class Rates:
    """What a unit of each kind of job takes, to estimate the cost of others."""

    cpu_s: Mapping[str, float]  # by kind; a kind that is missing counts as nothing
    source: str  # for people: where they are from

    def cost_s(self, job: Job) -> float:
        """What a job is expected to take [s of one core]."""
        return units_of(job) * self.cpu_s.get(job_kind(job), 0.0)


# To weigh jobs against each other where nothing is known yet; no figure of any result.
GUESSED_RATES = Rates(cpu_s={'training': 2e-6, 'flights': 1e-2, 'plans': 1e-2}, source='guessed')


def rates_of(done: SpentCost) -> Rates | None:
    """What done jobs say; None where no training is done."""
    if not done.units['training']:
        return None
    cpu_s = {kind: done.cpu_s[kind] / units for kind, units in done.units.items() if units}
    return Rates(cpu_s=cpu_s, source=f'from {done.n_jobs.total()} jobs that are done')


def disk_bytes(jobs: Iterable[Job], n_slots: int) -> tuple[int, int]:
    """What results take on the disk, and states of trainings that run at once, at most."""
    results, states = 0, [0]
    for job in jobs:
        results += _FOLDER_BYTES
        if isinstance(job, TrainingJob):
            weights_bytes, state_bytes = _training_bytes(job)
            results += weights_bytes
            states.append(state_bytes)
        elif isinstance(job, FlightsJob):
            results += _ROW_BYTES * job.n_missions
    return results, sum(sorted(states)[-n_slots:])


def _training_bytes(job: TrainingJob) -> tuple[int, int]:
    scenario, config = from_yaml(job.scenario), job_config(job)
    size = observation_size(config.layout, scenario.n_cells, scenario.n_uavs)
    shapes = weight_shapes(size, config.network.hidden_size).values()
    weights_bytes = 4 * sum(shape[0] * (shape[1] if len(shape) > 1 else 1) for shape in shapes)
    # Adam keeps two numbers for each weight, the target network another; the replay is the rest.
    return weights_bytes, 4 * weights_bytes + replay_bytes(
        config.replay.decisions, brief(scenario)
    )

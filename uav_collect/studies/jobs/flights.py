"""Does the jobs that fly and plan missions: a row of numbers for each."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from uav_collect import files
from uav_collect.analysis.metrics import metrics_row, mission_metrics, MissionMetrics
from uav_collect.analysis.plan_shares import bound_metrics
from uav_collect.analysis.statistics import mission_seeds
from uav_collect.errors import PolicyMismatchError
from uav_collect.missions.rollout import fly
from uav_collect.planning.bound import bound_of
from uav_collect.recording.mission_folder import log_name
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import from_yaml
from uav_collect.scenario.site import build_site
from uav_collect.studies.jobs.jobs import FlightsJob, MISSIONS, PlansJob
from uav_collect.uav.heuristics import RulePolicy
from uav_collect.uav.policy import policy_named
from uav_collect.uav.policy_file import policy_from_bytes
from uav_collect.uav.policy_network import LearnedPolicy

MISSION_COLUMNS = (
    'mission_seed', 'efficiency_kbit_per_j', 'completion_s', 'energy_kj', 'collected_mbit',
    'total_mbit', 'collected_share', 'is_complete', 'is_safe', 'collecting_s', 'shared_cells',
    'visited_cells', 'decisions',
)  # fmt: skip
_AT_ONCE = 50  # missions between two looks

FlightStep = float | Mapping[str, bytes]


def run_flights(
    job: FlightsJob, policies: Mapping[str, bytes], is_stopping: Callable[[], bool]
) -> Iterator[FlightStep]:
    """Fly missions.

    Args:
        policies: files of learned policies, by the digest of their training.

    Raises:
        PolicyMismatchError: the policy does not fit the scenario.
    """
    site, policy = build_site(from_yaml(job.scenario)), _policy(job, policies)
    seeds = mission_seeds(job.first_seed, job.n_missions)
    logs: list[MissionLog] = []
    for start in range(0, len(seeds), _AT_ONCE):
        if is_stopping():
            return
        some = seeds[start : start + _AT_ONCE]
        logs += fly(site, some, partial(replace, policy), job.bandwidth)
        yield len(logs) / len(seeds)
    flown = [mission_metrics(log) for log in logs]
    rows = [_row(log, mission) for log, mission in zip(logs, flown, strict=True)]
    kept = {log_name(log.header.mission_seed): log.to_jsonl() for log in logs if job.keeps_logs}
    yield {MISSIONS: _csv(MISSION_COLUMNS, rows), **kept}


def run_plans(job: PlansJob, is_stopping: Callable[[], bool]) -> Iterator[FlightStep]:
    """Plan missions; what has no plan within the budgets has empty cells."""
    site = build_site(from_yaml(job.scenario))
    seeds = mission_seeds(job.first_seed, job.n_missions)
    rows: list[dict[str, float]] = []
    for seed in seeds:
        if is_stopping():
            return
        bound = bound_of(site, seed, job.bandwidth, job.n_rounds)
        about = {'mission_seed': seed, 'data_cells': bound.n_data_cells}
        rows.append(about | {'total_mbit': bound.total_bit / 1e6} | bound_metrics(bound))
        if len(rows) % _AT_ONCE == 0:
            yield len(rows) / len(seeds)
    yield {MISSIONS: _csv([*rows[0]], [[*row.values()] for row in rows])}


def _policy(job: FlightsJob, policies: Mapping[str, bytes]) -> RulePolicy | LearnedPolicy:
    if not job.trainings:
        return _untrained(job)
    learned = [policy_from_bytes(policies[digest]) for digest in job.trainings]
    best = max(learned, key=lambda it: it.header.validation.rank)
    return LearnedPolicy(name=job.policy, frozen=best)


def _untrained(job: FlightsJob) -> RulePolicy | LearnedPolicy:
    name, _, version = job.policy.partition(' ')
    match policy_named(name):
        case RulePolicy() as rule:
            return rule
        case LearnedPolicy() as shipped if shipped.version == version:
            return shipped
        case other:
            wanted = version or 'a rule, or come from trainings'
            raise PolicyMismatchError(f'policy {name} is {other.version}: must be {wanted}')


def _row(log: MissionLog, mission: MissionMetrics) -> list[float]:
    n_shared, n_visited = _visits(log)
    values = metrics_row(mission) | {
        'collecting_s': sum(uav.hover_s for uav in mission.uavs),
        'shared_cells': n_shared,
        'visited_cells': n_visited,
    }
    return [values[column] for column in MISSION_COLUMNS]


def _visits(log: MissionLog) -> tuple[int, int]:
    """Cells in which more than one UAV decided, and in which any did; the common start aside."""
    size_m = log.header.cell_size_m
    visitors: dict[tuple[int, int], set[int]] = defaultdict(set)
    events = log.events
    places: Sequence[np.ndarray[tuple[int], np.dtype[np.int64]]] = [
        (events[name] // size_m).astype(np.int64) for name in ('x_m', 'y_m')
    ]
    starts = events['decision'] == 0
    first = set(zip(*(place[starts].tolist() for place in places), strict=True))
    for column, row, uav in zip(*(it.tolist() for it in (*places, events['uav'])), strict=True):
        if (column, row) not in first:
            visitors[column, row].add(uav)
    return sum(len(uavs) > 1 for uavs in visitors.values()), len(visitors)


def _csv(columns: Sequence[str], rows: Sequence[Sequence[float]]) -> bytes:
    return files.csv_of([columns, *(map(files.blank_if_nan, row) for row in rows)])

"""Reads the results of a study: tables by column, seeds and missions in order."""

import csv
from dataclasses import dataclass
import io
import json
from typing import Any

import numpy as np
from uav_collect.analysis.resampling import estimate_mean
from uav_collect.analysis.statistics import Estimate
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.jobs.jobs import CURVE, MISSIONS, POLICY, SUMMARY
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.study import MissionSet, PanelMeasure, TrainedPolicies
from uav_collect.training.curves import LearningCurve, mean_curve, rising
from uav_collect.uav.policy_file import policy_from_bytes

_TAIL_SHARE = 0.2  # of a training: its end, over which a curve is averaged


@dataclass(frozen=True, kw_only=True)
class Column:
    """One number of each mission of a test."""

    value: Floats  # (T, M): a row for each training, or one; nan where there is none
    trainings: tuple[str, ...]  # digests, (T,); none where nothing was trained


class Findings:
    """Reads results from a store as studies ask for them."""

    def __init__(self, store: Store) -> None:
        """Read from a store; tables are kept in memory."""
        self._store = store
        self._tables: dict[tuple[str, str], dict[str, Floats]] = {}
        self._ranks: dict[str, tuple[float, float]] = {}

    def column(self, tested: MissionSet, measure: PanelMeasure) -> Column | None:
        """A measure of all missions of a test, as shown; None where plans have none.

        Raises:
            StoreError: a job is not done.
        """
        keys = measure.factors or (measure.key,)
        if tested.is_planned:
            keys = (measure.plan_key,)
        if not all(keys):
            return None
        columns = [self.numbers(tested, key) for key in keys]
        value = np.prod(columns, axis=0) * measure.scale
        return Column(value=value, trainings=tested.trainings)

    def numbers(self, tested: MissionSet, key: str) -> Floats:
        """A column of the tables of all missions of a test, (T, M)."""
        rows = [
            np.concatenate([self._table(digest, MISSIONS)[key] for digest in row])
            for row in tested.digests
        ]
        return np.array(rows)

    def best_training(self, tested: MissionSet) -> int:
        """Which of the trainings gave the policy that is the best in validation."""
        ranks = [self._rank(it) for it in tested.trainings]
        return ranks.index(max(ranks))

    def curve(self, trained: TrainedPolicies, key: str) -> LearningCurve | None:
        """Mean and deviation over the seeds; None where they have no stretch in common."""
        lines = []
        for digest in trained.digests:
            over, value = self._line(digest, key)
            if not len(over):
                return None
            lines.append((over, value))
        return mean_curve(trained.label, range(len(lines)), lines)

    def final_values(self, trained: TrainedPolicies, key: str) -> Floats:
        """What each seed achieved in the last fifth of its training, (N,); nan if it diverged."""
        means = []
        for digest in trained.digests:
            over, value = self._line(digest, key)
            # What came before a training diverged is not what it achieved.
            has_end = len(over) > 0 and not self._summary(digest)['diverged']
            is_late = over >= (1.0 - _TAIL_SHARE) * (over[-1] if has_end else np.inf)
            means.append(float(value[is_late].mean()) if has_end else np.nan)
        return np.array(means)

    def n_parameters(self, trained: TrainedPolicies) -> int:
        """How many numbers the networks have that are learned, the mixer's among them."""
        return int(self._summary(trained.digests[0])['parameters'])

    def update_ms(self, trained: TrainedPolicies) -> Floats:
        """What an update took on a core with the missions that it learned from, (T,) [ms]."""
        cpu_s = [self._store.cost(digest).cpu_s for digest in trained.digests]
        n_updates = [self._summary(digest)['updates'] for digest in trained.digests]
        return 1e3 * np.array(cpu_s) / np.maximum(1, n_updates)

    def curve_rows(self, digest: str) -> list[dict[str, float]]:
        """What the validations of a training gave, one after the other."""
        table = self._table(digest, CURVE)
        return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]

    def file(self, digest: str, name: str) -> bytes:
        """A file that a job gave."""
        return self._store.read(digest, name)

    def _summary(self, digest: str) -> dict[str, Any]:
        summary: dict[str, Any] = json.loads(self._store.read(digest, SUMMARY))
        return summary

    def _line(self, digest: str, key: str) -> tuple[Floats, Floats]:
        """Decisions and values of a training where they are known; decisions rise."""
        table = self._table(digest, CURVE)
        return rising(table['n_decisions'], table[key])

    def _table(self, digest: str, name: str) -> dict[str, Floats]:
        if (digest, name) not in self._tables:
            self._tables[digest, name] = read_table(self._store.read(digest, name))
        return self._tables[digest, name]

    def _rank(self, training: str) -> tuple[float, float]:
        if training not in self._ranks:
            policy = policy_from_bytes(self._store.read(training, POLICY))
            self._ranks[training] = policy.header.validation.rank
        return self._ranks[training]


def read_table(content: bytes) -> dict[str, Floats]:
    """The columns of a CSV of numbers; an empty cell is nan."""
    header, *rows = csv.reader(io.StringIO(content.decode()))
    cells = np.array([[float(cell or 'nan') for cell in row] for row in rows], dtype=np.float64)
    cells = cells.reshape(len(rows), len(header))
    return {name: cells[:, index] for index, name in enumerate(header)}


def estimate_column(column: Column) -> tuple[int, Estimate] | None:
    """How many missions count, and the estimate of their mean; None where none does.

    A mission counts where it has the number with each of the trainings.
    """
    known = column.value[:, np.isfinite(column.value).all(axis=0)]
    if not known.size:
        return None
    return known.shape[1], estimate_mean(known, column.trainings)

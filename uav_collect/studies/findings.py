"""Reads the results of a study: tables by column, seeds and missions in order."""

import csv
from dataclasses import dataclass
import io

import numpy as np
from uav_collect.analysis.statistics import column_estimates, Estimate
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.jobs.jobs import CURVE, MISSIONS
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.study import MissionSet, PanelMeasure, TrainedPolicies
from uav_collect.training.curves import LearningCurve, mean_curve, rising

_TAIL_SHARE = 0.2  # of a training: its end, over which a curve is averaged


@dataclass(frozen=True, kw_only=True)
class Column:
    """One number of each mission of a test."""

    seed: Floats  # (M,) of the mission
    value: Floats  # (M,) nan where there is none


class Findings:
    """Reads results from a store as studies ask for them."""

    def __init__(self, store: Store) -> None:
        """Read from a store; tables are kept in memory."""
        self._store = store
        self._tables: dict[str, dict[str, Floats]] = {}

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
        tables = [self._table(digest, MISSIONS) for digest in tested.digests]
        return Column(
            seed=np.concatenate([table['mission_seed'] for table in tables]),
            value=np.concatenate(
                [np.prod([table[key] for key in keys], axis=0) for table in tables]
            )
            * measure.scale,
        )

    def numbers(self, tested: MissionSet, key: str) -> Floats:
        """A column of the table of all missions of a test, (M,)."""
        return np.concatenate([self._table(it, MISSIONS)[key] for it in tested.digests])

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
        """What each seed achieved in the last fifth of its training, (N,)."""
        means = []
        for digest in trained.digests:
            over, value = self._line(digest, key)
            is_late = over >= (1.0 - _TAIL_SHARE) * over[-1] if len(over) else over > 0
            means.append(float(value[is_late].mean()) if is_late.any() else np.nan)
        return np.array(means)

    def file(self, digest: str, name: str) -> bytes:
        """A file that a job gave."""
        return self._store.read(digest, name)

    def _line(self, digest: str, key: str) -> tuple[Floats, Floats]:
        """Decisions and values of a training where they are known; decisions rise."""
        table = self._table(digest, CURVE)
        return rising(table['n_decisions'], table[key])

    def _table(self, digest: str, name: str) -> dict[str, Floats]:
        if digest not in self._tables:
            self._tables[digest] = read_table(self._store.read(digest, name))
        return self._tables[digest]


def read_table(content: bytes) -> dict[str, Floats]:
    """The columns of a CSV of numbers; an empty cell is nan."""
    header, *rows = csv.reader(io.StringIO(content.decode()))
    cells = np.array([[float(cell or 'nan') for cell in row] for row in rows], dtype=np.float64)
    cells = cells.reshape(len(rows), len(header))
    return {name: cells[:, index] for index, name in enumerate(header)}


def estimate_column(column: Column) -> tuple[int, Estimate] | None:
    """How many missions count, and the estimate of their mean; None where none does."""
    known = column.value[np.isfinite(column.value)]
    if not len(known):
        return None
    return len(known), column_estimates(known[:, None], int(column.seed[0]))[0]

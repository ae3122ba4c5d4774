"""The metrics of missions flown side by side, as arrays, for who needs no logs of thousands."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from uav_collect.kernels.arrays import Bools, Floats
from uav_collect.uav.briefing import Briefing
from uav_collect.world.dynamics import Missions

TOLERANCE = 1e-9  # relative; what rounding may leave of a sum, a time or a position
_Bits = TypeVar('_Bits', float, Floats)


def least_complete_bit(total_bit: _Bits) -> _Bits:
    """What must be collected of some data for a mission to be complete [bit]."""
    return total_bit * (1.0 - TOLERANCE)


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchMetrics:
    """What missions that are over achieved; by mission, in the order of their seeds."""

    collected_bit: Floats  # (N,)
    total_bit: Floats  # (N,) waiting at the start
    energy_j: Floats  # (N, U) used by each UAV, way home included
    landed_s: Floats  # (N, U)

    @property
    def n_missions(self) -> int:
        """How many missions there are."""
        return len(self.total_bit)

    @property
    def is_complete(self) -> Bools:
        """Whether all data were collected, (N,)."""
        complete: Bools = self.collected_bit >= least_complete_bit(self.total_bit)
        return complete

    @property
    def collected_share(self) -> Floats:
        """Share of the data that was collected, 1 where there was none, (N,)."""
        total_bit = np.where(self.total_bit > 0, self.total_bit, 1.0)
        return np.where(self.total_bit > 0, np.minimum(1.0, self.collected_bit / total_bit), 1.0)

    @property
    def efficiency_kbit_per_j(self) -> Floats:
        """Data collected over the energy used, 0 where none was, (N,)."""
        energy_j = self.energy_j.sum(axis=1)
        used_j = np.where(energy_j > 0.0, energy_j, 1.0)
        return np.where(energy_j > 0.0, self.collected_bit / used_j / 1e3, 0.0)

    @property
    def completion_s(self) -> Floats:
        """When the last UAV landed, (N,)."""
        last_s: Floats = self.landed_s.max(axis=1)
        return last_s


def metrics_of(briefing: Briefing, missions: Missions) -> BatchMetrics:
    """What missions achieved; all must be over."""
    return BatchMetrics(
        collected_bit=np.asarray(missions.collected_bit)[:, 0],
        total_bit=np.asarray(missions.demand_bit).sum(axis=1),
        energy_j=np.asarray(briefing.energy_budget_j) - np.asarray(missions.energy_left_j),
        landed_s=np.array(missions.leg_end_s),
    )


def joined(parts: Sequence[BatchMetrics]) -> BatchMetrics:
    """The metrics of several batches of the same fleet, at least one, in their order."""
    return BatchMetrics(
        collected_bit=np.concatenate([part.collected_bit for part in parts]),
        total_bit=np.concatenate([part.total_bit for part in parts]),
        energy_j=np.concatenate([part.energy_j for part in parts]),
        landed_s=np.concatenate([part.landed_s for part in parts]),
    )

"""How long a training runs, how far it is, how well its policy flies and how fast it learns."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from uav_collect.kernels.arrays import Floats
from uav_collect.kernels.compile import compilation
from uav_collect.uav.policy_header import policy_rank

_REPORT_EVERY_S = 1.0
_N_RECENT = 100  # missions


@dataclass(frozen=True, kw_only=True)
class Budget:
    """How long to train: so many minutes, or so many decisions."""

    minutes: float | None = None
    decisions: int | None = None


@dataclass(frozen=True, kw_only=True)
class ConditionResult:
    """What a policy achieved in one condition of a panel; rows of panel.csv."""

    name: str
    sweep_ratio: float  # mean efficiency over the sweep's in the same missions
    efficiency_kbit_per_j: float
    complete_share: float
    safe_share: float
    sweep_complete_share: float
    sweep_safe_share: float


@dataclass(frozen=True, kw_only=True)
class ValidationResult:
    """What a policy achieved in the validation missions; a row of validation.csv."""

    wall_s: float
    n_decisions: int
    n_updates: int
    efficiency_kbit_per_j: float
    completion_s: float
    energy_kj: float
    collected_share: float
    complete_share: float
    safe_share: float
    team_reward: float  # the scenario's reward, summed over a mission
    conditions: tuple[ConditionResult, ...] = ()  # of the panel; none: scenarios were flown

    @property
    def sweep_ratio(self) -> float:
        """The mean over the panel's conditions of the efficiency over the sweep's."""
        return _mean(each.sweep_ratio for each in self.conditions)

    @property
    def worst(self) -> ConditionResult:
        """The condition in which the policy stays behind the sweep most, or gains least."""
        return min(self.conditions, key=lambda each: each.sweep_ratio)

    @property
    def rank(self) -> tuple[float, float]:
        """How good the policy is: of two, the one of greater rank is kept.

        In a panel what the sweep leaves incomplete too is not held against it.
        """
        if not self.conditions:
            return policy_rank(self.complete_share, self.safe_share, self.efficiency_kbit_per_j)
        complete, safe = (
            _mean(min(1.0, 1.0 + own - sweeps) for own, sweeps in shares)
            for shares in (
                [(it.complete_share, it.sweep_complete_share) for it in self.conditions],
                [(it.safe_share, it.sweep_safe_share) for it in self.conditions],
            )
        )
        return policy_rank(complete, safe, self.sweep_ratio)


class UpdateMetrics(NamedTuple):
    """How an update went; the mean of several tells of diverging before the loss does."""

    loss: float  # before it
    mean_value: float  # the same: of the team's action values that are learned, each UAV's in AIQL
    gradient_norm: float  # of all parameters together, before the clip


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a training is, and how well it goes; a row of progress.csv."""

    share_done: float
    wall_s: float
    n_decisions: int
    n_updates: int
    n_missions: int
    decisions_per_s: float
    updates_per_s: float
    loss: float
    mean_value: float
    gradient_norm: float
    epsilon: float
    learning_rate: float
    training_efficiency_kbit_per_j: float
    training_reward: float
    replay_transitions: int
    replay_bytes: int
    validation: ValidationResult | None
    best: ValidationResult | None


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


class RecentMissions:
    """Running means over the last hundred missions that a training learned from."""

    def __init__(self) -> None:
        """Start without a mission."""
        self._metrics: deque[tuple[float, float]] = deque(maxlen=_N_RECENT)

    def add(self, efficiency_kbit_per_j: float, reward: float) -> None:
        """Add a mission, with its undiscounted return."""
        self._metrics.append((efficiency_kbit_per_j, reward))

    @property
    def efficiency_kbit_per_j(self) -> float:
        """Mean energy efficiency; nan before the first mission."""
        return float(np.mean([it[0] for it in self._metrics])) if self._metrics else np.nan

    @property
    def reward(self) -> float:
        """Mean undiscounted return; nan before the first mission."""
        return float(np.mean([it[1] for it in self._metrics])) if self._metrics else np.nan

    def state(self) -> Floats:
        """Efficiency and reward of each, (N, 2); the inverse is `restore`."""
        return np.array(self._metrics, dtype=np.float64).reshape(-1, 2)

    def restore(self, state: Floats) -> None:
        """Take over the state of another one."""
        self._metrics.clear()
        self._metrics.extend((efficiency, reward) for efficiency, reward in state.tolist())


class SpeedMeter:
    """Measures how fast a training goes, by the wall clock, which no result depends on.

    The time in which kernels are compiled does not count.
    """

    def __init__(self, n_decisions: int, n_updates: int) -> None:
        """Start the clock after so many decisions and updates."""
        self._lap_from_s = self._read_s = compilation.now_s()
        self._read_at = n_decisions, n_updates
        self._updates: list[UpdateMetrics] = []
        self._means = UpdateMetrics(np.nan, np.nan, np.nan)

    def add_update(self, metrics: UpdateMetrics) -> None:
        """Count an update in the next means."""
        self._updates.append(metrics)

    def lap_s(self) -> float:
        """Training time since the last call, pauses left out [s]."""
        now_s = compilation.now_s()
        lap_s, self._lap_from_s = now_s - self._lap_from_s, now_s
        return lap_s

    def pause(self) -> None:
        """Stop the clock: validation does not count as training."""
        self._paused_s = compilation.now_s()

    def resume(self) -> None:
        """Let the clock run again after a pause."""
        paused_s = compilation.now_s() - self._paused_s
        self._lap_from_s += paused_s
        self._read_s += paused_s

    def is_due(self) -> bool:
        """Whether a second has passed since the last reading."""
        return compilation.now_s() - self._read_s >= _REPORT_EVERY_S

    def read(self, n_decisions: int, n_updates: int) -> tuple[float, float, UpdateMetrics]:
        """Decisions and updates per second, and the means of updates, since the last call."""
        now_s = compilation.now_s()
        here = n_decisions, n_updates
        elapsed_s = max(now_s - self._read_s, 1e-9)
        speeds = [(new - old) / elapsed_s for new, old in zip(here, self._read_at, strict=True)]
        if self._updates:
            self._means = UpdateMetrics(*np.mean(self._updates, axis=0).tolist())
        self._updates.clear()
        self._read_s, self._read_at = now_s, here
        return speeds[0], speeds[1], self._means

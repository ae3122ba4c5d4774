"""What a training tells of itself: how long it is to go, how it stands, how fast it goes."""

from collections import deque
from dataclasses import dataclass
from time import monotonic
from typing import Protocol

import numpy as np

_LOOK_EVERY_S = 1.0
_N_RECENT = 100


@dataclass(frozen=True, kw_only=True)
class Budget:
    """How long to train: one of the two."""

    minutes: float | None = None
    decisions: int | None = None


@dataclass(frozen=True, kw_only=True)
class ValidationResult:
    """How the policy flew the validation missions."""

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


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How the training stands."""

    share_done: float
    wall_s: float
    n_decisions: int
    n_updates: int
    n_missions: int
    decisions_per_s: float
    updates_per_s: float
    loss: float
    epsilon: float
    learning_rate: float
    training_efficiency_kbit_per_j: float
    training_reward: float
    replay_transitions: int
    replay_bytes: int
    validation: ValidationResult | None
    best: ValidationResult | None


class RecentMissions:
    """Figures of the missions that a training learned from last, up to a hundred."""

    def __init__(self) -> None:
        """Begin without a mission."""
        self._figures: deque[tuple[float, float]] = deque(maxlen=_N_RECENT)

    def note(self, efficiency_kbit_per_j: float, reward: float) -> None:
        """Count one more mission, with its total reward, undiscounted."""
        self._figures.append((efficiency_kbit_per_j, reward))

    @property
    def efficiency_kbit_per_j(self) -> float:
        """Their mean; nan before the first."""
        return float(np.mean([it[0] for it in self._figures])) if self._figures else np.nan

    @property
    def reward(self) -> float:
        """The mean of their total rewards; nan before the first."""
        return float(np.mean([it[1] for it in self._figures])) if self._figures else np.nan

    def state(self) -> list[tuple[float, float]]:
        """All that it needs to go on; the inverse is `restore`."""
        return [*self._figures]

    def restore(self, state: list[tuple[float, float]]) -> None:
        """Go on from where another one was."""
        self._figures.extend(state)


class TrainingCounts(Protocol):
    """What counts its decisions and updates."""

    @property
    def n_decisions(self) -> int:
        """Decisions flown so far."""

    @property
    def n_updates(self) -> int:
        """Updates so far."""


class SpeedMeter:
    """How fast a training goes; reads the clock, which no result depends on."""

    def __init__(self, counted: TrainingCounts) -> None:
        self._counted = counted
        self._lap_from_s = self._read_s = monotonic()
        self._read_at = counted.n_decisions, counted.n_updates
        self._losses: list[float] = []
        self._loss = np.nan

    def note(self, loss: float) -> None:
        """Take an update's loss into the mean."""
        self._losses.append(loss)

    def lap_s(self) -> float:
        """Time since the last call."""
        now_s = monotonic()
        lap_s, self._lap_from_s = now_s - self._lap_from_s, now_s
        return lap_s

    def pause(self) -> None:
        """Validation does not count as training."""
        self._paused_s = monotonic()

    def go_on(self) -> None:
        """Count again."""
        paused_s = monotonic() - self._paused_s
        self._lap_from_s += paused_s
        self._read_s += paused_s

    def is_due(self) -> bool:
        """Whether it is time to look."""
        return monotonic() - self._read_s >= _LOOK_EVERY_S

    def read(self) -> tuple[float, float, float]:
        """Decisions and updates per second, and the mean loss, since the last call."""
        now_s = monotonic()
        here = self._counted.n_decisions, self._counted.n_updates
        elapsed_s = max(now_s - self._read_s, 1e-9)
        speeds = [(new - old) / elapsed_s for new, old in zip(here, self._read_at, strict=True)]
        if self._losses:
            self._loss = float(np.mean(self._losses))
        self._losses.clear()
        self._read_s, self._read_at = now_s, here
        return speeds[0], speeds[1], self._loss

"""When a refinement keeps a policy, and when it ends."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from uav_collect.analysis.against_rules import Flown
from uav_collect.missions.batch_metrics import BatchMetrics
from uav_collect.training.progress import Budget, Progress, ValidationResult

pytest.importorskip('torch', reason='training needs torch')
from uav_collect.learning.refinement import Attempt, refinement, Step

BUDGET = Budget(minutes=10.0)
VALIDATION = ValidationResult(
    wall_s=0.0,
    n_decisions=0,
    n_updates=0,
    efficiency_kbit_per_j=1.0,
    completion_s=1.0,
    energy_kj=1.0,
    collected_share=1.0,
    complete_share=1.0,
    safe_share=1.0,
    team_reward=0.0,
)


def flown(efficiency_kbit_per_j: float) -> Flown:
    return Flown(
        metrics=BatchMetrics(
            collected_bit=np.array([1e3 * efficiency_kbit_per_j]),
            total_bit=np.array([1e3 * efficiency_kbit_per_j]),
            energy_j=np.ones((1, 1)),
            landed_s=np.ones((1, 1)),
        )
    )


def tried(efficiency_kbit_per_j: float) -> Attempt:
    policy: Any = None
    return Attempt(name='', policy=policy, flown=flown(efficiency_kbit_per_j))


class ScriptedTrainer:
    """Validates at each tenth of its budget; `policy` is then worth what the script says."""

    def __init__(self, worth: Sequence[float], n_first: int = 1) -> None:
        self._worth, self._n_first, self._n_done = worth, n_first, 0

    def policy(self) -> float:
        return self._worth[self._n_done - 1]

    def run(self, budget: Budget, is_stopped: Callable[[], bool]) -> Iterator[Progress]:
        for tenth in range(1, 11):
            self._n_done = tenth
            yield self._progress(tenth / 10 - 0.04, None)
            yield self._progress(tenth / 10, VALIDATION if tenth >= self._n_first else None)

    def _progress(self, share_done: float, validation: ValidationResult | None) -> Progress:
        return Progress(
            share_done=share_done,
            wall_s=600.0 * share_done,
            n_decisions=0,
            n_updates=1,
            n_missions=1,
            decisions_per_s=1.0,
            updates_per_s=1.0,
            loss=1.0,
            mean_value=1.0,
            gradient_norm=1.0,
            epsilon=0.0,
            learning_rate=0.0,
            training_efficiency_kbit_per_j=0.0,
            training_reward=0.0,
            replay_transitions=0,
            replay_bytes=0,
            validation=validation,
            best=None,
        )


class ScriptedTrials:
    def tried(self, name: str, policy: float) -> Attempt:
        return tried(policy)


def steps(
    worth: Sequence[float],
    best: Attempt | None,
    is_stopped: Callable[[], bool] = lambda: False,
    n_first: int = 1,
) -> list[Step]:
    trainer: Any = ScriptedTrainer(worth, n_first)
    trials: Any = ScriptedTrials()
    return [*refinement(trainer, trials, best, BUDGET, is_stopped)]


def better_at(found: Sequence[Step]) -> list[float]:
    """The minutes at which something better came."""
    return [round(step.trained_s / 60.0, 3) for step in found if step.is_better]


def test_only_what_is_better_than_all_before_is_kept() -> None:
    found = steps([0.8, 1.1, 1.0, 1.2, 1.2, 1.3, 0.9, 1.4, 1.0, 1.5], tried(1.0))

    assert better_at(found) == [2.0, 4.0, 6.0, 8.0, 10.0]
    assert found[-1].best is not None
    assert found[-1].best.flown.mean_kbit_per_j == pytest.approx(1.5)
    assert not any(step.has_stalled for step in found)


def test_anything_is_kept_where_nothing_was_there() -> None:
    assert better_at(steps([0.1] * 10, None)) == [1.0]


def test_it_ends_when_a_quarter_of_the_budget_brought_nothing_better() -> None:
    found = steps([0.5, 0.5, 0.5, 1.1, *[0.9] * 6], tried(1.0))

    assert [step.has_stalled for step in found[-2:]] == [False, True]
    assert found[-1].trained_s == pytest.approx(600.0 * 0.66)


def test_it_does_not_end_before_half_of_the_budget() -> None:
    found = steps([0.5] * 10, tried(1.0))

    assert found[-1].has_stalled
    assert found[-1].trained_s == pytest.approx(300.0)


def test_it_does_not_end_before_anything_was_tried_for_long_enough() -> None:
    found = steps([0.5] * 10, tried(1.0), n_first=6)

    assert found[-1].has_stalled
    assert found[-1].trained_s == pytest.approx(600.0 * 0.86)


def test_it_ends_where_it_is_stopped() -> None:
    found = steps([1.1] * 10, tried(1.0), is_stopped=lambda: True)

    assert len(found) == 1

"""How a policy flies missions that it did not learn from: of its scenarios, or of a panel."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from functools import cached_property
from typing import Any, get_type_hints, Protocol

import numpy as np
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.analysis.statistics import MEASURES, mission_seeds
from uav_collect.errors import ConfigError
from uav_collect.learning.headers import Learned
from uav_collect.learning.saved import SavedPart
from uav_collect.learning.task import Task
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.site import build_site
from uav_collect.training.panel import Condition, Panel
from uav_collect.training.progress import ConditionResult, ValidationResult
from uav_collect.training.seeds import VALIDATION_SEED
from uav_collect.uav.policy_network import LearnedPolicy


class Validator(Protocol):
    """What validates a policy."""

    @property
    def n_missions(self) -> int:
        """How many missions a validation flies."""

    def warm_up(self, policy: LearnedPolicy) -> None:
        """Let the kernels be compiled, which takes minutes once."""

    def measured(
        self, policy: LearnedPolicy, between_decisions: Callable[[], None] | None
    ) -> dict[str, Any]:
        """The fields of a `ValidationResult` that missions tell, without exploration."""


class ScenarioValidator:
    """Flies missions of the scenarios that are learned in."""

    def __init__(self, tasks: Sequence[Task], n_missions: int) -> None:
        """Take so many missions of each."""
        self._tasks, self._seeds = tasks, mission_seeds(VALIDATION_SEED, n_missions)

    @property
    def n_missions(self) -> int:
        """How many missions a validation flies."""
        return len(self._tasks) * len(self._seeds)

    def warm_up(self, policy: LearnedPolicy) -> None:
        """Let the kernels be compiled, which takes minutes once."""
        for task in self._tasks:
            task.validate(policy, self._seeds[:1])

    def measured(
        self, policy: LearnedPolicy, between_decisions: Callable[[], None] | None
    ) -> dict[str, Any]:
        """The means over all missions."""
        logs = [
            log
            for task in self._tasks
            for log in task.validate(policy, self._seeds, between_decisions)
        ]
        return _means([mission_metrics(log) for log in logs], logs)


class PanelValidator:
    """Flies missions in each condition of a panel, and compares with the sweep's in the same."""

    def __init__(self, panel: Panel, n_missions: int, learned: Learned) -> None:
        """Lay out the conditions; so many missions are flown in each.

        Raises:
            ConfigError: the policies may not fly all of them.
        """
        for condition in panel.conditions:
            area, n_uavs = condition.scenario.area, condition.scenario.n_uavs
            _check_span(panel, condition, 'rows', area.n_rows, learned.cells_per_side)
            _check_span(panel, condition, 'columns', area.n_columns, learned.cells_per_side)
            _check_span(panel, condition, 'UAVs', n_uavs, learned.n_uavs)
        self._names = [condition.name for condition in panel.conditions]
        self._sites = [build_site(condition.scenario) for condition in panel.conditions]
        self._seeds = mission_seeds(VALIDATION_SEED, n_missions)

    @property
    def n_missions(self) -> int:
        """How many missions a validation flies."""
        return len(self._sites) * len(self._seeds)

    def warm_up(self, policy: LearnedPolicy) -> None:
        """Let the kernels be compiled, which takes minutes once."""
        fly(self._sites[0], self._seeds[:1], lambda: policy, 'equal', 0)

    def measured(
        self, policy: LearnedPolicy, between_decisions: Callable[[], None] | None
    ) -> dict[str, Any]:
        """The means over all missions, and each condition's."""
        logs = [
            fly(site, self._seeds, lambda: policy, 'equal', 0, between_decisions)
            for site in self._sites
        ]
        flown = [[*map(mission_metrics, each)] for each in logs]
        conditions = tuple(map(_compared, self._names, flown, self._swept))
        return {
            **_means([it for each in flown for it in each], [it for each in logs for it in each]),
            'conditions': conditions,
        }

    @cached_property
    def _swept(self) -> list[list[MissionMetrics]]:
        """The sweep's missions, by condition."""
        return [
            [*map(mission_metrics, fly(site, self._seeds, 'sweep', 'equal'))]
            for site in self._sites
        ]


def _check_span(
    panel: Panel, condition: Condition, what: str, value: int, span: tuple[int, int]
) -> None:
    if not span[0] <= value <= span[1]:
        raise ConfigError(
            f'panel {panel.name}: {condition.name} has {value} {what}: must have {span[0]} to'
            f' {span[1]}, as the courses have'
        )


def _compared(
    name: str, flown: Sequence[MissionMetrics], swept: Sequence[MissionMetrics]
) -> ConditionResult:
    by_sweep = _mean(it.efficiency_kbit_per_j for it in swept)
    efficiency = _mean(it.efficiency_kbit_per_j for it in flown)
    return ConditionResult(
        name=name,
        sweep_ratio=efficiency / by_sweep if by_sweep > 0.0 else 1.0,
        efficiency_kbit_per_j=efficiency,
        complete_share=_mean(it.is_complete for it in flown),
        safe_share=_mean(it.is_safe for it in flown),
        sweep_complete_share=_mean(it.is_complete for it in swept),
        sweep_safe_share=_mean(it.is_safe for it in swept),
    )


def _means(flown: Sequence[MissionMetrics], logs: Sequence[MissionLog]) -> dict[str, Any]:
    return {
        **{it.key: _mean(map(it.of, flown)) for it in MEASURES},
        'team_reward': _mean(log.events['reward'].sum() for log in logs),
    }


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def validation_state(validation: ValidationResult | None) -> dict[str, Any] | None:
    """A validation as a checkpoint holds it; the inverse is `validation_of`."""
    if validation is None:
        return None
    values = asdict(validation)
    if not validation.conditions:
        del values['conditions']
    return values


def validation_of(saved: SavedPart | None, *, has_panel: bool) -> ValidationResult | None:
    """The inverse of `validation_state`; of a panel it has conditions.

    Raises:
        CheckpointError: something is not what a validation has.
    """
    if saved is None:
        return None
    conditions = saved.parts('conditions') if has_panel else []
    return ValidationResult(
        **_record_of(saved, ValidationResult),
        conditions=tuple(ConditionResult(**_record_of(it, ConditionResult)) for it in conditions),
    )


def _record_of(saved: SavedPart, kind: type) -> dict[str, Any]:
    """The fields of a record that are a number or a text."""
    read: dict[Any, Callable[[str], Any]] = {
        int: saved.whole, float: saved.number, str: saved.text,
    }  # fmt: skip
    kinds = get_type_hints(kind)
    return {name: read[kinds[name]](name) for name in kinds if kinds[name] in read}

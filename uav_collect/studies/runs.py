"""What every training achieved on every task: scores to compare, and a file for other tools.

The file is as github.com/instadeepai/marl-eval reads it: environment, task, algorithm, run, step.
"""

from collections.abc import Mapping
import json

import numpy as np
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.findings import Findings
from uav_collect.studies.study import (
    COLLECTED,
    COMPLETION,
    EFFICIENCY,
    ENERGY,
    LEARNED,
    MissionSet,
    PLAN,
    RunsStudy,
    StudyTask,
    Suite,
)

_ENVIRONMENT = 'uav_collect'
_MEASURES = (EFFICIENCY, COMPLETION, ENERGY, COLLECTED)
_VALIDATED = {measure.key for measure in _MEASURES}  # known of each validation, too


def suite_scores(suite: Suite, findings: Findings) -> dict[str, Floats]:
    """Mean efficiency of each training's policy as a share of the thriftiest plans', by label.

    Shapes are (R, K): of every task as many trainings as the task with the fewest has. A rule has
    one row.
    """
    columns: dict[str, list[Floats]] = {}
    for task in suite.tasks:
        plan = _means(task.tests[PLAN], findings)[0]
        for label, tested in task.tests.items():
            if label != PLAN:
                columns.setdefault(label, []).append(_means(tested, findings) / plan)
    return {
        label: np.stack([it[: min(map(len, of_tasks))] for it in of_tasks], axis=1)
        for label, of_tasks in columns.items()
    }


def _means(tested: MissionSet, findings: Findings) -> Floats:
    """Mean efficiency over the missions, by training."""
    column = findings.column(tested, EFFICIENCY)
    if column is None:
        raise ValueError('plans and missions have an efficiency')
    return np.asarray(np.nanmean(column.value, axis=1))


def marl_eval_json(study: RunsStudy, findings: Findings) -> bytes:
    """All trainings: each validation as a step, and the test missions as absolute metrics."""
    tasks = {
        task.key: {
            label: _runs(task, label, findings) for label in LEARNED if label in task.trained
        }
        for suite in study.suites
        for task in suite.tasks
    }
    return (json.dumps({_ENVIRONMENT: tasks}, indent=1) + '\n').encode()


def _runs(task: StudyTask, label: str, findings: Findings) -> Mapping[str, object]:
    tested = task.tests[label]
    values = {measure.key: findings.numbers(tested, measure.key) for measure in _MEASURES}
    runs: dict[str, object] = {}
    for seed, digest in enumerate(task.trained[label].digests):
        steps: dict[str, object] = {}
        for number, row in enumerate(findings.curve_rows(digest)):
            known = {key: [row[key]] for key in sorted(_VALIDATED)}
            steps[f'step_{number}'] = {'step_count': int(row['n_decisions']), **known}
        tests = {key: value[seed].tolist() for key, value in values.items()}
        runs[f'seed_{seed}'] = {**steps, 'absolute_metrics': tests}
    return runs

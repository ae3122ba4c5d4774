"""What every training achieved on every task: scores to compare, and a file for other tools.

The file is as github.com/instadeepai/marl-eval reads it: environment, task, algorithm, run, step.
"""

from collections.abc import Mapping, Sequence
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

_Part = dict[str, int | list[float]]  # a step, or the absolute metrics


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
    """All trainings: validations as steps, and the test missions as absolute metrics.

    A suite is an environment. marl-eval wants as many runs everywhere in an environment, and as
    many steps of each run: as the one with the fewest has. It wants the same measures, too, each
    with a number: time counts where all UAVs landed, and if they never did in a step or a run, no
    run of the environment has a time.
    """
    environments = {
        f'{_ENVIRONMENT}_{suite.key}': _environment(suite, findings) for suite in study.suites
    }
    return (json.dumps(environments, indent=1, allow_nan=False) + '\n').encode()


def _environment(suite: Suite, findings: Findings) -> Mapping[str, Mapping[str, object]]:
    labels = [label for label in LEARNED if all(label in task.trained for task in suite.tasks)]
    trained = [task.trained[label].digests for task in suite.tasks for label in labels]
    n_runs = min(map(len, trained), default=0)
    curves = {it: findings.curve_rows(it) for digests in trained for it in digests[:n_runs]}
    n_steps = min(map(len, curves.values()), default=0)
    steps = {digest: _steps(rows, n_steps) for digest, rows in curves.items()}
    tasks = {
        task.key: {label: _runs(task, label, n_runs, steps, findings) for label in labels}
        for task in suite.tasks
    }
    runs = [run for task in tasks.values() for of in task.values() for run in of.values()]
    parts = [part for run in runs for part in run.values()]
    unknown = {key for part in parts for key, numbers in part.items() if numbers == []}
    for part in parts:
        for key in unknown & part.keys():
            del part[key]
    return tasks


def _runs(
    task: StudyTask,
    label: str,
    n_runs: int,
    steps: Mapping[str, Mapping[str, _Part]],
    findings: Findings,
) -> Mapping[str, Mapping[str, _Part]]:
    tested = task.tests[label]
    values = {measure.key: findings.numbers(tested, measure.key) for measure in _MEASURES}
    return {
        f'seed_{seed}': {
            **steps[digest],
            'absolute_metrics': {key: _known(value[seed]) for key, value in values.items()},
        }
        for seed, digest in enumerate(task.trained[label].digests[:n_runs])
    }


def _steps(rows: Sequence[Mapping[str, float]], n_steps: int) -> Mapping[str, _Part]:
    """So many of a training's validations, evenly, the first and the last among them."""
    numbers = np.linspace(0, len(rows) - 1, n_steps).round().astype(int)
    return {
        f'step_{step}': {
            'step_count': int(rows[number]['n_decisions']),
            **{key: _known(np.array([rows[number][key]])) for key in sorted(_VALIDATED)},
        }
        for step, number in enumerate(numbers)
    }


def _known(values: Floats) -> list[float]:
    known: list[float] = values[np.isfinite(values)].tolist()
    return known

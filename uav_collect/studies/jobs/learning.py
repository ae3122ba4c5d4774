"""Does a training job: a policy, and how it came to be; and measures what one takes."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
import json
from time import monotonic, process_time
from typing import Any

import torch
from uav_collect import files
from uav_collect.errors import DivergedError, TrainingRunError
from uav_collect.learning.learner import keep_freed_memory
from uav_collect.learning.loop import nothing_learned
from uav_collect.learning.saved import SavedPart
from uav_collect.learning.trainer import Trainer
from uav_collect.revision import UNKNOWN
from uav_collect.scenario.load import from_yaml
from uav_collect.studies.jobs.costs import Rates, units_of
from uav_collect.studies.jobs.jobs import (
    CURVE,
    CURVE_COLUMNS,
    job_config,
    POLICY,
    SUMMARY,
    TrainingJob,
)
from uav_collect.training.config import TrainingConfig
from uav_collect.training.progress import Budget, Progress
from uav_collect.uav.policy_file import policy_bytes
from uav_collect.uav.policy_network import FrozenPolicy

_NEVER = 10**9  # updates
_SETTLED_SHARE = 0.3  # of the time: until then there may be nothing to learn from

# How far it is; or that and what to go on from; or the files that came out.
TrainingStep = float | tuple[float, Any] | Mapping[str, bytes]


def run_training(
    job: TrainingJob,
    state: SavedPart | None,  # what an earlier step yielded
    checkpoint_s: float,
    is_stopping: Callable[[], bool],
) -> Iterator[TrainingStep]:
    """Train a policy.

    Raises:
        CheckpointError: nothing can go on from the state.
        ConfigError: the scenario cannot be trained with these settings.
        DivergedError: it diverged at once.
        TrainingRunError: its decisions were too few for an update.
    """
    trainer, rows = _trainer_of(job, job_config(job)), []
    if state is not None:
        trainer.restore(state.part('trainer'))
        rows = state.rows('rows', len(CURVE_COLUMNS))
    saved_s = monotonic()
    diverged = ''
    try:
        for progress in trainer.run(Budget(decisions=job.decisions), is_stopping):
            rows += _rows(progress)
            yield progress.share_done
            stops = is_stopping()
            if stops or monotonic() - saved_s >= checkpoint_s:
                yield progress.share_done, {'trainer': trainer.state(), 'rows': rows}
                saved_s = monotonic()
            if stops:
                return
    except DivergedError as error:
        diverged = str(error)
    policy = trainer.best_policy()
    if policy is None:
        which = f'{job.algorithm}, seed {job.seed}'
        if diverged:
            raise DivergedError(f'{which}: diverged {diverged}')
        raise TrainingRunError(f'{which}: {nothing_learned(trainer, trainer.config)}')
    yield _results(job, policy, rows, trainer, diverged)


def _trainer_of(job: TrainingJob, config: TrainingConfig) -> Trainer:
    torch.set_num_threads(1)  # others run beside; and the number decides the last bits of sums
    keep_freed_memory()
    return Trainer([from_yaml(job.scenario)], config, job.algorithm, job.seed)


def _rows(progress: Progress) -> list[list[float]]:
    if progress.validation is None:
        return []
    # What the clock decides, as how often there was a look, stays out.
    known = asdict(progress) | asdict(progress.validation)
    return [[known[column] for column in CURVE_COLUMNS]]


def _results(
    job: TrainingJob,
    policy: FrozenPolicy,
    rows: list[list[float]],
    trainer: Trainer,
    diverged: str,
) -> dict[str, bytes]:
    # The checkout of who did it must not show in the bytes; the cost says which it was.
    frozen = FrozenPolicy(replace(policy.header, git_revision=UNKNOWN), policy.weights)
    header = frozen.header
    summary = {
        'algorithm': job.algorithm,
        'seed': job.seed,
        'decisions': job.decisions,
        'updates': trainer.n_updates,
        'parameters': trainer.n_parameters,
        'diverged': diverged,
        'best': {
            'version': header.version,
            'decisions': header.decisions,
            'validation': asdict(header.validation),
        },
    }
    return {
        POLICY: policy_bytes(frozen),
        CURVE: _csv(rows),
        SUMMARY: (json.dumps(summary, indent=1) + '\n').encode(),
    }


def _csv(rows: list[list[float]]) -> bytes:
    return files.csv_of([CURVE_COLUMNS, *(map(files.blank_if_nan, row) for row in rows)])


def measure_rates(job: TrainingJob, duration_s: float) -> Rates:
    """What a decision takes in the beginning of a training that is thrown away.

    Validation is left out: as soon as policies get home it takes next to nothing.

    Args:
        duration_s: to measure for, of a core's time [s].
    """
    settings = job_config(job)
    validation = replace(settings.validation, every_updates=_NEVER)
    config = replace(settings, validation=validation)
    trainer = _trainer_of(job, config)
    looks = trainer.run(Budget(decisions=job.decisions))
    next(looks, None)  # kernels are compiled
    begun_s = process_time()
    start = _counters(trainer)
    is_settled = False
    for _ in looks:
        elapsed_s = process_time() - begun_s
        if not is_settled and elapsed_s >= _SETTLED_SHARE * duration_s:
            is_settled, start = True, _counters(trainer)
        if elapsed_s >= duration_s:
            break
    n_decisions, cpu_s = (now - then for now, then in zip(_counters(trainer), start, strict=True))
    per_decision_s = cpu_s / max(1, n_decisions)
    return Rates(
        cpu_s={'training': per_decision_s * job.decisions / units_of(job)},
        source=f'from {duration_s:.0f} s of {job.algorithm.upper()} on a core of this machine, '
        f'{n_decisions / max(cpu_s, 1e-9):,.0f} decisions/s; tests and plans not counted',
    )


def _counters(trainer: Trainer) -> tuple[int, float]:
    return trainer.n_decisions, process_time()

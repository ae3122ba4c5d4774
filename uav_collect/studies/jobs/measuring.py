"""Measures what a training takes on this machine, before a long run is begun."""

from time import process_time

from uav_collect.learning.trainer import Trainer
from uav_collect.scenario.load import from_yaml
from uav_collect.studies.jobs.costs import Rates, units_of
from uav_collect.studies.jobs.jobs import settings_of, TrainingJob
from uav_collect.training.progress import Budget

_NEVER = 10**9  # updates
_SETTLED_SHARE = 0.3  # of the time: until then there may be nothing to learn from


def measured(job: TrainingJob, duration_s: float) -> Rates:
    """What a decision takes in the beginning of a training that is thrown away.

    Validation is left out: as soon as policies get home it takes next to nothing.

    Args:
        duration_s: to measure for, of a core's time [s].
    """
    settings = settings_of(job)
    validation = settings.validation.model_copy(update={'every_updates': _NEVER})
    config = settings.model_copy(update={'validation': validation})
    trainer = Trainer([from_yaml(job.scenario)], config, job.algorithm, job.seed)
    looks = trainer.run(Budget(decisions=job.decisions))
    next(looks, None)  # kernels are compiled
    begun_s = process_time()
    start = _here(trainer)
    is_settled = False
    for _ in looks:
        elapsed_s = process_time() - begun_s
        if not is_settled and elapsed_s >= _SETTLED_SHARE * duration_s:
            is_settled, start = True, _here(trainer)
        if elapsed_s >= duration_s:
            break
    n_decisions, cpu_s = (now - then for now, then in zip(_here(trainer), start, strict=True))
    per_decision_s = cpu_s / max(1, n_decisions)
    return Rates(
        cpu_s={'training': per_decision_s * job.decisions / units_of(job)},
        source=f'from {duration_s:.0f} s of {job.algorithm.upper()} on a core of this machine, '
        f'{n_decisions / max(cpu_s, 1e-9):,.0f} decisions/s; tests and plans not counted',
    )


def _here(trainer: Trainer) -> tuple[int, float]:
    return trainer.n_decisions, process_time()

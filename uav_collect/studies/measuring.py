"""Measures what a training takes on this machine, before a long run is begun."""

from time import monotonic, process_time

from uav_collect.scenario import from_yaml
from uav_collect.studies.costs import Rates
from uav_collect.studies.jobs import settings_of, TrainingJob
from uav_collect.trainer import Trainer
from uav_collect.training_progress import Budget

_SETTLED_SHARE = 0.3  # of the time: until then there may be nothing to learn from


def measured(job: TrainingJob, duration_s: float) -> Rates:
    """What a decision takes in the beginning of a training that is thrown away."""
    trainer = Trainer([from_yaml(job.scenario)], settings_of(job), job.algorithm, job.seed)
    looks = trainer.run(Budget(decisions=job.decisions))
    next(looks, None)  # kernels are compiled
    start = _here(trainer)
    begun_s, is_settled = monotonic(), False
    for _ in looks:
        elapsed_s = monotonic() - begun_s
        if not is_settled and elapsed_s >= _SETTLED_SHARE * duration_s:
            is_settled, start = True, _here(trainer)
        if elapsed_s >= duration_s:
            break
    n_decisions, cpu_s = (now - then for now, then in zip(_here(trainer), start, strict=True))
    per_decision_s = cpu_s / max(1, n_decisions)
    told = f'{1.0 / per_decision_s:,.0f} decisions/s of one core' if per_decision_s > 0 else ''
    return Rates(
        cpu_s={'training': per_decision_s},
        source=f'from {duration_s:.0f} s of {job.algorithm.upper()} on this machine, {told}; '
        'tests and plans not counted',
    )


def _here(trainer: Trainer) -> tuple[int, float]:
    return trainer.n_decisions, process_time()

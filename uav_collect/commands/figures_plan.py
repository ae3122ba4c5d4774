"""What the figures take: studies, their jobs, what is missing, its cost and its bytes."""

import argparse
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from functools import cached_property
import os
import shutil

from uav_collect.commands.terminal import say
from uav_collect.config.packages import extra_remedy, is_there
from uav_collect.errors import ConfigError, counted, PolicyMismatchError, TrainingRunError
from uav_collect.kernels.patience import waiting_for
from uav_collect.scenario.load import from_yaml
from uav_collect.studies import catalogue
from uav_collect.studies.comparisons import field_of
from uav_collect.studies.jobs.costs import disk_bytes, GUESSED_RATES, Rates, rates_of, spent_cost
from uav_collect.studies.jobs.jobs import (
    digest_of,
    FlightsJob,
    Job,
    job_kind,
    PlansJob,
    TrainingJob,
)
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.requests import Requests
from uav_collect.studies.scale import load_scale, ScaleConfig
from uav_collect.studies.study import Study

_SPARE_BYTES = 200e6  # to be left on the disk


@dataclass(frozen=True, kw_only=True)
class FiguresPlan:
    """The studies to draw, their jobs, which of them are missing, and what those cost."""

    scale: ScaleConfig
    asked: tuple[str, ...]  # the studies to draw
    studies: Mapping[str, Study]  # the others, too: what is found of them is judged with these
    needs: Mapping[str, frozenset[str]]  # digests of a study's jobs
    jobs: Mapping[str, Job]  # of all of them
    store: Store
    missing: frozenset[str]
    rates: Rates
    n_slots: int

    def show(self) -> None:
        """Print the studies, and what is missing."""
        from rich.box import SIMPLE_HEAD
        from rich.table import Table
        from uav_collect.analysis.console import plain_console

        console = plain_console()
        table = Table(box=SIMPLE_HEAD, pad_edge=False)
        for heading in ('study', 'fig.', 'what'):
            table.add_column(heading)
        for heading in ('jobs', 'missing'):
            table.add_column(heading, justify='right')
        for name in self.asked:
            study, needs = self.studies[name], self.needs[name]
            counts = str(len(needs)), str(len(needs & self.missing))
            table.add_row(name, str(study.figure or ''), f'{study.title}: {study.about}', *counts)
        console.print(table)
        for line in self._lines():
            console.print(line, soft_wrap=True)

    def _lines(self) -> list[str]:
        missing = [self.jobs[digest] for digest in self.missing]
        counts = Counter(map(job_kind, missing))
        kinds = ', '.join(f'{counts[kind]} of {kind}' for kind in sorted(counts, reverse=True))
        total = len(self.jobs_of(self.asked))
        lines = [
            f'scale {self.scale.name}: {total} jobs, several of which serve many studies;'
            f' {len(missing)} missing{f": {kinds}" if kinds else ""}'
        ]
        if missing:
            results, states = disk_bytes(missing, self.n_slots)
            lines.append(
                f'disk: {results / 1e6:,.0f} MB of results, up to {states / 1e6:,.0f} MB of'
                f' checkpoints while it runs, in {self.store.folder}'
            )
            hours = sum(map(self.rates.cost_s, missing)) / 3600.0
            if self.rates is not GUESSED_RATES:
                wall = f', {hours / self.n_slots:,.2f} h on {self.n_slots} cores'
                lines.append(f'cost: about {hours:,.2f} core-hours{wall} ({self.rates.source})')
        return lines

    def check_disk(self) -> None:
        """Refuse to begin what the disk has no room for.

        Raises:
            TrainingRunError: it has not.
        """
        wanted = sum(disk_bytes([self.jobs[it] for it in self.missing], self.n_slots))
        self.store.folder.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(self.store.folder).free
        if wanted + _SPARE_BYTES > free:
            raise TrainingRunError(
                f'{self.store.folder}: has {free / 1e6:,.0f} MB left:'
                f' must be {(wanted + _SPARE_BYTES) / 1e6:,.0f} MB or more'
            )

    def complete_studies(self) -> dict[str, Study]:
        """The studies whose jobs are all done by now, asked for or not."""
        return {
            name: study
            for name, study in self.studies.items()
            if not self.store.missing(self.needs[name])
        }

    def turn(self, job: Job) -> tuple[int, float]:
        """When a job's turn is: study by study, cheap ones first, in each the long jobs first."""
        digest = digest_of(job)
        first = next(number for number, needs in enumerate(self._by_cost) if digest in needs)
        return first, -self.rates.cost_s(job)

    @cached_property
    def _by_cost(self) -> list[frozenset[str]]:
        """The jobs of each study, the one first that lacks the least."""
        jobs, cost_s = self.jobs, self.rates.cost_s
        return sorted(
            (self.needs[name] for name in self.asked),
            key=lambda needs: sum(cost_s(jobs[digest]) for digest in needs & self.missing),
        )

    def jobs_of(self, names: Iterable[str]) -> dict[str, Job]:
        """The jobs that studies need."""
        return _jobs_of(names, self.needs, self.jobs)

    def name_of(self, digest: str) -> str:
        """What a job is called, for people."""
        job = self.jobs[digest]
        scenario = from_yaml(job.scenario)
        where = f'{scenario.name}, {counted(scenario.n_uavs, "UAV")}'
        match job:
            case TrainingJob(algorithm=algorithm, seed=seed):
                return f'train {algorithm}, seed {seed}, {where}'
            case FlightsJob(policy=policy, n_missions=n_missions):
                return f'fly {counted(n_missions, "mission")} by {policy}, {where}'
            case PlansJob(n_missions=n_missions):
                return f'plan {counted(n_missions, "mission")}, {where}'


def plan_figures(arguments: argparse.Namespace) -> FiguresPlan:
    """What the arguments ask for.

    Raises:
        ConfigError: there is no such scale or study, or a part of the scale does not fit.
        TrainingRunError: trainings are missing, and so is torch.
    """
    scale, asked = load_scale(arguments.scale), _names(arguments.only)
    requests, needs, studies = Requests(scale), {}, {}
    for name in catalogue.study_names():
        # A scale may not fit a study that nobody asks for.
        with nullcontext() if name in asked else suppress(ConfigError, PolicyMismatchError):
            studies[name] = catalogue.make_study(name, requests)
        needs[name] = requests.take_new()
    store = Store(arguments.output)
    missing = frozenset(store.missing(_jobs_of(asked, needs, requests.jobs)))
    does_work = not (arguments.list or arguments.dry_run)
    if does_work and arguments.engine == 'local':
        _check_torch(requests.jobs[digest] for digest in missing)
    rates = _rates(scale, requests.jobs, store, missing, measures=does_work)
    return FiguresPlan(
        scale=scale,
        asked=asked,
        studies=studies,
        needs=needs,
        jobs=requests.jobs,
        store=store,
        missing=missing,
        rates=rates,
        n_slots=arguments.workers or len(os.sched_getaffinity(0)),
    )


def _jobs_of(
    names: Iterable[str], needs: Mapping[str, frozenset[str]], jobs: Mapping[str, Job]
) -> dict[str, Job]:
    wanted: set[str] = set().union(*(needs[name] for name in names))
    return {digest: job for digest, job in jobs.items() if digest in wanted}


def _names(asked: list[str] | None) -> tuple[str, ...]:
    known = catalogue.study_names()
    for name in asked or ():
        if name not in known:
            raise ConfigError(f'--only is {name!r}: must be of {", ".join(known)}')
    return tuple(name for name in known if asked is None or name in asked)


def _check_torch(missing: Iterable[Job]) -> None:
    trains = any(isinstance(job, TrainingJob) for job in missing)
    if trains and not is_there('torch'):
        raise TrainingRunError(
            f'figures needs torch for what is missing: {extra_remedy("train", "make figures")}'
        )


def _rates(
    scale: ScaleConfig,
    jobs: Mapping[str, Job],
    store: Store,
    missing: frozenset[str],
    *,
    measures: bool,
) -> Rates:
    """What jobs take: as those did that are done, or as a first minute says if it `measures`."""
    trainings = [jobs[digest] for digest in sorted(missing)]
    first = next((job for job in trainings if isinstance(job, TrainingJob)), None)
    known = rates_of(spent_cost(jobs, store))
    if known is not None:
        return known
    if first is None or not measures or scale.measured_s == 0.0:
        return GUESSED_RATES
    if not is_there('torch'):
        return GUESSED_RATES
    say(f'measuring what a decision takes: {scale.measured_s:.0f} s')
    with waiting_for('torch to load'):
        from uav_collect.studies.jobs.learning import measure_rates

    return measure_rates(_usual_training(scale, trainings, first), scale.measured_s)


def _usual_training(scale: ScaleConfig, trainings: list[Job], first: TrainingJob) -> TrainingJob:
    """A training on the usual field where one is missing: others take about as long a decision."""
    field = field_of(scale.fields.usual).to_yaml()
    usual = (it for it in trainings if isinstance(it, TrainingJob) and it.scenario == field)
    return next((job for job in usual if job.algorithm == 'aqmix'), first)

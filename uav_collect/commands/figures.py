"""Draws the figures of the paper's evaluation from trainings and missions that it has done."""

import argparse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
from typing import TYPE_CHECKING

from uav_collect import files
from uav_collect.commands import options
from uav_collect.commands.terminal import deferred_interruption, Interruption, say, write_files
from uav_collect.config.packages import extra_remedy, is_there
from uav_collect.errors import in_one_line, reason_of, TrainingRunError
from uav_collect.kernels.patience import waiting_for
from uav_collect.limits import FAILED, UNUSABLE

if TYPE_CHECKING:  # loaded when needed, so that --help answers at once
    from uav_collect.commands.figures_plan import FiguresPlan
    from uav_collect.studies.findings import Findings
    from uav_collect.studies.jobs.schedule import JobEngine, JobsStatus
    from uav_collect.studies.study import Study

_DESCRIPTION = """
Draws the figures of the paper's evaluation as PNG and PDF, writes their numbers as CSV, and judges
each of its statements in a table, study by study, each as soon as it is done. It runs the
trainings, test missions and clairvoyant plans that this takes. Results are kept by what they
depend on, so a second call does only what is missing, a call after Ctrl-C continues where it
stopped, and one after a crash continues from the last checkpoint.
"""
_MAX_WORKERS = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments."""
    parser.description = _DESCRIPTION
    parser.add_argument('--list', action='store_true', help='list the studies, and do nothing')
    parser.add_argument(
        '--only',
        nargs='+',
        metavar='STUDY',
        help='do and draw these studies (default: all, see --list)',
    )
    parser.add_argument(
        '--scale',
        default='laptop',
        metavar='NAME|FILE',
        help='how large: smoke (minutes), laptop (two cores, a night), paper (a cluster) or a YAML'
        ' file (default: %(default)s)',
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('runs/studies'),
        metavar='FOLDER',
        help='what was found is kept here, figures in a folder for each scale'
        ' (default: %(default)s)',
    )
    parser.add_argument(
        '--results',
        type=Path,
        metavar='FILE',
        help='the table of all that was found so far (default: results.md beside figures)',
    )
    parser.add_argument('--dry-run', action='store_true', help='say what it takes, and do nothing')
    _add_engine_options(parser)


def _add_engine_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--engine',
        choices=('local', 'ray'),
        default='local',
        help='who does the work: processes of this machine, or a Ray cluster'
        ' (default: %(default)s)',
    )
    parser.add_argument(
        '--address',
        metavar='ADDRESS',
        help='of the Ray cluster, as HOST:6379 or auto (default: one is started on this machine)',
    )
    parser.add_argument(
        '--workers',
        type=options.whole_number(1, _MAX_WORKERS),
        metavar='N',
        help='jobs at once (default: one for each core, of the cluster if there is one)',
    )
    parser.add_argument(
        '--checkpoint-minutes',
        type=options.number_from(0.0, 1e6, 'min'),
        default=5.0,
        metavar='M',
        help='how often trainings are saved: so much is lost when one is killed'
        ' (default: %(default)g)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Do the jobs that are missing, then draw the figures; returns the exit status."""
    if not (arguments.list or arguments.dry_run):
        options.check_outputs(arguments.results)  # rather than hours later
    with waiting_for('the studies to load'):
        from uav_collect.commands.figures_plan import plan_figures

    plan = plan_figures(arguments)
    plan.show()
    if arguments.list or arguments.dry_run:
        return 0
    plan.check_disk()
    drawn = _Drawn(arguments, plan)
    status = 0
    if plan.missing:
        drawn.draw_whole()
        status = _run_jobs(arguments, plan, drawn)
    unwritten = drawn.finish()
    return status or unwritten


def _run_jobs(arguments: argparse.Namespace, plan: 'FiguresPlan', drawn: '_Drawn') -> int:
    from uav_collect.commands.figures_display import jobs_display
    from uav_collect.studies.jobs.schedule import run_jobs

    jobs = plan.jobs_of(plan.asked)
    n_done = len(jobs) - len(plan.missing)  # what these give is drawn

    with deferred_interruption() as interruption, jobs_display(plan) as show_jobs:

        def show(status: 'JobsStatus') -> None:
            nonlocal n_done
            show_jobs(status)
            if status.done != n_done:
                n_done = status.done
                drawn.draw_whole()

        ended = run_jobs(
            jobs,
            plan.store,
            _engine(arguments),
            checkpoint_s=arguments.checkpoint_minutes * 60.0,
            order=plan.turn,
            is_stopping=interruption.acknowledge,
            show=show,
        )
    return _exit_status(plan, ended, interruption)


def _exit_status(plan: 'FiguresPlan', jobs: 'JobsStatus', interruption: Interruption) -> int:
    for digest, why in jobs.failures.items():
        trace = plan.store.folder / 'failures' / f'{digest}.txt'
        say(f'error: {plan.name_of(digest)}: {why} ({trace})')
    if jobs.n_lost:
        say(f'{jobs.n_lost} jobs were lost and done again')
    if interruption.signal_number is not None:
        left = jobs.total - jobs.done
        say(f'interrupted with {left} jobs to do; the same command goes on')
        return interruption.exit_status
    return FAILED if jobs.failures else 0


def _engine(arguments: argparse.Namespace) -> 'JobEngine':
    match arguments.engine:
        case 'ray':
            if not is_there('ray'):
                raise TrainingRunError(
                    '--engine ray needs ray: ' + extra_remedy('cluster', 'make figures ENGINE=ray')
                )
            with waiting_for('Ray to load'):
                from uav_collect.studies.jobs.cluster import RayEngine

            return RayEngine(arguments.address, arguments.workers)
        case _:
            from uav_collect.studies.jobs.processes import ProcessEngine

            return ProcessEngine(arguments.workers or len(os.sched_getaffinity(0)))


@contextmanager
def _put_off(what: str) -> Iterator[None]:
    """Say an error and go on: what raised it is done again when no job runs any more."""
    try:
        yield
    except Exception as error:  # whatever it is, jobs of hours must not end with it
        say(f'{what} cannot be drawn yet: {in_one_line(reason_of(error))}')


class _Drawn:
    """The studies that are drawn and judged: each once, as soon as all of its jobs are done.

    What cannot be drawn or written keeps no job from being done: it is tried again at the end.
    """

    def __init__(self, arguments: argparse.Namespace, plan: 'FiguresPlan') -> None:
        self._plan, self._folder = plan, arguments.output / plan.scale.name
        self._results: Path = arguments.results or self._folder / 'results.md'
        self._names: list[str] = []
        self._tried: set[str] = set()
        self._is_judged = False

    def draw_whole(self) -> None:
        """Draw what can be drawn by now, and judge what can be judged; errors are only said."""
        from uav_collect.studies.findings import Findings

        whole = self._plan.complete_studies()
        new = [name for name in self._asked_of(whole) if name not in self._tried]
        if not new:
            return
        findings = Findings(self._plan.store)
        self._tried.update(new)
        self._is_judged = False
        for name in new:
            with _put_off(name):
                self._draw(name, whole[name], findings)
        if not files.is_stream(self._results):  # which is written once, at the end
            with _put_off(self._results.name):
                self._judge(whole, findings)

    def finish(self) -> int:
        """Draw and judge what is not yet, say what was written; returns the exit status."""
        from uav_collect.studies.findings import Findings

        whole = self._plan.complete_studies()
        findings = Findings(self._plan.store)
        asked = self._asked_of(whole)
        for name in asked:
            if name not in self._names:
                self._draw(name, whole[name], findings)
        if asked and not self._is_judged:
            self._judge(whole, findings)
        self._report(whole)
        is_all_written = len(self._names) == len(asked) and (self._is_judged or not asked)
        return 0 if is_all_written else UNUSABLE

    def _asked_of(self, whole: Mapping[str, 'Study']) -> list[str]:
        return [name for name in self._plan.asked if name in whole]

    def _draw(self, name: str, study: 'Study', findings: 'Findings') -> None:
        from uav_collect.studies.pictures.draw import draw

        drawn = draw(study, findings)
        contents = {f'{name}.csv': drawn.table, **drawn.others}
        for kind in ('png', 'pdf'):
            contents[f'{name}.{kind}'] = drawn.picture(kind)
        self._folder.mkdir(parents=True, exist_ok=True)
        if write_files({self._folder / file: content for file, content in contents.items()}):
            self._names.append(name)

    def _judge(self, whole: Mapping[str, 'Study'], findings: 'Findings') -> None:
        from uav_collect.studies import catalogue
        from uav_collect.studies.claims.claims import judge
        from uav_collect.studies.jobs.costs import spent_cost
        from uav_collect.studies.results_text import results_text

        plan = self._plan
        not_run = [name for name in catalogue.study_names() if name not in whole]
        judged, spent = judge(whole, findings), spent_cost(plan.jobs_of(whole), plan.store)
        text = results_text(plan.scale, whole, judged, spent, not_run)
        self._is_judged = write_files({self._results: text.encode()})

    def _report(self, whole: Mapping[str, 'Study']) -> None:
        """Say what was written, and what could not be."""
        for name in self._names:
            print(self._folder / f'{name}.png')
        if self._is_judged:
            print(self._results)
        lacking = [name for name in self._plan.asked if name not in whole]
        if lacking:
            say(f'not drawn, as jobs are missing: {", ".join(lacking)}')

"""The progress of jobs on stderr: a live display in a terminal, lines in a file."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING

from uav_collect.analysis.console import plain_console
from uav_collect.commands.figures_plan import FiguresPlan
from uav_collect.studies.jobs.costs import GUESSED_RATES
from uav_collect.studies.jobs.jobs import job_kind
from uav_collect.studies.jobs.schedule import JobsStatus
from uav_collect.training.time_left import TimeLeft

if TYPE_CHECKING:
    from rich.console import RenderableType

_LINE_EVERY_S = 10.0
_FIRST_LINE_S = 2.0
_DRAWN_EVERY_S = 0.5
_BAR_WIDTH = 40
_MAX_SHOWN = 16  # jobs that run
_MOST_GUESSED = 0.3  # of what is left, where it still makes an estimate


@contextmanager
def jobs_display(plan: FiguresPlan) -> Iterator[Callable[[JobsStatus], None]]:
    """Show how far the jobs are; call what it yields with each `JobsStatus`."""
    from rich.live import Live

    console = plain_console(stderr=True)
    work = _RemainingWork(plan)
    if not console.is_terminal:
        yield _lines(work, lambda line: console.print(line, soft_wrap=True))
        return
    with Live(console=console, transient=True, auto_refresh=False) as live:
        drawn_s = 0.0

        def show(status: JobsStatus) -> None:
            nonlocal drawn_s
            if monotonic() - drawn_s >= _DRAWN_EVERY_S:
                drawn_s = monotonic()
                live.update(_live_display(plan, work, status), refresh=True)

        yield show


class _RemainingWork:
    """How much of the work is done, by what jobs are expected to take, and how long is left."""

    def __init__(self, plan: FiguresPlan) -> None:
        self._plan, self._time_left = plan, TimeLeft()
        jobs, rates = plan.jobs, plan.rates
        kinds = () if rates is GUESSED_RATES else rates.cpu_s
        self._known = {it for it in plan.missing if job_kind(jobs[it]) in kinds}
        self._cost_s = {
            it: max(1e-3, (rates if it in self._known else GUESSED_RATES).cost_s(jobs[it]))
            for it in plan.missing
        }

    def share_done(self, status: JobsStatus) -> float:
        """Share of what was missing at first, by cost."""
        still = self._plan.store.missing(self._cost_s)
        left_s = sum(
            self._cost_s[digest] * (1.0 - status.running.get(digest, 0.0)) for digest in still
        )
        total_s = sum(self._cost_s.values())
        return 1.0 - left_s / total_s

    def time_left(self, share_done: float) -> str:
        """The time that the rest takes if it goes on as so far; '' where that is a mere guess."""
        still = self._plan.store.missing(self._cost_s)
        guessed_s = sum(self._cost_s[it] for it in still if it not in self._known)
        text = self._time_left.text(share_done)
        return text if guessed_s <= _MOST_GUESSED * sum(self._cost_s[it] for it in still) else ''


def _lines(
    work: _RemainingWork, print_line: Callable[[str], None]
) -> Callable[[JobsStatus], None]:
    printed_s = monotonic() - _LINE_EVERY_S + _FIRST_LINE_S

    def show(status: JobsStatus) -> None:
        nonlocal printed_s
        if monotonic() - printed_s >= _LINE_EVERY_S:
            printed_s = monotonic()
            share_done = work.share_done(status)
            parts = (*_counts(status), f'{share_done:.0%}', work.time_left(share_done))
            print_line(', '.join(filter(None, parts)))

    return show


def _counts(status: JobsStatus) -> tuple[str, ...]:
    lost = f'{status.n_lost} lost and done again' if status.n_lost else ''
    compiling = f' ({len(status.compiling)} compile kernels, once)' if status.compiling else ''
    failed = len(status.failures) + len(status.blocked)
    return (
        f'{status.done} of {status.total} jobs done',
        f'{len(status.running)} running{compiling}',
        f'{len(status.elsewhere)} in another command' if status.elsewhere else '',
        lost,
        f'{failed} failed' if failed else '',
    )


def _live_display(plan: FiguresPlan, work: _RemainingWork, status: JobsStatus) -> 'RenderableType':
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    share_done = work.share_done(status)
    top = Table.grid(padding=(0, 2))
    bar = ProgressBar(total=1.0, completed=share_done, width=_BAR_WIDTH)
    top.add_row(Text(f'scale {plan.scale.name}', 'bold'), bar, work.time_left(share_done))
    rows = Table.grid(padding=(0, 2))
    for digest, share in list(status.running.items())[:_MAX_SHOWN]:
        rows.add_row(f'{share:4.0%}', plan.name_of(digest), status.hosts.get(digest, ''))
    counts = Text(f'  {", ".join(filter(None, _counts(status)))}')
    return Group(top, counts, rows)

"""The progress of jobs on stderr: a live display in a terminal, lines in a file."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING

from uav_collect.analysis.console import plain_console
from uav_collect.commands.figures_plan import FiguresPlan
from uav_collect.studies.jobs.schedule import JobsStatus

if TYPE_CHECKING:
    from rich.console import RenderableType

_LINE_EVERY_S = 10.0
_DRAWN_EVERY_S = 0.5
_BAR_WIDTH = 40
_MAX_SHOWN = 16  # jobs that run


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
        self._plan = plan
        self._begun_s = monotonic()
        self._cost_s = {
            digest: max(1e-3, plan.rates.cost_s(plan.jobs[digest])) for digest in plan.missing
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
        """The time that the rest takes if it goes on as so far."""
        if share_done <= 0.0:
            return ''
        left_s = (monotonic() - self._begun_s) * (1.0 / share_done - 1.0)
        hours, minutes = divmod(round(left_s / 60.0), 60)
        return f'{hours}:{minutes:02d} h left' if hours else f'{minutes} min left'


def _lines(
    work: _RemainingWork, print_line: Callable[[str], None]
) -> Callable[[JobsStatus], None]:
    printed_s = monotonic()

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
    failed = len(status.failures) + len(status.blocked)
    return (
        f'{status.done} of {status.total} jobs done',
        f'{len(status.running)} running',
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

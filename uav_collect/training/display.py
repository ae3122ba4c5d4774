"""The progress of a training on stderr: a live display in a terminal, lines in a file."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import math
from time import monotonic
from typing import TYPE_CHECKING

from uav_collect.analysis.console import plain_console
from uav_collect.training.time_left import TimeLeft

if TYPE_CHECKING:  # loaded when training, so that --help answers at once
    from rich.console import RenderableType
    from uav_collect.training.progress import Progress, ValidationResult

_LINE_EVERY_S = 5.0
_BAR_WIDTH = 40


@contextmanager
def progress_display(
    title: str, extras: Callable[[], tuple[str, ...]] = tuple
) -> Iterator[Callable[['Progress'], None]]:
    """Show how a training goes; call what it yields with each `Progress`.

    Args:
        title: of the live display.
        extras: what else to show, asked each time.
    """
    from rich.live import Live

    console = plain_console(stderr=True)
    if not console.is_terminal:
        yield _lines(lambda line: console.print(line, soft_wrap=True), extras)
        return
    validated, left = LastValidation(), TrainingTimeLeft()
    with Live(console=console, transient=True, auto_refresh=False) as live:
        yield lambda progress: live.update(
            _live_display(
                title, progress, validated.update(progress), left.text(progress), extras()
            ),
            refresh=True,
        )


class LastValidation:
    """The last validation; most reports of a training bring none."""

    def __init__(self) -> None:
        """Start without a validation."""
        self._last: ValidationResult | None = None

    def update(self, progress: 'Progress') -> 'ValidationResult | None':
        """Take the report's validation, if it has one; the last one there was."""
        self._last = progress.validation or self._last
        return self._last


class TrainingTimeLeft:
    """The time to the end of the budget, once updates go on steadily: before, all is faster."""

    def __init__(self) -> None:
        """Start without progress."""
        self._left = TimeLeft()

    def text(self, progress: 'Progress') -> str:
        """'12:34 min left', or '' while that is unknown."""
        return self._left.text(progress.share_done) if progress.n_updates else ''


def _lines(
    print_line: Callable[[str], None], extras: Callable[[], tuple[str, ...]]
) -> Callable[['Progress'], None]:
    """A line every few seconds, and one for each validation."""
    printed_s = -math.inf
    validated, left = LastValidation(), TrainingTimeLeft()

    def show(progress: 'Progress') -> None:
        nonlocal printed_s
        last, time_left = validated.update(progress), left.text(progress)
        if progress.validation is not None or monotonic() - printed_s >= _LINE_EVERY_S:
            printed_s = monotonic()
            parts = (
                *speeds(progress),
                *efficiencies(progress, last),
                time_left,
                *extras(),
            )
            print_line(', '.join(filter(None, parts)))

    return show


def _live_display(
    title: str,
    progress: 'Progress',
    last: 'ValidationResult | None',
    time_left: str,
    extras: tuple[str, ...],
) -> 'RenderableType':
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    top = Table.grid(padding=(0, 2))
    bar = ProgressBar(total=1.0, completed=progress.share_done, width=_BAR_WIDTH)
    top.add_row(Text(title, 'bold'), bar, Text(time_left))
    lines = (
        speeds(progress),
        efficiencies(progress, last),
        counts(progress),
        *((it,) for it in extras),
    )
    return Group(top, *(Text('  ' + '   '.join(parts)) for parts in lines))


def speeds(progress: 'Progress') -> tuple[str, ...]:
    """Share done, decisions and updates per second, and the loss."""
    return (
        f'{progress.share_done:.0%}',
        f'{progress.decisions_per_s:,.0f} decisions/s',
        f'{progress.updates_per_s:.1f} updates/s',
        'no update yet' if math.isnan(progress.loss) else f'loss {progress.loss:.4g}',
    )


def efficiencies(progress: 'Progress', last: 'ValidationResult | None') -> tuple[str, ...]:
    """Energy efficiency: of the last missions, which explore, and of policies as validated."""
    recent = progress.training_efficiency_kbit_per_j
    exploring = 'no mission yet' if math.isnan(recent) else f'{recent:.3f} kbit/J exploring'
    if last is None or progress.best is None:
        return exploring, 'not validated yet'
    validated = exploring, f'{_efficiency(last)} validated', f'{_efficiency(progress.best)} best'
    if not last.conditions:
        return validated
    return *validated, f'worst x{last.worst.sweep_ratio:.2f} in {last.worst.name}'


def _efficiency(validation: 'ValidationResult') -> str:
    if validation.conditions:
        return f'x{validation.sweep_ratio:.3f} of the sweep'
    # Without it a policy that leaves missions unfinished looks better than the best one.
    share = validation.complete_share
    complete = '' if share == 1.0 else f' ({int(100.0 * share)} % complete)'
    return f'{validation.efficiency_kbit_per_j:.3f}{complete}'


def counts(progress: 'Progress') -> tuple[str, ...]:
    """How many missions, decisions and updates so far, and the size of the replay."""
    return (
        f'{progress.n_missions:,} missions',
        f'{progress.n_decisions:,} decisions',
        f'{progress.n_updates:,} updates',
        f'replay {progress.replay_transitions:,} ({progress.replay_bytes / 1e6:.0f} MB)',
    )

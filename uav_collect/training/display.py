"""What train says while it learns, on stderr: a picture for a person, lines for a file."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import math
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # loaded when training, so that --help answers at once
    from rich.console import RenderableType
    from uav_collect.training.progress import Progress, ValidationResult

_LINE_EVERY_S = 5.0
_BAR_WIDTH = 40


@contextmanager
def progress_display(
    title: str, more: Callable[[], tuple[str, ...]] = tuple
) -> Iterator[Callable[['Progress'], None]]:
    """Show a training; call what it yields with each look at it.

    Args:
        title: of the picture.
        more: what else there is to tell.
    """
    from rich.console import Console
    from rich.live import Live

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines(lambda line: console.print(line, highlight=False, soft_wrap=True), more)
        return
    validated = LastValidation()
    with Live(console=console, transient=True, auto_refresh=False) as live:
        yield lambda progress: live.update(
            _picture(title, progress, validated.after(progress), more()), refresh=True
        )


class LastValidation:
    """What the last validation said; most looks at a training bring none."""

    def __init__(self) -> None:
        """There was none."""
        self._last: ValidationResult | None = None

    def after(self, progress: 'Progress') -> 'ValidationResult | None':
        """The last validation, that of this look among them."""
        self._last = progress.validation or self._last
        return self._last


def _lines(
    say: Callable[[str], None], more: Callable[[], tuple[str, ...]]
) -> Callable[['Progress'], None]:
    """A line every few seconds, and one for each validation."""
    said_s = -math.inf
    validated = LastValidation()

    def show(progress: 'Progress') -> None:
        nonlocal said_s
        last = validated.after(progress)
        if progress.validation is not None or monotonic() - said_s >= _LINE_EVERY_S:
            said_s = monotonic()
            parts = (
                *speeds(progress),
                *efficiencies(progress, last),
                time_left(progress),
                *more(),
            )
            say(', '.join(filter(None, parts)))

    return show


def _picture(
    title: str, progress: 'Progress', last: 'ValidationResult | None', more: tuple[str, ...]
) -> 'RenderableType':
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    top = Table.grid(padding=(0, 2))
    bar = ProgressBar(total=1.0, completed=progress.share_done, width=_BAR_WIDTH)
    top.add_row(Text(title, 'bold'), bar, Text(time_left(progress)))
    lines = (
        speeds(progress),
        efficiencies(progress, last),
        sizes(progress),
        *((it,) for it in more),
    )
    return Group(top, *(Text('  ' + '   '.join(parts)) for parts in lines))


def speeds(progress: 'Progress') -> tuple[str, ...]:
    """How far and how fast it learns."""
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
    return exploring, f'{_efficiency(last)} validated', f'{_efficiency(progress.best)} best'


def _efficiency(validation: 'ValidationResult') -> str:
    # Without it a policy that leaves missions unfinished looks better than the best one.
    share = validation.complete_share
    complete = '' if share == 1.0 else f' ({int(100.0 * share)} % complete)'
    return f'{validation.efficiency_kbit_per_j:.3f}{complete}'


def sizes(progress: 'Progress') -> tuple[str, ...]:
    """What was done, and what the replay holds."""
    return (
        f'{progress.n_missions:,} missions',
        f'{progress.n_decisions:,} decisions',
        f'{progress.n_updates:,} updates',
        f'replay {progress.replay_transitions:,} ({progress.replay_bytes / 1e6:.0f} MB)',
    )


def time_left(progress: 'Progress') -> str:
    """The time that the rest will take if it goes on as fast as so far."""
    if progress.share_done <= 0:
        return ''
    return f'{minutes_text(progress.wall_s * (1.0 / progress.share_done - 1.0))} left'


def minutes_text(duration_s: float) -> str:
    """A time as minutes and seconds."""
    minutes, seconds = divmod(round(duration_s), 60)
    return f'{minutes}:{seconds:02d} min'

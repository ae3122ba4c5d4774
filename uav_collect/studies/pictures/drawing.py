"""What all figures of studies have in common: colours, panels, legends, files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import io
import textwrap

from uav_collect.analysis.area_picture import GRID
from uav_collect.analysis.plotting import Axes, Figure, FigureCanvasAgg
from uav_collect.analysis.trajectories import COLOURS, DPI
from uav_collect.studies.study import AIQL, AQMIX, HERT, PLAN, QMIX, SWEEP
from uav_collect.training.curves import REFERENCE_STYLES
from uav_collect.uav.policy import STRONG

COLOUR = {
    AQMIX: COLOURS[0], QMIX: COLOURS[1], AIQL: COLOURS[2], HERT: '#555555', SWEEP: '#009E73',
    PLAN: '#111111', STRONG: COLOURS[0],
}  # fmt: skip
MARKER = {AQMIX: 'o', QMIX: 's', AIQL: '^', HERT: 'D', SWEEP: 'v', PLAN: 'x', STRONG: 'o'}
STYLE = dict(zip((HERT, SWEEP, PLAN), REFERENCE_STYLES, strict=True))
SOLID = (0.0, ())
THIN = (0.0, (3.0, 1.0))
_TITLE_WIDTH = 46  # characters for each panel beside another


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """A figure and the numbers that it shows."""

    figure: Figure
    table: bytes  # CSV, units in the header
    others: Mapping[str, bytes] = field(default_factory=dict)  # files beside it, by name

    def picture(self, kind: str) -> bytes:
        """The figure as 'png' or 'pdf': the same numbers give the same bytes."""
        written = io.BytesIO()
        # Neither the time nor the software's name.
        metadata = {
            'png': {'Software': None},
            'pdf': {'CreationDate': None, 'Producer': None, 'Creator': None},
        }[kind]
        self.figure.savefig(written, dpi=DPI, format=kind, metadata=metadata)
        return written.getvalue()


def panels(
    n_rows: int, n_columns: int, title: str, note: str, *, size_in: tuple[float, float]
) -> tuple[Figure, list[list[Axes]]]:
    """Empty panels under a title, row by row.

    Args:
        note: below the title: what was done.
        size_in: width and height of a panel [inch].
    """
    width_in, height_in = size_in
    # Room for a title above and legends below.
    figure = Figure(
        figsize=(width_in * n_columns, height_in * n_rows + 0.9),
        facecolor='white',
        layout='constrained',
    )
    FigureCanvasAgg(figure)
    text = textwrap.fill(note, int(_TITLE_WIDTH * n_columns * width_in / 3.6))
    figure.suptitle(f'{title}\n{text}', x=0.01, ha='left', fontsize=9)
    axes = figure.subplots(n_rows, n_columns, squeeze=False)
    return figure, [list(row) for row in axes]


def label_axes(axes: Axes, over: str, title: str, unit: str) -> None:
    """Give a panel its labels, grid and spines; no unit is shown where that is 1."""
    axes.set_xlabel(over, fontsize=9)
    axes.set_ylabel(title if unit == '1' else f'{title} [{unit}]', fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(color=GRID, linewidth=0.6)
    axes.spines[['top', 'right']].set_visible(False)


def count_text(numbers: Sequence[int], noun: str) -> str:
    """How many things are shown, for a caption: `300 missions`, `3 to 6 trainings`."""
    least, most = min(numbers), max(numbers)
    count = f'{least}' if least == most else f'{least} to {most}'
    return f'{count} {noun}{"" if most == 1 else "s"}'

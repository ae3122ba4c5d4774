"""The table of who read which sensor, when and at which rate, for the terminal."""

from collections.abc import Sequence
import math

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from uav_collect.analysis.readings import Reading
from uav_collect.errors import in_one_line

_HEADINGS = (
    'from\ns', 'to\ns', 'UAV\n', 'data\nMbit', 'rate\nkbit/s', 'bandwidth\nkHz',
)  # fmt: skip
_UNKNOWN = '-'


def reading_table(readings: Sequence[Reading]) -> RenderableType:
    """One line for each reading, in the order in which they began."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.add_column('sensor\n', overflow='fold')  # a name is never cut
    for heading in _HEADINGS:
        table.add_column(heading, justify='right', no_wrap=True)
    for reading in readings:
        table.add_row(Text(in_one_line(reading.sensor_id)), *_cells(reading))
    if all(math.isfinite(reading.rate_bps) for reading in readings):
        return table
    why = (
        f'{_UNKNOWN}: not known, as the agent shared its bandwidth in a way of its own, or earlier'
        ' events are missing'
    )
    return Group(table, Text(why, style='dim'))


def _cells(reading: Reading) -> tuple[str, ...]:
    return (
        f'{reading.start_s:.1f}',
        f'{reading.end_s:.1f}',
        str(reading.uav),
        f'{reading.data_bit / 1e6:.3f}',
        _kilo(reading.rate_bps),
        _kilo(reading.bandwidth_hz),
    )


def _kilo(value: float) -> str:
    return f'{value / 1e3:.1f}' if math.isfinite(value) else _UNKNOWN

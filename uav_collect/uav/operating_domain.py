"""Where a policy decides by itself: the fields and fleets on which it was found to do well.

Elsewhere it does what its adviser would. The word is that of automated driving: the conditions
that a system is designed to work in are its operational design domain (SAE J3016).
"""

from collections.abc import Iterator, Sequence
import math
from typing import Annotated

from uav_collect.config.rules import number_span, Section, whole_span
from uav_collect.limits import MAX_CELLS_PER_SIDE, MAX_UAVS
from uav_collect.uav.briefing import Briefing

_TOLERANCE = 1e-9  # relative; what floating point rounds away

_Span = tuple[float, float]


class OperatingDomain(Section):
    """Spans of fields and fleets, least and most; absent: any."""

    n_uavs: Annotated[tuple[int, int] | None, whole_span(1, MAX_UAVS)] = None
    cells_per_side: Annotated[tuple[int, int] | None, whole_span(1, MAX_CELLS_PER_SIDE)] = None
    contact_range_cells: Annotated[_Span | None, number_span(0, math.inf)] = None  # of two or more
    speed_ratio: Annotated[_Span | None, number_span(1, 1e6)] = None  # fastest UAV to slowest one
    known_share: Annotated[_Span | None, number_span(0, 1)] = None  # cells known to be complete
    data_share: Annotated[_Span | None, number_span(0, 1)] = None  # of the others, with data

    def misfits(self, briefing: Briefing) -> Iterator[str]:
        """By what a fleet over a field lies outside, for people."""
        sides = briefing.n_rows, briefing.n_columns
        known = sum(briefing.known_complete) / len(briefing.known_complete)
        yield from _outside('UAVs', self.n_uavs, (briefing.n_uavs,))
        yield from _outside('rows and columns', self.cells_per_side, sides)
        if briefing.n_uavs > 1:
            reach = briefing.contact_range_m / briefing.cell_size_m
            yield from _outside('cells of contact range', self.contact_range_cells, (reach,))
            ratio = max(briefing.speed_mps) / min(briefing.speed_mps)
            yield from _outside('of the fastest to the slowest', self.speed_ratio, (ratio,))
        yield from _outside('of cells known to be empty', self.known_share, (known,))
        yield from _outside('of cells with data', self.data_share, (briefing.data_chance,))


def is_covered(domains: Sequence[OperatingDomain], briefing: Briefing) -> bool:
    """Whether a fleet over a field lies within one of them; without any, everything does."""
    return not domains or any(not [*it.misfits(briefing)] for it in domains)


def _outside(name: str, span: _Span | None, flown: Sequence[float]) -> Iterator[str]:
    if span is None:
        return
    (least, most), low, high = span, min(flown), max(flown)
    if low < least * (1.0 - _TOLERANCE) or high > most * (1.0 + _TOLERANCE):
        yield f'{_text(low, high)} {name} (within: {_text(least, most)})'


def _text(low: float, high: float) -> str:
    return f'{low:.3g}' if low == high else f'{low:.3g} to {high:.3g}'

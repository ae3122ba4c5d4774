"""Where a policy decides by itself: the fields and fleets on which it was found to do well.

Elsewhere it does what its adviser would. The word is that of automated driving: the conditions
that a system is designed to work in are its operational design domain (SAE J3016).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
from typing import Annotated

from uav_collect.config.rules import number, whole
from uav_collect.limits import MAX_CELLS_PER_SIDE, MAX_UAVS
from uav_collect.uav.briefing import Briefing

_TOLERANCE = 1e-9  # relative; what floating point rounds away

_Side = Annotated[int, whole(1, MAX_CELLS_PER_SIDE)]
_Fleet = Annotated[int, whole(1, MAX_UAVS)]
_Share = Annotated[float, number(0, 1)]
_Limit = Annotated[float, number(0, math.inf)]
_Ratio = Annotated[float, number(1, 1e6)]


@dataclass(frozen=True, kw_only=True)
class OperatingDomain:
    """Spans of fields and fleets, least and most."""

    n_uavs: tuple[_Fleet, _Fleet]
    cells_per_side: tuple[_Side, _Side]
    contact_range_cells: tuple[_Limit, _Limit]  # of fleets of two and more
    speed_ratio: tuple[_Ratio, _Ratio]  # of the fastest UAV to the slowest one
    known_share: tuple[_Share, _Share]  # of the cells, those known to hold no data
    data_share: tuple[_Share, _Share]  # of the other cells, those that hold some, as is expected

    def misfits(self, briefing: Briefing) -> Iterator[str]:
        """By what a fleet over a field lies outside, for people."""
        sides = briefing.n_rows, briefing.n_columns
        speeds_mps = [*briefing.speed_mps]
        yield from _outside('UAVs', self.n_uavs, (briefing.n_uavs,))
        yield from _outside('rows and columns', self.cells_per_side, sides)
        if briefing.n_uavs > 1:
            reach = briefing.contact_range_m / briefing.cell_size_m
            yield from _outside('cells of contact range', self.contact_range_cells, (reach,))
            ratio = max(speeds_mps) / min(speeds_mps)
            yield from _outside('of the fastest to the slowest', self.speed_ratio, (ratio,))
        known = sum(briefing.known_complete) / len(briefing.known_complete)
        yield from _outside('of cells known to be empty', self.known_share, (known,))
        yield from _outside('of cells with data', self.data_share, (briefing.data_chance,))


def is_covered(domains: Sequence[OperatingDomain], briefing: Briefing) -> bool:
    """Whether a fleet over a field lies within one of them; none: everything does."""
    return not domains or any(not [*it.misfits(briefing)] for it in domains)


def _outside(name: str, span: tuple[float, float], flown: Sequence[float]) -> Iterator[str]:
    least, most = span
    low, high = min(flown), max(flown)
    if low < least * (1.0 - _TOLERANCE) or high > most * (1.0 + _TOLERANCE):
        yield f'{_text(low, high)} {name} (within: {_text(least, most)})'


def _text(low: float, high: float) -> str:
    return f'{low:.3g}' if low == high else f'{low:.3g} to {high:.3g}'

"""Where a policy decides by itself: the fields and fleets on which it was found to do well.

Elsewhere its adviser flies. A policy of several networks has domains of each. The word is that of
automated driving: the conditions that a system is designed to work in are its operational design
domain (SAE J3016).
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
import math
from typing import Annotated

from uav_collect.config.rules import number_span, Rule, Section, truth, whole, whole_span
from uav_collect.limits import MAX_CELLS_PER_SIDE, MAX_UAVS
from uav_collect.uav.briefing import Briefing, budget_crossings

MAX_DOMAINS = 16  # of a policy: they are looked through at every take-off
MAX_NETWORKS = 8  # of a policy
_TOLERANCE = 1e-9  # relative; what floating point rounds away

_Span = tuple[float, float]


def _spans(low: float, high: float) -> Rule:
    """Spans of numbers that ascend, one for each UAV."""
    span = number_span(low, high)

    def parse(value: object) -> tuple[_Span, ...]:
        if not isinstance(value, list | tuple) or not 1 <= len(value) <= MAX_UAVS:
            raise ValueError
        spans: tuple[_Span, ...] = tuple(span.parse(each) for each in value)
        if any([*ends] != sorted(ends) for ends in zip(*spans, strict=True)):
            raise ValueError
        return spans

    return Rule(f'a list that ascends, of each UAV {span.allowed}', parse)


class OperatingDomain(Section):
    """Spans of fields and fleets, least and most; absent: any."""

    n_uavs: Annotated[tuple[int, int] | None, whole_span(1, MAX_UAVS)] = None
    cells_per_side: Annotated[tuple[int, int] | None, whole_span(1, MAX_CELLS_PER_SIDE)] = None
    side_ratio: Annotated[_Span | None, number_span(1, 1e6)] = None  # longer side to shorter one
    contact_range_cells: Annotated[_Span | None, number_span(0, math.inf)] = None  # of two or more
    loss_share: Annotated[_Span | None, number_span(0, 1)] = None  # of their messages
    late_s: Annotated[_Span | None, number_span(0, math.inf)] = None  # that these come at most
    speed_ratio: Annotated[_Span | None, number_span(1, 1e6)] = None  # fastest UAV to slowest one
    # Of each UAV over the slowest one's, from the slowest up: as many as there are UAVs.
    relative_speeds: Annotated[tuple[_Span, ...] | None, _spans(1, 1e6)] = None
    closed_share: Annotated[_Span | None, number_span(0, 1)] = None  # cells where nobody may fly
    known_share: Annotated[_Span | None, number_span(0, 1)] = None  # others known to be complete
    data_share: Annotated[_Span | None, number_span(0, 1)] = None  # of what is left, with data
    # What the UAV with the least may spend, in crossings of its part of these.
    budget_crossings: Annotated[_Span | None, number_span(0, math.inf)] = None
    # How far UAVs start and land from the nearest corner, along the area's sides.
    corner_cells: Annotated[_Span | None, number_span(0, MAX_CELLS_PER_SIDE)] = None
    # How far the starts, or the homes, of two UAVs are from each other.
    apart_cells: Annotated[_Span | None, number_span(0, 2 * MAX_CELLS_PER_SIDE)] = None
    may_fail: Annotated[bool | None, truth()] = None  # whether a UAV or its radio may
    # Which of the policy's networks decides; absent: the first.
    network: Annotated[int | None, whole(1, MAX_NETWORKS)] = None

    def misfits(self, briefing: Briefing) -> Iterator[str]:
        """By what a fleet over a field lies outside, for people."""
        sides = briefing.n_rows, briefing.n_columns
        n_closed = len(briefing.is_open) - sum(briefing.is_open)
        closed = n_closed / len(briefing.is_open)
        known = (sum(briefing.known_complete) - n_closed) / len(briefing.is_open)
        yield from _outside('UAVs', self.n_uavs, (briefing.n_uavs,))
        yield from _outside('rows and columns', self.cells_per_side, sides)
        square = (max(sides) / min(sides),)
        yield from _outside('of the longer side to the shorter', self.side_ratio, square)
        if briefing.n_uavs > 1:
            reach = briefing.contact_range_m / briefing.cell_size_m
            yield from _outside('cells of contact range', self.contact_range_cells, (reach,))
            yield from _outside('of messages lost', self.loss_share, (briefing.loss_share,))
            yield from _outside('s that messages are late', self.late_s, (briefing.late_s,))
            ratio = max(briefing.speed_mps) / min(briefing.speed_mps)
            yield from _outside('of the fastest to the slowest', self.speed_ratio, (ratio,))
        yield from self._unlike_speeds(briefing)
        yield from _outside('of cells closed', self.closed_share, (closed,))
        yield from _outside('of cells known to be empty', self.known_share, (known,))
        yield from _outside('of cells with data', self.data_share, (briefing.data_chance,))
        budget = (budget_crossings(briefing),)
        yield from _outside(
            "crossings of its cells in a UAV's budget", self.budget_crossings, budget
        )
        away = [*_corner_cells(briefing)]
        yield from _outside('cells from start and home to a corner', self.corner_cells, away)
        if briefing.n_uavs > 1:
            apart = (_apart_cells(briefing),)
            yield from _outside("cells between two UAVs' starts or homes", self.apart_cells, apart)
        if self.may_fail is not None and self.may_fail != (briefing.may_fail == 1):
            yield 'no faults are listed' if self.may_fail else 'faults are listed'

    @property
    def contradiction(self) -> str:
        """Why its `relative_speeds` keep every fleet outside, for people; '' if they do not."""
        n_speeds = len(self.relative_speeds or ())
        if n_speeds and not self.is_for(n_speeds):
            return f'is of {n_speeds} UAVs: must be of as many as n_uavs says'
        return ''

    def is_for(self, n_uavs: int) -> bool:
        """Whether fleets of so many UAVs may lie within."""
        return self.n_uavs is None or self.n_uavs[0] <= n_uavs <= self.n_uavs[1]

    def _unlike_speeds(self, briefing: Briefing) -> Iterator[str]:
        if self.relative_speeds is None:
            return
        ratios = _over_slowest(briefing)
        if len(ratios) != len(self.relative_speeds):
            if self.is_for(len(ratios)):  # else that was said
                yield f'{len(ratios)} UAVs (within: {len(self.relative_speeds)})'
            return
        names = (
            f'of speed {place} from below to the slowest' for place in range(1, len(ratios) + 1)
        )
        for name, span, ratio in zip(names, self.relative_speeds, ratios, strict=True):
            yield from _outside(name, span, (ratio,))

    def covers(self, briefing: Briefing) -> bool:
        """Whether a fleet over a field lies within."""
        return not any(self.misfits(briefing))


def _over_slowest(briefing: Briefing) -> list[float]:
    """The UAVs' speeds over the slowest one's, from the slowest up."""
    speeds_mps = sorted(briefing.speed_mps[uav] for uav in range(briefing.n_uavs))
    return [speed_mps / speeds_mps[0] for speed_mps in speeds_mps]


def _corner_cells(briefing: Briefing) -> Iterator[float]:
    wide_m = briefing.n_columns * briefing.cell_size_m
    high_m = briefing.n_rows * briefing.cell_size_m
    places = (
        (briefing.start_x_m, briefing.start_y_m),
        (briefing.home_x_m, briefing.home_y_m),
    )
    for x_row, y_row in places:
        for x_m, y_m in zip(x_row, y_row, strict=True):
            along, across = min(x_m, wide_m - x_m), min(y_m, high_m - y_m)
            yield max(along, across, 0.0) / briefing.cell_size_m


def _apart_cells(briefing: Briefing) -> float:
    uavs = range(briefing.n_uavs)
    starts = [(briefing.start_x_m[uav], briefing.start_y_m[uav]) for uav in uavs]
    homes = [(briefing.home_x_m[uav], briefing.home_y_m[uav]) for uav in uavs]
    pairs = (pair for places in (starts, homes) for pair in combinations(places, 2))
    return max(math.dist(*pair) for pair in pairs) / briefing.cell_size_m


def _outside(name: str, span: _Span | None, flown: Sequence[float]) -> Iterator[str]:
    if span is None:
        return
    (least, most), low, high = span, min(flown), max(flown)
    if low < least * (1.0 - _TOLERANCE) or high > most * (1.0 + _TOLERANCE):
        yield f'{_text(low, high)} {name} (within: {_text(least, most)})'


def _text(low: float, high: float) -> str:
    return f'{low:.3g}' if low == high else f'{low:.3g} to {high:.3g}'

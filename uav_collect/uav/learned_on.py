"""What a policy learned on, and by what a scenario lies outside of it.

A policy may fly where it did not learn, but how well nobody knows: whoever flies it there is told.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
import math
from typing import Annotated

from uav_collect.config.rules import number, truth, whole
from uav_collect.limits import MAX_CELLS_PER_SIDE, MAX_UAVS
from uav_collect.scenario.area import open_cells
from uav_collect.scenario.model import DrawnSensors, Scenario
from uav_collect.uav.briefing import brief, budget_crossings

_TOLERANCE = 1e-6  # relative; what files round away

_Amount = Annotated[float, number(0, 1e12)]
_Coordinate = Annotated[float, number(-1e12, 1e12)]
_Share = Annotated[float, number(0, 1)]
_Limit = Annotated[float, number(0, math.inf)]

Span = tuple[float, float]  # least and most


@dataclass(frozen=True, kw_only=True)
class LearnedOn:
    """A scenario, as far as a policy has got used to it."""

    cells_per_side: Annotated[int, whole(1, MAX_CELLS_PER_SIDE)]  # of the longer side
    cell_size_m: _Amount
    speeds_mps: tuple[_Amount, ...]  # by UAV
    contact_range_m: _Limit  # inf: always in contact
    homes: tuple[tuple[_Coordinate, _Coordinate], ...]  # by UAV, east and north in cells
    sensors_per_cell: _Amount  # on average
    cell_share: _Share  # of the cells with sensors, those that have data on average
    data_mbit: tuple[_Amount, _Amount]  # of a sensor that has any
    # Of messages between UAVs; files of before there were such radios say nothing of them.
    loss_share: _Share = 0.0
    delay_s: tuple[_Coordinate, _Coordinate] = (0.0, 0.0)
    rate_bps: _Limit = math.inf  # of a UAV's radio; inf: sending takes no time
    # Of areas that are not square; files of before there were such areas say nothing of them.
    rows: Annotated[int, whole(0, MAX_CELLS_PER_SIDE)] = 0  # 0: as many as cells per side
    columns: Annotated[int, whole(0, MAX_CELLS_PER_SIDE)] = 0
    closed_share: _Share = 0.0  # of the cells
    may_fail: Annotated[bool, truth()] = False  # whether faults were listed
    # Files of before say nothing of these two: specialists had ample energy, and knew of no cell.
    may_run_out: Annotated[bool, truth()] = False  # whether energy was for less than all cells
    known_share: _Share = 0.0  # of the cells, open ones that all know to hold nothing

    @property
    def area(self) -> tuple[int, int]:
        """Rows and columns of the area."""
        return self.rows or self.cells_per_side, self.columns or self.cells_per_side


def learned_on(scenario: Scenario) -> LearnedOn:
    """What a policy gets used to that learns in a scenario."""
    area, sensors, demand = scenario.area, scenario.sensors, scenario.demand
    size_m = area.cell_size_m
    if isinstance(sensors, DrawnSensors):
        dense = sensors.dense_cell_share
        per_cell = dense * sensors.dense_mean + (1.0 - dense) * sensors.sparse_mean
        listed_mbit = []
    else:
        per_cell = len(sensors.entries) / scenario.n_cells
        listed_mbit = [each.data_mbit or 0.0 for each in sensors.entries]
    data_mbit, radio = demand.data_mbit, scenario.radio
    mean_s, jitter_s = radio.delay_s or (0.0, 0.0)
    closed_share, briefing = 1.0 - float(open_cells(area).mean()), brief(scenario)
    # Of open cells: those that are closed hold nothing, either.
    n_known = int(sum(briefing.known_complete)) - int((open_cells(area) == 0).sum())
    return LearnedOn(
        cells_per_side=max(area.n_rows, area.n_columns),
        cell_size_m=size_m,
        speeds_mps=tuple(uav.speed_mps for uav in scenario.uavs),
        contact_range_m=radio.contact_range_m,
        homes=tuple((uav.home_m[0] / size_m, uav.home_m[1] / size_m) for uav in scenario.uavs),
        sensors_per_cell=per_cell,
        cell_share=1.0 if demand.cell_share == 'all' else demand.cell_share,
        data_mbit=(min(listed_mbit), max(listed_mbit)) if data_mbit == 'csv' else data_mbit,
        loss_share=radio.loss_share or 0.0,
        delay_s=(mean_s - jitter_s, mean_s + jitter_s),
        rate_bps=radio.rate_bps or math.inf,
        rows=0 if area.n_rows == area.n_columns else area.n_rows,
        columns=0 if area.n_rows == area.n_columns else area.n_columns,
        closed_share=closed_share,
        may_fail=bool(scenario.faults),
        may_run_out=bool(budget_crossings(briefing) < 1.0),
        known_share=n_known / scenario.n_cells,
    )


@dataclass(frozen=True, kw_only=True)
class LearnedWithin:
    """The spans that scenarios were drawn from, least and most; homes lay anywhere."""

    cells_per_side: tuple[
        Annotated[int, whole(1, MAX_CELLS_PER_SIDE)], Annotated[int, whole(1, MAX_CELLS_PER_SIDE)]
    ]
    cell_size_m: tuple[_Amount, _Amount]
    closed_share: tuple[_Share, _Share]
    n_uavs: tuple[Annotated[int, whole(1, MAX_UAVS)], Annotated[int, whole(1, MAX_UAVS)]]
    speed_mps: tuple[_Amount, _Amount]
    contact_range_m: tuple[_Limit, _Limit]
    loss_share: tuple[_Share, _Share]
    delay_s: tuple[_Coordinate, _Coordinate]
    sensors_per_cell: tuple[_Amount, _Amount]
    cell_share: tuple[_Share, _Share]
    data_mbit: tuple[_Amount, _Amount]


def strangeness_within(known: LearnedWithin, scenario: Scenario) -> list[str]:
    """By what a scenario lies outside the spans that a policy learned within, for people."""
    return [*_strange_within(known, learned_on(scenario))]


def _strange_within(known: LearnedWithin, flown: LearnedOn) -> Iterator[str]:
    n_uavs = len(flown.speeds_mps)
    fleet = min(flown.speeds_mps), max(flown.speeds_mps)
    yield from _outside('rows and columns', '', known.cells_per_side, _span_of(flown.area))
    yield from _outside('cells of', 'm', known.cell_size_m, _point(flown.cell_size_m))
    yield from _outside('closed cells', '', known.closed_share, _point(flown.closed_share))
    yield from _outside('UAVs', '', known.n_uavs, _point(n_uavs))
    yield from _outside('speeds', 'm/s', known.speed_mps, fleet)
    if n_uavs > 1:
        range_m = _point(flown.contact_range_m)
        yield from _outside('contact range', 'm', known.contact_range_m, range_m)
        yield from _outside('messages lost', '', known.loss_share, _point(flown.loss_share))
        yield from _outside('messages late by', 's', known.delay_s, flown.delay_s)
    per_cell = _point(flown.sensors_per_cell)
    yield from _outside('sensors per cell', '', known.sensors_per_cell, per_cell)
    yield from _outside('cells with data', '', known.cell_share, _point(flown.cell_share))
    yield from _outside('data of a sensor', 'Mbit', known.data_mbit, flown.data_mbit)


def _outside(name: str, unit: str, known: Span, flown: Span) -> Iterator[str]:
    """The difference where what is flown lies outside a span."""
    (least, most), (low, high) = known, flown
    if not (_at_most(least, low) and _at_most(high, most)):
        yield f'{name} {_span(low, high, unit)} (learned: {_span(least, most, unit)})'


def _span_of(values: Sequence[float]) -> Span:
    return min(values), max(values)


def strangeness(known: Sequence[LearnedOn], scenario: Scenario) -> list[str]:
    """By what a scenario lies outside all that a policy learned on.

    Args:
        known: the scenarios that it learned in; none: it does not say, and nothing is judged.

    Returns:
        Each difference as the value that is flown and those that were learned, for people.
    """
    if not known:
        return []
    return [*_strange(known, learned_on(scenario))]


def _strange(known: Sequence[LearnedOn], flown: LearnedOn) -> Iterator[str]:
    yield from _unlike('area', _area, known, flown)
    yield from _beyond('closed cells', '', lambda it: _point(it.closed_share), known, flown)
    yield from _unlike('fleet', _fleet, known, flown)
    # Which UAV is which it tells by their number: only fleets of as many compare.
    alike = [each for each in known if len(each.speeds_mps) == len(flown.speeds_mps)]
    if alike:
        yield from _unlike('speeds', _speeds, alike, flown)
        yield from _unlike('homes', _homes, alike, flown)
    if len(flown.speeds_mps) > 1:  # else there is nobody to be in contact with
        yield from _strange_radio(known, flown)
    yield from _beyond(
        'sensors per cell', '', lambda it: _point(it.sensors_per_cell), known, flown
    )
    yield from _beyond('cells with data', '', lambda it: _point(it.cell_share), known, flown)
    yield from _beyond('data of a sensor', 'Mbit', lambda it: it.data_mbit, known, flown)
    yield from _beyond(
        'cells known to hold nothing', '', lambda it: _point(it.known_share), known, flown
    )
    if flown.may_fail and not any(each.may_fail for each in known):
        yield 'faults (learned: none)'
    if flown.may_run_out and not any(each.may_run_out for each in known):
        yield 'energy that may run out (learned: ample)'


def _strange_radio(known: Sequence[LearnedOn], flown: LearnedOn) -> Iterator[str]:
    yield from _beyond('contact range', 'm', lambda it: _point(it.contact_range_m), known, flown)
    yield from _beyond('messages lost', '', lambda it: _point(it.loss_share), known, flown)
    yield from _beyond('messages late by', 's', lambda it: it.delay_s, known, flown)
    yield from _beyond('messages sent at', 'bit/s', lambda it: _point(it.rate_bps), known, flown)


def _unlike(
    name: str, text_of: Callable[[LearnedOn], str], known: Sequence[LearnedOn], flown: LearnedOn
) -> Iterator[str]:
    """The difference where what is flown is none of the learned."""
    learned = [*dict.fromkeys(map(text_of, known))]
    if text_of(flown) not in learned:
        yield f'{name} {text_of(flown)} (learned: {", ".join(learned)})'


def _beyond(
    name: str,
    unit: str,
    span_of: Callable[[LearnedOn], Span],
    known: Sequence[LearnedOn],
    flown: LearnedOn,
) -> Iterator[str]:
    """The difference where what is flown lies outside the span of the learned."""
    least = min(span_of(each)[0] for each in known)
    most = max(span_of(each)[1] for each in known)
    yield from _outside(name, unit, (least, most), span_of(flown))


def _at_most(value: float, limit: float) -> bool:
    return value <= limit or math.isclose(value, limit, rel_tol=_TOLERANCE)


def _point(value: float) -> Span:
    return value, value


def _span(low: float, high: float, unit: str) -> str:
    numbers = f'{low:g}' if _at_most(high, low) else f'{low:g} to {high:g}'
    return f'{numbers} {unit}'.rstrip()


def _area(it: LearnedOn) -> str:
    return '{} x {} cells of {:g} m'.format(*it.area, it.cell_size_m)


def _fleet(it: LearnedOn) -> str:
    return f'{len(it.speeds_mps)} UAV{"s" if len(it.speeds_mps) > 1 else ""}'


def _speeds(it: LearnedOn) -> str:
    return f'{" and ".join(f"{speed:g}" for speed in it.speeds_mps)} m/s'


def _homes(it: LearnedOn) -> str:
    places = [f'({east:g}, {north:g})' for east, north in it.homes]
    return f'{" and ".join(places if len({*places}) > 1 else places[:1])} cells east and north'

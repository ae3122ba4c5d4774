"""What each UAV of a fleet takes, over missions: energy and time, by policy."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from uav_collect.analysis.console import LEAST_COLUMNS
from uav_collect.analysis.metrics import MissionMetrics, UavMetrics
from uav_collect.analysis.short_names import short_names

UAV_MEASURES = ('energy_kj', 'landed_s', 'collected_mbit')  # of a UAV in a mission
_MAX_ROWS = 48  # of the table; of a larger fleet it has the UAVs at the limit
_FIGURES_COLUMNS = 58  # without names


@dataclass(frozen=True, kw_only=True)
class UavFigures:
    """What one UAV takes in some missions."""

    id: int  # from 1
    energy_kj: float  # mean
    most_energy_kj: float
    most_energy_share: float  # of its budget
    landed_s: float  # mean time of landing; nan where it did not land in each
    latest_landed_s: float
    collected_mbit: float  # mean

    def to_json(self) -> dict[str, float | None]:
        """The figures as files hold them; None where one is not known."""
        return {name: it if math.isfinite(it) else None for name, it in vars(self).items()}


def uav_figures(missions: Sequence[MissionMetrics]) -> tuple[UavFigures, ...]:
    """What each UAV takes in missions of one policy, at least one; by id."""
    return tuple(_figures(uavs) for uavs in zip(*(it.uavs for it in missions), strict=True))


def uav_columns(n_uavs: int) -> tuple[str, ...]:
    """The columns of a CSV file that `uav_values` fills."""
    return tuple(f'uav_{uav}_{name}' for uav in range(1, n_uavs + 1) for name in UAV_MEASURES)


def uav_values(mission: MissionMetrics) -> tuple[float, ...]:
    """UAV_MEASURES of each UAV in a mission, one after the other."""
    return tuple(value for uav in mission.uavs for value in _values(uav))


def uav_table(
    missions: Mapping[str, Sequence[MissionMetrics]], columns: int = LEAST_COLUMNS
) -> RenderableType:
    """What each UAV takes, by policy; of a large fleet, those that take most or land last.

    Args:
        missions: by policy, at least one; the same seeds for each.
        columns: of the terminal; names of policies are as short as that asks for.
    """
    names = short_names([*missions], max(14, columns - _FIGURES_COLUMNS))
    rows = {names[policy]: uav_figures(flown) for policy, flown in missions.items()}
    is_mean = any(len(flown) > 1 for flown in missions.values())
    n_uavs = len(next(iter(rows.values())))
    shown = _shown_uavs(rows, n_uavs)
    table = _empty_table(is_mean=is_mean)
    for uav in shown:
        for index, (name, figures) in enumerate(rows.items()):
            number = '' if index else str(uav + 1)
            table.add_row(number, Text(name), *_cells(figures[uav], is_mean=is_mean))
        if len(rows) > 1:
            table.add_section()
    if len(shown) == n_uavs:
        return table
    what = f'of {n_uavs} UAVs, those that use most of their energy or land last'
    return Group(table, Text(what, style='dim'))


def _values(uav: UavMetrics) -> tuple[float, float, float]:
    return uav.energy_j / 1e3, uav.landed_s, uav.collected_bit / 1e6


def _figures(uavs: Sequence[UavMetrics]) -> UavFigures:
    """What one UAV takes, given by its metrics in each mission."""
    values = np.array([_values(uav) for uav in uavs])
    energy_kj, landed_s, collected_mbit = values.mean(axis=0).tolist()
    return UavFigures(
        id=uavs[0].id,
        energy_kj=energy_kj,
        most_energy_kj=float(values[:, 0].max()),
        most_energy_share=max(uav.energy_j / uav.energy_budget_j for uav in uavs),
        landed_s=landed_s,
        latest_landed_s=float(values[:, 1].max()),
        collected_mbit=collected_mbit,
    )


def _shown_uavs(rows: Mapping[str, Sequence[UavFigures]], n_uavs: int) -> Sequence[int]:
    """The UAVs of the table, by index."""
    if n_uavs * len(rows) <= _MAX_ROWS:
        return range(n_uavs)
    return sorted({uav for figures in rows.values() for uav in _extremes(figures)})


def _extremes(figures: Sequence[UavFigures]) -> Iterator[int]:
    uavs = range(len(figures))
    yield max(uavs, key=lambda uav: figures[uav].most_energy_share)
    yield max(uavs, key=lambda uav: figures[uav].latest_landed_s)


def _empty_table(*, is_mean: bool) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.add_column('UAV\n', justify='right', no_wrap=True)
    table.add_column('policy\n', overflow='fold')
    headings = ['energy\nkJ', 'most\nkJ'] if is_mean else ['energy\nkJ']
    headings += ['of its\nbudget', 'landed\ns']
    for heading in [*headings, *(['latest\ns'] if is_mean else []), 'data\nMbit']:
        table.add_column(heading, justify='right', no_wrap=True)
    return table


def _cells(figures: UavFigures, *, is_mean: bool) -> Iterator[str]:
    yield f'{figures.energy_kj:.2f}'
    if is_mean:
        yield f'{figures.most_energy_kj:.2f}'
    yield f'{100 * figures.most_energy_share:.1f} %'
    yield _seconds(figures.landed_s)
    if is_mean:
        yield _seconds(figures.latest_landed_s)
    yield f'{figures.collected_mbit:.2f}'


def _seconds(time_s: float) -> str:
    return f'{time_s:.1f}' if math.isfinite(time_s) else '-'

"""What batteries do for fleets, as tables, as one closing sentence, and as rows of a file."""

from collections.abc import Iterable, Iterator, Sequence
import math
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from uav_collect.analysis.metrics import percent
from uav_collect.analysis.sizing import Battery, J_PER_WH, QUANTILES, quantiles, Sized, Trial
from uav_collect.analysis.statistics import (
    CONFIDENCE_LEVEL,
    n_missions_to_show,
    share_interval,
)
from uav_collect.kernels.arrays import Floats

_FREELY = 'ample'
_MOST_NAMED = 3  # pairs in one line


def needs_table(trials: Iterable[Trial], battery: Battery) -> Table:
    """Energy and time of each UAV in the trials with all that they take, by fleet."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 0, 0, 1))
    for heading in ('UAVs\n', 'UAV\n', 'speed\nm/s'):
        table.add_column(heading, justify='right', no_wrap=True)
    table.add_column('of the\nmissions', no_wrap=True)
    columns = (
        'energy\nkJ',
        'energy\nWh',
        'battery\nWh',
        f'at {battery.volt:g} V\nmAh',
        'landed\ns',
    )
    for heading in columns:
        table.add_column(heading, justify='right', no_wrap=True)
    for trial in trials:
        if not math.isinf(trial.battery_wh) or trial.metrics is None:
            continue
        for uav in range(trial.n_uavs):
            numbers = uav_quantiles(trial, uav, battery)
            for index, key in enumerate(QUANTILES):
                first = _uav_cells(trial, uav) if index == 0 else ('', '', '')
                table.add_row(*first, key, *_need_cells(numbers, key))
        table.add_section()
    return table


def composition(trials: Sequence[Trial], battery: Battery) -> str:
    """What a battery must hold besides the energy that a flight takes, in one line."""
    margins_wh = {f'{margin_j / J_PER_WH:.1f}' for it in trials for margin_j in it.margin_j}
    margin = ' or '.join(sorted(margins_wh, key=float))
    return f'battery: (energy + {margin} Wh of energy_margin_kj) / {battery.usable_share:g}'


def _uav_cells(trial: Trial, uav: int) -> tuple[str, ...]:
    n_uavs = str(trial.n_uavs) if uav == 0 else ''
    return n_uavs, str(uav + 1), f'{trial.speed_mps[uav]:g}'


def _need_cells(numbers: dict[str, dict[str, float]], key: str) -> tuple[str, ...]:
    return (
        f'{numbers["energy_kj"][key]:.2f}',
        f'{numbers["energy_wh"][key]:.2f}',
        f'{numbers["battery_wh"][key]:.2f}',
        f'{numbers["battery_mah"][key]:.0f}',
        f'{numbers["landed_s"][key]:.1f}',
    )


def uav_quantiles(trial: Trial, uav: int, battery: Battery) -> dict[str, dict[str, float]]:
    """QUANTILES of what one UAV, by its index, used and needed in the missions of a trial."""
    if trial.metrics is None:
        return {}
    energy_j, landed_s = trial.metrics.energy_j[:, uav], trial.metrics.landed_s[:, uav]
    margin_j = trial.margin_j[uav]
    columns: dict[str, Floats] = {
        'energy_kj': energy_j / 1e3,
        'energy_wh': energy_j / J_PER_WH,
        'battery_wh': (energy_j + margin_j) * battery.wh(1.0),
        'battery_mah': (energy_j + margin_j) * battery.mah(battery.wh(1.0)),
        'landed_s': landed_s,
    }
    return {name: quantiles(values) for name, values in columns.items()}


def trials_table(trials: Iterable[Trial], battery: Battery) -> Table:
    """What each battery that was flown did, by fleet, the smallest first."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 0, 0, 1))
    for heading in (
        'UAVs\n', 'battery\nWh', 'charge\nmAh', 'complete\n%',
        f'{100 * CONFIDENCE_LEVEL:.0f} % within\n%', 'data\n%', 'landed\np50, s', '\np95', '\nmax',
    ):  # fmt: skip
        table.add_column(heading, justify='right', no_wrap=True)
    shown = 0
    for trial in sorted(trials, key=lambda it: (it.n_uavs, it.battery_wh)):
        if shown and trial.n_uavs != shown:
            table.add_section()
        is_first, shown = trial.n_uavs != shown, trial.n_uavs
        table.add_row(str(trial.n_uavs) if is_first else '', *_trial_cells(trial, battery))
    return table


def _trial_cells(trial: Trial, battery: Battery) -> Iterator[str]:
    is_free = math.isinf(trial.battery_wh)
    yield _FREELY if is_free else f'{trial.battery_wh:g}'
    yield '' if is_free else f'{battery.mah(trial.battery_wh):.0f}'
    low, high = trial.interval
    yield _percent(trial.complete_share).removesuffix(' %')
    yield f'{math.floor(1e3 * low) / 10:.1f} to {math.ceil(1e3 * high) / 10:.1f}'
    if trial.metrics is None:
        yield 'stays'
        return
    yield percent(float(trial.metrics.collected_share.mean())).removesuffix(' %')
    yield from (f'{value:.0f}' for value in quantiles(trial.metrics.completion_s).values())


def _percent(share: float) -> str:
    """A share in per cent, rounded down, with as many digits as ten thousand missions bear."""
    return f'{math.floor(1e4 * share + 1e-6) / 100:.2f} %'


def summary(found: Sequence[Sized], wanted_share: float, *, is_searched: bool) -> RenderableType:
    """The sentence that it ends with, and what a user must know beside it.

    Args:
        is_searched: whether the batteries were searched for, not given.
    """
    enough = [it for it in found if not math.isnan(it.needed_wh)]
    wanted = f'{100 * wanted_share:g} %'
    lines = [Text(line, style='bold') for line in _enough(enough, wanted_share, wanted)]
    for it in found:
        if math.isnan(it.needed_wh):
            lines.append(Text(_too_little(it, wanted, is_searched), style='yellow'))
        if it.reversals:
            lines.append(Text(_reversed(it), style='yellow'))
    return Group(*lines)


def _enough(enough: Sequence[Sized], wanted_share: float, wanted: str) -> Iterator[str]:
    """The batteries that do; where too few missions were flown to say so, what these show."""
    n_least = n_missions_to_show(wanted_share)
    if enough and n_least is not None and enough[0].n_missions >= n_least:
        yield f'with {wanted} of missions complete: {_fleets(enough)}'
        return
    for n_complete, n_missions in dict.fromkeys((it.n_complete, it.n_missions) for it in enough):
        low, _ = share_interval(n_complete, n_missions)
        least = math.floor(1e3 * low) / 10  # not more than was shown
        shown = f'all data in {n_complete} of {n_missions} missions (at least {least:.1f} %)'
        yield f'{shown}: {_fleets(it for it in enough if it.n_complete == n_complete)}'
    if enough and n_least is not None:
        yield f'too few missions to show {wanted}: fly --missions {n_least} or more'


def _fleets(found: Iterable[Sized]) -> str:
    return ', '.join(f'{it.n_uavs} x {it.needed_wh:g} Wh' for it in found)


def _too_little(found: Sized, wanted: str, is_searched: bool) -> str:
    fleet = f'{found.n_uavs} UAV{"s" if found.n_uavs > 1 else ""}'
    if math.isnan(found.best_share):
        return f'{fleet}: interrupted before anything was known'
    best = f'{_percent(found.best_share)} with all that they take'
    if is_searched or math.isnan(found.most_wh):
        return f'{fleet}: no battery does for {wanted} of missions: {best}'
    likely = '' if math.isinf(found.free_wh) else f'; try {found.free_wh:g} Wh'
    return f'{fleet}: {found.most_wh:g} Wh are too little for {wanted} of missions: {best}{likely}'


def _reversed(found: Sized) -> str:
    pairs = [f'{more:g} Wh less than {less:g} Wh' for less, more in found.reversals]
    more = f' and {len(pairs) - _MOST_NAMED} more' if len(pairs) > _MOST_NAMED else ''
    return (
        f'{found.n_uavs} UAVs: more battery did not always do more:'
        f' {", ".join(pairs[:_MOST_NAMED])}{more}'
    )


def rows(trials: Iterable[Trial], battery: Battery) -> Iterator[dict[str, Any]]:
    """A row of a file for each UAV of each trial; None where there is nothing to say."""
    for trial in trials:
        low, high = trial.interval
        about = {
            'uavs': trial.n_uavs,
            'battery_wh': None if math.isinf(trial.battery_wh) else trial.battery_wh,
            'budget_kj': _rounded(trial.budget_j / 1e3),
            'usable_share': battery.usable_share,
            'battery_v': battery.volt,
            'missions': trial.n_missions,
            'complete_share': _rounded(trial.complete_share),
            'complete_share_low': _rounded(low),
            'complete_share_high': _rounded(high),
        } | _whole_fleet(trial)
        for uav in range(trial.n_uavs):
            numbers = uav_quantiles(trial, uav, battery)
            own = {
                f'{name}_{key}': _rounded(numbers[name][key]) if numbers else None
                for name in ('energy_kj', 'battery_wh', 'battery_mah', 'landed_s')
                for key in QUANTILES
            }
            yield about | {'uav': uav + 1} | own


def _whole_fleet(trial: Trial) -> dict[str, float | None]:
    keys = [f'completion_s_{key}' for key in QUANTILES]
    if trial.metrics is None:
        return dict.fromkeys(('collected_share', *keys))
    times_s = map(_rounded, quantiles(trial.metrics.completion_s).values())
    share = float(trial.metrics.collected_share.mean())
    return {'collected_share': _rounded(share), **dict(zip(keys, times_s, strict=True))}


def _rounded(value: float) -> float:
    """A number with as many digits as missions bear; infinite stays infinite."""
    return float(f'{value:.6g}')

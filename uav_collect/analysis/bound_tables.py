"""Tables of clairvoyant bounds for the terminal."""

from collections.abc import Mapping

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from uav_collect.analysis.statistics import Estimate, LEVEL
from uav_collect.analysis.tables import estimate_cells

_TITLES = {
    'completion_s': 'completion time [s]',
    'energy_kj': 'energy [kJ]',
    'efficiency_kbit_per_j': 'energy efficiency [kbit/J]',
}
_PLANS = {
    'shortest': 'shortest plan',
    'thriftiest': 'thriftiest plan',
    'limit': 'no flight beyond',
}
_SHARES = {
    'time_share': 'time, of the shortest',
    'efficiency_share': 'efficiency, of the thriftiest',
    'efficiency_share_of_shortest': 'efficiency, of the shortest',
}


def bound_table(rows: Mapping[str, Estimate]) -> RenderableType:
    """The plans and the limits, measure by measure; estimates by key of `bound_numbers`."""
    table = _table('measure', 'what')
    for measure, title in _TITLES.items():
        for plan, name in _PLANS.items():
            cells = estimate_cells(rows[f'{plan}_{measure}'])
            table.add_row(Text(title), Text(name), *cells)
            title = ''
        table.add_section()
    gaps = [
        _gap(rows, 'completion_s', 'shortest', 'time'),
        _gap(rows, 'energy_kj', 'thriftiest', 'energy'),
    ]
    text = f'the limits are proven; they leave open {" and ".join(gaps)}'
    return Group(table, Text(text, style='dim'))


def share_table(rows: Mapping[str, tuple[int, Mapping[str, Estimate]]]) -> RenderableType:
    """How near policies come to the plans, in per cent.

    The shortest plan's efficiency is no bound, but what may be reached when time counts first.

    Args:
        rows: by policy, how many missions count and the estimates by key of `shares`.
    """
    table = _table('% of the clairvoyant plan', 'policy')
    for key, title in _SHARES.items():
        for policy, (_, estimates) in rows.items():
            if key in estimates:
                table.add_row(Text(title), Text(policy), *_percentages(estimates[key]))
                title = ''
        if len(rows) > 1:
            table.add_section()
    counts = ', '.join(f'{policy} {n_missions}' for policy, (n_missions, _) in rows.items())
    text = f'missions that collected everything and have plans: {counts}'
    return Group(table, Text(text, style='dim'))


def _percentages(estimate: Estimate) -> tuple[str, str, str]:
    shown = [f'{100 * share:.1f}' for share in (estimate.mean, estimate.low, estimate.high)]
    return shown[0], f'{shown[1]} to {shown[2]}', f'{100 * estimate.median:.1f}'


def _table(*headings: str) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        table.add_column(heading)
    for heading in ('mean', f'{100 * LEVEL:.0f} % interval', 'median'):
        table.add_column(heading, justify='right')
    return table


def _gap(rows: Mapping[str, Estimate], measure: str, plan: str, name: str) -> str:
    share = 1.0 - rows[f'limit_{measure}'].mean / max(rows[f'{plan}_{measure}'].mean, 1e-300)
    return f'{100 * max(share, 0.0):.1f} % of the {name}'

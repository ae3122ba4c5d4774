"""Tables for the terminal: one mission, many missions of several policies, clairvoyant plans."""

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
import math

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from uav_collect.analysis.console import LEAST_COLUMNS
from uav_collect.analysis.metrics import (
    FAILSAFE,
    FAULT,
    MissionMetrics,
    percent,
    UavMetrics,
    UNFINISHED,
    UNKNOWN,
)
from uav_collect.analysis.per_uav import uav_table
from uav_collect.analysis.plan_shares import efficiency_share, time_share
from uav_collect.analysis.short_names import short_names
from uav_collect.analysis.statistics import CONFIDENCE_LEVEL, Estimate, MEASURES
from uav_collect.errors import in_one_line
from uav_collect.limits import MAX_NAME
from uav_collect.planning.bound import Bound, Plan
from uav_collect.recording.mission_log import MissionHeader

_WARNING = 'bold red'
_MAX_SEEDS = 5  # named in one line
_MAX_SENSORS = 8  # the same
_GAP = 'events were not recorded'
_WHOLE = 10_000  # columns, for names that nobody shortens
_ROUNDING = 1e-9  # that a share of all may lack
_ALIKE = 1e-3  # shares of the data that count as the same
_LEAST_NAME = 20  # columns of a policy's name, at least: titles of measures take two lines first
_ESTIMATES_COLUMNS = 66  # of a table of estimates, without names
_FIGURES_COLUMNS = 44  # of a comparison
_BAD_ENDS = (FAILSAFE, FAULT, UNFINISHED, UNKNOWN)
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

# The title of some rows, and by the name of a row its mean, interval and median.
_Group = tuple[str, Mapping[str, tuple[str, str, str]]]


def mission_tables(
    header: MissionHeader,
    mission: MissionMetrics,
    n_radio_messages: int | None = None,
    bound: Bound | None = None,
    left: Sequence[str] = (),
) -> RenderableType:
    """What a mission achieved, each UAV's part, and what went wrong.

    Args:
        header: of the mission's log.
        mission: its metrics.
        n_radio_messages: delivered between UAVs; None where only the log is known.
        bound: the mission's; None where it is not known.
        left: the sensors whose data were left behind, by their ids, as far as they are known.
    """
    policies = ', '.join(short_names([uav.policy for uav in header.uavs], MAX_NAME).values())
    allocators = ', '.join(dict.fromkeys(uav.allocator for uav in header.uavs))
    title = headline(
        f'{in_one_line(header.scenario, MAX_NAME)}, mission seed {header.mission_seed}',
        f': {policies}, {allocators} bandwidth',
    )
    return Group(
        title,
        _fleet_table(mission, n_radio_messages, bound),
        _uav_table(mission),
        *(Text(f'warning: {line}', style=_WARNING) for line in mission_warnings(mission, left)),
    )


def headline(subject: str, rest: str) -> Text:
    """The line above tables: what they are about, and under which circumstances."""
    title = Text(subject, style='bold')
    title.append(rest, style='not bold')
    return title


def mission_warnings(mission: MissionMetrics, left: Sequence[str] = ()) -> list[str]:
    """What a user must not overlook, one line each; `left` as for `mission_tables`."""
    lines = [_ending_warning(uav) for uav in mission.uavs if uav.outcome in _BAD_ENDS]
    lines += [
        f'UAV {fault.uav} was {fault.fault} from {fault.time_s:.0f} s on, by a fault'
        for fault in mission.faults
    ]
    lines += [
        f'UAV {uav.id} landed with {uav.energy_left_j / 1e3:.3f} kJ,'
        f' less than its margin of {uav.energy_margin_j / 1e3:.3f} kJ'
        for uav in mission.uavs
        if uav.has_landed and not uav.is_safe
    ]
    if not mission.is_complete:
        lines.append(_data_warning(mission, left))
    return lines


def _data_warning(mission: MissionMetrics, left: Sequence[str]) -> str:
    left_mbit = (mission.total_bit - mission.collected_bit) / 1e6
    if mission.lacks_events:
        return f'of {left_mbit:.2f} Mbit it is not known whether they were collected: {_GAP}'
    return f'{left_mbit:.2f} Mbit of data were left behind{_at_sensors(left)}'


def _at_sensors(ids: Sequence[str]) -> str:
    """The first of some sensors by their ids, and how many more there are."""
    if not ids:
        return ''
    named = ', '.join(map(in_one_line, ids[:_MAX_SENSORS]))
    n_more = len(ids) - _MAX_SENSORS
    return f', at {named}' + (f' and {n_more} more sensors' if n_more > 0 else '')


def _ending_warning(uav: UavMetrics) -> str:
    if uav.outcome == UNFINISHED:
        return f'UAV {uav.id} has not landed: the mission was cut short'
    if uav.outcome == UNKNOWN:
        return f'of UAV {uav.id} it is not known whether it landed: {_GAP}'
    why = 'its agent was gone' if uav.outcome == FAULT else 'its agent did not answer'
    return f'UAV {uav.id} was flown home by the failsafe: {why}'


def _fleet_table(
    mission: MissionMetrics, n_radio_messages: int | None, bound: Bound | None
) -> Table:
    table = Table(box=None, show_header=False, padding=(0, 2))
    table.add_column()
    table.add_column(justify='right')
    table.add_column(style='dim')
    collected_mbit, total_mbit = mission.collected_bit / 1e6, mission.total_bit / 1e6
    share = f'{percent(mission.collected_share)} of {total_mbit:.2f} Mbit'
    table.add_row('data collected', f'{collected_mbit:.2f} Mbit', share)
    table.add_row('energy', f'{mission.energy_kj:.2f} kJ')
    table.add_row(
        'completion time',
        f'{mission.completion_s:.1f} s' if mission.is_finished else '-',
        _plan_share_text(time_share, mission, bound),
    )
    table.add_row(
        'energy efficiency',
        f'{mission.efficiency_kbit_per_j:.3f} kbit/J',
        _plan_share_text(efficiency_share, mission, bound),
    )
    by_guard = f'{mission.n_guarded} by the guard' if mission.n_guarded else ''
    table.add_row('decisions', str(mission.n_decisions), by_guard)
    if n_radio_messages is None:
        table.add_row('UAVs heard', str(mission.n_heard), 'over all decisions')
    else:
        table.add_row('radio messages', str(n_radio_messages), 'delivered between UAVs')
    return table


def _plan_share_text(
    share: Callable[[MissionMetrics, Bound], float], mission: MissionMetrics, bound: Bound | None
) -> str:
    """How near a mission comes to the best that is possible; nothing where that is not known."""
    reached = math.nan if bound is None else share(mission, bound)
    return '' if math.isnan(reached) else f'{percent(reached)} of the clairvoyant plan'


def _uav_table(mission: MissionMetrics) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 0, 0, 1))
    for heading in (
        'UAV\n', 'speed\nm/s', 'data\nMbit', 'energy\nkJ', 'left\nkJ', 'flight\ns', 'hover\ns',
        'decisions\n(guard)' if mission.n_guarded else 'decisions\n',
    ):  # fmt: skip
        table.add_column(heading, justify='right', no_wrap=True)
    table.add_column('went home by\n', no_wrap=True)
    for uav in mission.uavs:
        is_bad = uav.outcome in _BAD_ENDS or not uav.is_safe
        table.add_row(*_uav_row(uav), style=_WARNING if is_bad else None)
    return table


def _uav_row(uav: UavMetrics) -> tuple[str, ...]:
    return (
        str(uav.id),
        f'{uav.speed_mps:g}',
        f'{uav.collected_bit / 1e6:.2f}',
        f'{uav.energy_j / 1e3:.2f}',
        '-' if math.isnan(uav.energy_left_j) else f'{uav.energy_left_j / 1e3:.2f}',
        f'{uav.flight_s:.1f}',
        f'{uav.hover_s:.1f}',
        f'{uav.n_decisions} ({uav.n_guarded})' if uav.n_guarded else str(uav.n_decisions),
        uav.outcome,
    )


def comparison_table(
    missions: Mapping[str, MissionMetrics],
    bound: Bound | None = None,
    columns: int = LEAST_COLUMNS,
) -> RenderableType:
    """One mission as several policies fly it, by policy, and as plans that know it would.

    Args:
        columns: of the terminal, as for other tables of several policies.
    """
    names = short_names([*missions], columns - _FIGURES_COLUMNS)
    table = Table(box=SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.add_column('the same mission by\n', overflow='fold')  # a name is never cut
    for heading in ('data\ncollected', 'energy\nkJ', 'completion\ns', 'efficiency\nkbit/J'):
        table.add_column(heading, justify='right', no_wrap=True)
    for policy, mission in missions.items():
        table.add_row(
            Text(names[policy]),
            percent(mission.collected_share),
            f'{mission.energy_kj:.2f}',
            f'{mission.completion_s:.1f}' if mission.is_finished else '-',
            f'{mission.efficiency_kbit_per_j:.3f}',
        )
    if bound is not None:
        for name, plan in (
            ('shortest plan', bound.shortest),
            ('thriftiest plan', bound.thriftiest),
        ):
            if plan is not None:
                table.add_row(*_plan_row(name, plan, bound), style='dim')
    return Group(table, uav_table({policy: [one] for policy, one in missions.items()}, columns))


def _plan_row(name: str, plan: Plan, bound: Bound) -> tuple[str, ...]:
    return (
        name,
        percent(1.0),
        f'{plan.total_energy_j / 1e3:.2f}',
        f'{plan.completion_s:.1f}',
        f'{bound.efficiency_kbit_per_j(plan):.3f}',
    )


def evaluation_table(
    missions: Mapping[str, Sequence[MissionMetrics]],
    rows: Mapping[str, Sequence[Estimate]],
    columns: int = LEAST_COLUMNS,
) -> RenderableType:
    """The estimates of several policies, measure by measure, and the missions that went wrong.

    Measures that are 100 % in every mission of every policy share a line.

    Args:
        missions: flown, by policy; the same seeds for each.
        rows: one estimate for each of MEASURES, by policy.
        columns: of the terminal; names of policies are as short as that asks for.
    """
    names, whole = _names_of(rows, columns), _whole_measures(rows)
    groups = _by_measure(rows, names, but=whole)
    table = _estimate_table('measure', 'policy', groups, is_split=len(rows) > 1)
    whole_names = short_names([*missions], _WHOLE)  # somewhere a reader must find them
    lines = [
        line for policy, flown in missions.items() for line in _remarks(whole_names[policy], flown)
    ]
    titles = ', '.join(MEASURES[index].title for index in whole)
    all_there = [Text(f'100 % in every mission: {titles}', style='dim')] if whole else []
    return Group(table, *all_there, uav_table(missions, columns), *lines)


def _whole_measures(rows: Mapping[str, Sequence[Estimate]]) -> list[int]:
    """The measures, by index, that are shares of which all is there in all missions."""
    return [
        index
        for index, measure in enumerate(MEASURES)
        if measure.unit == 'share'
        and all(estimates[index].low > 1.0 - _ROUNDING for estimates in rows.values())
    ]


def _names_of(policies: Iterable[str], columns: int) -> Mapping[str, str]:
    """What policies are called in a table of estimates."""
    return short_names([*policies], max(_LEAST_NAME, columns - _ESTIMATES_COLUMNS))


def verdict(estimated: Mapping[str, Sequence[Estimate]]) -> Text:
    """Who takes least time and least energy of those that collect most, in one line.

    Args:
        estimated: of MEASURES, by policy.
    """
    means = {
        name: {measure.key: one.mean for measure, one in zip(MEASURES, row, strict=True)}
        for name, row in estimated.items()
    }
    most = max(of['collected_share'] for of in means.values()) - _ALIKE
    rivals = {name: of for name, of in means.items() if of['collected_share'] >= most}
    among = '' if len(rivals) == len(means) else ' of those that collect most'
    quick, least_s = _least(rivals, 'completion_s')
    thrifty, least_kj = _least(rivals, 'energy_kj')
    return Text(
        f'on average{among}: quickest {quick}, {least_s:.1f} s; '
        f'thriftiest {thrifty}, {least_kj:.2f} kJ',
        style='bold',
    )


def _least(means: Mapping[str, Mapping[str, float]], key: str) -> tuple[str, float]:
    """All who have the least of something: policies may fly the same missions alike."""
    least = min(of[key] for of in means.values())
    return ' and '.join(name for name, of in means.items() if of[key] == least), least


def difference_table(
    first: str, rows: Mapping[str, Sequence[Estimate]], columns: int = LEAST_COLUMNS
) -> RenderableType:
    """By how much one policy's measures differ from those of others in the same missions.

    Args:
        first: the policy that the others are taken from.
        rows: one estimate for each of MEASURES, by the policy that was taken away.
        columns: as for `evaluation_table`.
    """
    names = _names_of([first, *rows], columns)
    groups = _by_measure(rows, names)
    table = _estimate_table('measure', 'minus', groups, is_split=len(rows) > 1)
    whole_names = short_names([first, *rows], _WHOLE)
    title = f'{whole_names[first]} minus each other policy, mission by mission'
    return Group(Text(title, style='bold'), table)


def estimate_cells(estimate: Estimate) -> tuple[str, str, str]:
    """Mean, interval and median of an estimate, as shown."""
    span = f'{number_text(estimate.low)} to {number_text(estimate.high)}'
    return number_text(estimate.mean), span, number_text(estimate.median)


def number_text(value: float) -> str:
    """A mean as shown: four digits after the point, one from 10 on."""
    # Adding zero takes the sign from a zero.
    return f'{value:.1f}' if abs(value) >= 10 else f'{round(value, 4) + 0.0:.4f}'


def _remarks(policy: str, missions: Sequence[MissionMetrics]) -> list[Text]:
    n_decisions = sum(mission.n_decisions for mission in missions) / len(missions)
    lines = [Text(f'{policy}: {n_decisions:.1f} decisions per mission', style='dim')]
    circled = [mission for mission in missions if mission.n_guarded]
    if circled:
        n_guarded = sum(mission.n_guarded for mission in circled)
        text = (
            f'{policy}: the guard took {n_guarded} decisions, in {len(circled)} of'
            f' {len(missions)} missions (first in seed {circled[0].mission_seed})'
        )
        lines.append(Text(text, style='yellow'))
    left = [mission for mission in missions if not mission.is_complete]
    if left:
        worst = min(left, key=lambda mission: mission.collected_share)
        text = (
            f'{policy}: data left behind in {len(left)} of {len(missions)} missions'
            f' (most in seed {worst.mission_seed}: {percent(worst.collected_share)} collected)'
        )
        lines.append(Text(text, style='yellow'))
    unsafe = [str(mission.mission_seed) for mission in missions if not mission.is_safe]
    if unsafe:
        seeds = ', '.join(unsafe[:_MAX_SEEDS]) + (', ...' if len(unsafe) > _MAX_SEEDS else '')
        text = f'{policy}: UAVs landed without their margin in {len(unsafe)} missions'
        lines.append(Text(f'warning: {text} (seed {seeds})', style=_WARNING))
    return lines


def bound_table(rows: Mapping[str, Estimate]) -> RenderableType:
    """The plans and the limits, measure by measure; estimates by key of `bound_metrics`."""
    groups = [
        (title, {name: estimate_cells(rows[f'{plan}_{key}']) for plan, name in _PLANS.items()})
        for key, title in _TITLES.items()
    ]
    table = _estimate_table('measure', 'what', groups, is_split=True)
    gaps = [
        _gap(rows, 'completion_s', 'shortest', 'time'),
        _gap(rows, 'energy_kj', 'thriftiest', 'energy'),
    ]
    text = f'the limits are proven; they leave open {" and ".join(gaps)}'
    return Group(table, Text(text, style='dim'))


def share_table(
    rows: Mapping[str, tuple[int, Mapping[str, Estimate]]], columns: int = LEAST_COLUMNS
) -> RenderableType:
    """How near policies come to the plans, in per cent.

    The shortest plan's efficiency is what may be reached when time counts first.

    Args:
        rows: by policy, how many missions count and the estimates by key of `shares`.
        columns: as for `evaluation_table`.
    """
    names = _names_of(rows, columns)
    groups = [
        (
            title,
            {
                names[policy]: _percentages(estimates[key])
                for policy, (_, estimates) in rows.items()
                if key in estimates
            },
        )
        for key, title in _SHARES.items()
    ]
    table = _estimate_table('% of the clairvoyant plan', 'policy', groups, is_split=len(rows) > 1)
    counts = ', '.join(f'{names[policy]} {n_missions}' for policy, (n_missions, _) in rows.items())
    text = f'missions that collected everything and have plans: {counts}'
    return Group(table, Text(text, style='dim'))


def _percentages(estimate: Estimate) -> tuple[str, str, str]:
    shown = [f'{100 * share:.1f}' for share in (estimate.mean, estimate.low, estimate.high)]
    return shown[0], f'{shown[1]} to {shown[2]}', f'{100 * estimate.median:.1f}'


def _by_measure(
    rows: Mapping[str, Sequence[Estimate]], names: Mapping[str, str], but: Container[int] = ()
) -> Iterator[_Group]:
    """Rows of MEASURES by policy, grouped by measure, but for some by their index."""
    for index, measure in enumerate(MEASURES):
        if index in but:
            continue
        cells = {names[policy]: estimate_cells(row[index]) for policy, row in rows.items()}
        yield f'{measure.title} [{measure.unit}]', cells


def _estimate_table(
    heading: str, row_heading: str, groups: Iterable[_Group], *, is_split: bool
) -> Table:
    """Estimates in groups of rows; the title of a group stands in its first row alone."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column(heading)
    groups = [*groups]
    longest = max((len(name) for _, rows in groups for name in rows), default=0)
    table.add_column(row_heading, overflow='fold', min_width=min(longest, _LEAST_NAME))
    for column in ('mean', f'{100 * CONFIDENCE_LEVEL:.0f} % interval', 'median'):
        table.add_column(column, justify='right', no_wrap=True)
    for title, rows in groups:
        for index, (name, cells) in enumerate(rows.items()):
            table.add_row(Text('' if index else title), Text(name), *cells)
        if is_split:
            table.add_section()
    return table


def _gap(rows: Mapping[str, Estimate], measure: str, plan: str, name: str) -> str:
    share = 1.0 - rows[f'limit_{measure}'].mean / max(rows[f'{plan}_{measure}'].mean, 1e-300)
    return f'{100 * max(share, 0.0):.1f} % of the {name}'

"""What candidates achieved in the same sampled missions of a scenario, and which one is best."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from uav_collect.analysis.metrics import percent
from uav_collect.analysis.short_names import short_names
from uav_collect.analysis.statistics import Estimate
from uav_collect.uav.policy_header import policy_rank

MOST_MISSIONS = 200  # that each candidate flies
_MOST_NAME = 24  # columns of a candidate's name in the table


@dataclass(frozen=True, kw_only=True)
class Tried:
    """What one candidate achieved."""

    policy: str  # as it is named to agents
    version: str
    estimates: Mapping[str, Estimate]  # by key of MEASURES
    # Processor time of its missions [s], which is another one each time; None: nobody counted it.
    computing_s: float | None = field(default=None, compare=False)

    @property
    def rank(self) -> tuple[float, float]:
        """How good it is: of two, the one of greater rank flies."""
        return policy_rank(
            self.estimates['complete_share'].mean,
            self.estimates['safe_share'].mean,
            self.estimates['efficiency_kbit_per_j'].mean,
        )


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Which of several candidates flies, and why; printed, it is a table of them."""

    scenario: str
    fingerprint: str
    bandwidth: str  # how it was shared
    first_seed: int  # of the missions; the others have those after it
    n_missions: int  # that each candidate flew
    n_planned: int  # that each was to fly
    is_compiled: bool  # as kernels were
    tried: tuple[Tried, ...]  # in the order in which the earlier of two equal ones is taken
    lead: Estimate | None = None  # over the next best [kbit/J], mission by mission; None: alone

    @property
    def best(self) -> Tried:
        """The candidate of the greatest rank."""
        return max(self.tried, key=lambda it: it.rank)

    @property
    def policy(self) -> str:
        """The best candidate's name."""
        return self.best.policy

    @property
    def next_best(self) -> Tried | None:
        """Who would fly without the best one; None: nobody."""
        others = [it for it in self.tried if it is not self.best]
        return max(others, key=lambda it: it.rank, default=None)

    @property
    def why(self) -> str:
        """Who flies and why, in one line for people."""
        best, other = self.best, self.next_best
        start = (
            f'{best.policy} is the best of {len(self.tried)} in {self.n_missions} sampled missions'
        )
        if other is None or self.lead is None:
            return f'{best.policy} is the only candidate'
        if best.rank[0] > other.rank[0]:
            return f'{start}: it leaves less behind than {other.policy}'
        lead = self.lead
        return (
            f'{start}: {lead.mean:+.3f} ({lead.low:+.3f} to {lead.high:+.3f}) kbit/J'
            f' against {other.policy}'
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is unusual about how it was chosen, one line each."""
        lines = []
        if self.n_missions < self.n_planned:
            lines.append(
                f'stopped for lack of time after {self.n_missions} of {self.n_planned} missions:'
                ' a faster machine may choose another policy'
            )
        if not self.is_compiled:
            lines.append(
                f'flown by interpreted kernels, {self.n_planned} missions by each; compiled ones'
                f' fly up to {MOST_MISSIONS} in less time'
            )
        return tuple(lines)

    def __str__(self) -> str:
        return '\n'.join([self.why, '', *_table(self), '', *self.remarks]).rstrip()


def _table(choice: Choice) -> list[str]:
    """The candidates and what they achieved, a line each, an arrow before the one that flies."""
    names = short_names([it.policy for it in choice.tried], _MOST_NAME)
    rows = [
        ('candidate', 'kbit/J', '95 % interval', 'time', 'energy', 'complete', 'safe', 'CPU time'),
        *(
            (
                names[it.policy],
                f'{it.estimates["efficiency_kbit_per_j"].mean:.3f}',
                '{0.low:.3f} to {0.high:.3f}'.format(it.estimates['efficiency_kbit_per_j']),
                f'{it.estimates["completion_s"].mean:.0f} s',
                f'{it.estimates["energy_kj"].mean:.1f} kJ',
                percent(it.estimates['complete_share'].mean),
                percent(it.estimates['safe_share'].mean),
                '' if it.computing_s is None else f'{it.computing_s:.1f} s',
            )
            for it in choice.tried
        ),
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for number, (name, *figures) in enumerate(rows):
        is_best = number > 0 and choice.tried[number - 1] is choice.best
        cells = [name.ljust(widths[0]), *map(str.rjust, figures, widths[1:])]
        lines.append(('> ' if is_best else '  ') + '  '.join(cells))
    return lines

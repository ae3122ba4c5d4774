"""How much battery a fleet needs: missions flown with all that they take, and with less.

Of a rule a budget changes what is legal and nothing else. An action is legal if the budget B lasts
for all that was used before, the action, the way home from where it ends, and the margin. What
that adds up to never falls along a flight, as no way home is longer than a detour to it, so it is
largest at the end: with the energy E of a whole flight, a UAV of B >= E + margin was free to take
each of its actions, and flies the same mission to its end. With less it turns home early, and
others, who hear of what it has seen, may still do its part; or all data may be collected before
anybody knows that no more waits. How often, only flying tells. Learned policies see their energy
as a share of the budget, and random ones choose among what is legal, so for them flying alone
tells anything. So a flight with all that it takes is where the search for a battery begins, and
every answer has been flown.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
import math

import numpy as np
from uav_collect.analysis.statistics import share_interval
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Floats
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.batch_metrics import BatchMetrics, joined
from uav_collect.missions.rollout import fly_for_metrics
from uav_collect.scenario.airframes import KJ_PER_WH
from uav_collect.scenario.model import FleetConfig, Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav.briefing import briefing_of
from uav_collect.uav.policy import NamedPolicy

J_PER_WH = 1e3 * KJ_PER_WH
QUANTILES = {'p50': 0.5, 'p95': 0.95, 'max': 1.0}
_MOST_STEPS = 10  # towards the least battery of a fleet, with all missions flown in each
_PRECISION = 0.01  # of that, relative
_FIRST_STEP = 0.05  # of the search, relative
_MOST_MOVES = 100  # over each cell: nobody who gets anywhere makes so many
_FEW = 20  # missions that say how much energy is ample
_AT_ONCE = 250 if kernels_are_compiled() else 10  # missions flown between two looks at Ctrl-C


@dataclass(frozen=True, kw_only=True)
class Battery:
    """How what batteries hold and what UAVs may use of it belong together."""

    usable_share: float  # of a battery: the energy budget
    volt: float  # nominal

    def wh(self, energy_j: float) -> float:
        """What a battery must hold [Wh] to give some energy."""
        return energy_j / J_PER_WH / self.usable_share

    def budget_j(self, wh: float) -> float:
        """The energy [J] that a battery gives."""
        return wh * J_PER_WH * self.usable_share

    def mah(self, wh: float) -> float:
        """The charge [mAh] of a battery."""
        return wh / self.volt * 1e3


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """The same missions flown by a fleet with one battery for each UAV."""

    n_uavs: int
    battery_wh: float  # of each UAV; inf: all that they take
    budget_j: float  # what that gives
    margin_j: Floats  # of that, to be left when landed, by UAV, (U,)
    speed_mps: tuple[float, ...]  # by UAV
    n_asked: int  # missions; fewer were flown where somebody interrupted
    metrics: BatchMetrics | None  # None: too little to take off

    @property
    def n_missions(self) -> int:
        """How many missions this says something about."""
        return self.n_asked if self.metrics is None else self.metrics.n_missions

    @property
    def n_complete(self) -> int:
        """How many of them collected all data."""
        return 0 if self.metrics is None else int(self.metrics.is_complete.sum())

    @property
    def complete_share(self) -> float:
        """Share of the missions that collected all data."""
        return self.n_complete / self.n_missions

    @property
    def interval(self) -> tuple[float, float]:
        """The interval of that share."""
        return share_interval(self.n_complete, self.n_missions)

    @property
    def is_whole(self) -> bool:
        """Whether all missions were flown that were asked for."""
        return self.n_missions == self.n_asked


@dataclass(frozen=True, kw_only=True)
class Sized:
    """What was found for one fleet."""

    n_uavs: int
    needed_wh: float  # least battery that does, as all larger ones that were flown; nan: none
    n_missions: int  # flown with it; 0: there is none
    n_complete: int  # of these
    best_share: float  # of the missions, complete with all that they take
    free_wh: float  # battery that does for each UAV as it flies then; inf: none is known
    most_wh: float  # largest battery that was flown; nan: none was
    # Pairs of batteries [Wh], the smaller first, of which the larger did worse.
    reversals: tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetAtSite:
    """So many UAVs over the site, and who flies them."""

    site: Site
    # By the scenario, for what energy there is may decide who flies it.
    policy_for: Callable[[Scenario], NamedPolicy]

    @property
    def margin_j(self) -> Floats:
        """What must be left when landed [J], by UAV, (U,)."""
        return np.array([uav.energy_margin_j for uav in self.site.scenario.uavs])

    @property
    def own_budget_j(self) -> float:
        """The largest budget that the scenario gives a UAV [J]."""
        return max(uav.energy_budget_j for uav in self.site.scenario.uavs)

    @property
    def most_j(self) -> float:
        """More than what a flight takes that ends by itself [J]: _MOST_MOVES for each cell."""
        scenario, briefing = self.site.scenario, briefing_of(self.site)
        n_moves = _MOST_MOVES * scenario.n_cells
        return max(
            power_w * n_moves * briefing.cell_size_m / speed_mps
            for power_w, speed_mps in zip(briefing.flight_power_w, briefing.speed_mps, strict=True)
        )

    def with_budget(self, budget_j: float) -> Site:
        """The site, all UAVs with the same energy budget."""
        scenario = self.site.scenario
        uavs = tuple(replace(uav, energy_budget_kj=budget_j / 1e3) for uav in scenario.uavs)
        return replace(self.site, scenario=replace(scenario, fleet=FleetConfig(uavs=uavs)))


class Sizing:
    """Flies fleets with batteries, and keeps what came of it, whoever interrupts."""

    def __init__(
        self,
        fleets: Mapping[int, FleetAtSite],
        mission_seeds: Sequence[int],
        battery: Battery,
        *,
        allocator: str = 'exact',
        guard_after: int = GUARD_AFTER,
        advance: Callable[[int], None] = lambda _: None,
    ) -> None:
        """Have flown nothing.

        Args:
            fleets: by number of UAVs.
            mission_seeds: the same for every fleet and battery.
            allocator: exact or equal.
            advance: called with how many missions more are flown.
        """
        self.trials: list[Trial] = []
        self.battery = battery
        self._fleets, self._seeds = fleets, mission_seeds
        self._allocator, self._guard_after, self._advance = allocator, guard_after, advance

    def fly(self, n_uavs: int, battery_wh: float) -> Trial:
        """Fly all missions with a battery for each UAV.

        Raises:
            ConfigError: there is so much energy that a mission would not end.
        """
        return self._fly(n_uavs, battery_wh, self.battery.budget_j(battery_wh))

    def fly_freely(self, n_uavs: int) -> Trial:
        """Fly all missions with all that they take: twice what any UAV used of it, if they end."""
        fleet = self._fleets[n_uavs]
        budget_j = fleet.own_budget_j
        few = self._seeds[:_FEW]
        while budget_j < fleet.most_j and not _is_ample(
            self._part(fleet, few, budget_j), budget_j
        ):
            budget_j *= 2.0
        trial = self._fly(n_uavs, math.inf, budget_j)
        while budget_j < fleet.most_j and not _is_ample(trial.metrics, budget_j):
            budget_j *= 2.0
            self.trials.remove(trial)
            trial = self._fly(n_uavs, math.inf, budget_j)
        return trial

    def search(self, n_uavs: int, wanted_share: float) -> None:
        """Fly batteries until the least one is known, to _PRECISION, that does.

        Args:
            wanted_share: of the missions that are to be complete.
        """
        free = self.fly_freely(n_uavs)
        enough_wh = first_guess_wh(free, self.battery, wanted_share)
        if math.isinf(enough_wh):
            return
        step, too_little_wh = _FIRST_STEP, 0.0
        while not self._does(n_uavs, enough_wh, wanted_share):  # as no rule's does
            too_little_wh, enough_wh = enough_wh, rounded_up(enough_wh * (1.0 + step))
            step *= 2.0
            if self.battery.budget_j(enough_wh) >= free.budget_j:
                return
        for _ in range(_MOST_STEPS):
            is_bracketed = too_little_wh > 0.0
            middle_wh = (too_little_wh + enough_wh) / 2 if is_bracketed else enough_wh * (1 - step)
            middle_wh = rounded_up(middle_wh)
            if not too_little_wh < middle_wh < enough_wh * (1.0 - _PRECISION / 2):
                return
            if self._does(n_uavs, middle_wh, wanted_share):
                enough_wh = middle_wh
            else:
                too_little_wh = middle_wh
            step = min(2.0 * step, 0.5)

    def _does(self, n_uavs: int, battery_wh: float, wanted_share: float) -> bool:
        return does(self.fly(n_uavs, battery_wh), wanted_share)

    def _fly(self, n_uavs: int, battery_wh: float, budget_j: float) -> Trial:
        fleet, parts = self._fleets[n_uavs], list[BatchMetrics]()
        trial = Trial(
            n_uavs=n_uavs,
            battery_wh=battery_wh,
            budget_j=budget_j,
            margin_j=fleet.margin_j,
            speed_mps=tuple(uav.speed_mps for uav in fleet.site.scenario.uavs),
            n_asked=len(self._seeds),
            metrics=None,
        )
        try:
            for first in range(0, len(self._seeds), _AT_ONCE):
                seeds = self._seeds[first : first + _AT_ONCE]
                part = self._part(fleet, seeds, budget_j)
                if part is None:
                    self._advance(len(self._seeds))
                    break
                parts.append(part)
                self._advance(len(seeds))
        finally:  # also where somebody interrupts
            if parts:
                trial = replace(trial, metrics=joined(parts))
                self.trials.append(trial)
        if not parts:
            self.trials.append(trial)
        return trial

    def _part(
        self, fleet: FleetAtSite, seeds: Sequence[int], budget_j: float
    ) -> BatchMetrics | None:
        """Some missions; None if the budget is too small to take off."""
        site = fleet.with_budget(budget_j)
        try:
            make_policy = partial(replace, fleet.policy_for(site.scenario))
            return fly_for_metrics(site, seeds, make_policy, self._allocator, self._guard_after)
        except ConfigError:
            if budget_j > max(fleet.own_budget_j, fleet.most_j):
                raise  # it is too large
            return None


def _is_ample(metrics: BatchMetrics | None, budget_j: float) -> bool:
    """Whether a budget has not kept any UAV from anything, but for a hover of half of it."""
    return metrics is not None and float(metrics.energy_j.max()) <= budget_j / 2.0


def does(trial: Trial, wanted_share: float) -> bool:
    """Whether so many missions are complete, as a share of those flown."""
    return trial.n_complete >= wanted_share * trial.n_missions - 1e-9


def sized(trials: Sequence[Trial], n_uavs: int, battery: Battery, wanted_share: float) -> Sized:
    """What the trials of one fleet say of its batteries; interrupted ones say nothing."""
    own = [it for it in trials if it.n_uavs == n_uavs and it.is_whole]
    free = [it for it in own if math.isinf(it.battery_wh)]
    flown = sorted(
        (it for it in own if math.isfinite(it.battery_wh)), key=lambda it: it.battery_wh
    )
    least = None
    for trial in reversed(flown):
        if not does(trial, wanted_share):
            break
        least = trial
    return Sized(
        n_uavs=n_uavs,
        needed_wh=least.battery_wh if least else math.nan,
        n_missions=least.n_missions if least else 0,
        n_complete=least.n_complete if least else 0,
        best_share=max((it.complete_share for it in free), default=math.nan),
        free_wh=min((first_guess_wh(it, battery, wanted_share) for it in free), default=math.inf),
        most_wh=flown[-1].battery_wh if flown else math.nan,
        reversals=tuple(
            (less.battery_wh, more.battery_wh)
            for less, more in pairwise(flown)
            if more.n_complete < less.n_complete
        ),
    )


def needs_wh(trial: Trial, battery: Battery) -> Floats:
    """The battery [Wh] that each mission of a trial would take; inf: it is not complete.

    All UAVs have the same: that of the one that needs most. Shape (N,).
    """
    if trial.metrics is None:
        return np.full(trial.n_missions, math.inf)
    most_j = (trial.metrics.energy_j + trial.margin_j).max(axis=1)
    return np.where(trial.metrics.is_complete, battery.wh(1.0) * most_j, math.inf)


def first_guess_wh(free: Trial, battery: Battery, wanted_share: float) -> float:
    """The battery with which so many missions are flown as with all that they take; or inf."""
    needed_wh = np.sort(needs_wh(free, battery))
    n_wanted = math.ceil(wanted_share * free.n_missions - 1e-9)
    return rounded_up(float(needed_wh[max(n_wanted, 1) - 1]))


def quantiles(values: Floats) -> dict[str, float]:
    """QUANTILES of values, by key: the least value that so many are not above."""
    return {
        key: float(np.quantile(values, share, method='inverted_cdf'))
        for key, share in QUANTILES.items()
    }


def rounded_up(value: float) -> float:
    """The next number of three digits: what is found has been flown as it is shown.

    Infinite stays infinite.
    """
    if not 0.0 < value < math.inf:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f'{math.ceil(value / unit - 1e-9) * unit:.3g}')

"""Batteries for fleets: what a flight with all that it takes tells, and what only flying does."""

from collections.abc import Callable, Sequence
from functools import partial
import math

import numpy as np
import pytest
from tiny_world import Script, tiny, uav
from uav_collect.analysis import sizing as sizing_module
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.sizing import (
    Battery,
    first_guess_wh,
    FleetAtSite,
    needs_wh,
    quantiles,
    rounded_up,
    sized,
    Sizing,
    Trial,
)
from uav_collect.analysis.statistics import share_interval
from uav_collect.errors import ConfigError
from uav_collect.missions.batch_metrics import BatchMetrics
from uav_collect.missions.rollout import fly, fly_for_metrics
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.heuristics import Heuristic, RulePolicy
from uav_collect.uav.policy import policy_for

PLAIN = Battery(usable_share=1.0, volt=22.2)
SEEDS = range(40, 48)
# A sensor in each of 4 x 4 cells: whoever leaves out a cell leaves data.
EVERYWHERE = [(50.0 * cell % 200 + 25.0, cell // 4 * 50.0 + 25.0, 1.0) for cell in range(16)]
TINY = tiny(uav(5.0), sensors=EVERYWHERE, demand__data_mbit=[1.0, 20.0])


def fleet_of(scenario: Scenario, policy: str = 'sweep') -> FleetAtSite:
    return FleetAtSite(site=build_site(scenario), policy_for=partial(policy_for, policy))


def sizing_of(
    *scenarios: Scenario,
    policy: str = 'sweep',
    seeds: Sequence[int] = SEEDS,
    battery: Battery = PLAIN,
    advance: Callable[[int], None] = lambda _: None,
) -> Sizing:
    fleets = {one.n_uavs: fleet_of(one, policy) for one in scenarios}
    return Sizing(fleets, seeds, battery, advance=advance)


def trial_of(battery_wh: float, n_complete: int, n_missions: int = 100, asked: int = 100) -> Trial:
    """Missions of one UAV, the first of which were complete; mission n took n + 1 kJ."""
    total_bit = np.ones(n_missions)
    metrics = BatchMetrics(
        collected_bit=np.where(np.arange(n_missions) < n_complete, 1.0, 0.5),
        total_bit=total_bit,
        energy_j=1e3 * (np.arange(n_missions) + 1.0)[:, None],
        landed_s=np.ones((n_missions, 1)),
    )
    return Trial(
        n_uavs=1,
        battery_wh=battery_wh,
        budget_j=PLAIN.budget_j(min(battery_wh, 1e3)),
        margin_j=np.zeros(1),
        speed_mps=(5.0,),
        n_asked=asked,
        metrics=metrics,
    )


def test_metrics_of_a_batch_are_those_of_its_logs() -> None:
    site = build_site(load('paper_8x8', {'fleet.default.energy_budget_kj': 30}))
    batch = fly_for_metrics(site, SEEDS, 'sweep')
    logs = [mission_metrics(log) for log in fly(site, SEEDS, 'sweep')]
    assert batch.collected_share == pytest.approx([it.collected_share for it in logs], rel=1e-12)
    assert batch.energy_j == pytest.approx(np.array([it.uav_energy_j for it in logs]), rel=1e-9)
    assert batch.completion_s == pytest.approx([it.completion_s for it in logs], rel=1e-12)
    assert batch.is_complete.tolist() == [it.is_complete for it in logs]
    assert 0 < batch.is_complete.sum() < len(SEEDS)  # of both kinds


@pytest.mark.parametrize('policy', ['sweep', 'hert'])
def test_a_rule_flies_as_freely_with_all_that_its_flights_take(policy: str) -> None:
    sizing = sizing_of(load('paper_8x8'), policy=policy)
    free = sizing.fly_freely(2)
    assert free.metrics is not None
    again = sizing.fly(2, needs_wh(free, PLAIN).max() * (1 + 1e-9))
    assert again.metrics is not None
    assert again.metrics.energy_j == pytest.approx(free.metrics.energy_j, rel=1e-9)
    assert again.metrics.landed_s.tolist() == free.metrics.landed_s.tolist()
    assert again.metrics.is_complete.all()


def test_a_uav_alone_that_has_less_than_its_flight_takes_leaves_data() -> None:
    sizing = sizing_of(TINY)
    free = sizing.fly_freely(1)
    needed_wh = np.sort(needs_wh(free, PLAIN))
    middle_wh = float(needed_wh[3] + needed_wh[4]) / 2
    less = sizing.fly(1, middle_wh)
    assert less.n_complete == 4


def test_other_uavs_may_do_the_part_of_one_that_turned_home() -> None:
    sizing = sizing_of(load('paper_8x8'), seeds=range(12))
    free = sizing.fly_freely(2)
    flown = sizing.fly(2, float(np.quantile(needs_wh(free, PLAIN), 0.6)))
    assert flown.n_complete > 8


def test_batteries_hold_more_than_what_is_usable_of_them() -> None:
    battery = Battery(usable_share=0.8, volt=20.0)
    assert battery.wh(3600.0) == pytest.approx(1.25)
    assert battery.budget_j(1.25) == pytest.approx(3600.0)
    assert battery.mah(1.25) == pytest.approx(62.5)


def test_the_search_ends_with_the_least_battery_that_does_to_a_hundredth() -> None:
    sizing = sizing_of(TINY, battery=Battery(usable_share=0.75, volt=22.2))
    sizing.search(1, 0.75)
    found = sized(sizing.trials, 1, sizing.battery, 0.75)
    n_flights = len(sizing.trials)
    assert sizing.fly(1, found.needed_wh).n_complete >= 6
    assert sizing.fly(1, found.needed_wh * 0.98).n_complete < 6
    assert n_flights <= 16
    assert found.best_share == 1.0
    assert found.reversals == ()


def test_the_same_missions_are_flown_by_every_fleet_and_battery() -> None:
    sizing = sizing_of(TINY, with_uavs(TINY, 2))
    trials = [sizing.fly(n_uavs, wh) for n_uavs in (1, 2) for wh in (3.0, 9.0)]
    totals = [trial.metrics.total_bit.tolist() for trial in trials if trial.metrics is not None]
    assert len(totals) == 4
    assert all(total == totals[0] for total in totals)


def test_a_battery_too_small_to_take_off_completes_nothing() -> None:
    trial = sizing_of(TINY).fly(1, 0.0005)
    assert trial.metrics is None
    assert (trial.complete_share, trial.n_missions, trial.is_whole) == (0.0, len(SEEDS), True)


def test_so_much_energy_that_no_mission_ends_is_refused() -> None:
    with pytest.raises(ConfigError, match='must be less'):
        sizing_of(TINY).fly(1, 1e8)


def test_no_battery_is_found_for_a_policy_that_never_completes() -> None:
    homing = FleetAtSite(site=build_site(TINY), policy_for=lambda _: Script([[]]))
    sizing = Sizing({1: homing}, SEEDS, PLAIN)
    sizing.search(1, 0.5)
    found = sized(sizing.trials, 1, PLAIN, 0.5)
    assert math.isnan(found.needed_wh)
    assert found.best_share == 0.0
    assert len(sizing.trials) == 1


def test_with_each_battery_flies_who_is_named_for_so_much_energy() -> None:
    flown = list[float]()

    def by_budget(scenario: Scenario) -> RulePolicy:
        flown.append(scenario.uavs[0].energy_budget_kj)
        return RulePolicy(Heuristic.SWEEP if flown[-1] > 50.0 else Heuristic.RANDOM)

    fleet = FleetAtSite(site=build_site(TINY), policy_for=by_budget)
    trials = [Sizing({1: fleet}, SEEDS, PLAIN).fly(1, wh) for wh in (20.0, 2.0)]
    assert flown == [72.0, 7.2]
    for trial, name in zip(trials, ('sweep', 'random'), strict=True):
        alone = sizing_of(TINY, policy=name).fly(1, trial.battery_wh)
        assert trial.metrics is not None
        assert alone.metrics is not None
        assert (trial.metrics.energy_j == alone.metrics.energy_j).all()


def test_what_was_flown_before_an_interruption_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sizing_module, '_AT_ONCE', 3)
    n_flown = []

    def advance(n_more: int) -> None:
        n_flown.append(n_more)
        if len(n_flown) == 5:  # the second flight's second part
            raise KeyboardInterrupt

    sizing = sizing_of(TINY, advance=advance)
    with pytest.raises(KeyboardInterrupt):
        sizing.search(1, 0.9)
    assert n_flown == [3, 3, 2, 3, 3]
    assert [(it.n_missions, it.is_whole) for it in sizing.trials] == [(8, True), (6, False)]
    assert math.isnan(sized(sizing.trials, 1, PLAIN, 0.9).needed_wh)


def test_the_least_battery_is_one_above_which_none_fails() -> None:
    trials = [trial_of(math.inf, 100), *(trial_of(wh, n) for wh, n in ((9, 99), (8, 98), (7, 99)))]
    found = sized(trials, 1, PLAIN, 0.99)
    assert found.needed_wh == 9.0
    assert found.reversals == ((7.0, 8.0),)


def test_interrupted_flights_say_nothing_of_batteries() -> None:
    trials = [trial_of(9.0, 100), trial_of(8.0, 50, n_missions=50)]
    assert sized(trials, 1, PLAIN, 0.99).needed_wh == 9.0


def test_the_first_guess_counts_incomplete_missions_as_never_done() -> None:
    # 80 are complete with 1 to 80 kJ: half of all missions by 50 kJ, nine tenths by nothing.
    free = trial_of(math.inf, 80)
    assert first_guess_wh(free, PLAIN, 0.5) == rounded_up(50.0 / 3.6)
    assert first_guess_wh(free, PLAIN, 0.9) == math.inf


def test_quantiles_are_values_that_were_flown() -> None:
    assert quantiles(np.arange(1.0, 101.0)) == {'p50': 50.0, 'p95': 95.0, 'max': 100.0}
    assert quantiles(np.array([3.0])) == {'p50': 3.0, 'p95': 3.0, 'max': 3.0}


@pytest.mark.parametrize(
    ('value', 'rounded'),
    [(16.01, 16.1), (16.1, 16.1), (0.012341, 0.0124), (999.4, 1000.0), (0, 0)],
)
def test_batteries_are_rounded_up_to_three_digits(value: float, rounded: float) -> None:
    assert rounded_up(value) == rounded


def test_the_interval_of_a_share_is_wilson_s() -> None:
    # z^2 / n = 0.384146, by hand: (0.8 + 0.192073 -/+ sqrt(0.384146 (0.16 + 0.096037))) / 1.384146
    assert share_interval(8, 10) == pytest.approx((0.4901625, 0.9433178), abs=1e-6)
    assert share_interval(0, 10)[0] == 0.0
    assert share_interval(10, 10)[1] == 1.0

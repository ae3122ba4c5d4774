from dataclasses import replace

import numpy as np
import pytest
from uav_collect.analysis.against_rules import better_rule, Flown, standing_of
from uav_collect.missions.batch_metrics import BatchMetrics

# Four missions of one UAV, of 1 Mbit each.
TOTAL_BIT = np.full(4, 1e6)


def flown(energy_j: list[float], collected_bit: float = 1e6, landed_s: float = 100.0) -> Flown:
    return Flown(
        metrics=BatchMetrics(
            collected_bit=np.full(4, collected_bit),
            total_bit=TOTAL_BIT,
            energy_j=np.array(energy_j)[:, None],
            landed_s=np.full((4, 1), landed_s),
        )
    )


SWEEP = flown([1000.0, 1000.0, 1250.0, 2000.0])  # 1, 1, .8 and .5 kbit/J
HERT = flown([2000.0, 2000.0, 2500.0, 4000.0])
RULES = {'sweep': SWEEP, 'hert': HERT}


def test_the_rule_of_the_better_efficiency_counts_where_both_collect_everything() -> None:
    assert better_rule(RULES) == 'sweep'
    assert better_rule({'sweep': HERT, 'hert': SWEEP}) == 'hert'


def test_a_rule_that_leaves_data_is_not_the_better_one_however_little_it_flies() -> None:
    hasty = flown([100.0] * 4, collected_bit=5e5)

    assert hasty.mean_kbit_per_j > SWEEP.mean_kbit_per_j
    assert better_rule({'sweep': SWEEP, 'hert': hasty}) == 'sweep'


def test_a_difference_is_taken_mission_by_mission() -> None:
    own = flown([800.0, 800.0, 1000.0, 1600.0])  # a quarter more in each mission

    found = standing_of(own, RULES, seed=0)

    assert found.difference.mean == pytest.approx(0.25 * SWEEP.mean_kbit_per_j)
    assert found.gain_share == pytest.approx(0.25)
    assert not found.is_below


def test_a_policy_is_below_only_by_more_than_the_interval() -> None:
    worse = flown([1100.0, 1100.0, 1300.0, 2200.0])
    mixed = flown([900.0, 1100.0, 1300.0, 2000.0])

    assert standing_of(worse, RULES, seed=0).is_below
    assert not standing_of(mixed, RULES, seed=0).is_below


def test_missions_count_as_missed_where_any_rule_collected_everything() -> None:
    left = flown([500.0] * 4, collected_bit=9e5)

    assert standing_of(left, {'sweep': left, 'hert': left}, seed=0).n_missed == 0
    assert standing_of(left, {'sweep': left, 'hert': HERT}, seed=0).n_missed == 4


def test_a_mission_is_too_long_beyond_twice_the_time_of_the_sweep() -> None:
    twice, more = flown([1000.0] * 4, landed_s=200.0), flown([1000.0] * 4, landed_s=201.0)

    assert standing_of(twice, RULES, seed=0).n_too_long == 0
    assert standing_of(more, RULES, seed=0).n_too_long == 4


def test_other_missions_are_refused() -> None:
    metrics = SWEEP.metrics
    fewer = replace(
        metrics,
        collected_bit=metrics.collected_bit[:3],
        total_bit=metrics.total_bit[:3],
        energy_j=metrics.energy_j[:3],
        landed_s=metrics.landed_s[:3],
    )

    with pytest.raises(ValueError, match='same missions'):
        standing_of(Flown(metrics=fewer), RULES, seed=0)


def test_a_mission_without_energy_has_no_efficiency() -> None:
    assert flown([0.0] * 4, collected_bit=0.0).mean_kbit_per_j == 0.0

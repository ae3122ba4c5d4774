from collections import Counter
from collections.abc import Iterator
import math

import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.kernels.arrays import Floats, new_row
from uav_collect.missions.simulation import Simulation
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.world.sensor_field import draw_demand, lay_out

N_MISSIONS = 2000

# Two sensors in each of the 16 cells, 40 m apart.
EVERYWHERE = [
    (25.0 + 50.0 * (cell % 4) + away_m, 25.0 + 50.0 * (cell // 4), 1.0)
    for cell in range(16)
    for away_m in (-20.0, 20.0)
]


def everywhere(cell_share: float, **overrides: object) -> Scenario:
    demand = {'cell_share': cell_share, 'data_mbit': [0.1, 1.0]}
    return tiny(sensors=EVERYWHERE, demand=demand, **overrides)


def demands(scenario: Scenario, n_missions: int = N_MISSIONS) -> Iterator[Floats]:
    site = build_site(scenario)
    sensor_field = lay_out(site)
    demand_bit = new_row(site.n_sensors, math.nan)
    for mission_seed in range(n_missions):
        draw_demand(sensor_field, mission_seed, demand_bit)
        yield np.array(demand_bit)


def data_cells(scenario: Scenario, n_missions: int = N_MISSIONS) -> list[list[int]]:
    cell = build_site(scenario).cell
    return [sorted({*cell[bit > 0].tolist()}) for bit in demands(scenario, n_missions)]


def test_the_number_of_data_cells_is_poisson_and_at_least_one() -> None:
    # phi H^2 = 0.25 * 16 = 4; drawing 0, of probability exp(-4), counts as 1.
    counts = np.array([len(cells) for cells in data_cells(everywhere(0.25))])
    mean = 4.0 + math.exp(-4.0)
    assert counts.mean() == pytest.approx(mean, abs=4 * 2.0 / math.sqrt(N_MISSIONS))
    assert counts.var() == pytest.approx(4.0, rel=0.15)
    expected = {count: math.exp(-4.0) * 4.0**count / math.factorial(count) for count in range(16)}
    expected[1] += expected.pop(0)
    for count, probability in expected.items():
        error = 4 * math.sqrt(probability * (1 - probability) / N_MISSIONS) + 1e-3
        assert (counts == count).mean() == pytest.approx(probability, abs=error)


def test_where_hardly_any_cell_should_have_data_exactly_one_has() -> None:
    assert {len(cells) for cells in data_cells(everywhere(1e-9), 200)} == {1}


def test_there_are_no_more_data_cells_than_cells_with_sensors() -> None:
    two_cells = [(25.0, 25.0, 1.0), (30.0, 25.0, 1.0), (125.0, 75.0, 1.0)]
    demand = {'cell_share': 1.0, 'data_mbit': [0.1, 1.0]}
    assert data_cells(tiny(sensors=two_cells, demand=demand), 50) == [[0, 6]] * 50


def test_only_cells_with_sensors_have_data() -> None:
    some = [sensor for sensor in EVERYWHERE if sensor[1] > 100.0]
    demand = {'cell_share': 0.25, 'data_mbit': [0.1, 1.0]}
    drawn = {
        cell for cells in data_cells(tiny(sensors=some, demand=demand), 300) for cell in cells
    }
    assert drawn == {8, 9, 10, 11, 12, 13, 14, 15}


def test_every_cell_with_sensors_is_as_likely_to_have_data() -> None:
    cells = Counter(cell for drawn in data_cells(everywhere(0.25)) for cell in drawn)
    expected = N_MISSIONS * (4.0 + math.exp(-4.0)) / 16
    for cell in range(16):
        assert cells[cell] == pytest.approx(expected, abs=4.5 * math.sqrt(expected))


def test_every_sensor_of_a_data_cell_has_data_and_none_elsewhere() -> None:
    for bit in demands(everywhere(0.25), 100):
        assert ((bit[0::2] > 0) == (bit[1::2] > 0)).all()


def test_amounts_are_uniform_in_their_range() -> None:
    amounts_mbit = np.concatenate([bit[bit > 0] for bit in demands(everywhere(0.25), 500)]) / 1e6
    assert amounts_mbit.min() >= 0.1
    assert amounts_mbit.max() < 1.0
    error = 4 * 0.9 / math.sqrt(12 * len(amounts_mbit))
    assert amounts_mbit.mean() == pytest.approx(0.55, abs=error)
    quarters, _ = np.histogram(amounts_mbit, bins=4, range=(0.1, 1.0))
    assert quarters / len(amounts_mbit) == pytest.approx([0.25] * 4, abs=0.03)


def test_all_means_every_sensor() -> None:
    scenario = tiny(sensors=EVERYWHERE, demand={'cell_share': 'all', 'data_mbit': [0.5, 1.0]})
    for bit in demands(scenario, 20):
        assert (bit >= 0.5e6).all()


def test_amounts_that_the_site_gives_stand() -> None:
    given = [(75.0, 25.0, 1.0), (125.0, 125.0, 0.5), (125.0, 125.0, 0.25)]
    for bit in demands(tiny(sensors=given), 5):
        assert bit.tolist() == [1e6, 0.5e6, 0.25e6]


def test_a_given_amount_waits_only_in_drawn_cells() -> None:
    scenario = tiny(sensors=EVERYWHERE, demand={'cell_share': 0.25, 'data_mbit': 'csv'})
    assert {*np.unique(np.concatenate([*demands(scenario, 20)])).tolist()} == {0.0, 1e6}


def test_demand_depends_on_the_mission_seed_alone() -> None:
    scenario = everywhere(0.25)
    other = everywhere(0.25, radio__contact_range_m=0.0, reward__discount_per_s=0.5)
    fleet = tiny(uav(7.0), sensors=EVERYWHERE, demand=scenario.demand.as_mapping())
    for same in (other, fleet):
        for bit, same_bit in zip(demands(scenario, 20), demands(same, 20), strict=True):
            assert bit.tolist() == same_bit.tolist()
    assert len({bit.tobytes() for bit in demands(scenario, 50)}) == 50


def test_a_sensors_amount_does_not_depend_on_which_cells_have_data() -> None:
    for few, many in zip(demands(everywhere(0.1), 50), demands(everywhere(0.9), 50), strict=True):
        both = (few > 0) & (many > 0)
        assert few[both].tolist() == many[both].tolist()


def test_the_largest_seed_draws_as_any_other() -> None:
    site = build_site(everywhere(0.25))
    last = Simulation(site, 2**63 - 1).demand_bit
    assert last != Simulation(site, 2**62 - 1).demand_bit
    assert sum(last) > 0.0


def test_the_share_of_cells_with_data_is_one_of_the_open_cells() -> None:
    # An L of 12 of 16 cells: 0.25 * 12 = 3 on average; of all it would be 4.
    corner = [[100.0, 100.0], [200.0, 100.0], [200.0, 200.0], [100.0, 200.0]]
    sensors = [it for it in EVERYWHERE if it[0] < 100.0 or it[1] < 100.0]
    demand = {'cell_share': 0.25, 'data_mbit': [0.1, 1.0]}
    field = tiny(sensors=sensors, demand=demand, area__no_fly=[corner])
    counts = np.array([len(cells) for cells in data_cells(field, 500)])
    assert counts.mean() == pytest.approx(3.0 + math.exp(-3.0), abs=4 * math.sqrt(3.0 / 500))

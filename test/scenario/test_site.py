from interpreted import interpreted
import numpy as np
import pytest
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site, Site


def test_the_default_topology_is_the_one_of_the_reference_values() -> None:
    site = build_site(load('paper_10x10'))
    counts = np.diff(site.first_sensor)
    assert site.n_sensors == 406
    assert np.count_nonzero(counts) == 72
    assert counts[:10].tolist() == [2, 0, 4, 0, 2, 15, 1, 10, 11, 13]
    np.testing.assert_allclose(site.position_m[0], [29.32361606, 39.0676448], atol=1e-8)
    np.testing.assert_allclose(site.position_m[-1], [459.44886344, 452.78008148], atol=1e-8)
    assert (site.sensor_ids[0], site.sensor_ids[-1]) == ('S001', 'S406')


def topology() -> str:
    site = build_site(load('paper_15x15'))
    numbers = [number.hex() for number in site.position_m.ravel().tolist()]
    return ' '.join([*numbers, *map(str, site.first_sensor.tolist())])


def test_a_topology_is_drawn_to_the_same_bits_by_interpreted_kernels() -> None:
    assert interpreted(topology) == topology()


def test_sensors_are_sorted_by_cell_and_lie_in_it() -> None:
    for name in ('paper_8x8', 'paper_10x10', 'lillgrund'):
        area, site = load(name).area, build_site(load(name))
        column, row = np.floor(site.position_m / area.cell_size_m).astype(int).T
        assert (site.cell == row * area.n_columns + column).all()
        assert (np.diff(site.cell) >= 0).all()
        for cell in range(area.n_cells):
            own = slice(site.first_sensor[cell], site.first_sensor[cell + 1])
            assert (site.cell[own] == cell).all()
        assert site.first_sensor[-1] == site.n_sensors == len(set(site.sensor_ids))


def test_sensor_numbers_have_the_means_of_dense_and_sparse_cells() -> None:
    counts = np.concatenate(
        [
            np.diff(build_site(load('paper_20x20', {'sensors.seed': seed})).first_sensor)
            for seed in range(30)
        ]
    )
    # 400 cells: 120 x Poisson(10), 280 x Poisson(1); the mean of 12,000 counts spreads by 0.041.
    assert counts.mean() == pytest.approx(3.7, abs=4 * np.sqrt((0.3 * 10 + 0.7) / 12_000))
    # Above 5: 93 % of the dense cells, 0.06 % of the sparse ones.
    assert (counts > 5).mean() == pytest.approx(0.3 * 0.9329 + 0.7 * 0.0006, abs=0.005)


def test_dense_cells_are_the_share_rounded_and_chosen_anew_by_each_seed() -> None:
    chosen = []
    for seed in range(20):
        overrides = {'sensors.seed': seed, 'sensors.sparse_mean': 0, 'sensors.dense_mean': 40}
        counts = np.diff(build_site(load('paper_10x10', overrides)).first_sensor)
        assert np.count_nonzero(counts) == 30  # Poisson(40) is never 0
        chosen.append(tuple(np.flatnonzero(counts)))
    assert len(set(chosen)) == 20


def test_dense_cells_are_a_share_of_the_open_ones() -> None:
    corner = [[250.0, 250.0], [500.0, 250.0], [500.0, 500.0], [250.0, 500.0]]
    dense = {'sensors.sparse_mean': 0, 'sensors.dense_mean': 40, 'area.no_fly': [corner]}
    counts = np.diff(build_site(load('paper_10x10', dense)).first_sensor)
    assert np.count_nonzero(counts) == 23  # of 75: 22.5, rounded


def test_sensors_are_spread_evenly_in_their_cells() -> None:
    site = build_site(load('paper_20x20'))
    within = site.position_m % 50.0 / 50.0
    spread = 1.0 / np.sqrt(12 * site.n_sensors)
    np.testing.assert_allclose(within.mean(axis=0), 0.5, atol=4 * spread)
    np.testing.assert_allclose(within.var(axis=0), 1 / 12, atol=4 * spread / np.sqrt(15))
    assert abs(np.corrcoef(within.T)[0, 1]) < 4 / np.sqrt(site.n_sensors)


def test_a_topology_does_not_depend_on_what_else_the_scenario_says() -> None:
    overrides = {'demand.cell_share': 0.9, 'fleet.uavs': [{'speed_mps': 3}], 'area.altitude_m': 50}
    plain, other = build_site(load('paper_8x8')), build_site(load('paper_8x8', overrides))
    np.testing.assert_array_equal(plain.position_m, other.position_m)


def listed(entries: list[dict[str, object]], *, data_mbit: object) -> Site:
    sensors = {'kind': 'listed', 'entries': entries}
    return build_site(load('paper_10x10', {'sensors': sensors, 'demand.data_mbit': data_mbit}))


def test_listed_sensors_are_put_into_their_cells_in_the_order_of_the_file() -> None:
    site = listed(
        [
            {
                'id': 'corner',
                'x_m': 500,
                'y_m': 500,
                'data_mbit': 4,
            },  # the edges belong to the area
            {'id': 'second', 'x_m': 60, 'y_m': 10, 'data_mbit': 2},
            {'id': 'third', 'x_m': 99, 'y_m': 49, 'data_mbit': 0},
            {'id': 'border', 'x_m': 50, 'y_m': 50, 'data_mbit': 3},
            {'id': 'first', 'x_m': 0, 'y_m': 0, 'data_mbit': 1},
        ],
        data_mbit='csv',
    )
    assert site.sensor_ids == ('first', 'second', 'third', 'border', 'corner')
    assert site.cell.tolist() == [0, 1, 1, 11, 99]
    assert site.data_bit.tolist() == [1e6, 2e6, 0.0, 3e6, 4e6]
    assert site.first_sensor[[0, 1, 2, 11, 12, 99, 100]].tolist() == [0, 1, 3, 3, 4, 4, 5]


def test_amounts_are_left_open_where_missions_draw_them() -> None:
    entries: list[dict[str, object]] = [{'id': 'a', 'x_m': 1, 'y_m': 2, 'data_mbit': 7}]
    assert np.isnan(listed(entries, data_mbit=[0.1, 1.0]).data_bit).all()
    assert np.isnan(build_site(load('paper_8x8')).data_bit).all()

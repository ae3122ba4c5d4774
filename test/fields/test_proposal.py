"""What is proposed for a field, and why."""

from dataclasses import replace
import math

from fields import ground, proposed, square
import pytest
from uav_collect.errors import ConfigError
from uav_collect.fields.radio_reach import mean_rate_bps
from uav_collect.fields.settings import usual_settings
from uav_collect.fields.summary import doubts, summary
from uav_collect.scenario.airframes import airframe_named, airframe_names

LINE = [(100.0 * n, 0.0) for n in range(40)]  # 3.9 km


@pytest.mark.parametrize('side_m', [1001.7, 5000.0, 9001.0, 9002.0, 9003.0])
def test_the_least_cell_size_that_is_named_is_one_that_is_taken(side_m: float) -> None:
    field = ground((0.0, 0.0), (side_m, 0.0))
    with pytest.raises(ConfigError, match='--cell-size is 1: must be at least ') as caught:
        proposed(field, cell_size_m=1.0)
    least_m = float(str(caught.value).split('at least ')[1].split(' m ')[0])
    assert proposed(field, cell_size_m=least_m).grid.cell_size_m == least_m
    assert least_m == pytest.approx(side_m / 63.0, abs=0.1)


def test_cells_are_as_large_as_corners_have_their_share_of_the_rate() -> None:
    field = proposed(ground(*LINE), n_uavs=2)
    settings, size_m = usual_settings(), field.grid.cell_size_m
    shares = [
        mean_rate_bps(field.radio, settings.altitude_m, 5e5, side_m / math.sqrt(2))
        / mean_rate_bps(field.radio, settings.altitude_m, 5e5, 0.0)
        for side_m in (size_m, size_m + 5.0)
    ]
    assert shares[0] >= settings.rate_share > shares[1]
    assert field.corner_share == pytest.approx(shares[0])
    assert field.why_size.startswith("as large as the radio allows; a sensor in a cell's")


def test_a_small_field_has_smaller_cells_so_that_each_uav_has_some() -> None:
    field = proposed(ground(*[(5.0 * n, 20.0 * (n % 3)) for n in range(30)]), n_uavs=3)
    assert field.grid.n_data_cells >= 3 * usual_settings().data_cells_per_uav
    assert f'to lie in {field.grid.n_data_cells} cells, for 3 UAVs to share; ' in field.why_size


def test_few_sensors_share_no_cell_if_they_need_not() -> None:
    field = proposed(ground((0.0, 0.0), (60.0, 0.0), (0.0, 60.0)), n_uavs=3)
    assert field.grid.n_data_cells == 3
    assert field.why_size.startswith('small enough for few sensors to share a cell; ')


@pytest.mark.parametrize('name', airframe_names())
def test_no_craft_is_proposed_to_fly_faster_than_it_can(name: str) -> None:
    most_mps = airframe_named(name).max_speed_mps or math.inf
    assert proposed(ground(*LINE), airframe=name).crafts[0].speed_mps <= most_mps


def test_a_speed_that_the_craft_does_not_fly_is_refused() -> None:
    with pytest.raises(ConfigError, match='--speed is 24: must be at most 23 m/s'):
        proposed(ground(*LINE), airframe='dji_m300', speeds_mps=(10.0, 24.0))


def test_a_field_too_large_for_its_cells_has_larger_ones_and_says_what_that_costs() -> None:
    field = proposed(ground((0.0, 0.0), (60_000.0, 0.0), (0.0, 60_000.0)))
    assert field.grid.n_columns <= 64
    assert 'no smaller, as an area has at most 64 x 64 cells' in field.why_size
    said = ' '.join(doubts(field))
    assert 'sensors in corners of cells send' in said
    assert 'cells are out of reach' in said


def test_what_is_asked_for_is_not_proposed() -> None:
    field = proposed(
        ground(*LINE),
        cell_size_m=130.0,
        altitude_m=60.0,
        airframe='dji_mavic_3',
        battery_wh=50.0,
        speeds_mps=(9.0, 9.0),
        data_mbit=(2.0, 3.0),
    )
    assert (field.grid.cell_size_m, field.grid.altitude_m) == (130.0, 60.0)
    assert (field.crafts[0].airframe, field.crafts[0].speed_mps) == ('dji_mavic_3', 9.0)
    assert field.crafts[0].energy_budget_kj == pytest.approx(50.0 * 3.6 * 0.8)
    assert (field.data_mbit, field.scale_mbit) == ((2.0, 3.0), 3.0)
    assert field.why_size.startswith('as asked')
    assert list(doubts(field)) == []


def test_a_craft_flies_at_the_speed_that_takes_it_farthest() -> None:
    craft = proposed(ground(*LINE)).crafts[0]
    for speed_mps in (craft.speed_mps - 1.0, craft.speed_mps + 1.0):
        other = proposed(ground(*LINE), speeds_mps=(speed_mps,) * 2).crafts[0]
        assert other.energy_per_m_j > craft.energy_per_m_j
    assert craft.held_wh == airframe_named(craft.airframe).battery_wh


def test_a_craft_whose_battery_nobody_knows_has_a_usual_one() -> None:
    craft = proposed(ground(*LINE), airframe='zeng_2019').crafts[0]
    assert craft.battery_wh == craft.held_wh == usual_settings().battery_wh


def test_data_are_as_the_list_says_where_it_says_them_of_all() -> None:
    known = proposed(ground((0.0, 0.0), (90.0, 0.0), data_mbit=[0.5, 4.0]))
    assert (known.data_mbit, known.scale_mbit) == (None, 4.0)
    half = proposed(ground((0.0, 0.0), (90.0, 0.0), data_mbit=[0.5, None]))
    assert half.data_mbit == usual_settings().data_mbit
    assert 'the list does not say how much data' in ' '.join(doubts(half))


def test_a_boundary_that_is_moved_is_a_note() -> None:
    edge_m = square(-50.0, -50.0, 600.0)
    wide = proposed(ground((0.0, 0.0), (400.0, 0.0), edge_m=edge_m, widen_m=30.0))
    assert '--widen moves the boundary itself: 30 m outside of what was' in ' '.join(doubts(wide))
    assert '--widen' not in ' '.join(
        doubts(proposed(ground((0.0, 0.0), (400.0, 0.0), edge_m=edge_m)))
    )


def test_a_move_counts_in_rewards_as_much_as_one_of_the_paper() -> None:
    field = proposed(ground(*LINE))
    move_s = field.grid.cell_size_m / field.crafts[0].speed_mps
    assert field.discount_per_s**move_s == pytest.approx(0.99**5, rel=1e-3)
    assert field.move_penalty_per_s * move_s == pytest.approx(0.01 * 5, rel=1e-2)


def test_the_round_trip_is_that_to_the_farthest_sensor() -> None:
    field = proposed(ground(*LINE), cell_size_m=100.0)
    base_m = field.grid.centre_m(field.grid.base_cell)[0]
    assert field.round_trip_m == pytest.approx(2 * max(base_m - 50.0, 3950.0 - base_m), abs=1.0)
    assert field.round_trip_kj == pytest.approx(
        field.round_trip_m * field.crafts[0].energy_per_m_j / 1e3
    )
    assert f'{field.round_trip_kj:.1f} kJ' in dict(summary(field))['round trip']


def test_amounts_of_some_sensors_alone_count_for_none_which_is_said() -> None:
    said = replace(ground((0.0, 0.0), (60.0, 0.0), (0.0, 60.0)), data_mbit=(None, 0.0, 2.0))
    field = proposed(said)
    assert field.data_mbit == usual_settings().data_mbit
    assert 'how much data 1 of 3 sensors hold (1e-06 to 10,000 Mbit' in ' '.join(doubts(field))


def test_the_round_trip_leads_around_no_fly_zones() -> None:
    # A wall between base and sensor, 300 m to each side of the straight way of 800 m.
    wall = ((200.0, -300.0), (600.0, -300.0), (600.0, 300.0), (200.0, 300.0))
    places = [(0.0, 0.0), (800.0, 0.0), (0.0, 500.0), (0.0, -500.0)]
    straight = proposed(ground(*places, base_m=(0.0, 0.0)), cell_size_m=100.0)
    around = proposed(ground(*places, base_m=(0.0, 0.0), no_fly_m=[wall]), cell_size_m=100.0)
    assert straight.round_trip_m < 2 * 900.0
    assert around.round_trip_m > 2 * 2 * math.hypot(300.0, 200.0)


@pytest.mark.parametrize(
    ('field', 'wishes', 'words'),
    [
        (
            ground((0.0, 0.0), (400.0, 0.0), no_fly_m=[square(-20.0, -20.0, 40.0)]),
            {},
            [
                "list.csv:2: sensor 'S1' lies in a no-fly zone: draw the zone smaller, or leave"
                ' the sensor out'
            ],
        ),
        (
            ground((0.0, 0.0), (400.0, 0.0), (900.0, 50.0), edge_m=square(-50.0, -50.0, 600.0)),
            {},
            ["sensor 'S3'", "m beyond the area's edge: give --widen "],
        ),
        (
            ground((0.0, 0.0), (400.0, 0.0), no_fly_m=[square(150.0, -500.0, 1000.0)]),
            {},
            ["sensor 'S2' lies in a no-fly zone"],
        ),
        (
            ground((0.0, 0.0), (900.0, 0.0), no_fly_m=[square(400.0, -40.0, 80.0)]),
            {'cell_size_m': 100.0},
            ["sensor 'S2' cannot be reached from the base over open cells: leave a gap"],
        ),
        (
            ground((0.0, 0.0), (900.0, 0.0), base_m=(450.0, 0.0), no_fly_m=[square(440, -5, 20)]),
            {},
            ['the base lies in a cell of ', 'or leave --base out'],
        ),
        (
            ground((0.0, 0.0), (9000.0, 0.0)),
            {'cell_size_m': 100.0},
            ['--cell-size is 100: must be at least 142.9 m here, for an area has at most 64 x 64'],
        ),
        (
            ground((0.0, 0.0)),
            {'airframe': 'kite'},
            ["airframe is 'kite': must be a mapping, or one of ", 'dji_m30'],
        ),
    ],
)
def test_what_cannot_be_flown_is_refused_with_what_would_help(
    field: object, wishes: dict[str, object], words: list[str]
) -> None:
    with pytest.raises(ConfigError) as raised:
        proposed(field, **wishes)  # type: ignore[arg-type]
    assert [word for word in words if word not in str(raised.value)] == []


def test_a_sensor_near_a_zone_is_refused_with_a_cell_size_that_serves_all() -> None:
    # 6 m to the west and to the east of a pond of 108 m: cells of 112 m, or of 16, fit between.
    pond = square(201.0, 0.0, 108.0)
    field = ground((0.0, 0.0), (500.0, 300.0), (195.0, 50.0), (315.0, 50.0), no_fly_m=[pond])
    with pytest.raises(ConfigError) as raised:
        proposed(field, cell_size_m=100.0)
    [line] = {problem.split(': ', 2)[2] for problem in raised.value.problems}
    assert line.startswith('draw the zone smaller, give --cell-size ')
    size_m = float(line.split('--cell-size ')[1].split(',')[0])
    assert proposed(field, cell_size_m=size_m).grid.unserved.size == 0


def test_no_cell_size_is_named_for_a_sensor_that_none_serves() -> None:
    zones = square(0.0, 0.0, 19.9), square(20.1, 0.0, 19.9)  # 0.2 m between them
    field = ground((20.0, 10.0), (40.0, 60.0), no_fly_m=zones)
    with pytest.raises(ConfigError) as raised:
        proposed(field, cell_size_m=30.0)
    assert '--cell-size' not in str(raised.value)


def test_all_sensors_that_cannot_be_served_are_named_at_once() -> None:
    with pytest.raises(ConfigError) as raised:
        proposed(ground(*LINE, no_fly_m=[square(1010.0, -500.0, 1000.0)]))
    named = [line.split("'")[1] for line in raised.value.problems]
    within = {f'S{number}' for number, (x_m, _) in enumerate(LINE, 1) if 1010 < x_m < 2010}
    assert len(named) == len({*named})
    assert within <= {*named}


def test_more_zones_than_an_area_may_have_are_refused_before_cells_are_sought() -> None:
    zones = [square(20.0 * number, 500.0, 10.0) for number in range(4097)]
    with pytest.raises(ConfigError, match='has 4,097 no-fly zones with 16,388 corners in all: mu'):
        proposed(ground(*LINE, no_fly_m=zones))

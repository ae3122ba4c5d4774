"""Areas that are not squares, and cells that are closed."""

from collections.abc import Sequence
import math
from pathlib import Path

import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Bools
from uav_collect.scenario import area as area_module
from uav_collect.scenario.area import open_cells, outlines_box_m, shown_box_m
from uav_collect.scenario.load import fingerprint, from_yaml, load
from uav_collect.scenario.model import AreaConfig, Polygon
from uav_collect.scenario.site import build_site, known_complete_cells
from uav_collect.uav.briefing import brief, Briefing, briefing_of

SENSOR = [(75.0, 25.0, 1.0)]
RING: Polygon = tuple(
    (165.0 + math.cos(step * 0.002 * math.pi), 165.0 + math.sin(step * 0.002 * math.pi))
    for step in range(1000)
)
SQUARE = {'cells_per_side': 4, 'cell_size_m': 50.0, 'altitude_m': 100.0}


def assert_equal(briefing: Briefing, other: Briefing) -> None:
    for values, others in zip(briefing, other, strict=True):
        assert np.array_equal(
            values, others
        )  # rows are lists, or arrays where kernels are compiled


def rectangle(west_m: float, south_m: float, east_m: float, north_m: float) -> Polygon:
    return (west_m, south_m), (east_m, south_m), (east_m, north_m), (west_m, north_m)


def closed(*zones: Polygon, boundary: Polygon | None = None) -> list[int]:
    """The closed cells of 4 x 4 cells of 50 m."""
    area = AreaConfig(**SQUARE, no_fly=zones or None, boundary=boundary)
    return np.flatnonzero(open_cells(area) == 0).tolist()


def test_an_area_of_rows_and_columns_is_numbered_row_by_row_from_the_south_west() -> None:
    scenario = tiny(uav(start=(2, 1)), sensors=[(225.0, 75.0, 1.0)], area__rows=3, area__columns=5)
    area = scenario.area
    assert (area.n_rows, area.n_columns, scenario.n_cells) == (3, 5, 15)
    assert (area.width_m, area.height_m) == (250.0, 150.0)
    assert build_site(scenario).cell.tolist() == [9]
    assert scenario.uavs[0].start_m == (75.0, 125.0)


def test_a_square_of_rows_and_columns_is_flown_like_one_of_cells_per_side() -> None:
    one, other = tiny(uav()), tiny(uav(), area__rows=4, area__columns=4)
    assert_equal(brief(one), brief(other))
    assert fingerprint(one) != fingerprint(other)


def test_sensors_are_drawn_in_open_cells_alone() -> None:
    overrides = {
        'area.rows': 6,
        'area.columns': 12,
        'area.no_fly': [[*rectangle(100, 0, 300, 90)]],
    }
    site = build_site(load('paper_10x10', overrides))
    assert len({*site.cell.tolist()}) > 20
    assert open_cells(site.scenario.area)[site.cell].all()
    assert site.position_m[:, 0].max() > 550.0
    assert site.position_m[:, 1].max() < 300.0


@pytest.mark.parametrize(
    ('zones', 'cells'),
    [
        ([rectangle(50, 50, 100, 100)], [5]),  # along its borders, no further
        ([rectangle(60, 60, 61, 61)], [5]),  # inside one cell
        ([rectangle(99.999, 60, 100.001, 61)], [5, 6]),  # a sliver of two
        ([rectangle(-500, 160, 500, 170)], [12, 13, 14, 15]),  # beyond the area
        ([rectangle(-20, -20, 0, 400), rectangle(200, 0, 300, 9)], []),  # beside it
        ([((0, 0), (100, 0), (0, 100))], [0, 1, 4]),  # touches 5 in a point
        ([((0, 0), (100.1, 0), (0, 100.1))], [0, 1, 2, 4, 5, 8]),
        ([rectangle(0, 0, 200, 200)], [*range(16)]),
        # A star drawn in one stroke, in whose middle all cells lie.
        ([((100, 700), (-253, -385), (671, 285), (-471, 285), (453, -385))], [*range(16)]),
        # A ring that runs in and out again: what it leaves in the middle is open.
        (
            [
                (
                    (0, 0), (150, 0), (150, 150), (0, 150), (0, 100), (50, 100), (100, 100),
                    (100, 50), (50, 50), (50, 100), (0, 100),
                )
            ],
            [0, 1, 2, 4, 6, 8, 9, 10],
        ),
    ],
)  # fmt: skip
def test_a_zone_closes_the_cells_that_it_shares_more_than_a_border_with(
    zones: Sequence[Polygon], cells: list[int]
) -> None:
    assert closed(*zones) == cells
    assert closed(*(zone[::-1] for zone in zones)) == cells


def test_a_cell_belongs_to_the_area_if_its_centre_lies_within_the_boundary() -> None:
    outside = [11, *range(12, 16)]
    assert closed(boundary=((0, 0), (200, 0), (200, 118), (110, 140), (0, 130))) == outside
    assert closed(boundary=rectangle(25, 25, 175, 175)) == []  # through the outer centres
    assert closed(boundary=rectangle(26, 26, 175, 175)) == [0, 1, 2, 3, 4, 8, 12]


def test_zones_agree_with_many_points_tried_one_by_one() -> None:
    rng = np.random.default_rng(5)
    for _ in range(60):
        corners = [(float(x_m), float(y_m)) for x_m, y_m in rng.uniform(-30, 230, (5, 2))]
        found, zone = closed(tuple(corners)), np.array(corners)
        points_m = rng.uniform(0, 200, (1500, 2))
        ends = np.roll(zone, -1, axis=0)
        above = (zone[:, 1] > points_m[:, 1:]) != (ends[:, 1] > points_m[:, 1:])
        slope = (ends[:, 0] - zone[:, 0]) / (ends[:, 1] - zone[:, 1])
        is_east = points_m[:, :1] < zone[:, 0] + slope * (points_m[:, 1:] - zone[:, 1])
        inside = points_m[(above & is_east).sum(axis=1) % 2 == 1]
        column, row = (inside // 50.0).astype(int).T
        assert {*(row * 4 + column).tolist()} <= {*found}


def test_what_is_known_complete_before_take_off() -> None:
    zone = [[*rectangle(100, 100, 150, 150)]]
    some = tiny(uav(), sensors=SENSOR, area__no_fly=zone, demand__known_empty='none')
    assert np.flatnonzero(known_complete_cells(some)).tolist() == [10]
    known = tiny(uav(), sensors=SENSOR, area__no_fly=zone, demand__known_empty='sensors')
    assert np.flatnonzero(known_complete_cells(known) == 0).tolist() == [1]
    briefing = brief(known)
    assert_equal(briefing_of(build_site(known)), briefing)
    assert [*briefing.known_complete] == known_complete_cells(known).tolist()
    assert [*briefing.is_open] == [int(cell != 10) for cell in range(16)]


def test_only_open_cells_count_for_how_many_sensors_are_drawn() -> None:
    overrides = {
        'area.cells_per_side': 64,
        'area.boundary': [*rectangle(0, 0, 3200, 500)],
        'sensors': {'kind': 'drawn', 'seed': 1, 'dense_cell_share': 0.5}
        | {'dense_mean': 20.0, 'sparse_mean': 10.0},
    }
    site = build_site(load('paper_10x10', overrides))  # 640 cells of 4096: some 9,600 sensors
    assert 9_000 < site.n_sensors < 10_200
    with pytest.raises(ConfigError, match='has some 32,000 sensors by it, at most 20,000'):
        load('paper_10x10', {**overrides, 'sensors.sparse_mean': 80.0})


def test_an_area_survives_its_text() -> None:
    scenario = tiny(
        uav(),
        sensors=SENSOR,
        area__rows=3,
        area__columns=7,
        area__boundary=[*rectangle(0, 0, 340, 150)],
        area__no_fly=[[*rectangle(200, 0, 210, 10)], [(0, 90), (30, 90), (9, 99.5)]],
    )
    assert from_yaml(scenario.to_yaml()) == scenario


def test_an_heir_says_how_many_cells_there_are_in_its_own_way(tmp_path: Path) -> None:
    for name, text in (
        ('wide', 'extends: paper_10x10\narea: {rows: 2, columns: 9}\n'),
        ('wider', 'extends: wide.yaml\narea: {columns: 12}\n'),
        ('square', 'extends: wide.yaml\narea: {cells_per_side: 5}\n'),
    ):
        (tmp_path / f'{name}.yaml').write_text(text)
    sizes = [load(tmp_path / f'{name}.yaml').area for name in ('wide', 'wider', 'square')]
    assert [(area.n_rows, area.n_columns) for area in sizes] == [(2, 9), (2, 12), (5, 5)]
    assert load('paper_10x10', {'area.rows': 3, 'area.columns': 4}).n_cells == 12


EITHER = 'must be rows and columns, or cells_per_side'
CELLS = 'must be a whole number from 1 to 64'
POINTS = 'must be a list of 3 to 1000 points [x, y] of numbers from -640000 to 640000 m'


@pytest.mark.parametrize(
    ('area', 'problem'),
    [
        ('{rows: 3}', f'area.rows is given without columns: {EITHER}'),
        ('{columns: 3}', f'area.columns is given without rows: {EITHER}'),
        (
            '{rows: 3, columns: 3, cells_per_side: 3}',
            f'area.rows is given beside cells_per_side: {EITHER}',
        ),
        ('{rows: 65, columns: 3}', f'area.rows is 65: {CELLS}'),
        ('{boundary: [[0, 0], [9, 9]]}', f'area.boundary is [[0, 0], [9, 9]]: {POINTS}'),
        (
            '{no_fly: [[[0, 0], [9, 9], [5, 5], [2, 2]]]}',
            f'area.no_fly.0 is [[0, 0], [9, 9], [5, 5], [2, 2]]: {POINTS}, not all on one line',
        ),
        (
            '{no_fly: [[[0, 0], [9, 9], [5, .inf]]]}',
            f'area.no_fly.0 is [[0, 0], [9, 9], [5, inf]]: {POINTS}',
        ),
    ],
)  # fmt: skip
def test_an_area_that_cannot_be_is_refused_by_its_line(
    area: str, problem: str, tmp_path: Path
) -> None:
    file = tmp_path / 'site.yaml'
    file.write_text(f'extends: paper_10x10\narea: {area}\n')
    with pytest.raises(ConfigError) as refused:
        load(file)
    assert str(refused.value).startswith(f'{file}:2: {problem}')


def test_no_cells_at_all_are_missed(tmp_path: Path) -> None:
    text = load('paper_10x10').to_yaml().replace('  cells_per_side: 10\n', '')
    with pytest.raises(ConfigError, match=r'cells_per_side is missing: .* or rows and columns'):
        from_yaml(text)


@pytest.mark.parametrize(
    ('values', 'problem'),
    [
        ({'cell': [2, 0]}, r'\[2, 0\]: must be a list \[row, column\] of .* from 0 to 1 and'),
        ({'cell': {0: 1, 1: 1}}, 'from 0 to 1 and from 0 to 5'),
        ({'position_m': [25.0, 125.0]}, 'must be the centre of a cell of the area'),
    ],
)  # fmt: skip
def test_a_start_outside_the_rows_is_refused(values: dict[str, object], problem: str) -> None:
    away = {'speed_mps': 5.0, 'start': values, 'home': {'position_m': [0.0, 0.0]}}
    with pytest.raises(ConfigError, match=problem):
        tiny(away, sensors=SENSOR, area__rows=2, area__columns=6)


def test_many_sensors_under_the_last_of_many_zones_are_refused_as_quickly_as_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked_at: list[Polygon] = []

    def overlaps(area: AreaConfig, zone: Polygon) -> Bools:
        looked_at.append(zone)
        return one_overlaps(area, zone)

    one_overlaps = area_module._overlaps
    monkeypatch.setattr(area_module, '_overlaps', overlaps)
    zones = [rectangle(160.0 + step, 160.0, 170.0 + step, 170.0) for step in range(20)]
    sensors = [(60.0 + number, 60.0, 1.0) for number in range(30)]
    with pytest.raises(ConfigError) as refused:
        tiny(uav(), sensors=sensors, area__no_fly=[*zones, rectangle(60.0, 60.0, 90.0, 90.0)])
    assert len(refused.value.problems) == 30
    assert 'cell [1, 1] lies under area.no_fly.20' in refused.value.problems[29]
    assert len(looked_at) == 21


def test_an_area_is_not_looked_up_again_for_each_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    n_lookups = 0
    by_all_corners = AreaConfig.__hash__

    def counted(area: AreaConfig) -> int:
        nonlocal n_lookups
        n_lookups += 1
        return by_all_corners(area)

    monkeypatch.setattr(AreaConfig, '__hash__', counted)
    sensors = [(0.5 * number, 20.0, 1.0) for number in range(300)]
    tiny(uav(), sensors=sensors, area__no_fly=[rectangle(160, 160, 170, 170)])
    assert 0 < n_lookups < 30


def test_a_zone_is_given_by_cells_as_well_as_by_its_corners() -> None:
    corners = [(0.0, 150.0), (50.0, 150.0), (50.0, 200.0)]
    cells = [[0, 2], [1, 2], [0, 3], [1, 3], [3, 3], [0, 3]]
    zones = [{'cells': cells}, corners]
    area = tiny(uav(), sensors=[(75.0, 75.0, 1.0)], area__no_fly=zones).area
    assert np.flatnonzero(open_cells(area) == 0).tolist() == [2, 3, 6, 7, 12, 15]
    assert area.no_fly is not None
    assert area.no_fly[0] == rectangle(100.0, 0.0, 200.0, 100.0)
    assert area.no_fly[1] == tuple(corners)  # zones keep their numbers
    assert area.no_fly[2:] == (rectangle(150.0, 150.0, 200.0, 200.0),)


def test_any_cells_may_be_one_zone() -> None:
    cells = [[row, column] for row in range(1, 24, 2) for column in range(1, 24, 2)]
    zone = {'cells': cells}  # no two of them side by side: a rectangle each
    scenario = tiny(uav(), sensors=SENSOR, area__cells_per_side=24, area__no_fly=[zone])
    assert int((open_cells(scenario.area) == 0).sum()) == len(cells) == 144
    assert from_yaml(scenario.to_yaml()) == scenario


@pytest.mark.parametrize(
    ('zones', 'problem'),
    [
        ([rectangle(160, 160, 170, 170)] * 4097, 'has 4097 entries: must have at most 4096'),
        ([RING] * 101, r'no_fly has 101,000 corners in all: must have at most 100,000'),
    ],
)
def test_more_zones_than_cells_and_too_many_corners_are_refused(
    zones: list[Polygon], problem: str
) -> None:
    with pytest.raises(ConfigError, match=problem):
        tiny(uav(), area__no_fly=zones)


@pytest.mark.parametrize(
    ('zone', 'problem'),
    [
        ({'cells': [[0, 4]]}, r'0\.cells\.0 is \[0, 4\]: must be a list \[row, column\] of whole'),
        (
            {'cells': []},
            r'0 is {.*}: must be a list of points, or {cells: \[\[row, column\], \.\.\.\]}',
        ),
        ({'cell': [0, 1]}, 'must be a list of points, or {cells: '),
    ],
)
def test_a_zone_of_cells_that_are_none_is_refused(zone: object, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        tiny(uav(), area__no_fly=[zone])


@pytest.mark.parametrize('cells', [[[0, 0]], [[3, 3], [0, 0]]])
def test_a_start_under_a_zone_of_cells_is_refused_by_a_zone_that_there_is(
    cells: list[list[int]],
) -> None:
    with pytest.raises(ConfigError, match=r'cell \[0, 0\] lies under area\.no_fly\.0'):
        tiny(uav(start=(0, 0)), area__no_fly=[{'cells': cells}])


def test_pictures_hold_the_whole_edge_and_all_zones_about_it() -> None:
    edge = (-40.0, 10.0), (150.0, -30.0), (150.0, 150.0)
    area = AreaConfig(**SQUARE, boundary=edge, no_fly=(rectangle(100, 100, 250, 120),))
    assert outlines_box_m(area) == (-40.0, -30.0, 250.0, 150.0)
    west_m, south_m, east_m, north_m = shown_box_m(area)
    assert -45.0 < west_m < -40.0
    assert -35.0 < south_m < -30.0
    assert 250.0 < east_m < 255.0
    assert 200.0 < north_m < 205.0


def test_without_outlines_beyond_them_pictures_hold_the_cells() -> None:
    within = AreaConfig(**SQUARE, boundary=rectangle(10, 10, 150, 150))
    assert outlines_box_m(AreaConfig(**SQUARE)) is None
    assert shown_box_m(AreaConfig(**SQUARE)) == shown_box_m(within) == (0.0, 0.0, 200.0, 200.0)


def test_of_a_zone_that_reaches_far_pictures_hold_what_is_near() -> None:
    area = AreaConfig(**SQUARE, no_fly=(rectangle(150, 150, 90_000, 90_000),))
    assert outlines_box_m(area) == (150.0, 150.0, 300.0, 300.0)

"""Ways home around closed cells, and what closed cells must not cut off."""

import math
from pathlib import Path

import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.errors import ConfigError
from uav_collect.scenario.area import cell_of, open_cells
from uav_collect.scenario.load import load
from uav_collect.scenario.model import AreaConfig, Point, Polygon
from uav_collect.scenario.ways import HOME_ITSELF, reached_cells, ways_home
from uav_collect.uav.briefing import brief

CELL_M = 50.0


def area_of(n_rows: int, n_columns: int, *closed: tuple[int, int]) -> AreaConfig:
    """An area with some closed cells, by row and column."""
    zones = tuple(
        inside((column + 0.4) * CELL_M, (row + 0.4) * CELL_M, 10.0) for row, column in closed
    )
    return AreaConfig(
        rows=n_rows, columns=n_columns, cell_size_m=CELL_M, altitude_m=100.0, no_fly=zones or None
    )


def inside(x_m: float, y_m: float, side_m: float) -> Polygon:
    return (x_m, y_m), (x_m + side_m, y_m), (x_m + side_m, y_m + side_m), (x_m, y_m + side_m)


def centre_m(area: AreaConfig, cell: int) -> Point:
    row, column = divmod(cell, area.n_columns)
    return (column + 0.5) * CELL_M, (row + 0.5) * CELL_M


def touched(area: AreaConfig, from_m: Point, to_m: Point) -> bool:
    """Whether a straight way comes into a closed cell, tried at many points."""
    share = np.linspace(0.0, 1.0, 501)
    x_m, y_m = (from_m[i] + (to_m[i] - from_m[i]) * share for i in (0, 1))
    column = np.minimum(x_m // CELL_M, area.n_columns - 1)
    row = np.minimum(y_m // CELL_M, area.n_rows - 1)
    cells = (row * area.n_columns + column).astype(int)
    return bool((open_cells(area)[cells] == 0).any())


def random_area(rng: np.random.Generator) -> AreaConfig:
    n_rows, n_columns = rng.integers(2, 13, 2).tolist()
    n_closed = int(rng.integers(0, n_rows * n_columns // 3 + 1))
    return area_of(n_rows, n_columns, *zip(
        rng.integers(0, n_rows, n_closed).tolist(), rng.integers(0, n_columns, n_closed).tolist(),
        strict=True,
    ))  # fmt: skip


def test_a_way_turns_at_the_corner_that_is_in_it() -> None:
    # north     H home, x closed: from a the way leads over b, as c is behind the corner.
    #  b . .
    #  a x .
    #  . x H
    ways = ways_home(area_of(3, 3, (0, 1), (1, 1)), (125.0, 25.0))
    assert ways.via[3] == 6
    assert ways.via[6] == 7
    assert ways.via[7] == 8
    assert ways.via[8] == HOME_ITSELF
    assert ways.length_m[3] == 50.0 + 50.0 + 50.0 + 100.0


def test_a_way_leads_past_a_corner_with_a_cell_to_spare_and_no_further() -> None:
    # . . . . a     One turn, at t: straight from there to both ends.
    # . . x . .
    # . . t . .
    # H . . . .
    ways = ways_home(area_of(4, 5, (2, 2)), (25.0, 25.0))
    assert [ways.via[cell] for cell in (19, 18, 17)] != [HOME_ITSELF] * 3
    for cell in (19, 18, 17, 14):
        turns, at = 0, cell
        while ways.via[at] != HOME_ITSELF:
            turns, at = turns + 1, ways.via[at]
        assert turns <= 1
    assert ways.length_m[19] < math.hypot(200.0, 150.0) + 30.0


def test_ways_home_touch_no_closed_cell_and_are_straight_where_they_can_be() -> None:
    rng = np.random.default_rng(4)
    n_turning = 0
    for _ in range(15):
        area = random_area(rng)
        is_open = np.flatnonzero(open_cells(area))
        if not len(is_open):
            continue
        own = centre_m(area, int(rng.choice(is_open)))
        home_m = own[0] + float(rng.uniform(-24, 24)), own[1] + float(rng.uniform(-24, 24))
        ways = ways_home(area, home_m)
        reached = reached_cells(area, cell_of(area, home_m))
        for cell in is_open.tolist():
            if cell not in reached:
                assert ways.length_m[cell] == 0.0
                continue
            here_m, via = centre_m(area, cell), ways.via[cell]
            straight_m = math.dist(here_m, home_m)
            assert ways.length_m[cell] >= straight_m - 1e-9
            if via == HOME_ITSELF:
                assert ways.length_m[cell] == pytest.approx(straight_m, rel=1e-15)
                assert not touched(area, here_m, home_m)
            else:
                n_turning += 1
                assert not touched(area, here_m, centre_m(area, via))
                rest_m = ways.length_m[cell] - ways.length_m[via]
                assert rest_m == pytest.approx(math.dist(here_m, centre_m(area, via)))
    assert n_turning > 60


def test_no_way_home_is_longer_than_by_moves() -> None:
    rng = np.random.default_rng(9)
    for _ in range(30):
        area = random_area(rng)
        is_open = np.flatnonzero(open_cells(area)).tolist()
        if not is_open:
            continue
        home = int(rng.choice(is_open))
        ways, n_moves, ring = ways_home(area, centre_m(area, home)), 0, {home}
        seen = {home}
        while ring:
            for cell in ring:
                assert ways.length_m[cell] <= n_moves * CELL_M + 1e-9
            n_moves += 1
            ring = {
                near
                for cell in ring
                for near in reached_cells(area, cell)
                if near not in seen
                and abs(near // area.n_columns - cell // area.n_columns)
                + abs(near % area.n_columns - cell % area.n_columns) == 1
            }  # fmt: skip
            seen |= ring


@pytest.mark.parametrize('home_m', [(0.0, 0.0), (200.0, 150.0), (50.0, 100.0), (100.0, 25.0)])
def test_a_home_on_a_border_is_reached(home_m: Point) -> None:
    area = area_of(3, 4, (1, 2))
    ways = ways_home(area, home_m)
    assert all(ways.length_m[cell] > 0.0 for cell in np.flatnonzero(open_cells(area)))


def test_between_two_closed_cells_that_touch_in_a_corner_no_way_leads() -> None:
    ways = ways_home(area_of(2, 2, (0, 0), (1, 1)), (75.0, 25.0))
    assert ways.length_m[2] == 0.0
    assert reached_cells(area_of(2, 2, (0, 0), (1, 1)), 1) == {1}


def test_a_fleet_that_flies_straight_home_everywhere_has_no_obstacles() -> None:
    zone = [[*inside(160.0, 10.0, 10.0)]]
    scenario = tiny(uav(), sensors=[(75.0, 25.0, 1.0)], area__no_fly=zone, area__rows=1,
                    area__columns=4)  # fmt: skip
    briefing = brief(scenario)
    assert briefing.has_obstacles == 0
    assert len(briefing.home_m) == len(briefing.home_via) == 0
    around = brief(tiny(uav(), sensors=[(75.0, 25.0, 1.0)], area__no_fly=[[*inside(60, 60, 9)]]))
    assert around.has_obstacles == 1
    assert len(around.home_m) == len(around.home_via) == 16


HEAD = """extends: paper_10x10
demand: {cell_share: all, data_mbit: [1, 2], known_empty: none}
area: {cells_per_side: 4, no_fly: [[[60, 0], [90, 0], [90, 199]]]}
"""
SENSORS = (
    'sensors: {kind: listed, entries: [{id: a, x_m: 20, y_m: 20}, {id: b, x_m: 180, y_m: 20}]}\n'
)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (
            f'{HEAD}{SENSORS}',
            ':3: area.no_fly cuts cells [0, 2], [0, 3] with sensor b, [1, 2] and 5 more off from '
            'the start of UAV 1: must leave open cells that lead there, or close what they',
        ),
        (
            f'{HEAD}{SENSORS}'.replace('none', 'sensors'),
            ':3: area.no_fly cuts cell [0, 3] with sensor b off from the start of UAV 1: must',
        ),
        (
            f'{HEAD}{SENSORS}'.replace('x_m: 180', 'x_m: 80'),
            ':4: sensors.entries.1 is sensor b at x = 80 m, y = 20 m: must be in an open cell, '
            'but cell [0, 1] lies under area.no_fly.0; leave it out, or let the area have its',
        ),
        (
            f'{HEAD}{SENSORS}fleet:\n  uavs: [{{speed_mps: 5, start: {{cell: [2, 1]}}}}]\n',
            ':6: fleet.uavs.0.start.position_m is [75.0, 125.0]: must be in an open cell, but '
            'cell [2, 1] lies under area.no_fly.0',
        ),
        (
            f'{HEAD}{SENSORS}fleet:\n  uavs: [{{speed_mps: 5, home: {{cell: [2, 3]}}}}]\n',
            ':6: fleet.uavs.0.home.position_m is [175.0, 125.0]: must be where open cells lead '
            'from the start, but none lead from cell [0, 0] to cell [2, 3]',
        ),
        (
            'extends: paper_10x10\narea:\n  boundary: [[60, 60], [400, 60], [60, 400]]\n',
            'fleet.default.start.position_m is [25.0, 25.0]: must be in an open cell, but the '
            'centre of cell [0, 0] lies outside area.boundary',
        ),
    ],
)  # fmt: skip
def test_what_closed_cells_hold_or_cut_off_is_named_with_the_remedy(
    text: str, problem: str, tmp_path: Path
) -> None:
    (tmp_path / 'site.yaml').write_text(text)
    with pytest.raises(ConfigError) as refused:
        load(tmp_path / 'site.yaml')
    assert problem in str(refused.value)


def test_cells_that_nobody_has_to_visit_may_be_cut_off(tmp_path: Path) -> None:
    text = f'{HEAD}{SENSORS}'.replace('none', 'sensors').replace('x_m: 180', 'x_m: 30')
    (tmp_path / 'site.yaml').write_text(text)
    assert load(tmp_path / 'site.yaml').demand.is_empty_known

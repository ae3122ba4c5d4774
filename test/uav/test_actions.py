import pytest
from tiny_world import HOVER_W, MOVE_5_J, MOVE_10_J, tiny, uav
from uav_collect.kernels.arrays import new_row
from uav_collect.uav import action_codes, actions
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOVER, LEFT, NONE, RIGHT
from uav_collect.uav.briefing import brief, Briefing

MOVES = [FORWARD, RIGHT, BACKWARD, LEFT]
PLENTY_J = 1e6


@pytest.fixture
def briefing() -> Briefing:
    return brief(tiny())


def legal_at(
    briefing: Briefing,
    cell: tuple[int, int],
    *,
    previous: int = NONE,
    energy_j: float = PLENTY_J,
    hover_s: float = 0.0,
    unit: int = 0,
) -> list[int]:
    legal = new_row(action_codes.N_ACTIONS, 0)
    x_m, y_m = 25.0 + 50.0 * cell[1], 25.0 + 50.0 * cell[0]
    n_legal = actions.mark_legal(briefing, unit, x_m, y_m, energy_j, previous, hover_s, legal)
    marked = [action for action in range(action_codes.N_ACTIONS) if legal[action]]
    assert len(marked) == n_legal
    return marked


@pytest.mark.parametrize(
    ('x_m', 'y_m', 'cell'),
    [(25.0, 25.0, 0), (199.9, 0.0, 3), (0.0, 50.0, 4), (125.0, 125.0, 10), (175.0, 175.0, 15)],
)
def test_cells_count_from_the_south_west_row_by_row(
    briefing: Briefing, x_m: float, y_m: float, cell: int
) -> None:
    assert actions.cell_under(briefing, x_m, y_m) == cell


@pytest.mark.parametrize(
    ('action', 'target'), [(FORWARD, 9), (RIGHT, 6), (BACKWARD, 1), (LEFT, 4)]
)
def test_forward_is_north_and_right_is_east(briefing: Briefing, action: int, target: int) -> None:
    row_step, column_step = action_codes.ROW_STEP[action], action_codes.COLUMN_STEP[action]
    assert actions.neighbour(briefing, 5, row_step, column_step) == target


@pytest.mark.parametrize(
    ('cell', 'row_step', 'column_step'),
    [(0, 0, -1), (0, -1, 0), (3, 0, 1), (12, 1, 0), (15, 1, 1)],
)
def test_there_is_no_neighbour_across_the_edge(
    briefing: Briefing, cell: int, row_step: int, column_step: int
) -> None:
    assert actions.neighbour(briefing, cell, row_step, column_step) == -1


@pytest.mark.parametrize(
    ('action', 'back'),
    [
        (FORWARD, BACKWARD),
        (BACKWARD, FORWARD),
        (RIGHT, LEFT),
        (LEFT, RIGHT),
        (HOVER, NONE),
        (NONE, NONE),
        (action_codes.HOME, NONE),
    ],
)
def test_only_a_move_has_an_opposite(action: int, back: int) -> None:
    assert actions.opposite(action) == back


@pytest.mark.parametrize(
    ('cell', 'moves'),
    [
        ((0, 0), [FORWARD, RIGHT]),
        ((0, 3), [FORWARD, LEFT]),
        ((3, 0), [RIGHT, BACKWARD]),
        ((3, 3), [BACKWARD, LEFT]),
        ((0, 1), [FORWARD, RIGHT, LEFT]),
        ((2, 1), MOVES),
    ],
)
def test_moves_stay_inside_the_area(
    briefing: Briefing, cell: tuple[int, int], moves: list[int]
) -> None:
    assert legal_at(briefing, cell) == moves


@pytest.mark.parametrize('previous', MOVES)
def test_a_move_straight_back_is_illegal(briefing: Briefing, previous: int) -> None:
    back = actions.opposite(previous)
    assert legal_at(briefing, (1, 1), previous=previous) == [m for m in MOVES if m != back]


def test_a_hover_in_between_lifts_the_rule_against_turning_back(briefing: Briefing) -> None:
    assert legal_at(briefing, (1, 1), previous=HOVER) == MOVES


def test_at_the_start_every_direction_is_open(briefing: Briefing) -> None:
    assert legal_at(briefing, (1, 1), previous=NONE) == MOVES


@pytest.mark.parametrize(('hover_s', 'is_legal'), [(0.0, False), (-1.0, False), (0.5, True)])
def test_a_hover_is_legal_only_where_data_waits(
    briefing: Briefing, hover_s: float, is_legal: bool
) -> None:
    assert (HOVER in legal_at(briefing, (1, 1), hover_s=hover_s)) is is_legal


def test_a_hover_that_never_ends_is_illegal(briefing: Briefing) -> None:
    assert HOVER not in legal_at(briefing, (1, 1), hover_s=float('inf'))


def test_where_nothing_else_is_legal_the_uav_may_turn_back() -> None:
    # Home is the start. From cell (0, 2) the way back west is affordable, any other move is not.
    briefing = brief(tiny(uav(5.0)))
    enough_j = 2 * MOVE_5_J + 1000.0 + 1.0
    assert legal_at(briefing, (0, 2), previous=RIGHT, energy_j=enough_j) == [LEFT]


def test_turning_back_stays_illegal_while_a_hover_is_legal() -> None:
    briefing = brief(tiny(uav(5.0)))
    enough_j = 2 * MOVE_5_J + 1000.0 + 20.0
    legal = legal_at(briefing, (0, 2), previous=RIGHT, energy_j=enough_j, hover_s=0.1)
    assert legal == [HOVER]


def test_turning_back_keeps_the_reserve_too() -> None:
    briefing = brief(tiny(uav(5.0)))
    short_j = 2 * MOVE_5_J + 1000.0 - 1.0
    assert legal_at(briefing, (0, 2), previous=RIGHT, energy_j=short_j) == []


def test_a_single_cell_has_no_moves() -> None:
    briefing = brief(tiny(uav(5.0), sensors=[(25.0, 25.0, 1.0)], area__cells_per_side=1))
    assert legal_at(briefing, (0, 0)) == []
    assert legal_at(briefing, (0, 0), hover_s=1.0) == [HOVER]


def test_a_corner_of_four_cells_is_no_dead_end() -> None:
    briefing = brief(tiny(uav(5.0), sensors=[(25.0, 25.0, 1.0)], area__cells_per_side=2))
    assert legal_at(briefing, (0, 1), previous=RIGHT) == [FORWARD]


# The reading of eqs (ctr_safe_energy_hover), (ctr_safe_energy_move): what is left after the
# action pays for the way home from where it ends, and leaves the margin of 1 kJ.
@pytest.mark.parametrize(('unit', 'move_j'), [(0, MOVE_5_J), (1, MOVE_10_J)])
@pytest.mark.parametrize(('spare_j', 'is_legal'), [(0.05, True), (-0.05, False)])
def test_a_move_leaves_the_way_home_and_the_margin(
    briefing: Briefing, unit: int, move_j: float, spare_j: float, is_legal: bool
) -> None:
    # East from (0, 1) to (0, 2): one move there, two cells home.
    energy_j = 3 * move_j + 1000.0 + spare_j
    assert (RIGHT in legal_at(briefing, (0, 1), energy_j=energy_j, unit=unit)) is is_legal


@pytest.mark.parametrize(('spare_j', 'is_legal'), [(0.05, True), (-0.05, False)])
def test_a_hover_leaves_the_way_home_and_the_margin(
    briefing: Briefing, spare_j: float, is_legal: bool
) -> None:
    energy_j = HOVER_W * 2.0 + MOVE_5_J + 1000.0 + spare_j
    legal = legal_at(briefing, (0, 1), energy_j=energy_j, hover_s=2.0)
    assert (HOVER in legal) is is_legal


def test_a_move_that_leaves_exactly_the_reserve_is_legal(briefing: Briefing) -> None:
    move_j = briefing.flight_power_w[1] * actions.move_duration_s(briefing, 1)
    home_j = actions.home_energy_j(briefing, 1, 75.0, 25.0)
    after_j = home_j + briefing.energy_margin_j[1]
    energy_j = after_j + move_j
    while energy_j - move_j < after_j:  # rounding
        energy_j += 1e-12
    assert legal_at(briefing, (0, 0), energy_j=energy_j, unit=1) == [FORWARD, RIGHT]


def test_the_way_home_is_straight_and_ends_anywhere_in_the_area() -> None:
    # Home is the area's north-east corner, (200, 200) m: from the centre of cell (2, 3) it is
    # hypot(25, 75) m away.
    briefing = brief(tiny(uav(10.0, home_m=(200.0, 200.0))))
    way_j = 126.0337 * 79.0569 / 10.0
    assert actions.home_energy_j(briefing, 0, 175.0, 125.0) == pytest.approx(way_j, rel=1e-5)
    # Towards home from (1, 3) the energy that is left suffices, away from it it does not.
    energy_j = MOVE_10_J + way_j + 1000.0 + 0.1
    assert legal_at(briefing, (1, 3), energy_j=energy_j) == [FORWARD]


def test_the_margin_of_each_uav_is_its_own() -> None:
    briefing = brief(tiny(uav(10.0), uav(10.0, energy_margin_kj=5.0)))
    energy_j = 2 * MOVE_10_J + 1000.0 + 0.1
    assert legal_at(briefing, (0, 0), energy_j=energy_j, unit=0) == [FORWARD, RIGHT]
    assert legal_at(briefing, (0, 0), energy_j=energy_j, unit=1) == []

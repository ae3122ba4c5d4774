"""Moves between cells: straight on where all are open, around closed ones where not.

3 . . . .     4 x 4 cells; a wall of closed cells (#) lets UAVs through in the north only.
2 . # . .
1 . # . .
0 . # . .
  0 1 2 3
"""

from functools import cache

from tiny_world import tiny
from uav_collect.kernels.arrays import filled_row
from uav_collect.uav.action_codes import (
    BACKWARD,
    COLUMN_STEP,
    FORWARD,
    LEFT,
    N_ACTIONS,
    RIGHT,
    ROW_STEP,
)
from uav_collect.uav.actions import neighbour
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.moves import measure, n_moves_to, new_moves, NO_WAY, step
from uav_collect.uav.situation import step_towards

WALL = [[50.0, 0.0], [100.0, 0.0], [100.0, 150.0], [50.0, 150.0]]
SENSORS = ((25.0, 25.0, 1.0),)


@cache
def walled() -> Briefing:
    return brief(tiny(sensors=SENSORS, area__no_fly=[WALL]))


@cache
def unwalled() -> Briefing:
    return brief(tiny(sensors=SENSORS))


def legal_in(briefing: Briefing, cell: int) -> list[int]:
    legal = [0] * N_ACTIONS
    for action in range(FORWARD, N_ACTIONS):
        near = neighbour(briefing, cell, ROW_STEP[action], COLUMN_STEP[action])
        legal[action] = int(near >= 0)
    return legal


def test_moves_around_a_wall_are_counted() -> None:
    moves = new_moves(walled())
    measure(walled(), 0, moves)
    assert [n_moves_to(walled(), 0, cell, moves) for cell in (0, 4, 12, 13, 14, 10, 2, 3)] == [
        *(0, 1, 3, 4, 5, 6, 8, 9)
    ]
    assert n_moves_to(walled(), 0, 1, moves) == NO_WAY


def test_where_all_cells_are_open_moves_are_rows_and_columns() -> None:
    moves = new_moves(unwalled())
    measure(unwalled(), 6, moves)
    for cell in range(16):
        away = abs(cell // 4 - 1) + abs(cell % 4 - 2)
        assert n_moves_to(unwalled(), 6, cell, moves) == away


def test_each_step_leads_nearer_and_the_last_one_there() -> None:
    for briefing in (walled(), unwalled()):
        moves = new_moves(briefing)
        for start in range(16):
            for target in range(16):
                if not (briefing.is_open[start] and briefing.is_open[target]):
                    continue
                measure(briefing, start, moves)
                cell = start
                for _ in range(n_moves_to(briefing, start, target, moves)):
                    legal = filled_row(legal_in(briefing, cell), 0)
                    action = step(briefing, cell, target, legal, moves)
                    cell = neighbour(briefing, cell, ROW_STEP[action], COLUMN_STEP[action])
                assert cell == target


def test_a_step_keeps_to_what_is_legal() -> None:
    legal = filled_row([0, 1, 0, 0, 0], 0)
    for action, lawful in ((FORWARD, FORWARD), (BACKWARD, BACKWARD), (LEFT, LEFT)):
        for index in range(N_ACTIONS):
            legal[index] = int(index == lawful)
        assert step_towards(unwalled(), 5, 7, legal) == action
    assert step_towards(unwalled(), 5, 7, filled_row([0, 1, 1, 1, 1], 0)) == RIGHT

"""A kernel reads and writes by a handle what Python reads and writes in the rows themselves."""

import copy
from typing import NamedTuple

import pytest
from uav_collect.kernels.arrays import new_row, new_table, Row
from uav_collect.kernels.compile import kernel, kernels_are_compiled
from uav_collect.kernels.handle import Handle


class Inner(NamedTuple):
    table: Row[Row[float]]
    size: int


class Rows(NamedTuple):
    factor: float
    inner: Inner
    row: Row[float]


@kernel
def add_up(held: Handle[Rows]) -> float:
    rows = held.rows
    total = rows.factor * rows.inner.size
    for index in range(len(rows.row)):
        rows.row[index] += 1
        total += rows.row[index]
    return total + rows.inner.table[1][2]


def rows_of(kind: type[float] | type[int]) -> Rows:
    return Rows(0.5, Inner(new_table(2, 3, 4.0), 7), new_row(3, kind(1)))


@pytest.fixture(params=['room', 'no room'])
def handle_of(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> type[Handle[Rows]]:
    if request.param == 'no room' and kernels_are_compiled():
        monkeypatch.setattr('uav_collect.kernels.handle_type._FIRST_ROOM_BYTE', 8)
    return Handle


def test_kernel_and_python_share_what_a_handle_holds(handle_of: type[Handle[Rows]]) -> None:
    rows = rows_of(float)
    held = handle_of(rows)
    assert held.rows is rows
    assert add_up(held) == 0.5 * 7 + 3 * 2.0 + 4.0
    rows.row[0], rows.inner.table[1][2] = 10.0, -1.0
    assert add_up(held) == 0.5 * 7 + (11.0 + 3.0 + 3.0) - 1.0
    assert list(rows.row) == [11.0, 3.0, 3.0]


def test_a_copied_handle_holds_the_copied_rows() -> None:
    held = Handle(rows_of(float))
    copied = copy.deepcopy(held)
    assert [add_up(held), add_up(held), add_up(copied)] == [13.5, 16.5, 13.5]


def test_handles_to_numbers_of_another_kind_are_not_mistaken() -> None:
    held = [Handle(rows_of(kind)) for kind in (float, int, float)]
    assert [add_up(each) for each in held] == [13.5] * 3
    assert [list(each.rows.row) for each in held] == [[2, 2, 2]] * 3

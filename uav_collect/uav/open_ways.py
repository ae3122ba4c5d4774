"""Ways over the open cells of an area, for plans that are made before take-off."""

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from uav_collect.kernels.arrays import Ints, Row


class OpenCells:
    """The open cells of an area as the bits of one number, which walks spread over."""

    def __init__(self, n_rows: int, n_columns: int, is_open: Row[int] | Sequence[int]) -> None:
        """Take the cells of an area that are open, by row and then by column, (C,)."""
        self.n_rows, self.n_columns = n_rows, n_columns
        self.is_open = is_open
        self._width = n_columns + 1  # a column of closed cells keeps rows apart
        self._open = self._bits([cell for cell, is_one in enumerate(is_open) if is_one])
        self.has_closed = not all(is_open)

    def reached_from(self, cell: int) -> 'OpenCells':
        """The open cells that moves lead to from one; the others count as closed."""
        reached = {each for bits in self._walk(cell) for each in self._cells(bits)}
        is_open = [int(each in reached) for each in range(len(self.is_open))]
        return OpenCells(self.n_rows, self.n_columns, is_open)

    def place_of(self, cell: int) -> tuple[int, int]:
        """A cell's row and column."""
        return divmod(cell, self.n_columns)

    def column_first(self, cell: int) -> tuple[int, int]:
        """A cell's column and row, by which the western and then the southern ones come first."""
        return cell % self.n_columns, cell // self.n_columns

    def region(self, cell: int) -> list[int]:
        """The open cells that a UAV in a cell sees: itself and those around it."""
        row, column = divmod(cell, self.n_columns)
        cells = [
            each_row * self.n_columns + each_column
            for each_column in range(max(column - 1, 0), min(column + 2, self.n_columns))
            for each_row in range(max(row - 1, 0), min(row + 2, self.n_rows))
        ]
        return [each for each in cells if self.is_open[each]]

    def _bits(self, cells: Sequence[int]) -> int:
        return sum(1 << cell + cell // self.n_columns for cell in cells)

    def _cells(self, bits: int) -> Iterator[int]:
        while bits:
            bit = (bits & -bits).bit_length() - 1
            bits &= bits - 1
            yield bit - bit // self._width

    def _walk(self, cell: int) -> Iterator[int]:
        """The cells that are 0, 1, 2, ... moves away, each lot as bits."""
        newest, rest = self._bits([cell]), self._open
        while newest:
            rest &= ~newest
            yield newest
            around = newest << 1 | newest >> 1 | newest << self._width | newest >> self._width
            newest = around & rest

    def nearest_first(self, cells: Sequence[int], start: int) -> list[int]:
        """The cells, each the nearest to the one before; the first is that to the start.

        Of those as near the western and then the southern one comes first. Cells that no way
        leads to are left out.
        """
        left, order, here = self._bits(cells), list[int](), start
        while left:
            near = next((bits & left for bits in self._walk(here) if bits & left), 0)
            if not near:
                break
            here = min(self._cells(near), key=self.column_first)
            left &= ~self._bits([here])
            order.append(here)
        return order

    def moves(self, cell: int, other: int) -> int:
        """The moves from a cell to another one that can be reached."""
        if self.has_closed:
            wanted = self._bits([other])
            return next(n for n, bits in enumerate(self._walk(cell)) if bits & wanted)
        (row, column), (other_row, other_column) = self.place_of(cell), self.place_of(other)
        return abs(row - other_row) + abs(column - other_column)

    def step(self, cell: int, other: int) -> int:
        """The neighbour by which a shortest way leads to another cell, north or south first."""
        (row, column), (other_row, other_column) = self.place_of(cell), self.place_of(other)
        onwards = self.n_columns if other_row > row else -self.n_columns
        aside = 1 if other_column > column else -1
        if not self.has_closed:
            return cell + (onwards if other_row != row else aside)
        n_moves = self.moves(cell, other)
        around = self._cells(next(islice(self._walk(cell), 1, 2)))
        nearer = [near for near in around if self.moves(near, other) < n_moves]
        order = [cell + step for step in (onwards, -onwards, aside, -aside)]
        return min(nearer, key=order.index)

    def moves_between(self, cells: Sequence[int]) -> Ints:
        """The moves from each cell to each, (N, N); all of them can be reached."""
        rows, columns = np.divmod(np.array(cells, dtype=np.int64), self.n_columns)
        if not self.has_closed:
            distances: Ints = np.abs(rows[:, None] - rows) + np.abs(columns[:, None] - columns)
            return distances
        known = dict.fromkeys(cells)
        number = {cell: index for index, cell in enumerate(known)}
        wanted = self._bits([*known])
        distances = np.zeros((len(known), len(known)), dtype=np.int64)
        for cell in known:
            for n_moves, bits in enumerate(self._walk(cell)):
                for other in self._cells(bits & wanted):
                    distances[number[cell], number[other]] = n_moves
        numbers = [number[cell] for cell in cells]
        return distances[np.ix_(numbers, numbers)]

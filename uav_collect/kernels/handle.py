"""Rows that kernels are handed again and again, taken out of Python's objects once.

numba takes every array of its arguments out of its object at every call. Of a batch of missions,
150 arrays, that took as long as 40 of its decisions.
"""

from typing import Generic, TypeVar

from uav_collect.kernels.compile import kernels_are_compiled

_Rows = TypeVar('_Rows', bound=tuple[object, ...])


class Handle(Generic[_Rows]):
    """Named tuples of arrays and numbers, which a kernel reaches as `rows`.

    What stands in the arrays may change, in Python as well; none can be put in another's place.
    """

    __slots__ = ('_numba_type_', '_taken_out', 'address', 'rows')

    def __init__(self, rows: _Rows) -> None:
        """Take them out, if kernels are compiled."""
        self.rows = rows
        if kernels_are_compiled():
            from uav_collect.kernels.handle_type import taken_out_of

            self._taken_out, self._numba_type_ = taken_out_of(rows)
            self.address = self._taken_out.ctypes.data

    def __reduce__(self) -> tuple[type['Handle[_Rows]'], tuple[_Rows]]:
        """Let a copy hold the copied rows: addresses are of these."""
        return Handle, (self.rows,)

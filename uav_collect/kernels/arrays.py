"""The array types of the package, and the one check of a shape."""

from collections.abc import Iterator
from typing import Any, overload, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_Item = TypeVar('_Item')


class Row(Protocol[_Item]):
    """What a kernel indexes: a 1-D array when compiled, a list when interpreted."""

    def __len__(self) -> int:
        """Number of items."""

    def __iter__(self) -> Iterator[_Item]:
        """The items in order."""

    @overload
    def __getitem__(self, index: int, /) -> _Item: ...

    @overload
    def __getitem__(self, index: slice, /) -> Any: ...  # noqa: ANN401 - another kind of row

    def __setitem__(self, index: int, item: _Item, /) -> None:
        """Replace the item at a position."""


def check_shape(array: NDArray[np.generic], shape: tuple[int, ...], name: str) -> None:
    """Raise ValueError, naming the array and both shapes, unless the shape is as asked."""
    if array.shape != shape:
        raise ValueError(f'{name} must have shape {shape}, got {array.shape}')

"""What a UAV says: to the others over its radio, and to the world as its decision."""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from uav_collect.kernels.arrays import Row

_HEADER_BITS = 232  # sender 8, sequence 32, time and place 64 each; the map adds one for each cell


@dataclass(frozen=True, kw_only=True)
class RadioMessage:
    """What one UAV's radio sends: its map and where it is."""

    sender: int  # index of the UAV
    complete: Row[int]  # (C,), not to be written
    x_m: float
    y_m: float
    time_s: float
    decision: int = 0  # of the sender, that it belongs to


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What a UAV decided."""

    action: int
    reason: int
    sensor: tuple[int, ...] = ()  # whose data a hover collects; empty for any other action
    share_hz: tuple[float, ...] = ()  # bandwidth of each of them


def airtime_s(n_cells: int, rate_bps: float | None) -> float:
    """What it takes to send a message about so many cells [s]; None: no time."""
    return (_HEADER_BITS + n_cells) / rate_bps if rate_bps else 0.0


def packed_map(complete: Row[int]) -> bytes:
    """A completion map, one bit per cell: cell c is bit c % 8 of byte c // 8."""
    bits = np.array(complete, dtype=np.uint8)
    return np.packbits(bits, bitorder='little').tobytes()


def unpacked_map(content: Sequence[int], n_cells: int) -> list[int]:
    """The completion map of `packed_map`, (n_cells,).

    Raises:
        ValueError: there are not as many bytes as that many cells take.
    """
    if len(content) != (n_cells + 7) // 8:
        raise ValueError(f'a map of {len(content)} bytes for {n_cells} cells')
    bits = np.frombuffer(bytes(content), dtype=np.uint8)
    cells: list[int] = np.unpackbits(bits, count=n_cells, bitorder='little').tolist()
    return cells


def packed_maps(complete: Sequence[Row[int]]) -> 'array[int]':
    """Completion maps one after the other, each packed."""
    return array('B', b''.join(packed_map(each) for each in complete))

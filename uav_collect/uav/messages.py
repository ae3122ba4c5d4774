"""What a UAV says: to the others over its radio, and to the world as its decision."""

from dataclasses import dataclass

from uav_collect.kernels.arrays import Row


@dataclass(frozen=True, kw_only=True)
class RadioMessage:
    """What one UAV's radio sends: its map and where it is."""

    sender: int  # index of the UAV
    complete: Row[int]  # (C,), not to be written
    x_m: float
    y_m: float
    time_s: float


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What a UAV decided."""

    action: int
    reason: int
    sensor: tuple[int, ...] = ()  # whose data a hover collects; empty for any other action
    share_hz: tuple[float, ...] = ()  # bandwidth of each of them

"""Fields drawn by hand, for tests of what is proposed for them."""

from collections.abc import Sequence

import numpy as np
from uav_collect.fields.ground import Ground
from uav_collect.fields.proposal import Proposal, propose
from uav_collect.fields.settings import usual_settings, Wishes
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Point, Polygon


def ground(
    *places_m: Point,
    edge_m: Polygon | None = None,
    widen_m: float = 0.0,
    no_fly_m: Sequence[Polygon] = (),
    base_m: Point | None = None,
    data_mbit: Sequence[float | None] | None = None,
    origin_deg: Point | None = None,
) -> Ground:
    """A field with sensors S1, S2, ... at places [m]."""
    return Ground(
        sensor_ids=tuple(f'S{number}' for number in range(1, len(places_m) + 1)),
        sensor_where=tuple(f'list.csv:{row}' for row in range(2, len(places_m) + 2)),
        position_m=np.array(places_m),
        data_mbit=tuple(data_mbit or [None] * len(places_m)),
        edge_m=edge_m,
        widen_m=widen_m,
        no_fly_m=tuple(no_fly_m),
        base_m=base_m,
        origin_deg=origin_deg,
        crs=None,
    )


def square(west_m: float, south_m: float, side_m: float) -> Polygon:
    """A square by its south-west corner and its side."""
    east_m, north_m = west_m + side_m, south_m + side_m
    return ((west_m, south_m), (east_m, south_m), (east_m, north_m), (west_m, north_m))


def proposed(field: Ground, n_uavs: int = 2, **wishes: object) -> Proposal:
    """What is proposed for a field with the usual settings."""
    settings = usual_settings()
    asked = Wishes(n_uavs=n_uavs, **wishes)  # type: ignore[arg-type]
    return propose(field, asked, settings, load(settings.base))

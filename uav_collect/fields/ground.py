"""What lies where in a field: sensors, its edge, zones that nobody flies over, the base."""

from dataclasses import dataclass
from functools import cached_property

from uav_collect.fields.outlines import widened
from uav_collect.kernels.arrays import Floats
from uav_collect.scenario.model import Point, Polygon


@dataclass(frozen=True, kw_only=True)
class Ground:
    """A field in the plane that touches the Earth at its origin, or that its list counts in."""

    sensor_ids: tuple[str, ...]  # (S,)
    sensor_where: tuple[str, ...]  # (S,) the row of each, as a message begins
    position_m: Floats  # (S, 2) east and north of the origin
    data_mbit: tuple[float | None, ...]  # (S,) None where the list does not say it
    edge_m: Polygon | None  # of the field; None: there is none
    widen_m: float  # how far beyond the edge UAVs may fly
    no_fly_m: tuple[Polygon, ...]
    base_m: Point | None  # where UAVs are to start; None: wherever is near
    origin_deg: Point | None  # latitude and longitude of the origin, if they are known
    crs: str | None  # the grid that the list is of, if it is of one

    @cached_property
    def boundary_m(self) -> Polygon | None:
        """What nobody flies beyond; None: wherever cells are."""
        if self.edge_m is None or self.widen_m == 0:
            return self.edge_m
        return widened(self.edge_m, self.widen_m)

    @property
    def extent_m(self) -> tuple[Point, Point]:
        """South-west and north-east corner of all that cells must cover."""
        places = [*self.position_m.tolist(), *(self.edge_m or ())]
        if self.base_m is not None:
            places.append(self.base_m)
        easts, norths = zip(*places, strict=True)
        return (min(easts), min(norths)), (max(easts), max(norths))

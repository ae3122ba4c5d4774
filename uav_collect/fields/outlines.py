"""The edges of polygons: made wider, and how far from them things are."""

from collections.abc import Iterator, Sequence
import math

from uav_collect.scenario.model import Point, Polygon

_SHARP = 0.5  # 1 + cosine of the turn at a corner, below which it is cut off


def widened(polygon: Polygon, by_m: float) -> Polygon:
    """The polygon with each edge moved outwards [m]; corners stay sharp unless they are too sharp.

    Where a notch is narrower than twice that, its edges cross: what lies between them may be out.
    """
    corners = [here for here, after in _pairs(polygon) if here != after]
    turns = sum(x * v - u * y for (x, y), (u, v) in _pairs(corners))
    outwards = 1.0 if turns > 0 else -1.0  # corners may run either way round
    normals = []
    for (x, y), (u, v) in _pairs(corners):
        length_m = math.hypot(u - x, v - y)
        normals.append((outwards * (v - y) / length_m, outwards * (x - u) / length_m))
    moved: list[Point] = []
    for (x, y), before, after in zip(corners, [normals[-1], *normals], normals, strict=False):
        alignment = 1.0 + before[0] * after[0] + before[1] * after[1]
        if alignment < _SHARP:
            moved += [(x + by_m * side[0], y + by_m * side[1]) for side in (before, after)]
            continue
        east, north = (one + other for one, other in zip(before, after, strict=True))
        moved.append((x + by_m * east / alignment, y + by_m * north / alignment))
    return tuple(moved)


def distance_m(place_m: Point, polygon: Polygon) -> float:
    """From a place to the nearest edge of a polygon [m]."""
    return min(_to_edge_m(place_m, *edge) for edge in _pairs(polygon))


def lies_in(place_m: Point, polygon: Polygon) -> bool:
    """Whether a place lies within a polygon, whichever way round that runs."""
    x_m, y_m = place_m
    is_in = False
    for (ax_m, ay_m), (bx_m, by_m) in _pairs(polygon):
        if (ay_m > y_m) != (by_m > y_m):  # a ray to the east crosses each edge with one end above
            is_in ^= x_m < ax_m + (y_m - ay_m) / (by_m - ay_m) * (bx_m - ax_m)
    return is_in


def _to_edge_m(place_m: Point, start_m: Point, end_m: Point) -> float:
    east_m, north_m = end_m[0] - start_m[0], end_m[1] - start_m[1]
    x_m, y_m = place_m[0] - start_m[0], place_m[1] - start_m[1]
    length_m2 = east_m * east_m + north_m * north_m
    share = (x_m * east_m + y_m * north_m) / length_m2 if length_m2 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(x_m - share * east_m, y_m - share * north_m)


def _pairs(corners: Sequence[Point]) -> Iterator[tuple[Point, Point]]:
    """Each corner with the next one, the last with the first."""
    return zip(corners, [*corners[1:], corners[0]], strict=True)

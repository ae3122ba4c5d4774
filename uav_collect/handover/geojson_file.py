"""A mission as GeoJSON: stretches and stays with times, sensors with who read them, outlines.

Source: RFC 7946. Its heights are those over the ellipsoid, which nobody knows here, so places have
none; `altitude_m` is over ground.
"""

from collections.abc import Iterator, Sequence
import json
import math

from uav_collect.analysis.legs import HOVER_LEG
from uav_collect.handover.date_line import line_parts, ring_parts
from uav_collect.handover.flights import MissionFlights, UavFlight
from uav_collect.handover.outlines import outlines
from uav_collect.scenario.model import Point

Feature = dict[str, object]


def geojson_file(mission: MissionFlights) -> bytes:
    """The mission as a collection of features, each of a `kind`.

    Raises:
        ConfigError: it is not known where on Earth the area lies.
    """
    document = {'type': 'FeatureCollection', 'features': [*_features(mission)]}
    return (json.dumps(document, indent=1, allow_nan=False) + '\n').encode()


def _features(mission: MissionFlights) -> Iterator[Feature]:
    for outline in outlines(mission):
        rings = [[ring] for ring in ring_parts(outline.ring_deg)]
        yield _feature(*_one_or_many('Polygon', rings), {'kind': outline.name})
    yield from _sensors(mission)
    for flight in mission.flights:
        yield from _flight(mission, flight)


def _sensors(mission: MissionFlights) -> Iterator[Feature]:
    reading_of = {reading.sensor: reading for reading in mission.readings}
    for sensor, name in enumerate(mission.site.sensor_ids):
        properties: dict[str, object] = {
            'kind': 'sensor',
            'sensor': name,
            'data_mbit': float(mission.demand_bit[sensor] / 1e6),
        }
        if (reading := reading_of.get(sensor)) is not None:
            properties |= {
                'uav': reading.uav,
                **_times(mission, reading.start_s, reading.end_s),
                'rate_bps': _known(reading.rate_bps),
                'bandwidth_hz': _known(reading.bandwidth_hz),
            }
        place_m = tuple(mission.site.position_m[sensor].tolist())
        yield _feature('Point', _place(mission, place_m), properties)


def _flight(mission: MissionFlights, flight: UavFlight) -> Iterator[Feature]:
    for stretch in flight.stretches:
        properties = {
            'kind': stretch.kind,
            'uav': stretch.uav,
            'altitude_m': mission.altitude_m,
            **_times(mission, stretch.start_s, stretch.end_s),
            'energy_left_j': stretch.energy_left_j,
            'energy_j': stretch.energy_j,
        }
        start = _place(mission, stretch.start_m)
        if stretch.kind == HOVER_LEG:
            yield _feature('Point', start, properties)
        else:
            lines = line_parts([start, _place(mission, stretch.end_m)])
            yield _feature(*_one_or_many('LineString', lines), properties)


def _times(mission: MissionFlights, start_s: float, end_s: float) -> dict[str, object]:
    return {
        'start_s': start_s,
        'end_s': end_s,
        'start': mission.clock(start_s),
        'end': mission.clock(end_s),
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _place(mission: MissionFlights, place_m: Point) -> tuple[float, float]:
    lat_deg, lon_deg = mission.lat_lon_deg(place_m)
    return lon_deg, lat_deg


def _one_or_many(kind: str, parts: Sequence[object]) -> tuple[str, object]:
    """Kind and coordinates of a geometry in one part, or in several."""
    return (kind, parts[0]) if len(parts) == 1 else (f'Multi{kind}', parts)


def _feature(kind: str, coordinates: object, properties: dict[str, object]) -> Feature:
    return {
        'type': 'Feature',
        'geometry': {'type': kind, 'coordinates': coordinates},
        'properties': properties,
    }

"""A mission for Google Earth and its like: flights that move by a time slider, stays, sensors.

Source: OGC KML 2.2 (07-147r2), and Google's extension of it for tracks. Heights are over
ground.
"""

from collections.abc import Iterable, Iterator, Sequence
from html import escape

from uav_collect.analysis.legs import FlownLeg, HOVER_LEG
from uav_collect.errors import in_one_line
from uav_collect.handover.date_line import Degrees, line_parts, Part, ring_parts
from uav_collect.handover.flights import MissionFlights, UavFlight
from uav_collect.handover.outlines import AREA, outlines
from uav_collect.scenario.model import Point

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>',
    '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">',
    '<Document>',
)
# Of Okabe and Ito, as alpha, blue, green, red.
_COLOURS = ('ffb27200', 'ff005ed5', 'ffa779cc', 'ffe9b456', 'ff009fe6', 'ff739e00')

_CLOSED = '990000ff'  # a red that lets the ground through


def kml_file(mission: MissionFlights) -> bytes:
    """The mission as KML: a folder of sensors, a folder for each UAV, the outlines of the area.

    Raises:
        ConfigError: it is not known where on Earth the area lies.
    """
    return '\n'.join([*_HEAD, *_lines(mission), '</Document>', '</kml>', '']).encode()


def _lines(mission: MissionFlights) -> Iterator[str]:
    yield f'<name>{_text(mission.name)}</name>'
    for index, colour in enumerate(_COLOURS):
        yield f'<Style id="uav_{index}"><IconStyle><color>{colour}</color></IconStyle>'
        yield f'<LineStyle><color>{colour}</color><width>3</width></LineStyle></Style>'
    yield f'<Style id="{AREA}"><PolyStyle><fill>0</fill></PolyStyle></Style>'
    yield f'<Style id="closed"><PolyStyle><color>{_CLOSED}</color></PolyStyle></Style>'
    yield '<Folder><name>area</name>'
    for outline in outlines(mission):
        style = AREA if outline.name == AREA else 'closed'
        yield f'<Placemark><name>{_text(outline.name)}</name><styleUrl>#{style}</styleUrl>'
        yield _one_or_many(map(_polygon, ring_parts(outline.ring_deg)))
        yield '</Placemark>'
    yield '</Folder><Folder><name>sensors</name>'
    yield from _sensors(mission)
    yield '</Folder>'
    for flight in mission.flights:
        yield f'<Folder><name>UAV {flight.uav}</name>'
        yield from _track(mission, flight)
        for stretch in flight.stretches:
            yield from _stretch(mission, stretch)
        yield '</Folder>'


def _sensors(mission: MissionFlights) -> Iterator[str]:
    reading_of = {reading.sensor: reading for reading in mission.readings}
    for sensor, name in enumerate(mission.site.sensor_ids):
        reading, data_mbit = reading_of.get(sensor), mission.demand_bit[sensor] / 1e6
        about = [f'{data_mbit:.3f} Mbit']
        span = ''
        if reading is not None:
            about += [
                f'read by UAV {reading.uav}',
                f'{reading.start_s:.1f}..{reading.end_s:.1f} s',
            ]
            span = _span(mission, reading.start_s, reading.end_s)
        place_m = tuple(mission.site.position_m[sensor].tolist())
        yield f'<Placemark><name>{_text(name)}</name><description>{_text(", ".join(about))}'
        yield f'</description>{span}<Point><coordinates>'
        yield f'{_coordinates([_place(mission, place_m)], 0.0)}</coordinates></Point></Placemark>'


def _track(mission: MissionFlights, flight: UavFlight) -> Iterator[str]:
    """The whole flight, which moves as time passes."""
    states = [(flight.stretches[0].start_s, flight.take_off_m)]
    states += [(stretch.end_s, stretch.end_m) for stretch in flight.stretches]
    yield f'<Placemark><name>UAV {flight.uav}</name><styleUrl>{_style(flight.uav)}</styleUrl>'
    yield '<gx:Track><altitudeMode>relativeToGround</altitudeMode>'
    for time_s, _ in states:
        yield f'<when>{mission.clock(time_s)}</when>'
    for _, place_m in states:
        place = _coordinates([_place(mission, place_m)], mission.altitude_m)
        yield f'<gx:coord>{place.replace(",", " ")}</gx:coord>'
    yield '</gx:Track></Placemark>'


def _stretch(mission: MissionFlights, stretch: FlownLeg) -> Iterator[str]:
    """A stretch or a stay, there while it lasts."""
    yield f'<Placemark><name>{stretch.kind}</name>{_span(mission, stretch.start_s, stretch.end_s)}'
    yield f'<styleUrl>{_style(stretch.uav)}</styleUrl>'
    start, kind = _place(mission, stretch.start_m), 'Point'
    parts: tuple[Part, ...] = ((start,),)
    if stretch.kind != HOVER_LEG:
        parts, kind = line_parts([start, _place(mission, stretch.end_m)]), 'LineString'
    yield _one_or_many(
        f'<{kind}><altitudeMode>relativeToGround</altitudeMode>'
        f'<coordinates>{_coordinates(part, mission.altitude_m)}</coordinates></{kind}>'
        for part in parts
    )
    yield '</Placemark>'


def _span(mission: MissionFlights, start_s: float, end_s: float) -> str:
    begin, end = mission.clock(start_s), mission.clock(end_s)
    return f'<TimeSpan><begin>{begin}</begin><end>{end}</end></TimeSpan>'


def _polygon(ring: Part) -> str:
    corners = _coordinates(ring, 0.0)
    around = f'<LinearRing><coordinates>{corners}</coordinates></LinearRing>'
    return f'<Polygon><outerBoundaryIs>{around}</outerBoundaryIs></Polygon>'


def _one_or_many(parts: Iterable[str]) -> str:
    """A geometry in one part, or in several: what crosses the 180th meridian is cut there."""
    geometries = [*parts]
    whole = ''.join(geometries)
    return whole if len(geometries) == 1 else f'<MultiGeometry>{whole}</MultiGeometry>'


def _coordinates(places: Sequence[Degrees], altitude_m: float) -> str:
    """Places as KML writes them, to a millimetre."""
    return ' '.join(f'{lon_deg:.8f},{lat_deg:.8f},{altitude_m:g}' for lon_deg, lat_deg in places)


def _place(mission: MissionFlights, place_m: Point) -> Degrees:
    lat_deg, lon_deg = mission.lat_lon_deg(place_m)
    return lon_deg, lat_deg


def _style(uav: int) -> str:
    return f'#uav_{(uav - 1) % len(_COLOURS)}'


def _text(name: str) -> str:
    """What users wrote, as XML may hold it."""
    return escape(in_one_line(name))

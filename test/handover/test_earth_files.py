"""Missions on maps of the Earth, read back by GDAL and by a reader of XML."""

from collections.abc import Callable
from dataclasses import replace
from itertools import chain, pairwise
import json
from pathlib import Path

from defusedxml import ElementTree
from handed_on import flown_on_earth, handed_on, lengths_m, REFERENCE
import pyogrio
import pytest
from tiny_world import fly_scripts, tiny, uav
from uav_collect.errors import ConfigError
from uav_collect.handover.flights import MissionFlights
from uav_collect.handover.geojson_file import geojson_file
from uav_collect.handover.kml_file import kml_file
from uav_collect.handover.mission_items import plan_file
from uav_collect.uav.action_codes import FORWARD, HOVER, RIGHT

KML = '{http://www.opengis.net/kml/2.2}'
GX = '{http://www.google.com/kml/ext/2.2}'
# What a Placemark may hold, in the order of OGC's schema.
ORDER = ('name', 'description', 'TimeSpan', 'styleUrl', 'Point', 'LineString', 'Polygon', 'Track')
# 100 m wide in the south, 200 m in the north.
ELL_M = [[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [200.0, 100.0], [200.0, 200.0], [0.0, 200.0]]
HOSTILE = '<b>&amp;"\'</name>]]>'


@pytest.fixture(scope='module')
def mission() -> MissionFlights:
    return flown_on_earth()[0]


@pytest.fixture(scope='module')
def ell() -> MissionFlights:
    """An L that is wide in the north; a zone closes the cell east of the start."""
    zone_m = [[60.0, 10.0], [60.0, 20.0], [70.0, 20.0], [70.0, 10.0]]  # clockwise
    scenario = tiny(
        uav(5.0), area__reference=REFERENCE, area__boundary=ELL_M, area__no_fly=[zone_m],
        sensors=[(25.0, 75.0, 1.0)],
    )  # fmt: skip
    return handed_on(scenario, fly_scripts(scenario, [FORWARD, HOVER]))


def coordinates(text: str) -> list[tuple[float, ...]]:
    return [tuple(map(float, place.split(','))) for place in text.split()]


# KML


def test_gdal_reads_sensors_and_flights_of_kml(mission: MissionFlights, tmp_path: Path) -> None:
    file = tmp_path / 'one.kml'
    file.write_bytes(kml_file(mission))
    layers = [name for name, _ in pyogrio.list_layers(file)]
    assert layers == ['area', 'sensors', 'UAV 1', 'UAV 2']
    for folder, n_placemarks in (('UAV 1', 5), ('UAV 2', 5)):  # the track, stretches, stays
        _, _, geometries, fields = pyogrio.raw.read(file, layer=folder)
        assert len(geometries) == n_placemarks
        begins = fields[list(pyogrio.read_info(file, layer=folder)['fields']).index('begin')]
        assert sorted(str(begin) for begin in begins)[0].startswith('2026-06-01T08:00:00')
    info = pyogrio.read_info(file, layer='sensors')
    assert info['features'] == 3
    west_deg, south_deg, east_deg, north_deg = info['total_bounds']
    assert (south_deg, west_deg) == pytest.approx(mission.lat_lon_deg((75.0, 25.0)), abs=1e-8)
    assert (north_deg, east_deg) == pytest.approx(mission.lat_lon_deg((125.0, 125.0)), abs=1e-8)


def test_placemarks_of_kml_hold_their_elements_in_the_order_of_the_schema(
    mission: MissionFlights,
) -> None:
    root = ElementTree.fromstring(kml_file(mission))
    placemarks = root.findall(f'.//{KML}Placemark')
    assert len(placemarks) == 1 + 3 + 5 + 5
    for placemark in placemarks:
        names = [child.tag.rpartition('}')[2] for child in placemark]
        assert names == sorted(names, key=ORDER.index)
    for style in root.iter(f'{KML}Style'):
        parts = [part.tag.removeprefix(KML) for part in style]
        assert parts == [it for it in ('IconStyle', 'LineStyle', 'PolyStyle') if it in parts]
    styles = {f'#{style.get("id")}' for style in root.iter(f'{KML}Style')}
    assert {url.text for url in root.iter(f'{KML}styleUrl')} <= styles


def test_a_track_of_kml_is_the_flight_in_time(mission: MissionFlights) -> None:
    tracks = [*ElementTree.fromstring(kml_file(mission)).iter(f'{GX}Track')]
    for track, flight in zip(tracks, mission.flights, strict=True):
        whens = [when.text for when in track.findall(f'{KML}when')]
        places = [tuple(map(float, it.text.split())) for it in track.findall(f'{GX}coord')]
        assert len(whens) == len(places) == len(flight.stretches) + 1
        assert whens == sorted(whens)
        assert whens[0] == '2026-06-01T08:00:00.000Z'
        assert whens[-1] == mission.clock(flight.stretches[-1].end_s)
        flown_m = [stretch.length_m for stretch in flight.stretches]
        assert lengths_m([place[:2] for place in places]) == pytest.approx(flown_m, abs=0.01)
        assert {place[2] for place in places} == {mission.altitude_m}


def test_runs_of_kml_follow_each_other(mission: MissionFlights) -> None:
    folder = ElementTree.fromstring(kml_file(mission)).findall(f'.//{KML}Folder')[-1]
    ends = [
        (span.findtext(f'{KML}begin'), span.findtext(f'{KML}end'))
        for span in folder.iter(f'{KML}TimeSpan')
    ]
    assert len(ends) == 4
    assert all(end == begin for (_, end), (begin, _) in pairwise(ends))
    lines = [line.findtext(f'{KML}coordinates') for line in folder.iter(f'{KML}LineString')]
    assert all(len(coordinates(line)) == 2 for line in lines)


@pytest.mark.parametrize('lon_deg', [179.9995, -179.9999])
def test_kml_is_cut_at_the_180th_meridian_as_geojson_is(lon_deg: float) -> None:
    reference = {**REFERENCE, 'lon_deg': lon_deg}
    scenario = tiny(uav(5.0), area__reference=reference, sensors=[(25.0, 75.0, 1.0)])
    mission = handed_on(scenario, fly_scripts(scenario, [FORWARD, HOVER, RIGHT, RIGHT, RIGHT]))
    root = ElementTree.fromstring(kml_file(mission))
    parts_of = {
        kind: [
            coordinates(it.text or '') for it in root.iterfind(f'.//{KML}{kind}//{KML}coordinates')
        ]
        for kind in ('Polygon', 'LineString')
    }
    assert len(root.findall(f'.//{KML}MultiGeometry')) == 3  # the area, a move, the way home
    for parts in parts_of.values():
        for part in parts:
            lons_deg = [place[0] for place in part]
            assert max(lons_deg) - min(lons_deg) < 1.0
    features = json.loads(geojson_file(mission))['features']
    [area] = [it for it in features if it['properties']['kind'] == 'area']
    rings = [ring for [ring] in area['geometry']['coordinates']]
    for part, ring in zip(parts_of['Polygon'], rings, strict=True):
        assert [*chain(*(place[:2] for place in part))] == pytest.approx([*chain(*ring)], abs=1e-8)


def test_all_places_of_kml_have_eight_digits(ell: MissionFlights) -> None:
    for it in ElementTree.fromstring(kml_file(ell)).iter(f'{KML}coordinates'):
        for place in (it.text or '').split():
            assert [len(part.partition('.')[2]) for part in place.split(',')[:2]] == [8, 8]


# GeoJSON


def test_gdal_reads_geojson(mission: MissionFlights, tmp_path: Path) -> None:
    file = tmp_path / 'one.geojson'
    file.write_bytes(geojson_file(mission))
    info = pyogrio.read_info(file)
    assert info['crs'] == 'EPSG:4326'
    assert info['features'] == 1 + 3 + 4 + 4


def test_features_of_geojson_are_as_flown(mission: MissionFlights) -> None:
    features = json.loads(geojson_file(mission))['features']
    flown = [it for it in features if it['properties']['kind'] in ('move', 'hover', 'home')]
    stretches = [stretch for flight in mission.flights for stretch in flight.stretches]
    for feature, stretch in zip(flown, stretches, strict=True):
        properties, geometry = feature['properties'], feature['geometry']
        assert (properties['uav'], properties['kind']) == (stretch.uav, stretch.kind)
        assert (properties['start_s'], properties['end_s']) == (stretch.start_s, stretch.end_s)
        assert properties['start'] == mission.clock(stretch.start_s)
        is_hover = stretch.kind == 'hover'
        assert geometry['type'] == ('Point' if is_hover else 'LineString')
        way = [] if is_hover else lengths_m(geometry['coordinates'])
        assert sum(way) == pytest.approx(stretch.length_m, abs=0.01)
    assert {it.kind for it in stretches} == {'move', 'hover', 'home'}


def test_rings_of_geojson_are_closed_and_counter_clockwise(mission: MissionFlights) -> None:
    features = json.loads(geojson_file(mission))['features']
    polygons = [it['geometry'] for it in features if it['geometry']['type'] == 'Polygon']
    [[ring]] = [polygon['coordinates'] for polygon in polygons]
    assert ring[0] == ring[-1]
    assert sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring)) > 0.0
    assert lengths_m(ring) == pytest.approx([200.0] * 4, abs=0.01)


def test_sensors_of_geojson_say_who_read_them(mission: MissionFlights) -> None:
    features = json.loads(geojson_file(mission))['features']
    sensors = [it['properties'] for it in features if it['properties']['kind'] == 'sensor']
    assert [(it['sensor'], it['uav'], it['data_mbit']) for it in sensors] == [
        ('S1', 1, 1.0), ('S2', 2, 0.5), ('S3', 2, 0.25),
    ]  # fmt: skip
    for sensor in sensors:
        read_s = sensor['end_s'] - sensor['start_s']
        assert sensor['rate_bps'] * read_s == pytest.approx(sensor['data_mbit'] * 1e6)


def test_outlines_are_the_boundary_and_the_zones_of_the_scenario(ell: MissionFlights) -> None:
    features = json.loads(geojson_file(ell))['features']
    rings = {
        it['properties']['kind']: it['geometry']['coordinates'][0]
        for it in features
        if it['geometry']['type'] == 'Polygon'
    }
    assert len(rings['area']) == len(ELL_M) + 1
    sides_m = [100.0, 100.0, 100.0, 100.0, 200.0, 200.0]
    assert lengths_m(rings['area']) == pytest.approx(sides_m, abs=0.01)
    assert lengths_m(rings['no-fly zone']) == pytest.approx([10.0] * 4, abs=0.01)
    for ring in rings.values():
        assert ring[0] == ring[-1]
        assert sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring)) > 0.0
    polygons = [*ElementTree.fromstring(kml_file(ell)).iter(f'{KML}Polygon')]
    assert len(polygons) == 2


def test_a_ground_station_fences_no_fly_zones_off(ell: MissionFlights) -> None:
    [fence] = json.loads(plan_file(ell, ell.flights[0]))['geoFence']['polygons']
    assert (fence['inclusion'], fence['version'], len(fence['polygon'])) == (False, 1, 4)
    west_south = ell.lat_lon_deg((60.0, 10.0))
    assert [*west_south] in fence['polygon']


# Both


def test_names_are_no_markup() -> None:
    mission, _ = flown_on_earth()
    named = replace(mission, site=replace(mission.site, sensor_ids=(HOSTILE, 'S2', 'S3')))
    names = [it.text for it in ElementTree.fromstring(kml_file(named)).iter(f'{KML}name')]
    assert HOSTILE in names
    features = json.loads(geojson_file(named))['features']
    assert HOSTILE in [it['properties'].get('sensor') for it in features]


@pytest.mark.parametrize('write', [kml_file, geojson_file])
def test_without_a_place_on_earth_what_to_add_is_said(
    write: Callable[[MissionFlights], bytes],
) -> None:
    scenario = tiny()
    mission = handed_on(scenario, fly_scripts(scenario, [RIGHT, HOVER], []))
    with pytest.raises(ConfigError, match=r'tiny: area\.reference is missing: must be \{lat_deg'):
        write(mission)

"""Maps of the Earth, held against the schema of OGC and the rules of RFC 7946."""

from collections.abc import Callable
from importlib.resources import as_file, files
import json

import geojson
from handed_on import flown_on_earth, handed_on, REFERENCE
from lxml import etree
import pytest
from tiny_world import fly_scripts, tiny, uav
from uav_collect.handover.flights import MissionFlights
from uav_collect.handover.geojson_file import geojson_file
from uav_collect.handover.kml_file import kml_file
from uav_collect.uav.action_codes import FORWARD, HOVER, RIGHT


def across_the_date_line() -> MissionFlights:
    zone_m = [[60.0, 110.0], [90.0, 110.0], [90.0, 120.0]]
    reference = {**REFERENCE, 'lon_deg': 179.9995}
    scenario = tiny(
        uav(5.0), area__reference=reference, area__no_fly=[zone_m], sensors=[(25.0, 75.0, 1.0)]
    )
    return handed_on(scenario, fly_scripts(scenario, [FORWARD, HOVER, RIGHT, RIGHT]))


@pytest.fixture(scope='module')
def schema() -> etree.XMLSchema:
    """KML 2.2 of OGC with Google's extension, as fastkml brings it along; nothing is fetched."""
    with as_file(files('fastkml') / 'schema') as folder:
        parser = etree.XMLParser(no_network=True)
        return etree.XMLSchema(etree.parse(folder / 'kml22gx.xsd', parser))


MISSIONS = pytest.mark.parametrize('make', [lambda: flown_on_earth()[0], across_the_date_line])


@MISSIONS
def test_kml_is_valid(schema: etree.XMLSchema, make: Callable[[], MissionFlights]) -> None:
    schema.assertValid(etree.fromstring(kml_file(make())))


def test_the_schema_refuses_what_it_does_not_know(schema: etree.XMLSchema) -> None:
    content = kml_file(across_the_date_line())
    for good, bad in ((b'MultiGeometry', b'Geometries'), (b'<begin>2026', b'<begin>once 2026')):
        assert content.count(good) > 0
        assert not schema.validate(etree.fromstring(content.replace(good, bad)))


@MISSIONS
def test_geojson_is_valid(make: Callable[[], MissionFlights]) -> None:
    content = geojson_file(make())
    assert geojson.loads(content).is_valid
    broken = json.loads(content)
    polygon = next(it for it in broken['features'] if 'Polygon' in it['geometry']['type'])
    ring = polygon['geometry']['coordinates'][0]
    (ring[0] if polygon['geometry']['type'] == 'MultiPolygon' else ring).pop()
    assert not geojson.loads(json.dumps(broken)).is_valid

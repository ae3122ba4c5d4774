"""Lists of loggers as people publish them, of many kinds; all coordinates are made up."""

from collections.abc import Callable
from io import BytesIO
import json
from pathlib import Path
import zipfile

from openpyxl import Workbook
from uav_collect.scenario.earth import lat_lon_deg
from uav_collect.scenario.places import Places, read, ReadOptions


def _places(lat_deg: float, lon_deg: float, n: int, gap_m: float) -> list[tuple[float, float]]:
    """Latitudes and longitudes of loggers in rows of five, every other row shifted."""
    return [
        lat_lon_deg(
            gap_m * (number % 5) + 0.3 * gap_m * (number // 5 % 2),
            gap_m * (number // 5),
            origin_lat_deg=lat_deg,
            origin_lon_deg=lon_deg,
        )
        for number in range(n)
    ]


def _vineyard() -> str:
    rows = [
        f'V{n},{lat:.6f},{lon:.6f}' for n, (lat, lon) in enumerate(_places(44.8, -0.6, 12, 60))
    ]
    return '\n'.join(['sensor_id,lat,lon', *rows])


def _stations() -> str:
    rows = [
        f'Prüfstelle {n};{lat:.5f};{lon:.5f};{300 + n},5'.replace('.', ',')
        for n, (lat, lon) in enumerate(_places(47.4, 8.5, 8, 250))
    ]
    return '\n'.join(['Station;Breite;Länge;Höhe', *rows])


def _traps() -> str:
    rows = [
        f'T{n}\t{lon:.5f}\t{lat:.5f}\t2025-04-{n + 1:02d}'
        for n, (lat, lon) in enumerate(_places(8.4, -83.3, 10, 400))
    ]
    return '\n'.join(['deployment_id\tlongitude\tlatitude\tstart', *rows])


def _turbines() -> str:
    rows = [f'WT{n:02d},{361000 + 350 * (n % 4)},{6154000 + 400 * (n // 4)}' for n in range(12)]
    return '\n'.join(['turbine,easting_m,northing_m', *rows])


def _pipeline() -> str:
    rows = [f'km{n / 5:.1f},{200 * n},{2460 + 80 * (n % 2)}' for n in range(16)]
    return '\n'.join(['sensor_id,x_m,y_m', *rows])


def _wells() -> str:
    places = [f'W{n}|{530000 + 90 * n}|{180000 + 40 * (n % 3)}' for n in range(9)]
    return '\n'.join(['Site|Easting|Northing', *places])


def _readings() -> str:
    rows = [
        f'{n},{lat:.6f},{lon:.6f},{0.5 + 0.25 * n}'
        for n, (lat, lon) in enumerate(_places(46.78, -117.09, 15, 90))
    ]
    return '\n'.join(['logger_id,lat,lon,data_mbit', *rows])


def _redeployed() -> str:
    rows = [f'D{n},S{n // 2},{-83.34 + n // 2 * 0.002:.4f},8.4071' for n in range(8)]
    return '\n'.join(['deployment_id,place,longitude,latitude', *rows, 'D8,S9,,'])


def _minutes() -> str:
    rows = [f'B{n},"51° {10 + n}\' N","4° 0{n % 2}\' E"' for n in range(3)]
    return '\n'.join(['buoy,latitude,longitude', *rows])


def _zones() -> str:
    rows = [f'G{n},33N,{361000 + 120 * n},{6154000 + 90 * (n % 3)}' for n in range(9)]
    return '\n'.join(['gauge_id,utm_zone,easting,northing', *rows])


def _map() -> str:
    """An L of loggers within a polygon, and a mast between them."""
    rows = [it for it in enumerate(_places(50.1, 8.5, 25, 110)) if it[0] % 5 < 3 or it[0] < 15]
    loggers = [_feature(f'P{number}', 'Point', [lon, lat]) for number, (lat, lon) in rows]
    edge = [(-60, -60), (530, -60), (530, 280), (310, 280), (310, 500), (-60, 500)]  # [m]
    mast = [(162, 155), (182, 155), (182, 175), (162, 175)]
    features = [
        *loggers,
        _feature('field', 'Polygon', [_ring(50.1, 8.5, edge)]),
        _feature('no-fly mast', 'Polygon', [_ring(50.1, 8.5, mast)]),
    ]
    return json.dumps({'type': 'FeatureCollection', 'features': features})


def _ring(lat_deg: float, lon_deg: float, corners_m: list[tuple[int, int]]) -> list[list[float]]:
    places = [
        lat_lon_deg(x, y, origin_lat_deg=lat_deg, origin_lon_deg=lon_deg) for x, y in corners_m
    ]
    return [[lon, lat] for lat, lon in [*places, places[0]]]


def _feature(name: str, kind: str, coordinates: object) -> dict[str, object]:
    geometry = {'type': kind, 'coordinates': coordinates}
    return {'type': 'Feature', 'properties': {'name': name}, 'geometry': geometry}


def _earth() -> str:
    marks = [
        f'<Placemark><name>K{n}</name><Point><coordinates>{lon:.6f},{lat:.6f},0</coordinates>'
        '</Point></Placemark>'
        for n, (lat, lon) in enumerate(_places(-33.9, 18.4, 11, 130))
    ]
    return (
        '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2">'
        f'<Document>{"".join(marks)}</Document></kml>'
    )


def _workbook() -> bytes:
    book, file = Workbook(), BytesIO()
    sheet = book.active
    sheet.append(['Logger', 'Latitude', 'Longitude', 'Depth [m]'])
    for number, (lat, lon) in enumerate(_places(59.3, 18.1, 7, 170)):
        sheet.append([f'L{number}', lat, lon, 0.5 * number])
    book.save(file)
    return file.getvalue()


# By the file's name: its text, and the options without which it says too little.
LISTS: dict[str, tuple[Callable[[], str | bytes], tuple[str, ...]]] = {
    'vineyard.csv': (_vineyard, ()),
    'stations.csv': (_stations, ()),
    'traps.tsv': (_traps, ()),
    'turbines.csv': (_turbines, ()),
    'pipeline.csv': (_pipeline, ()),
    'wells.txt': (_wells, ('--crs', 'EPSG:27700')),
    'readings.csv': (_readings, ()),
    'redeployed.csv': (_redeployed, ('--doubles', 'first', '--blanks', 'skip')),
    'buoys.csv': (_minutes, ()),
    'gauges.csv': (_zones, ()),
    'silos.xlsx': (_workbook, ()),
    'map.geojson': (_map, ()),
    'earth.kml': (_earth, ()),
}


def write_list(name: str, folder: Path) -> Path:
    """One of the lists as a file; as Windows writes it where it has umlauts."""
    path = folder / name
    content = LISTS[name][0]()
    if isinstance(content, str):
        content = content.encode('cp1252' if name == 'stations.csv' else 'utf-8')
    path.write_bytes(content)
    return path


def places_of(path: Path, content: str | bytes, options: ReadOptions | None = None) -> Places:
    """What a file of some content is read as."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read(path, options or ReadOptions())


def ids_and_places(places: Places) -> dict[str, tuple[float, float]]:
    """Where each sensor stands."""
    return {sensor.id: sensor.at for sensor in places.sensors}


def zip_of(name: str, content: bytes) -> bytes:
    """A packed file with one file in it."""
    packed = BytesIO()
    with zipfile.ZipFile(packed, 'w') as file:
        file.writestr(name, content)
    return packed.getvalue()

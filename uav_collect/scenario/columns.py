"""Which column of a table means what: by names that are usual, or by those that a user gives."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple
import unicodedata

from uav_collect.config.yaml_text import shown
from uav_collect.errors import ConfigError
from uav_collect.scenario.tables import NAMES_PLACES

ID = 'id'
DATA = 'data_mbit'
ZONE = 'utm_zone'
_BARE = ('x', 'y')  # may be metres or degrees: the numbers tell


class System(NamedTuple):
    """One way to write a place in two columns."""

    roles: tuple[str, str]
    lows: tuple[float, float]
    highs: tuple[float, float]
    unit: str
    is_angular: bool

    def has(self, at: Sequence[float]) -> bool:
        """Whether two numbers may be a place."""
        return all(
            low <= it <= high for it, low, high in zip(at, self.lows, self.highs, strict=True)
        )


# East and north mean nothing at the poles.
DEGREES = System(('lat', 'lon'), (-89.0, -180.0), (89.0, 180.0), 'deg', is_angular=True)
# UTM: no zone is wider than 834 km; a metre here is 0.9996 to 1.001 m on the ground.
GRID = System(
    ('easting_m', 'northing_m'), (100_000.0, 0.0), (900_000.0, 1e7), 'm', is_angular=False
)
PLAIN = System(('x_m', 'y_m'), (-1e7, -1e7), (1e7, 1e7), 'm', is_angular=False)
SYSTEMS = (DEGREES, GRID, PLAIN)  # where a table has more than one, the first counts

# Names as `plain` leaves them, those first that count more. No unit but metres and degrees.
_USUAL: dict[str, tuple[str, ...]] = {
    ID: (
        *('sensor_id', 'sensorid', 'id', 'logger_id', 'loggerid', 'node_id', 'nodeid'),
        *('dev_eui', 'deveui', 'site_no', 'stations_id', 'boxid', 'individual_local_identifier'),
        *('station_id', 'stationid', 'device_id', 'deviceid', 'deployment_id', 'deploymentid'),
        *('site_id', 'siteid', 'point_id', 'plot_id', 'trap_id', 'well_id', 'location_id'),
        *('waypoint_id', 'turbine_id', 'gauge_id', 'identifier', 'sensor', 'logger', 'node'),
        *('station', 'device', 'deployment', 'site', 'point', 'plot', 'turbine', 'waypoint'),
        *('location', 'place', 'name', 'label', 'code', 'title', 'uid', 'fid', 'objectid'),
        *('station_name', 'site_name', 'sensor_name', 'bezeichnung', 'kennung', 'messstelle'),
        *('standort', 'nummer', 'nom', 'identifiant', 'nombre', 'estacion', 'codigo', 'nome'),
        *('stazione', 'codice', 'estacao', 'naam', 'namn', 'navn', 'nazwa', 'nr', 'no', 'num'),
    ),
    'lat': (
        *('lat', 'latitude', 'latitud', 'latitudine', 'lat_n', 'latitude_n', 'y_lat', 'lat_y'),
        *('decimallatitude', 'breite', 'breitengrad', 'geografische_breite', 'breedtegraad'),
        *('breddgrad', 'breddegrad', 'szerokosc', 'szerokosc_geograficzna', 'sirka', 'lat_dd'),
        *('dec_lat_va', 'location_lat', 'geobreite', 'gps_latitude'),
    ),
    'lon': (
        *('lon', 'lng', 'long', 'longitude', 'longitud', 'longitudine', 'lon_e', 'long_e'),
        *('longitude_e', 'x_lon', 'x_long', 'lon_x', 'long_x', 'decimallongitude', 'lange'),
        *('laenge', 'langengrad', 'laengengrad', 'geografische_lange', 'lengtegraad'),
        *('langdgrad', 'lengdegrad', 'laengdegrad', 'dlugosc', 'dlugosc_geograficzna', 'delka'),
        *('dec_long_va', 'location_long', 'location_lon', 'geolange', 'geolaenge'),
    ),
    'easting_m': (
        *('easting_m', 'easting', 'eastings', 'east_m', 'east', 'utm_e', 'utm_easting', 'utm_x'),
        *('utmx', 'utme', 'x_utm', 'e_utm', 'easting_utm', 'utm_east', 'ostwert', 'rechtswert'),
        *('este', 'est', 'oost'),
    ),
    'northing_m': (
        *('northing_m', 'northing', 'northings', 'north_m', 'north', 'utm_n', 'utm_northing'),
        *('utm_y', 'utmy', 'utmn', 'y_utm', 'n_utm', 'northing_utm', 'utm_north', 'nordwert'),
        *('hochwert', 'norte', 'nord', 'noord'),
    ),
    'x_m': ('x_m', 'x_metre', 'x_metres', 'x_meter', 'x_meters', 'pos_x_m'),
    'y_m': ('y_m', 'y_metre', 'y_metres', 'y_meter', 'y_meters', 'pos_y_m'),
    'x': ('x', 'xcoord', 'x_coord', 'x_coordinate', 'point_x', 'coord_x', 'coordx', 'pos_x'),
    'y': ('y', 'ycoord', 'y_coord', 'y_coordinate', 'point_y', 'coord_y', 'coordy', 'pos_y'),
    DATA: ('data_mbit', 'demand_mbit', 'mbit', 'volume_mbit'),
    ZONE: ('utm_zone', 'utmzone', 'zone_utm'),
}
_LONGEST = 200  # characters of a name that count
_NOISE = frozenset({'deg', 'degree', 'degrees', 'decimal', 'dd', 'wgs84', 'wgs', '84', 'gps'})
ROLES = (ID, *(role for system in SYSTEMS for role in system.roles), DATA, ZONE)
_ROLE_OF = {name: role for role, names in _USUAL.items() for name in names}
_RANK = {name: rank for names in _USUAL.values() for rank, name in enumerate(names)}
_PAIRS = (*(system.roles for system in SYSTEMS), _BARE)


def plain(name: str) -> str:
    """A column's name without what people write differently: case, accents, blanks, brackets."""
    letters = unicodedata.normalize('NFKD', name[:_LONGEST]).casefold()
    kept = (it if it.isalnum() else '_' for it in letters if not unicodedata.combining(it))
    return '_'.join(filter(None, ''.join(kept).split('_')))


def parse_columns(text: str, field: str) -> dict[str, str]:
    """Read `id=station,lat=Y`, as given on a command line: by role, the name of its column.

    Args:
        field: what it is called in messages.

    Raises:
        ConfigError: one line for each part that is not KEY=COLUMN.
    """
    columns, problems = {}, []
    for part in text.split(','):
        role, _, name = (each.strip() for each in part.partition('='))
        columns[role] = name
        if role not in ROLES or not name:
            allowed = f'KEY=COLUMN with KEY of {", ".join(ROLES)}'
            problems.append(f'{field} has {shown(part)}: must be {allowed}')
    if problems:
        raise ConfigError(*problems)
    return columns


def are_columns(columns: Mapping[object, object]) -> bool:
    """Whether a mapping gives names of columns to roles."""
    return all(
        role in ROLES and isinstance(name, str) and name.strip() for role, name in columns.items()
    )


class Found(NamedTuple):
    """The columns of a header that mean something, by their role."""

    by_role: dict[str, int]
    doubled: dict[str, str]  # by role, a name that stands in the header more than once
    missing: dict[str, str]  # by role, a name that the user gives and the header lacks


def find_columns(header: Sequence[str], columns: Mapping[str, str]) -> Found:
    """The columns that a user gives, and those with usual names.

    A name that is not used may be there as often as it likes.
    """
    names = [plain(name) for name in header]
    found = Found({}, {}, {})
    for role, name in columns.items():
        places = [at for at, it in enumerate(header) if it == name.strip()]
        places = places or [at for at, it in enumerate(names) if it == plain(name)]
        _note(found, role, name.strip(), places, missing=True)
    for role in _USUAL:
        if role in columns or _is_given(role, columns):
            continue
        usual = [at for at, name in enumerate(names) if role_of(name) == role]
        best = min((_rank(names[at]) for at in usual), default=0)
        places = [at for at in usual if _rank(names[at]) == best]
        _note(found, role, header[places[0]] if places else '', places)
    return found


def _is_given(role: str, columns: Mapping[str, str]) -> bool:
    """Whether a user says by which columns places go, and this is another pair."""
    given = [pair for pair in _PAIRS if any(it in columns for it in pair)]
    return bool(given) and any(role in pair for pair in _PAIRS if pair not in given)


def _note(found: Found, role: str, name: str, places: list[int], *, missing: bool = False) -> None:
    if len(places) > 1:
        found.doubled[role] = name
    if places:
        found.by_role[role] = places[0]
    elif missing:
        found.missing[role] = name


def _stripped(name: str) -> str:
    """A name without words that say of degrees what they are."""
    return '_'.join(part for part in name.split('_') if part not in _NOISE)


def role_of(name: str) -> str | None:
    """What a column means by its name, as `plain` leaves it; None if nobody knows."""
    role = _ROLE_OF.get(name)
    return role or _ROLE_OF.get(_stripped(name))


def _rank(name: str) -> int:
    return _RANK[name] if name in _RANK else 1_000 + _RANK[_stripped(name)]


def n_known(header: Sequence[str], columns: Mapping[str, str]) -> int:
    """How many columns of a row are known by their names, as `tables.Known` says."""
    by_role = find_columns(header, columns).by_role
    has_places = any(all(role in by_role for role in pair) for pair in _PAIRS)
    return len(by_role) + (NAMES_PLACES if has_places else 0)


def pairs_of(found: Found) -> list[tuple[str, str]]:
    """The pairs of columns by which places may go, those first that count more."""
    return [pair for pair in _PAIRS if all(role in found.by_role for role in pair)]

"""What is odd among the places of a list: those far from all others, and those listed twice."""

from collections.abc import Iterator, Sequence
import math
from typing import Literal, NamedTuple

from uav_collect.config.yaml_text import shown

Pair = tuple[float, float]
Doubles = Literal['refuse', 'first', 'last', 'keep']
DOUBLES: tuple[Doubles, ...] = ('refuse', 'first', 'last', 'keep')

FAR_IN_ANY_AREA_M = 100e3  # beyond that no list means it
_GAP = 10.0  # times as far as the one before: no longer of the same site
_LEAST_EXTENT_M = 100.0
_EARTH_RADIUS_M = 6_371_000.0
_MAX_NAMED = 8  # rows of one place in one line


class SensorPlace(NamedTuple):
    """One sensor of a list."""

    id: str
    at: Pair  # latitude and longitude [deg], or east and north [m]: `Places.is_angular`
    data_mbit: float | None
    number: int  # of its row
    where: str  # the same, as a message begins


class FarPlace(NamedTuple):
    """A place that lies far from all others of its list."""

    place: SensorPlace
    distance_m: float  # from their middle

    def said(self, names: tuple[str, str]) -> str:
        """A line that names it.

        Args:
            names: what the list calls its coordinates.
        """
        at = ', '.join(f'{it:.10g}' for it in self.place.at)
        away = _shown_m(self.distance_m)
        return f'{self.place.where}: {",".join(names)} is {at}: lies {away} from the others'


def far_places(places: Sequence[SensorPlace], *, is_angular: bool) -> list[FarPlace]:
    """The places beyond the first large gap in the distances from the middle of all.

    More than half of all places lie before the gap, so of two none is far. Latitude and longitude
    0, which receivers without a fix write, count as far whatever their number.
    """
    points = [_on_sphere_m(place.at) if is_angular else (*place.at, 0.0) for place in places]
    fixed = [at for at, place in enumerate(places) if not is_angular or any(place.at)]
    if not fixed:
        return []
    middle = tuple(_median(values) for values in zip(*(points[at] for at in fixed), strict=True))
    away_m = [math.dist(point, middle) for point in points]
    beyond = {*_beyond_gap(away_m, fixed)}
    unfixed = {*range(len(places))}.difference(fixed)
    beyond |= {at for at in unfixed if away_m[at] > FAR_IN_ANY_AREA_M}
    return [
        FarPlace(places[at], _along_m(away_m[at]) if is_angular else away_m[at])
        for at in sorted(beyond)
    ]


def _beyond_gap(away_m: Sequence[float], fixed: Sequence[int]) -> list[int]:
    ordered = sorted(fixed, key=away_m.__getitem__)
    for rank in range(len(ordered) // 2 + 1, len(ordered)):
        before_m = max(away_m[ordered[rank - 1]], _LEAST_EXTENT_M)
        if away_m[ordered[rank]] > _GAP * before_m:
            return ordered[rank:]
    return []


class Doubled(NamedTuple):
    """The places of a list without those that are there twice, and what is said of these."""

    kept: tuple[SensorPlace, ...]
    problems: tuple[tuple[int, str], ...]  # each with the row that it begins with
    n_left_out: int


def without_doubles(
    places: Sequence[SensorPlace],
    doubles: Doubles,
    id_name: str,
    names: tuple[str, str],
    unit: str,
) -> Doubled:
    """One row for each id and each place, as a user wants it.

    Args:
        doubles: keep the first or the last row of each, all rows of one place, or refuse.
        id_name: what the list calls its ids; `names`: its coordinates; `unit`: its rows.
    """
    if doubles in ('first', 'last'):
        kept = _one_each(places, is_last=doubles == 'last')
        return Doubled(kept, (), len(places) - len(kept))
    problems = [*_same_ids(places, id_name, unit)]
    if doubles == 'refuse':
        problems += _same_places(places, names, unit)
    return Doubled(tuple(places), tuple(problems), 0)


def _one_each(places: Sequence[SensorPlace], *, is_last: bool) -> tuple[SensorPlace, ...]:
    ids, spots, kept = set(), set(), []
    for place in reversed(places) if is_last else places:
        if place.id not in ids and place.at not in spots:
            kept.append(place)
        ids.add(place.id)
        spots.add(place.at)
    return tuple(reversed(kept)) if is_last else tuple(kept)


def _same_ids(places: Sequence[SensorPlace], name: str, unit: str) -> Iterator[tuple[int, str]]:
    for place, others in _groups(places, [place.id for place in places]):
        yield (
            place.number,
            f'{place.where}: {name} is {shown(place.id)}, as in {_rows(others, unit)}: must be '
            'unique, or doubles: first, or last, to keep one row',
        )


def _same_places(
    places: Sequence[SensorPlace], names: tuple[str, str], unit: str
) -> Iterator[tuple[int, str]]:
    for place, others in _groups(places, [place.at for place in places]):
        if all(other.id == place.id for other in others):
            continue  # said of the ids
        at = ', '.join(f'{it:.10g}' for it in place.at)
        yield (
            place.number,
            f'{place.where}: {",".join(names)} is {at}, as in {_rows(others, unit)}: must be one '
            'row for each place, or doubles: first, last, or keep for sensors of one place',
        )


def _groups(
    places: Sequence[SensorPlace], keys: Sequence[object]
) -> Iterator[tuple[SensorPlace, list[SensorPlace]]]:
    by_key: dict[object, list[SensorPlace]] = {}
    for key, place in zip(keys, places, strict=True):
        by_key.setdefault(key, []).append(place)
    return ((first, others) for first, *others in by_key.values() if others)


def _rows(places: Sequence[SensorPlace], unit: str) -> str:
    numbers = ', '.join(str(place.number) for place in places[:_MAX_NAMED])
    more = f' and {len(places) - _MAX_NAMED} more' if len(places) > _MAX_NAMED else ''
    return f'{unit} {numbers}{more}'


def _on_sphere_m(place: Pair) -> tuple[float, float, float]:
    lat, lon = map(math.radians, place)
    across_m = _EARTH_RADIUS_M * math.cos(lat)
    up_m = _EARTH_RADIUS_M * math.sin(lat)
    return across_m * math.cos(lon), across_m * math.sin(lon), up_m


def _along_m(chord_m: float) -> float:
    return 2 * _EARTH_RADIUS_M * math.asin(min(1.0, chord_m / (2 * _EARTH_RADIUS_M)))


def _median(values: Sequence[float]) -> float:
    ordered = sorted(values)
    half = len(ordered) // 2
    return ordered[half] if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2


def _shown_m(distance_m: float) -> str:
    return f'{distance_m / 1e3:,.0f} km' if distance_m >= 10e3 else f'{distance_m:,.0f} m'

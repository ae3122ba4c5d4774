"""Where every UAV was, again and again, as a table."""

from collections.abc import Iterator
from heapq import merge
from itertools import chain
import math

from uav_collect import files
from uav_collect.analysis.legs import state_at, UavState
from uav_collect.errors import ConfigError
from uav_collect.handover.flights import MissionFlights, UavFlight

STATE_COLUMNS = (
    'time_s', 'uav', 'x_m', 'y_m', 'altitude_m', 'speed_mps', 'heading_deg', 'energy_left_j',
    'doing',
)  # fmt: skip
PLACE_COLUMNS = ('lat_deg', 'lon_deg')  # where it is known where on Earth the area lies
LANDED = 'landed'
_MAX_ROWS = 5_000_000


def states_file(mission: MissionFlights, rate_hz: float) -> bytes:
    """The states of all UAVs at the times 0, 1 / rate, ... and as each one's flight ends.

    There is no row of a UAV at times of which the log lacks what it did.

    Raises:
        ConfigError: there would be more rows than anybody reads.
    """
    ends_s = [flight.stretches[-1].end_s for flight in mission.flights]
    n_rows = sum(end_s * rate_hz for end_s in ends_s)
    if n_rows > _MAX_ROWS:
        raise ConfigError(
            f'--rate-hz is {rate_hz:g}: makes {n_rows:.0f} rows, must make at most {_MAX_ROWS}'
        )
    is_placed = mission.reference is not None
    header = *STATE_COLUMNS, *(PLACE_COLUMNS if is_placed else ())
    # By time, then by UAV; no more than a row of each flight is held at once.
    rows = merge(*(_rows(mission, flight, rate_hz) for flight in mission.flights))
    return files.csv_of(chain([header], rows))


def _rows(
    mission: MissionFlights, flight: UavFlight, rate_hz: float
) -> Iterator[tuple[object, ...]]:
    end_s = flight.stretches[-1].end_s
    times_s = (number / rate_hz for number in range(math.ceil(end_s * rate_hz)))
    first = 0  # of the stretches that are not over
    for time_s in chain(times_s, [end_s]):
        while first < len(flight.stretches) - 1 and flight.stretches[first].end_s <= time_s:
            first += 1
        state = state_at(flight.stretches[first:], time_s)
        if state is not None:
            yield _row(mission, flight, state, time_s)


def _row(
    mission: MissionFlights, flight: UavFlight, state: UavState, time_s: float
) -> tuple[object, ...]:
    last = flight.stretches[-1]
    doing, speed_mps, heading = LANDED if flight.has_landed else last.kind, 0.0, ''
    if state.leg is not None:
        doing = state.leg.kind
        if state.leg.length_m > 0.0:
            speed_mps = flight.speed_mps
            heading = f'{mission.bearing_deg(state.leg):.3f}'
    place = mission.lat_lon_deg(state.place_m) if mission.reference is not None else ()
    x_m, y_m = state.place_m
    altitude_m = 0.0 if doing == LANDED else mission.altitude_m
    return (
        *(time_s, flight.uav, x_m, y_m, altitude_m, speed_mps, heading),
        *(state.energy_left_j, doing, *place),
    )

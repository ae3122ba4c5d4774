"""The parts of a scenario: frozen models with the range of every value, and derived numbers.

Within these ranges all that is derived is finite: powers, gains, rates, durations, rewards.

Values live in YAML, never here; config/scenarios/paper_10x10.yaml says what each one means.
"""

from dataclasses import replace
import math
from typing import Annotated, Literal

from uav_collect.config import yaml_text
from uav_collect.config.rules import (
    either,
    Entries,
    name,
    number,
    one_or_span,
    or_zero,
    pair,
    polygon,
    Rule,
    Section,
    text,
    whole,
    words,
)
from uav_collect.limits import (
    MAX_CELLS_PER_SIDE,
    MAX_CORNERS,
    MAX_DATA_MBIT,
    MAX_NO_FLY,
    MAX_SENSOR_ID,
    MAX_SENSORS,
    MAX_UAVS,
    MIN_DATA_MBIT,
)
from uav_collect.scenario import columns, grids
from uav_collect.scenario.earth import lat_lon_deg
from uav_collect.scenario.odd_places import DOUBLES, Doubles

_MIN_LENGTH_M = 0.1
_MAX_LENGTH_M = 10_000.0
_MAX_SIDE_M = MAX_CELLS_PER_SIDE * _MAX_LENGTH_M
_MAX_DELAY_S = 3600.0
_MAX_TIME_S = 1e6  # of a fault
_MAX_DECISIONS = 1_000_000
_MAX_FAULTS = 1_000

FAULT_KINDS = ('gone', 'silent', 'slow')  # in the order of `world.dynamics.GONE` and so on

Point = tuple[float, float]  # x, y [m]: east and north of the area's south-west corner
Polygon = tuple[Point, ...]  # its corners; which way round does not matter
_Share = Annotated[float, number(0, 1)]
_Length = Annotated[float, number(_MIN_LENGTH_M, _MAX_LENGTH_M, 'm')]
_Coordinate = Annotated[float, number(0, _MAX_SIDE_M, 'm')]
_CORNERS = polygon(-_MAX_SIDE_M, _MAX_SIDE_M, MAX_CORNERS)
_Amount = or_zero(number(MIN_DATA_MBIT, MAX_DATA_MBIT, 'Mbit'))


def _crs() -> Rule:
    def parse(value: object) -> str:
        if not isinstance(value, str):
            raise ValueError
        return grids.crs_name(value)

    return Rule(grids.CRS_ALLOWED, parse)


class GeoReference(Section):
    """A point of the area of known latitude and longitude (WGS84), and where y points there."""

    lat_deg: Annotated[float, number(-89, 89, 'deg')]
    lon_deg: Annotated[float, number(-180, 180, 'deg')]
    position_m: Annotated[
        Point,
        pair(number(0, _MAX_SIDE_M), f'a list [x, y] of numbers from 0 to {_MAX_SIDE_M:.10g} m'),
    ]
    # Of the y axis, clockwise from true north; absent: it is true north. A map grid's is not.
    y_bearing_deg: Annotated[float | None, number(-180, 180, 'deg')] = None

    def lat_lon_deg(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Latitude and longitude [deg] of a place in the area."""
        east_m, north_m = x_m - self.position_m[0], y_m - self.position_m[1]
        if self.y_bearing_deg is not None:
            turn = math.radians(self.y_bearing_deg)
            across_m, up_m = east_m, north_m
            east_m = math.cos(turn) * across_m + math.sin(turn) * up_m
            north_m = math.cos(turn) * up_m - math.sin(turn) * across_m
        return lat_lon_deg(
            east_m, north_m, origin_lat_deg=self.lat_deg, origin_lon_deg=self.lon_deg
        )


class AreaConfig(Section):
    """What is monitored: its cells, and the height at which UAVs fly over it.

    A square by `cells_per_side`, or `rows` and `columns`; of these, the cells that are open.
    """

    cells_per_side: Annotated[int | None, whole(1, MAX_CELLS_PER_SIDE)] = None
    rows: Annotated[int | None, whole(1, MAX_CELLS_PER_SIDE)] = None
    columns: Annotated[int | None, whole(1, MAX_CELLS_PER_SIDE)] = None
    cell_size_m: _Length
    altitude_m: _Length  # of all UAVs
    reference: GeoReference | None = None  # where on Earth it lies, if that is known
    crs: Annotated[str | None, _crs()] = None  # the grid that its places were given in, for people
    boundary: Annotated[Polygon | None, _CORNERS] = None  # within it is the centre of open cells
    no_fly: Annotated[tuple[Annotated[Polygon, _CORNERS], ...] | None, Entries(0, MAX_NO_FLY)] = (
        None  # no open cell lies under a part of them
    )

    @property
    def n_rows(self) -> int:
        """Cells from south to north."""
        return self.cells_per_side or self.rows or 0

    @property
    def n_columns(self) -> int:
        """Cells from west to east."""
        return self.cells_per_side or self.columns or 0

    @property
    def n_cells(self) -> int:
        """Number of cells, closed ones among them."""
        return self.n_rows * self.n_columns

    @property
    def width_m(self) -> float:
        """How far it reaches from west to east [m]."""
        return self.n_columns * self.cell_size_m

    @property
    def height_m(self) -> float:
        """How far it reaches from south to north [m]."""
        return self.n_rows * self.cell_size_m


def _columns() -> Rule:
    def parse(value: object) -> object:
        if not isinstance(value, dict) or not columns.are_columns(value):
            raise ValueError
        return value

    roles = ', '.join(columns.ROLES)
    return Rule(f'a mapping of some of {roles} to names of columns', parse)


class DrawnSensors(Section):
    """Sensors drawn as in the paper: dense and sparse cells, Poisson numbers, uniform places."""

    kind: Literal['drawn']
    seed: Annotated[int, whole(0, 2**63 - 1)]
    dense_cell_share: _Share
    dense_mean: Annotated[float, number(0, 1000, 'sensors per cell')]
    sparse_mean: Annotated[float, number(0, 1000, 'sensors per cell')]

    def n_dense_cells(self, n_open: int) -> int:
        """Number of dense cells among the open ones."""
        return math.floor(self.dense_cell_share * n_open + 0.5)


class CsvSensors(Section):
    """Sensors read from a list in a file; a loaded scenario holds them as `ListedSensors`."""

    kind: Literal['csv']
    file: Annotated[str, text(4096)]
    # South-west corner of the area in the file's coordinates; auto centres the sensors.
    origin: Annotated[
        Point | Literal['auto'],
        pair(number(-1e7, 1e7), 'a list of two numbers, or auto', word='auto'),
    ]
    columns: Annotated[dict[str, str] | None, _columns()] = None  # by role, the file's name
    crs: Annotated[str | None, _crs()] = None  # the grid of the file's coordinates
    doubles: Annotated[Doubles | None, words(*DOUBLES)] = None  # rows of one id or place
    blanks: Annotated[str | None, words('refuse', 'skip')] = None  # rows without a place


class ListedSensor(Section):
    """One sensor of a real site."""

    id: Annotated[str, text(MAX_SENSOR_ID)]
    x_m: _Coordinate
    y_m: _Coordinate
    data_mbit: Annotated[float | None, _Amount] = None


class ListedSensors(Section):
    """Sensors of a real site, in metres from the area's south-west corner."""

    kind: Literal['listed']
    entries: Annotated[tuple[ListedSensor, ...], Entries(1, MAX_SENSORS)]


class DemandConfig(Section):
    """How much data waits where, drawn anew for each mission."""

    cell_share: Annotated[float | Literal['all'], number(1e-9, 1, word='all')]
    data_mbit: Annotated[
        Point | Literal['csv'],
        pair(
            _Amount,
            f'a list [low, high], low <= high, of numbers from {MIN_DATA_MBIT:g} to '
            f'{MAX_DATA_MBIT:g} Mbit, low also 0, or csv',
            word='csv',
            is_span=True,
        ),
    ]
    # Cells that everybody knows to hold no data: those without a sensor, or none, as by None.
    known_empty: Annotated[str | None, words('sensors', 'none')] = None

    @property
    def is_empty_known(self) -> bool:
        """Whether UAVs need not look at cells without a sensor."""
        return self.known_empty == 'sensors'


class RadioConfig(Section):
    """Channel between sensors and UAVs, and the range between UAVs."""

    carrier_hz: Annotated[float, number(1e6, 3e11, 'Hz')]
    tx_power_dbm: Annotated[float, number(-50, 60, 'dBm')]
    noise_dbm_per_hz: Annotated[float, number(-250, 0, 'dBm/Hz')]
    system_bandwidth_mhz: Annotated[float, number(1e-6, 1e4, 'MHz')]
    path_loss_exponent: Annotated[float, number(2, 6)]
    nlos_attenuation: Annotated[float, number(1e-6, 1)]
    los_a: Annotated[float, number(0.001, 90, 'deg')]
    los_b: Annotated[float, number(1e-4, 10, 'per deg')]
    rician_a1: Annotated[float, number(1e-6, 1000)]
    rician_a2: Annotated[float, number(0, 20, 'per rad')]
    n_antennas: Annotated[int, whole(1, 64)]
    csi_error_variance: _Share
    contact_range_m: Annotated[float, number(0, math.inf, 'm')]
    # Between UAVs. Without any of these a message in range is heard at once, and none is lost.
    loss_share: Annotated[float | None, number(0, 1)] = None
    delay_s: Annotated[
        Point | None,
        pair(
            number(0, _MAX_DELAY_S, 's'),
            f'a list [mean, jitter], 0 <= jitter <= mean <= {_MAX_DELAY_S:g} s',
        ),
    ] = None
    rate_bps: Annotated[float | None, number(1, 1e12, 'bit/s')] = None
    beacon_period_s: Annotated[float | None, number(0.1, _MAX_DELAY_S, 's')] = None

    @property
    def is_ideal(self) -> bool:
        """Whether UAVs in range hear each other at once and always."""
        return (
            self.loss_share is None
            and self.delay_s is None
            and self.rate_bps is None
            and self.beacon_period_s is None
        )

    @property
    def tx_power_w(self) -> float:
        """Transmit power of a sensor [W]."""
        return _watt(self.tx_power_dbm)

    @property
    def noise_w_per_hz(self) -> float:
        """Noise power spectral density [W/Hz]."""
        return _watt(self.noise_dbm_per_hz)

    @property
    def system_bandwidth_hz(self) -> float:
        """Bandwidth of the whole fleet [Hz]."""
        return self.system_bandwidth_mhz * 1e6


class RewardConfig(Section):
    """What a policy is rewarded for."""

    discount_per_s: Annotated[float, number(1e-6, 1)]
    move_penalty_per_s: Annotated[float, number(0, 1000)]
    scale_mbit: Annotated[float, number(1e-6, 1e6, 'Mbit')]


class PropulsionConfig(Section):
    """Constants of a rotary-wing UAV's propulsion power. Source: Zeng 2019, paper eq. (3)."""

    blade_profile_power_w: Annotated[float, number(0.1, 1e5, 'W')]
    induced_power_w: Annotated[float, number(0.1, 1e5, 'W')]
    tip_speed_mps: Annotated[float, number(1, 1000, 'm/s')]
    induced_speed_mps: Annotated[float, number(0.1, 100, 'm/s')]
    parasite_coefficient: Annotated[float, number(0, 100, 'W s^3/m^3')]


class Place(Section):
    """A point on the ground. In a file also `cell: [row, column]`, its centre."""

    position_m: Annotated[
        Point,
        pair(number(0, _MAX_SIDE_M), f'a list [x, y] of numbers from 0 to {_MAX_SIDE_M:.10g} m'),
    ]


class BatteryConfig(Section):
    """The battery that a UAV's energy budget is of, as far as it is known; no mission needs it."""

    usable_share: Annotated[float | None, number(0.01, 1)] = None  # the budget
    nominal_v: Annotated[float | None, number(0.1, 10_000, 'V')] = None


class UavConfig(Section):
    """One UAV: how fast it is, what it may spend, where it starts and lands."""

    speed_mps: Annotated[float, number(0.01, 100, 'm/s')]
    energy_budget_kj: Annotated[float, number(0.001, 1e6, 'kJ')]
    energy_margin_kj: Annotated[float, number(0, 1e6, 'kJ')]
    start: Place
    home: Place
    propulsion: PropulsionConfig
    battery: BatteryConfig | None = None

    @property
    def start_m(self) -> Point:
        """Where it starts: x, y [m], the centre of a cell."""
        return self.start.position_m

    @property
    def home_m(self) -> Point:
        """Where it lands: x, y [m]."""
        return self.home.position_m

    @property
    def energy_budget_j(self) -> float:
        """Energy at the start [J]."""
        return self.energy_budget_kj * 1e3

    @property
    def energy_margin_j(self) -> float:
        """Energy that must be left when home [J]."""
        return self.energy_margin_kj * 1e3


class FleetConfig(Section):
    """The UAVs, in the order of their ids."""

    uavs: Annotated[tuple[UavConfig, ...], Entries(1, MAX_UAVS)]


class FaultConfig(Section):
    """What befalls a UAV on purpose; see `world.faults`. At a time or at a decision."""

    uav: Annotated[int | Literal['any'], either(whole(1, MAX_UAVS), 'any')]  # id; any: drawn
    kind: Literal['gone', 'silent', 'slow']
    at_s: Annotated[
        float | Point | None,
        one_or_span(number(0, _MAX_TIME_S, 's'), f'a number from 0 to {_MAX_TIME_S:g} s'),
    ] = None
    # Running number of the UAV's own decisions, from 0.
    at_decision: Annotated[
        int | tuple[int, int] | None,
        one_or_span(whole(0, _MAX_DECISIONS), f'a whole number from 0 to {_MAX_DECISIONS}'),
    ] = None
    share: Annotated[float | None, number(0, 1)] = None  # of missions; absent: of all

    @property
    def mission_share(self) -> float:
        """Share of missions that it happens in."""
        return 1.0 if self.share is None else self.share

    @property
    def span_s(self) -> Point:
        """The earliest and the latest time that it begins [s]; nan: at a decision."""
        if self.at_s is None:
            return math.nan, math.nan
        return self.at_s if isinstance(self.at_s, tuple) else (self.at_s, self.at_s)

    @property
    def span_decisions(self) -> tuple[int, int]:
        """The first and the last decision that it begins at; -1: at a time."""
        if self.at_decision is None:
            return -1, -1
        at = self.at_decision
        return at if isinstance(at, tuple) else (at, at)


class Scenario(Section):
    """Everything that a mission depends on, but the mission's seed and the policies."""

    name: Annotated[str, name()]
    area: AreaConfig
    sensors: DrawnSensors | ListedSensors
    demand: DemandConfig
    radio: RadioConfig
    reward: RewardConfig
    fleet: FleetConfig
    faults: Annotated[tuple[FaultConfig, ...] | None, Entries(0, _MAX_FAULTS)] = None

    @property
    def uavs(self) -> tuple[UavConfig, ...]:
        """The UAVs, in the order of their ids."""
        return self.fleet.uavs

    @property
    def n_uavs(self) -> int:
        """Number of UAVs."""
        return len(self.fleet.uavs)

    @property
    def n_cells(self) -> int:
        """Number of cells of the area."""
        return self.area.n_cells

    @property
    def bandwidth_hz(self) -> float:
        """Bandwidth of each UAV [Hz]: an equal part of the system's, paper Sec. III-B."""
        return self.radio.system_bandwidth_hz / self.n_uavs

    def with_discount(self, discount_per_s: float) -> 'Scenario':
        """The scenario with another discount of rewards."""
        return replace(self, reward=replace(self.reward, discount_per_s=discount_per_s))

    def to_yaml(self) -> str:
        """The scenario as YAML that stands alone; equal scenarios give equal text."""
        return yaml_text.dump(self.as_mapping())


def _watt(dbm: float) -> float:
    return float(10.0 ** ((dbm - 30.0) / 10.0))

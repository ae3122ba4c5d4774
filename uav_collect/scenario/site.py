"""The site of a scenario: the scenario, and its sensors, drawn or read, sorted by cell."""

from dataclasses import dataclass, replace

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.kernels import keyed_random
from uav_collect.kernels.arrays import Bools, Floats, Ints, Row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.keyed_random import draw_poisson, draw_uniform, shuffle_first
from uav_collect.scenario.area import cells_of, open_cells
from uav_collect.scenario.model import DrawnSensors, ListedSensors, Scenario

_BIT_PER_MBIT = 1e6
_DENSE_CELL = keyed_random.DENSE_CELL
_SENSOR_COUNT = keyed_random.SENSOR_COUNT
_SENSOR_POSITION = keyed_random.SENSOR_POSITION


@dataclass(frozen=True, kw_only=True)
class Site:
    """A scenario and where its sensors are.

    Those of cell c are first_sensor[c] : first_sensor[c + 1].
    """

    scenario: Scenario
    sensor_ids: tuple[str, ...]  # (S,)
    position_m: Floats  # (S, 2) east and north of the area's south-west corner
    cell: Ints  # (S,) row * n_columns + column
    first_sensor: Ints  # (C + 1,)
    data_bit: Floats  # (S,) amounts that the scenario gives, nan where each mission draws them

    @property
    def n_cells(self) -> int:
        """Number of cells, closed ones among them."""
        return self.scenario.n_cells

    @property
    def n_sensors(self) -> int:
        """Number of sensors."""
        return len(self.sensor_ids)

    def known_complete(self) -> Ints:
        """As `known_complete_cells` of the scenario."""
        if not self.scenario.demand.is_empty_known:
            return _closed(self.scenario)
        is_empty: Bools = np.diff(self.first_sensor) == 0
        return is_empty.astype(np.int64)

    def with_discount(self, discount_per_s: float) -> 'Site':
        """The same site under another discount of the reward."""
        return replace(self, scenario=self.scenario.with_discount(discount_per_s))


def build_site(scenario: Scenario) -> Site:
    """The site of a scenario: its sensors drawn by their seed, or where a file has them.

    Raises:
        ConfigError: the drawn topology has no sensor at all.
    """
    match scenario.sensors:
        case DrawnSensors() as drawn:
            return _drawn_site(scenario, drawn)
        case ListedSensors() as listed:
            return _listed_site(scenario, listed)


def known_complete_cells(scenario: Scenario) -> Ints:
    """1 for each cell that everybody knows to hold no data, 0 for the others, (C,).

    Those are the closed ones and, where the scenario says so, those without a sensor.

    Raises:
        ConfigError: as `build_site`.
    """
    if scenario.demand.is_empty_known:
        return build_site(scenario).known_complete()
    return _closed(scenario)  # no sensor need be drawn to know them


def _closed(scenario: Scenario) -> Ints:
    is_closed: Bools = open_cells(scenario.area) == 0
    return is_closed.astype(np.int64)


def _drawn_site(scenario: Scenario, drawn: DrawnSensors) -> Site:
    area = scenario.area
    order, counts = np.flatnonzero(open_cells(area)), np.zeros(scenario.n_cells, dtype=np.int64)
    n_dense = drawn.n_dense_cells(len(order))
    draw_counts(
        order, counts, len(order), n_dense, drawn.dense_mean, drawn.sparse_mean, drawn.seed
    )
    n_sensors = int(counts.sum())
    if n_sensors == 0:
        raise ConfigError(
            f'sensors.seed is {drawn.seed}: draws an area without sensors, must be another seed, '
            'or the means larger'
        )
    x_m, y_m = np.zeros(n_sensors), np.zeros(n_sensors)
    draw_positions(x_m, y_m, counts, area.n_columns, area.cell_size_m, drawn.seed)
    digits = len(str(n_sensors))
    return Site(
        scenario=scenario,
        sensor_ids=tuple(f'S{number:0{digits}d}' for number in range(1, n_sensors + 1)),
        position_m=np.column_stack([x_m, y_m]),
        cell=np.repeat(np.arange(scenario.n_cells), counts),
        first_sensor=np.concatenate([[0], np.cumsum(counts)]),
        data_bit=np.full(n_sensors, np.nan),
    )


def _listed_site(scenario: Scenario, listed: ListedSensors) -> Site:
    area = scenario.area
    amounts = scenario.demand.data_mbit == 'csv'
    position_m = np.array([[sensor.x_m, sensor.y_m] for sensor in listed.entries])
    cell = cells_of(area, position_m)
    order = np.argsort(cell, kind='stable')
    cell = cell[order]
    data_mbit = [sensor.data_mbit if amounts else None for sensor in listed.entries]
    return Site(
        scenario=scenario,
        sensor_ids=tuple(listed.entries[index].id for index in order),
        position_m=position_m[order],
        cell=cell,
        first_sensor=np.searchsorted(cell, np.arange(area.n_cells + 1)),
        data_bit=np.array(data_mbit, dtype=np.float64)[order] * _BIT_PER_MBIT,
    )


@kernel
def draw_counts(
    order: Row[int],
    counts: Row[int],
    n_open: int,
    n_dense: int,
    dense_mean: float,
    sparse_mean: float,
    seed: int,
) -> None:
    """Draw the number of sensors of each cell. `order` holds the open ones and is shuffled."""
    shuffle_first(order, n_open, n_dense, seed, _DENSE_CELL)
    for place in range(n_open):
        cell = order[place]
        mean = dense_mean if place < n_dense else sparse_mean
        counts[cell] = draw_poisson(mean, seed, _SENSOR_COUNT, cell)


@kernel
def draw_positions(
    x_m: Row[float],
    y_m: Row[float],
    counts: Row[int],
    n_columns: int,
    cell_size_m: float,
    seed: int,
) -> None:
    """Draw each sensor's place, uniform in its cell; sensors in the order of their cells."""
    sensor = 0
    for cell in range(len(counts)):
        row = cell // n_columns
        column = cell - row * n_columns
        for number in range(counts[cell]):
            across = draw_uniform(seed, _SENSOR_POSITION, cell, number, 0)
            up = draw_uniform(seed, _SENSOR_POSITION, cell, number, 1)
            x_m[sensor] = (column + across) * cell_size_m
            y_m[sensor] = (row + up) * cell_size_m
            sensor += 1

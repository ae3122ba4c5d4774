"""What every UAV knows before it takes off: the area, the fleet and the radio's constants."""

import math
from typing import NamedTuple

from uav_collect.kernels.arrays import filled_row, Ints, Row, row_of
from uav_collect.physics.energy import propulsion_power_w
from uav_collect.physics.radio import (
    elevation_rad,
    line_of_sight_probability,
    path_gain,
    reference_gain,
)
from uav_collect.scenario.area import cell_of, mean_data_cells, open_cells
from uav_collect.scenario.model import DrawnSensors, ListedSensors, RadioConfig, Scenario
from uav_collect.scenario.site import known_complete_cells, Site
from uav_collect.scenario.ways import ways_home
from uav_collect.uav.messages import airtime_s

_FAINT_SNR = 1e-6
_MEAN_AWAY = 0.3826  # of a point of a square from its centre, in sides, on average


class Briefing(NamedTuple):
    """The scenario as far as UAVs know it; rows are indexed by UAV."""

    n_rows: int  # from south to north
    n_columns: int  # from west to east
    cell_size_m: float
    is_open: Row[int]  # by cell, (C,): 1 where UAVs may fly
    known_complete: Row[int]  # (C,) 1 where nothing is to be collected, as everybody knows
    has_obstacles: int  # 1: ways home may lead around closed cells
    home_m: Row[float]  # (U * C,) from each cell's centre, by UAV; empty without obstacles
    home_via: Row[int]  # (U * C,) the cell to fly straight to, -1: home; empty without obstacles
    data_share: float  # of cells that are not known to be complete; 0: nobody knows
    hover_s: float  # that one at a cell that holds data is expected to take, where that is known
    data_chance: float  # that a cell which is not known to be complete holds data, as it is drawn
    cell_data_bit: float  # that one which does is expected to hold
    upload_bps: float  # at which that comes up, all its sensors together
    n_uavs: int
    contact_range_m: float  # inf: always in contact
    loss_share: float  # of the messages between UAVs
    late_s: float  # that one comes at most, with what sending it takes
    may_fail: int  # 1: a UAV or its radio may, as the scenario has it
    bandwidth_hz: float  # of one UAV
    noise_w_per_hz: float
    tx_power_w: float  # of a sensor
    speed_mps: Row[float]
    flight_power_w: Row[float]  # at that speed
    hover_power_w: Row[float]
    start_x_m: Row[float]
    start_y_m: Row[float]
    home_x_m: Row[float]
    home_y_m: Row[float]
    home_cell: Row[int]
    energy_budget_j: Row[float]
    energy_margin_j: Row[float]  # to be left when home


def brief(scenario: Scenario) -> Briefing:
    """The briefing of a scenario's fleet, for whoever has no site; it may take as long as one."""
    return _brief(scenario, known_complete_cells(scenario))


def briefing_of(site: Site) -> Briefing:
    """The briefing of the fleet over a site, as `brief` has it."""
    return _brief(site.scenario, site.known_complete())


def budget_crossings(briefing: Briefing) -> float:
    """What a UAV may spend, in crossings of its part of the cells not known to be complete.

    Parts are as large as UAVs are fast; of all UAVs it is the least, for what one has no energy
    for is left to others.
    """
    n_cells = max(len(briefing.known_complete) - sum(briefing.known_complete), 1)
    n_crossings = min(
        (briefing.energy_budget_j[uav] - briefing.energy_margin_j[uav])
        / (briefing.flight_power_w[uav] * briefing.cell_size_m)
        for uav in range(briefing.n_uavs)
    ) * sum(briefing.speed_mps[uav] for uav in range(briefing.n_uavs))
    return max(n_crossings, 0.0) / n_cells


def _brief(scenario: Scenario, is_known: Ints) -> Briefing:
    uavs, area = scenario.uavs, scenario.area
    home_m, home_via = _ways_home(scenario)
    data_chance, n_sensors = _expected_data(scenario, is_known)
    return Briefing(
        n_rows=area.n_rows,
        n_columns=area.n_columns,
        cell_size_m=area.cell_size_m,
        is_open=row_of(open_cells(area).tolist()),
        known_complete=row_of(is_known.tolist()),
        has_obstacles=int(len(home_m) > 0),
        home_m=filled_row(home_m, 0.0),
        home_via=filled_row(home_via, 0),
        data_share=_data_share(scenario, is_known),
        hover_s=_hover_s(scenario, is_known),
        data_chance=data_chance,
        cell_data_bit=n_sensors * 1e6 * _mean_mbit(scenario),
        upload_bps=_mean_rate_bps(scenario, n_sensors),
        n_uavs=len(uavs),
        contact_range_m=_contact_range_m(scenario.radio),
        loss_share=scenario.radio.loss_share or 0.0,
        late_s=sum(scenario.radio.delay_s or (0.0, 0.0))
        + airtime_s(scenario.n_cells, scenario.radio.rate_bps),
        may_fail=int(bool(scenario.faults)),
        bandwidth_hz=scenario.bandwidth_hz,
        noise_w_per_hz=scenario.radio.noise_w_per_hz,
        tx_power_w=scenario.radio.tx_power_w,
        speed_mps=row_of([uav.speed_mps for uav in uavs]),
        flight_power_w=row_of([_power_w(scenario, uav, flying=True) for uav in range(len(uavs))]),
        hover_power_w=row_of([_power_w(scenario, uav, flying=False) for uav in range(len(uavs))]),
        start_x_m=row_of([uav.start_m[0] for uav in uavs]),
        start_y_m=row_of([uav.start_m[1] for uav in uavs]),
        home_x_m=row_of([uav.home_m[0] for uav in uavs]),
        home_y_m=row_of([uav.home_m[1] for uav in uavs]),
        home_cell=row_of([cell_of(area, uav.home_m) for uav in uavs]),
        energy_budget_j=row_of([uav.energy_budget_j for uav in uavs]),
        energy_margin_j=row_of([uav.energy_margin_j for uav in uavs]),
    )


def _ways_home(scenario: Scenario) -> tuple[list[float], list[int]]:
    """The ways home from all cells, by UAV; empty where all of them are straight."""
    if open_cells(scenario.area).all():
        return [], []
    ways = [ways_home(scenario.area, uav.home_m) for uav in scenario.uavs]
    if not any(way.has_turns for way in ways):
        return [], []
    return [m for way in ways for m in way.length_m], [cell for way in ways for cell in way.via]


def _data_share(scenario: Scenario, is_known: Ints) -> float:
    """The share of the cells of unknown demand that are to hold data; 0: UAVs do not know."""
    n_unknown = len(is_known) - int(is_known.sum())
    if not scenario.demand.is_empty_known or n_unknown == 0:
        return 0.0
    return min(mean_data_cells(scenario) / n_unknown, 1.0)


def _hover_s(scenario: Scenario, is_known: Ints) -> float:
    sensors, n_unknown = scenario.sensors, len(is_known) - int(is_known.sum())
    if not (isinstance(sensors, ListedSensors) and scenario.demand.is_empty_known):
        return 0.0
    return mean_hover_s(scenario, len(sensors.entries) / max(n_unknown, 1))


def mean_hover_s(scenario: Scenario, n_sensors: float) -> float:
    """What a hover takes over mean data at so many sensors, of mean gain and not far aside [s]."""
    return n_sensors * 1e6 * _mean_mbit(scenario) / _mean_rate_bps(scenario, n_sensors)


def _mean_rate_bps(scenario: Scenario, n_sensors: float) -> float:
    """The rate of so many sensors together, of mean gain and not far aside."""
    radio, area = scenario.radio, scenario.area
    aside_m = _MEAN_AWAY * area.cell_size_m
    angle_rad = elevation_rad(aside_m, area.altitude_m)
    in_sight = line_of_sight_probability(angle_rad, radio.los_a, radio.los_b)
    distance_m = math.hypot(area.altitude_m, aside_m)
    gain = path_gain(distance_m, reference_gain(radio.carrier_hz), radio.path_loss_exponent)
    gain *= radio.n_antennas * (in_sight + (1.0 - in_sight) * radio.nlos_attenuation)
    cn0_hz = n_sensors * radio.tx_power_w * float(gain) / radio.noise_w_per_hz
    snr = cn0_hz / scenario.bandwidth_hz
    # Of a faint signal 1 + snr loses the digits, at last all of them: the rate is above 0 still.
    bit_per_s_hz = math.log2(1.0 + snr) if snr > _FAINT_SNR else math.log1p(snr) / math.log(2.0)
    return scenario.bandwidth_hz * bit_per_s_hz


def _expected_data(scenario: Scenario, is_known: Ints) -> tuple[float, float]:
    """The chance that a cell of unknown demand holds data, and how many sensors it has then.

    All cells of unknown demand are alike to who does not know where the sensors are.
    """
    n_unknown, sensors = max(len(is_known) - int(is_known.sum()), 1), scenario.sensors
    if isinstance(sensors, DrawnSensors):
        dense = sensors.dense_cell_share
        mean = dense * sensors.dense_mean + (1.0 - dense) * sensors.sparse_mean
        bare = dense * math.exp(-sensors.dense_mean)
        bare += (1.0 - dense) * math.exp(-sensors.sparse_mean)
    else:
        mean = len(sensors.entries) / n_unknown if isinstance(sensors, ListedSensors) else 1.0
        bare = max(1.0 - mean, 0.0)
    has_sensors = 1.0 if scenario.demand.is_empty_known else 1.0 - bare
    chance = min(mean_data_cells(scenario) / n_unknown, has_sensors)
    return chance, max(mean / (1.0 - bare), 1.0) if bare < 1.0 else 1.0


def _mean_mbit(scenario: Scenario) -> float:
    """What a sensor with data holds on average [Mbit]."""
    amounts, sensors = scenario.demand.data_mbit, scenario.sensors
    if not isinstance(amounts, str):
        return (amounts[0] + amounts[1]) / 2.0
    if not isinstance(sensors, ListedSensors):
        return 0.0
    return math.fsum(each.data_mbit or 0.0 for each in sensors.entries) / len(sensors.entries)


def _contact_range_m(radio: RadioConfig) -> float:
    # Where no message arrives, nobody is in range: so UAVs know that they hear nothing.
    return 0.0 if radio.loss_share == 1.0 else radio.contact_range_m


def _power_w(scenario: Scenario, uav: int, *, flying: bool) -> float:
    config = scenario.uavs[uav]
    rotor = config.propulsion
    return propulsion_power_w(
        config.speed_mps if flying else 0.0,
        rotor.blade_profile_power_w,
        rotor.induced_power_w,
        rotor.tip_speed_mps,
        rotor.induced_speed_mps,
        rotor.parasite_coefficient,
    )

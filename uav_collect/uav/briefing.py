"""What every UAV knows before it takes off: the area, the fleet and the radio's constants."""

from typing import NamedTuple

from uav_collect.kernels.arrays import Row, row_of
from uav_collect.physics.energy import propulsion_power_w
from uav_collect.scenario.model import RadioConfig, Scenario


class Briefing(NamedTuple):
    """The scenario as far as UAVs know it; rows are indexed by UAV."""

    cells_per_side: int
    cell_size_m: float
    n_uavs: int
    contact_range_m: float  # inf: always in contact
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
    energy_budget_j: Row[float]
    energy_margin_j: Row[float]  # to be left when home


def brief(scenario: Scenario) -> Briefing:
    """The briefing of a scenario's fleet."""
    uavs = scenario.uavs
    return Briefing(
        cells_per_side=scenario.area.cells_per_side,
        cell_size_m=scenario.area.cell_size_m,
        n_uavs=len(uavs),
        contact_range_m=_contact_range_m(scenario.radio),
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
        energy_budget_j=row_of([uav.energy_budget_j for uav in uavs]),
        energy_margin_j=row_of([uav.energy_margin_j for uav in uavs]),
    )


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

"""The craft that is to fly over a field: its speed, its power, what its battery gives."""

from dataclasses import dataclass

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.fields.settings import FieldSettings, Wishes
from uav_collect.physics.energy import propulsion_powers_w
from uav_collect.scenario.airframes import airframe_named, KJ_PER_WH

_SPEEDS_MPS = np.arange(1.0, 40.5, 0.5)  # that are looked at for the widest flight


@dataclass(frozen=True, kw_only=True)
class Craft:
    """One UAV of a field's fleet; all are alike but for their speed."""

    airframe: str
    mass_kg: float
    speed_mps: float
    flight_power_w: float  # at that speed
    is_widest: bool  # whether no speed takes it farther
    battery_wh: float | None  # None: what its airframe comes with
    held_wh: float  # by that battery
    is_battery_asked: bool
    usable_share: float

    @property
    def energy_per_m_j(self) -> float:
        """Energy to fly a metre [J/m]."""
        return self.flight_power_w / self.speed_mps

    @property
    def energy_budget_kj(self) -> float:
        """Energy at the start [kJ]."""
        return self.usable_share * self.held_wh * KJ_PER_WH


def crafts_of(wishes: Wishes, settings: FieldSettings) -> tuple[Craft, ...]:
    """The fleet that is asked for; at the speed that takes it farthest, unless some are given.

    Raises:
        ConfigError: there is no such airframe, or it flies no speed that is asked for.
    """
    if wishes.speeds_mps is None:
        return (_craft(wishes, settings, None),) * wishes.n_uavs
    return tuple(_craft(wishes, settings, speed_mps) for speed_mps in wishes.speeds_mps)


def _craft(wishes: Wishes, settings: FieldSettings, speed_mps: float | None) -> Craft:
    name = wishes.airframe or settings.airframe
    airframe = airframe_named(name)
    if speed_mps is None:
        most_mps = airframe.max_speed_mps or np.inf
        speeds_mps = _SPEEDS_MPS[most_mps >= _SPEEDS_MPS]
    elif problem := airframe.too_fast(speed_mps):
        raise ConfigError(f'--speed {problem}')
    else:
        speeds_mps = np.array([speed_mps])
    powers_w = propulsion_powers_w(speeds_mps, **airframe.propulsion)
    best = int((powers_w / speeds_mps).argmin())
    battery_wh = wishes.battery_wh
    if battery_wh is None and airframe.battery_wh is None:
        battery_wh = settings.battery_wh
    return Craft(
        airframe=name,
        mass_kg=airframe.mass_kg,
        speed_mps=float(speeds_mps[best]),
        flight_power_w=float(powers_w[best]),
        is_widest=speed_mps is None,
        battery_wh=battery_wh,
        is_battery_asked=wishes.battery_wh is not None,
        held_wh=battery_wh or airframe.battery_wh or settings.battery_wh,
        usable_share=settings.battery_usable_share,
    )

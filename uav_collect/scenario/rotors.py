"""What power a craft with rotors takes, from what can be measured of it.

Source: Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless Communication With Rotary-Wing
UAV", IEEE Transactions on Wireless Communications 18(4), 2019: Table I, eq. (12) and the appendix
that derives it, for one rotor. Several rotors that share the weight are taken as one of their
discs together, which is the same: each carries its part, and the powers add up.
"""

from dataclasses import dataclass
import math

GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True, kw_only=True)
class Rotors:
    """The rotors of a craft and what they carry, in SI units."""

    weight_n: float  # W
    disc_m2: float  # A, of all rotors together
    solidity: float  # s, area of the blades over that of the disc
    tip_speed_mps: float  # U_tip = Omega R
    profile_drag: float  # delta, of a blade section
    induced_correction: float  # k, by which induced power exceeds the ideal one
    drag_area_m2: float  # S_FP = d_0 s A, fuselage equivalent flat plate area
    efficiency: float  # power at the rotors over power out of the battery
    air_density_kgpm3: float  # rho

    @property
    def blade_profile_power_w(self) -> float:
        """P_0 = delta/8 rho s A Omega^3 R^3 [W], out of the battery."""
        profile = self.profile_drag / 8.0 * self.air_density_kgpm3 * self.solidity * self.disc_m2
        return profile * self.tip_speed_mps**3 / self.efficiency

    @property
    def induced_power_w(self) -> float:
        """P_i = (1 + k) W^1.5 / sqrt(2 rho A) [W], out of the battery."""
        ideal_w = self.weight_n * self.induced_speed_mps
        return (1.0 + self.induced_correction) * ideal_w / self.efficiency

    @property
    def induced_speed_mps(self) -> float:
        """v_0 = sqrt(W / (2 rho A)) [m/s], mean induced speed in hover."""
        return math.sqrt(self.weight_n / (2.0 * self.air_density_kgpm3 * self.disc_m2))

    @property
    def parasite_coefficient(self) -> float:
        """P_2 = 1/2 d_0 rho s A = 1/2 rho S_FP [W s^3/m^3], out of the battery."""
        return 0.5 * self.air_density_kgpm3 * self.drag_area_m2 / self.efficiency


def solidity_of(blades: int, chord_m: float, radius_m: float) -> float:
    """Area of the blades of a rotor over that of its disc: s = b c / (pi R)."""
    return blades * chord_m / (math.pi * radius_m)


def disc_area_m2(count: int, radius_m: float) -> float:
    """A: area of the discs of all rotors together [m^2]."""
    return count * math.pi * radius_m * radius_m


def hover_tip_speed_mps(
    weight_n: float,
    disc_m2: float,
    solidity: float,
    lift_coefficient: float,
    air_density_kgpm3: float,
) -> float:
    """Speed of the blades' tips [m/s] at which they carry the weight in hover.

    Args:
        lift_coefficient: mean one of the blades' sections.

    Source: W = rho A s C_L U_tip^2 / 6, the lift of blade elements c dr at speeds Omega r, summed
    from 0 to R.
    """
    return math.sqrt(6.0 * weight_n / (air_density_kgpm3 * disc_m2 * solidity * lift_coefficient))

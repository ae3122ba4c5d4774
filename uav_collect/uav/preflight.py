"""Whether a fleet has the energy to take off, and if not, what each UAV lacks."""

from uav_collect.kernels.rows import new_row
from uav_collect.scenario.load import ConfigError, Scenario
from uav_collect.uav import actions
from uav_collect.uav.actions import N_ACTIONS
from uav_collect.uav.briefing import Briefing


def check_can_start(scenario: Scenario, briefing: Briefing) -> None:
    """Raise ConfigError unless every UAV can land with its margin and one of them can do more."""
    uavs = range(briefing.n_uavs)
    stranded = [uav for uav in uavs if briefing.energy_budget_j[uav] < _to_land_j(briefing, uav)]
    if stranded:
        needs = '; '.join(_start_needs(briefing, uav) for uav in stranded)
        raise ConfigError(f'scenario {scenario.name}: too little energy for the way home: {needs}')
    # In an area of one cell there is nowhere to move to; a UAV hovers there, or lands.
    if briefing.cells_per_side == 1 or any(_can_move(briefing, uav) for uav in uavs):
        return
    needs = '; '.join(_start_needs(briefing, uav) for uav in uavs)
    raise ConfigError(
        f'scenario {scenario.name}: no UAV has the energy for a single move: {needs}'
    )


def _to_land_j(briefing: Briefing, uav: int) -> float:
    x_m, y_m = briefing.start_x_m[uav], briefing.start_y_m[uav]
    return actions.home_energy_j(briefing, uav, x_m, y_m) + briefing.energy_margin_j[uav]


def _can_move(briefing: Briefing, uav: int) -> bool:
    x_m, y_m = briefing.start_x_m[uav], briefing.start_y_m[uav]
    budget_j, legal = briefing.energy_budget_j[uav], new_row(N_ACTIONS, 0)
    return actions.mark_legal(briefing, uav, x_m, y_m, budget_j, actions.NONE, 0.0, legal) > 0


def _start_needs(briefing: Briefing, uav: int) -> str:
    margin_j = briefing.energy_margin_j[uav]
    move_j = briefing.flight_power_w[uav] * actions.move_duration_s(briefing, uav)
    return (
        f'UAV {uav + 1} has {briefing.energy_budget_j[uav] / 1e3:.4g} kJ; the way home from its '
        f'start costs {(_to_land_j(briefing, uav) - margin_j) / 1e3:.4g} kJ, a move '
        f'{move_j / 1e3:.4g} kJ, and {margin_j / 1e3:.4g} kJ must be left when it lands'
    )

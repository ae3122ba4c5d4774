"""A clairvoyant plan as the world flies it, so that it has a log as any flight has."""

from uav_collect.missions.event_log import mission_header
from uav_collect.missions.given_actions import GivenActions
from uav_collect.missions.simulation import fly_agents, Simulation
from uav_collect.planning.bound import flight_actions, Plan
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.agent import Agent, allocator_named


def fly_plan(site: Site, mission_seed: int, plan: Plan, allocator: str, name: str) -> MissionLog:
    """Fly a plan of a mission.

    Args:
        plan: of the same mission and allocator.
        allocator: how bandwidth is shared, one of `limits.ALLOCATOR_NAMES`.
        name: stands for the policy in the log.
    """
    simulation = Simulation(site, mission_seed)
    agents = [
        Agent(simulation.briefing, uav, GivenActions(actions, name), allocator_named(allocator))
        for uav, actions in enumerate(flight_actions(site.scenario, plan))
    ]
    for _ in fly_agents(simulation, agents):
        pass
    n_uavs, demand_bit = len(agents), simulation.demand_bit
    flown_by = [name] * n_uavs, [allocator] * n_uavs, [NONE] * n_uavs
    header = mission_header(site.scenario, mission_seed, demand_bit, *flown_by)
    return simulation.log(header)

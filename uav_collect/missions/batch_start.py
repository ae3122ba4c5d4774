"""Missions side by side at their start, and one of them back there."""

from collections.abc import Sequence

from uav_collect.kernels.arrays import new_map_table, new_row, new_table, Row
from uav_collect.kernels.compile import kernel
from uav_collect.kernels.handle import Handle
from uav_collect.missions.batch_kernels import Batch, IN_FLIGHT, Settings, Waiting
from uav_collect.missions.event_log import new_log
from uav_collect.missions.experience import new_records
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.agent import new_workspace, WATCH_SIZE
from uav_collect.uav.belief import belief_of, forget, new_beliefs
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.heuristics import MEMORY_SIZE, shares_for
from uav_collect.uav.moves import new_moves
from uav_collect.uav.observation import Layout, observation_size
from uav_collect.uav.view import new_view_rows
from uav_collect.world import exchange
from uav_collect.world.dynamics import mission_of
from uav_collect.world.faults import draw_all_faults, draw_faults, faults_of
from uav_collect.world.mission_start import new_missions, restart_mission
from uav_collect.world.reward import (
    KILOJOULE_J,
    new_earnings,
    Reward,
    reward_terms,
    start_earning,
)
from uav_collect.world.sensor_field import lay_out, most_sensors

_ENERGY = int(Reward.ENERGY)


def new_batch(
    site: Site,
    mission_seeds: Sequence[int],
    settings: Settings,
    log_capacity: int = 1,
    energy_unit_j: float = KILOJOULE_J,
) -> Batch:
    """Missions at their start, all in flight.

    Args:
        log_capacity: events of a mission that the log has room for.
        energy_unit_j: energy that takes one from the energy reward [J].

    Raises:
        ConfigError: the layout has no room for the fleet.
    """
    briefing, sensor_field = briefing_of(site), lay_out(site)
    n_worlds, n_uavs = len(mission_seeds), briefing.n_uavs
    n_cells = briefing.n_rows * briefing.n_columns
    max_sensors, is_news_wanted = most_sensors(sensor_field), settings.reward == _ENERGY
    link, faults = exchange.link_of(site.scenario), faults_of(site.scenario)
    missions = new_missions(briefing, sensor_field, mission_seeds)
    if len(faults.kind) > 0:
        draw_all_faults(faults, missions, n_worlds)
    complete = new_map_table(n_worlds if is_news_wanted else 1, n_cells)
    for world in range(len(complete)):
        for cell in range(n_cells):
            complete[world][cell] = briefing.known_complete[cell]
    return Batch(
        settings=settings,
        briefing=briefing,
        sensor_field=sensor_field,
        terms=reward_terms(site, energy_unit_j),
        missions=missions,
        link=link,
        airwaves=exchange.new_airwaves(link, briefing, n_worlds),
        faults=faults,
        may_fail=int(len(faults.kind) > 0),
        beliefs=new_beliefs(briefing, n_worlds * n_uavs),
        shares=shares_for(settings.adviser if settings.rule == NONE else settings.rule, briefing),
        moves=new_moves(briefing),
        memory=new_table(n_worlds * n_uavs, MEMORY_SIZE, 0),
        watch=new_table(n_worlds * n_uavs, WATCH_SIZE, NONE),
        complete=complete,
        n_events=new_row(n_worlds, 0),
        earnings=new_earnings(n_worlds),
        waiting=_new_waiting(settings.layout, briefing, n_worlds),
        log=new_log(n_worlds, log_capacity),
        records=new_records(max(1, n_worlds * settings.n_rows), briefing),
        workspace=new_workspace(max_sensors),
        view_rows=new_view_rows(max_sensors),
    )


def _new_waiting(layout: int, briefing: Briefing, n_worlds: int) -> Waiting:
    size = 1
    if layout != NONE:
        size = observation_size(Layout(layout), len(briefing.is_open), briefing.n_uavs)
    return Waiting(
        uav=new_row(n_worlds, IN_FLIGHT),
        time_s=new_row(n_worlds, 0.0),
        duration_s=new_row(n_worlds, 0.0),
        reward=new_row(n_worlds, 0.0),
        legal=new_table(n_worlds, N_ACTIONS, 0),
        advice=new_row(n_worlds, NONE),
        observation=new_table(n_worlds, size, 0.0),
        heard=new_row(n_worlds, 0),
        n_records=new_row(n_worlds, 0),
    )


@kernel
def restart_all(held: Handle[Batch], worlds: Row[int]) -> None:
    """Put missions back to their start, by their own seeds."""
    for world in worlds:
        _restart(held.rows, world)


@kernel
def _restart(batch: Batch, world: int) -> None:
    """Put a mission back to its start, by its own seed."""
    n_uavs = batch.briefing.n_uavs
    restart_mission(batch.briefing, batch.sensor_field, mission_of(batch.missions, world))
    draw_faults(batch.faults, mission_of(batch.missions, world))
    if batch.link.is_ideal == 0:
        exchange.clear(exchange.airwaves_of(batch.airwaves, world))
    for place in range(world * n_uavs, (world + 1) * n_uavs):
        forget(belief_of(batch.beliefs, place), batch.briefing)
        for index in range(MEMORY_SIZE):
            batch.memory[place][index] = 0
        for index in range(WATCH_SIZE):
            batch.watch[place][index] = NONE
    if batch.settings.reward == _ENERGY:
        for cell in range(len(batch.complete[world])):
            batch.complete[world][cell] = batch.briefing.known_complete[cell]
    batch.n_events[world] = 0
    start_earning(batch.earnings, world, 0.0)
    batch.waiting.n_records[world] = 0
    batch.waiting.uav[world] = IN_FLIGHT

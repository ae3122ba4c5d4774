"""Missions flown side by side: the world's rows, what UAVs believe, and a UAV's arrival."""

from collections.abc import Sequence
from typing import NamedTuple

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel, row_kernel
from uav_collect.kernels.rows import new_table
from uav_collect.uav.agent import allocate, Desk, must_go_home, new_desk
from uav_collect.uav.belief import belief_of, Beliefs, hear, new_beliefs, observe
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.heuristics import MEMORY_SIZE
from uav_collect.uav.view import LocalView, new_view_rows, ViewRows
from uav_collect.world.dynamics import in_contact, look, x_m_at, y_m_at
from uav_collect.world.sensor_field import Ground, most_sensors
from uav_collect.world.state import mission_of, Missions, new_missions


class Batch(NamedTuple):
    """Missions side by side, and what their UAVs believe and remember."""

    missions: Missions
    beliefs: Beliefs  # by mission, then UAV: (W * U, ...)
    memory: Row[Row[int]]  # of the rules, the same
    n_events: Row[Row[int]]  # (W, 1)
    desk: Desk
    view_rows: ViewRows


def new_batch(briefing: Briefing, ground: Ground, mission_seeds: Sequence[int]) -> Batch:
    """Missions at their start."""
    n_worlds, n_uavs = len(mission_seeds), briefing.n_uavs
    view_rows = new_view_rows(most_sensors(ground))
    return Batch(
        missions=new_missions(briefing, ground, mission_seeds),
        beliefs=new_beliefs(briefing, n_worlds * n_uavs),
        memory=new_table(n_worlds * n_uavs, MEMORY_SIZE, 0),
        n_events=new_table(n_worlds, 1, 0),
        desk=new_desk(len(view_rows.sensor)),
        view_rows=view_rows,
    )


@row_kernel
def arrive(
    allocator: int, briefing: Briefing, ground: Ground, batch: Batch, world: int, uav: int
) -> tuple[LocalView, int, int]:
    """Let a UAV do what it does at its action's end before it chooses: look, talk, allocate.

    The bandwidth shares and the legal actions lie on the batch's desk.

    Returns:
        What it sees; why it must go home, or NONE; the UAVs in contact, as bits.
    """
    mission = mission_of(batch.missions, world)
    view = look(briefing, ground, mission, uav, batch.view_rows)
    belief = belief_of(batch.beliefs, world * briefing.n_uavs + uav)
    observe(belief, briefing, view)
    heard = _exchange(briefing, batch, world, uav, view.time_s)
    hover_s = allocate(allocator, briefing, view, batch.desk)
    legal = batch.desk.legal
    return view, must_go_home(briefing, uav, belief.n_complete[0], view, hover_s, legal), heard


@kernel
def _exchange(briefing: Briefing, batch: Batch, world: int, uav: int, time_s: float) -> int:
    """The deciding UAV hears all in contact, then they hear it; a bit mask of who they are."""
    mission = mission_of(batch.missions, world)
    first = world * briefing.n_uavs
    belief = belief_of(batch.beliefs, first + uav)
    heard = 0
    for other in range(briefing.n_uavs):
        if in_contact(briefing, mission, uav, other, time_s):
            heard |= 1 << other
            x_m, y_m = x_m_at(mission, other, time_s), y_m_at(mission, other, time_s)
            hear(belief, other, batch.beliefs.complete[first + other], x_m, y_m, time_s)
    x_m, y_m = x_m_at(mission, uav, time_s), y_m_at(mission, uav, time_s)
    for other in range(briefing.n_uavs):
        if heard >> other & 1:
            peer = belief_of(batch.beliefs, first + other)
            hear(peer, uav, belief.complete, x_m, y_m, time_s)
    return heard

"""The mission log of one mission of a batch."""

from dataclasses import replace
import math

from uav_collect.missions.batch_kernels import Batch
from uav_collect.missions.event_log import logged_events
from uav_collect.recording.mission_log import MissionHeader, MissionLog
from uav_collect.world.dynamics import mission_of
from uav_collect.world.faults import fault_records


def log_of(batch: Batch, header: MissionHeader, world: int) -> MissionLog:
    """What a mission has logged so far.

    Args:
        header: of a mission of the same scenario and fleet; its seed and data are put in.
    """
    seed = int(batch.missions.seed[world][0])
    total_bit = math.fsum(batch.missions.demand_bit[world])
    return MissionLog(
        header=replace(header, mission_seed=seed, total_bit=total_bit),
        events=logged_events(batch.log, world, batch.n_events[world]),
        faults=fault_records(mission_of(batch.missions, world)),
    )

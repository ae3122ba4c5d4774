"""Many missions at once, stepped from outside: what a learner and a learned policy drive.

Every mission waits for one decision, that of the UAV whose action ended first. A step carries
out a decision of each mission and goes on to the next one: looking, talking, sharing bandwidth
and turning home happen as in a rollout, by the same kernels.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.errors import AllocationError
from uav_collect.kernels.arrays import Bools, check_shape, Floats, Ints
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.kernels.rows import new_map_table, new_row, new_table
from uav_collect.missions.batch import new_batch
from uav_collect.missions.batch_kernels import (
    Air,
    Desks,
    explore_batch,
    go_on,
    put_back,
    Rules,
    step_batch,
)
from uav_collect.missions.event_log import grown_log, logged_events, new_log
from uav_collect.missions.experience import (
    Episode,
    N_UAV_SCALARS,
    new_records,
    Records,
    write_fleet,
)
from uav_collect.missions.simulation import mission_header
from uav_collect.physics.bandwidth import EQUAL, EXACT
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.site import Site
from uav_collect.uav.actions import check_can_start, N_ACTIONS, NONE
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.observation import Layout, observation_size
from uav_collect.world.reward import Reward
from uav_collect.world.sensor_field import demand_by_cell, lay_out
from uav_collect.world.state import mission_of

KERNELS = (step_batch,)  # that carry missions from one decision to the next
_FIRST_CAPACITY = 256  # events of a mission that the log has room for before it must grow


@dataclass(frozen=True, kw_only=True)
class Stepping:
    """How missions are stepped."""

    layout: Layout = Layout.EGOCENTRIC
    allocator: str = 'equal'  # or 'exact'
    reward: Reward = Reward.PAPER
    is_synchronous: bool = False  # UAVs wait for each other and decide at the same instants
    is_logged: bool = False  # missions leave a log
    max_decisions: int = 0  # so many decisions of a mission are recorded for a learner


@dataclass(frozen=True, kw_only=True)
class Decisions:
    """The decisions that missions wait for, by mission. Valid until the next step or restart.

    What a UAV that turns home would have decided belongs to the decision before: reward and
    duration go on until a UAV decides again, or all have landed.
    """

    uav: Ints  # (W,) index of the UAV that decides; NONE (-1) where the mission is over
    time_s: Floats  # (W,)
    observation: Floats  # (W, observation_size)
    legal: Bools  # (W, N_ACTIONS)
    reward: Floats  # (W,) since the decision before, discounted to it
    duration_s: Floats  # (W,) since the decision before


class Flights:
    """Missions in flight that ask for one decision each."""

    def __init__(self, site: Site, mission_seeds: Sequence[int], stepping: Stepping) -> None:
        """Take off.

        Args:
            mission_seeds: one per mission, 0..2^63-1.

        Raises:
            AllocationError: the allocator is not one that kernels know.
            ConfigError: no UAV has the energy to start, or the layout has no room for the fleet.
        """
        self._scenario, self._stepping = site.scenario, stepping
        briefing, ground = brief(site.scenario), lay_out(site)
        check_can_start(site.scenario, briefing)
        rules = _rules(stepping)
        n_worlds = len(mission_seeds)
        self._air = Air(
            rules=rules,
            briefing=briefing,
            ground=ground,
            batch=new_batch(briefing, ground, mission_seeds),
            desks=_new_desks(stepping.layout, briefing, n_worlds),
            log=new_log(n_worlds, _FIRST_CAPACITY if stepping.is_logged else 1),
            records=new_records(max(1, n_worlds * rules.n_rows), briefing),
        )
        for world, seed in enumerate(mission_seeds):
            self.restart(world, seed)

    @property
    def briefing(self) -> Briefing:
        """What the UAVs know before they take off."""
        return self._air.briefing

    @property
    def decisions(self) -> Decisions:
        """What the missions wait for."""
        desks = self._air.desks
        return Decisions(
            uav=np.asarray(desks.uav),
            time_s=np.asarray(desks.time_s),
            observation=np.asarray(desks.observation),
            legal=np.asarray(desks.legal) == 1,
            reward=np.asarray(desks.reward),
            duration_s=np.asarray(desks.duration_s),
        )

    @property
    def n_recorded(self) -> Ints:
        """How many decisions of each mission are recorded, the one it waits for included, (W,)."""
        return np.asarray(self._air.desks.n_records)

    def step(self, actions: Ints) -> Decisions:
        """Carry out one decision of each mission.

        Args:
            actions: shape (W,); ignored where the mission is over.

        Returns:
            The next decisions, with the rewards of these.

        Raises:
            ValueError: an action is not legal.
        """
        waiting = self.decisions
        check_shape(actions, waiting.uav.shape, 'actions')
        is_legal = waiting.legal[np.arange(len(actions)), np.clip(actions, 0, N_ACTIONS - 1)]
        is_legal &= (actions >= 0) & (actions < N_ACTIONS)
        refused = np.flatnonzero((waiting.uav != NONE) & ~is_legal)
        if len(refused):
            world = refused[0]
            seed = self._air.batch.missions.seed[world][0]
            raise ValueError(
                f'action {actions[world]} of UAV {waiting.uav[world] + 1} in mission {seed} is '
                f'not legal; legal are {np.flatnonzero(waiting.legal[world]).tolist()}'
            )
        self._make_room()
        row = np.ascontiguousarray(actions, dtype=np.int64)
        answers: Any = row if kernels_are_compiled() else row.tolist()
        step_batch(self._air, answers)
        return self.decisions

    def explore(self, epsilon: float, hover_share: float) -> Ints:
        """Random actions where UAVs explore, NONE elsewhere, (W,); see `exploration.explore`."""
        actions = new_row(len(self._air.desks.uav), NONE)
        explore_batch(self._air, epsilon, hover_share, actions)
        return np.asarray(actions)

    def restart(self, world: int, mission_seed: int) -> None:
        """Let another mission take off in the place of one."""
        self._air.batch.missions.seed[world][0] = mission_seed
        put_back(self._air, world)
        go_on(self._air, world)

    def episode(self, world: int) -> Episode:
        """What was recorded of a mission, copied; cut off if the mission is still under way."""
        first = world * self._air.rules.n_rows
        rows = slice(first, first + int(self.n_recorded[world]))
        missions = self._air.batch.missions
        tables: list[Any] = [np.array(table[rows]) for table in self._air.records]
        return Episode(
            mission_seed=int(missions.seed[world][0]),
            demand_bit=demand_by_cell(self._air.ground.first_sensor, missions.demand_bit[world]),
            records=Records(*tables),
            is_whole=self._air.desks.uav[world] == NONE,
        )

    def mission_log(self, world: int, policy_name: str) -> MissionLog:
        """The log of a mission so far; the missions must be logged."""
        demand_bit = self._air.batch.missions.demand_bit[world]
        seed = int(self._air.batch.missions.seed[world][0])
        n_uavs = self._scenario.n_uavs
        header = mission_header(
            self._scenario, seed, (), [policy_name] * n_uavs, [self._stepping.allocator] * n_uavs
        )
        return MissionLog(
            header=replace(header, total_bit=math.fsum(demand_bit)),
            events=logged_events(self._air.log, world, self._air.batch.n_events[world][0]),
        )

    def global_state(self, world: int) -> Floats:
        """What a mixer is told of a mission: numbers from 0 to 1.

        Returns:
            Of each UAV east and north as shares of the area's side, energy left as a share of its
            budget, and whether it still decides; then each UAV's completion map; then the true
            one. Shape (U * N_UAV_SCALARS + (U + 1) * C,).
        """
        air, n_uavs = self._air, self._scenario.n_uavs
        mission = mission_of(air.batch.missions, world)
        fleet = new_row(n_uavs * N_UAV_SCALARS, 0.0)
        for uav in range(n_uavs):
            write_fleet(fleet, air.briefing, mission, uav, air.desks.time_s[world])
        known = [air.batch.beliefs.complete[world * n_uavs + uav] for uav in range(n_uavs)]
        is_empty = np.asarray(mission.cell_bit) <= 0.0
        return np.concatenate([np.asarray(fleet), *map(np.asarray, known), is_empty])

    def efficiency_kbit_per_j(self, world: int) -> float:
        """Data that a mission has collected over the energy it has spent, both so far."""
        missions = self._air.batch.missions
        spent_j = sum(self._air.briefing.energy_budget_j) - sum(missions.energy_left_j[world])
        return missions.collected_bit[world][0] / spent_j / 1e3 if spent_j > 0.0 else 0.0

    def arrays(self) -> list[NDArray[Any]]:
        """All that changes in flight, in a fixed order; writing into them sets the flights back.

        Only where kernels are compiled: interpreted ones work on lists.
        """
        return [*_arrays(self._air.batch), *_arrays(self._air.desks), *_arrays(self._air.records)]

    def _make_room(self) -> None:
        if not self._stepping.is_logged:
            return
        n_worlds, capacity = len(self._air.log.event), len(self._air.log.event[0])
        most = int(np.max(np.asarray(self._air.batch.n_events)))
        if most + 1 + self._air.briefing.n_uavs > capacity:
            self._air = self._air._replace(log=grown_log(self._air.log, n_worlds))


def _arrays(rows: tuple[Any, ...]) -> Iterator[NDArray[Any]]:
    for part in rows:
        if isinstance(part, tuple):
            yield from _arrays(part)
        else:
            yield part


def _rules(stepping: Stepping) -> Rules:
    codes = {'exact': EXACT, 'equal': EQUAL}
    if stepping.allocator not in codes:
        raise AllocationError(
            f'allocator {stepping.allocator!r} cannot be stepped; there are {", ".join(codes)}'
        )
    return Rules(
        layout=int(stepping.layout),
        allocator=codes[stepping.allocator],
        reward=int(stepping.reward),
        is_synchronous=int(stepping.is_synchronous),
        is_logged=int(stepping.is_logged),
        n_rows=stepping.max_decisions + 1 if stepping.max_decisions else 0,
    )


def _new_desks(layout: Layout, briefing: Briefing, n_worlds: int) -> Desks:
    side = briefing.cells_per_side
    size = observation_size(layout, side, briefing.n_uavs)
    return Desks(
        uav=new_row(n_worlds, 0),
        time_s=new_row(n_worlds, 0.0),
        duration_s=new_row(n_worlds, 0.0),
        reward=new_row(n_worlds, 0.0),
        legal=new_table(n_worlds, N_ACTIONS, 0),
        observation=new_table(n_worlds, size, 0.0),
        heard=new_row(n_worlds, 0),
        n_records=new_row(n_worlds, 0),
        complete=new_map_table(n_worlds, side * side),
    )

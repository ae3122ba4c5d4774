"""Many missions at once, stepped from outside: what a learner drives.

Every mission waits for one decision, that of the UAV whose action ended first. A step carries
out a decision of each mission and goes on to the next one: looking, talking, sharing bandwidth
and turning home happen as in a rollout, by the same kernels.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from uav_collect.actions import HOME, HOVER, N_ACTIONS, NONE
from uav_collect.agent import allocate
from uav_collect.arrays import Bools, check_shape, Floats, Ints, Row
from uav_collect.bandwidth import AllocationError, EQUAL, EXACT
from uav_collect.belief import belief_of, forget
from uav_collect.briefing import brief, Briefing
from uav_collect.compiled import kernel, kernels_are_compiled
from uav_collect.ground import Ground, lay_out
from uav_collect.missions import mission_of, restart_mission
from uav_collect.observation import encode, Layout, observation_size
from uav_collect.preflight import check_can_start
from uav_collect.reward import discount, interval_reward, terminal_reward
from uav_collect.rollout import arrive, Batch, new_batch
from uav_collect.rows import new_row, new_table
from uav_collect.scenario import Scenario
from uav_collect.site import Site
from uav_collect.world import end_s, look, next_uav, start_action


class _Desks(NamedTuple):
    """What each mission waits for; kernels write it."""

    uav: Row[int]  # (W,) NONE once the mission is over
    time_s: Row[float]  # (W,)
    duration_s: Row[float]  # (W,)
    reward: Row[float]  # (W,)
    legal: Row[Row[int]]  # (W, N_ACTIONS)
    observation: Row[Row[float]]  # (W, observation_size)


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

    def __init__(
        self,
        scenario: Scenario,
        site: Site,
        mission_seeds: Sequence[int],
        *,
        layout: Layout = Layout.EGOCENTRIC,
        allocator: str = 'equal',
    ) -> None:
        """Take off.

        Args:
            mission_seeds: one per mission, 0..2^63-1.
            allocator: 'exact' or 'equal'.

        Raises:
            AllocationError: the allocator is none of these.
            ConfigError: no UAV has the energy to start.
        """
        codes = {'exact': EXACT, 'equal': EQUAL}
        if allocator not in codes:
            raise AllocationError(
                f'allocator {allocator!r} cannot be stepped; there are {", ".join(codes)}'
            )
        self._briefing, self._ground = brief(scenario), lay_out(scenario, site)
        check_can_start(scenario, self._briefing)
        self._rules = int(layout), codes[allocator]
        self._batch = new_batch(self._briefing, self._ground, mission_seeds)
        n_worlds = len(mission_seeds)
        size = observation_size(layout, self._briefing.cells_per_side, self._briefing.n_uavs)
        self._desks = _Desks(
            uav=new_row(n_worlds, 0),
            time_s=new_row(n_worlds, 0.0),
            duration_s=new_row(n_worlds, 0.0),
            reward=new_row(n_worlds, 0.0),
            legal=new_table(n_worlds, N_ACTIONS, 0),
            observation=new_table(n_worlds, size, 0.0),
        )
        for world, seed in enumerate(mission_seeds):
            self.restart(world, seed)

    @property
    def decisions(self) -> Decisions:
        """What the missions wait for."""
        desks = self._desks
        return Decisions(
            uav=np.asarray(desks.uav),
            time_s=np.asarray(desks.time_s),
            observation=np.asarray(desks.observation),
            legal=np.asarray(desks.legal) == 1,
            reward=np.asarray(desks.reward),
            duration_s=np.asarray(desks.duration_s),
        )

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
            raise ValueError(
                f'action {actions[world]} of UAV {waiting.uav[world] + 1} in mission {world} is '
                f'not legal; legal are {np.flatnonzero(waiting.legal[world]).tolist()}'
            )
        row = np.ascontiguousarray(actions, dtype=np.int64)
        answers = row if kernels_are_compiled() else row.tolist()
        _step_batch(*self._rules, self._briefing, self._ground, self._batch, answers, self._desks)
        return self.decisions

    def restart(self, world: int, mission_seed: int) -> None:
        """Let another mission take off in the place of one."""
        self._batch.missions.seed[world][0] = mission_seed
        _put_back(self._briefing, self._ground, self._batch, world)
        _go_on(*self._rules, self._briefing, self._ground, self._batch, world, self._desks)


@kernel
def _step_batch(
    layout: int,
    allocator: int,
    briefing: Briefing,
    ground: Ground,
    batch: Batch,
    answers: Row[int],
    desks: _Desks,
) -> None:
    for world in range(len(answers)):
        uav = desks.uav[world]
        if uav == NONE:
            desks.duration_s[world] = 0.0
            desks.reward[world] = 0.0
            continue
        mission = mission_of(batch.missions, world)
        # A second look shows the same channels as the first.
        view = look(briefing, ground, mission, uav, batch.view_rows)
        if answers[world] == HOVER:
            allocate(allocator, briefing, view, batch.desk)
        start_action(briefing, mission, uav, view, answers[world], batch.desk.share_hz)
        _go_on(layout, allocator, briefing, ground, batch, world, desks)


@kernel
def _put_back(briefing: Briefing, ground: Ground, batch: Batch, world: int) -> None:
    restart_mission(briefing, ground, mission_of(batch.missions, world))
    for uav in range(briefing.n_uavs):
        forget(belief_of(batch.beliefs, world * briefing.n_uavs + uav))


@kernel
def _go_on(
    layout: int,
    allocator: int,
    briefing: Briefing,
    ground: Ground,
    batch: Batch,
    world: int,
    desks: _Desks,
) -> None:
    """Go on to the next decision, past the UAVs that turn home."""
    mission = mission_of(batch.missions, world)
    first_s = mission.clock_s[0]
    start_s = first_s
    reward = 0.0
    while True:
        uav = next_uav(mission)
        stop_s = mission.leg_end_s[uav] if uav >= 0 else end_s(mission)
        gained = interval_reward(briefing, ground, mission, start_s, stop_s)
        gained += terminal_reward(briefing, ground, mission, start_s)
        reward += discount(ground, start_s - first_s) * gained
        start_s = stop_s
        if uav < 0:
            break
        view, reason, _ = arrive(allocator, briefing, ground, batch, world, uav)
        if reason == NONE:
            belief = belief_of(batch.beliefs, world * briefing.n_uavs + uav)
            encode(layout, briefing, uav, belief, view, desks.observation[world])
            break
        start_action(briefing, mission, uav, view, HOME, batch.desk.share_hz)
    for action in range(N_ACTIONS):
        desks.legal[world][action] = batch.desk.legal[action] if uav >= 0 else 0
    desks.uav[world] = uav
    desks.time_s[world] = start_s
    desks.duration_s[world] = start_s - first_s
    desks.reward[world] = reward

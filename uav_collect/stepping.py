"""Many missions at once, stepped from outside: what a learner and a learned policy drive.

Every mission waits for one decision, that of the UAV whose action ended first. A step carries
out a decision of each mission and goes on to the next one: looking, talking, sharing bandwidth
and turning home happen as in a rollout, by the same kernels.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from uav_collect import actions
from uav_collect.actions import HOME, HOVER, N_ACTIONS, NONE
from uav_collect.agent import allocate
from uav_collect.arrays import Bools, check_shape, Floats, Ints, Row
from uav_collect.bandwidth import AllocationError, EQUAL, EXACT
from uav_collect.batch import arrive, Batch, new_batch
from uav_collect.belief import belief_of, forget
from uav_collect.briefing import brief, Briefing
from uav_collect.compiled import kernel, kernels_are_compiled
from uav_collect.event_log import (
    EventLog,
    grown_log,
    log_event,
    log_interval,
    logged_events,
    new_log,
)
from uav_collect.experience import Episode, new_records, record, Records
from uav_collect.exploration import explore
from uav_collect.ground import Ground, lay_out
from uav_collect.mission_log import MissionLog
from uav_collect.missions import LocalView, Mission, mission_of, restart_mission
from uav_collect.observation import encode, Layout, observation_size
from uav_collect.preflight import check_can_start
from uav_collect.reward import discount, energy_reward, interval_reward, Reward, terminal_reward
from uav_collect.rows import new_map_table, new_row, new_table
from uav_collect.scenario import Scenario
from uav_collect.simulation import mission_header
from uav_collect.site import Site
from uav_collect.world import end_s, look, next_uav, start_action, wait_for_the_slowest

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


class _Rules(NamedTuple):
    layout: int
    allocator: int
    reward: int
    is_synchronous: int
    is_logged: int
    n_rows: int  # records that a mission has room for


class _Desks(NamedTuple):
    """What each mission waits for; kernels write it."""

    uav: Row[int]  # (W,) NONE once the mission is over
    time_s: Row[float]  # (W,)
    duration_s: Row[float]  # (W,)
    reward: Row[float]  # (W,)
    legal: Row[Row[int]]  # (W, N_ACTIONS)
    observation: Row[Row[float]]  # (W, observation_size)
    heard: Row[int]  # (W,) UAVs in contact, as bits
    n_records: Row[int]  # (W,)
    complete: Row[Row[int]]  # (W, C) the union of the UAVs' maps


class _Air(NamedTuple):
    """All that kernels need of the flights."""

    rules: _Rules
    briefing: Briefing
    ground: Ground
    batch: Batch
    desks: _Desks
    log: EventLog
    records: Records


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
        self, scenario: Scenario, site: Site, mission_seeds: Sequence[int], stepping: Stepping
    ) -> None:
        """Take off.

        Args:
            mission_seeds: one per mission, 0..2^63-1.

        Raises:
            AllocationError: the allocator is not one that kernels know.
            ConfigError: no UAV has the energy to start, or the layout has no room for the fleet.
        """
        self._scenario, self._stepping = scenario, stepping
        briefing = brief(scenario)
        check_can_start(scenario, briefing)
        rules = _rules(stepping)
        n_worlds = len(mission_seeds)
        self._air = _Air(
            rules=rules,
            briefing=briefing,
            ground=lay_out(scenario, site),
            batch=new_batch(briefing, lay_out(scenario, site), mission_seeds),
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
            raise ValueError(
                f'action {actions[world]} of UAV {waiting.uav[world] + 1} in mission {world} is '
                f'not legal; legal are {np.flatnonzero(waiting.legal[world]).tolist()}'
            )
        self._make_room()
        row = np.ascontiguousarray(actions, dtype=np.int64)
        answers: Any = row if kernels_are_compiled() else row.tolist()
        _step_batch(self._air, answers)
        return self.decisions

    def explore(self, epsilon: float, hover_share: float) -> Ints:
        """Random actions where UAVs explore, NONE elsewhere, (W,); see `exploration.explore`."""
        actions = new_row(len(self._air.desks.uav), NONE)
        _explore_batch(self._air, epsilon, hover_share, actions)
        return np.asarray(actions)

    def restart(self, world: int, mission_seed: int) -> None:
        """Let another mission take off in the place of one."""
        self._air.batch.missions.seed[world][0] = mission_seed
        _put_back(self._air, world)
        _go_on(self._air, world)

    def episode(self, world: int) -> Episode:
        """What was recorded of a mission, copied; cut off if the mission is still under way."""
        first = world * self._air.rules.n_rows
        rows = slice(first, first + int(self.n_recorded[world]))
        missions = self._air.batch.missions
        tables: list[Any] = [np.array(table[rows]) for table in self._air.records]
        return Episode(
            mission_seed=int(missions.seed[world][0]),
            demand_bit=self._demand_bit(world),
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

    def _demand_bit(self, world: int) -> Floats:
        first, demand = self._air.ground.first_sensor, self._air.batch.missions.demand_bit[world]
        cells = range(len(first) - 1)
        # Summed one by one as the world does: the sum must be the same to the last bit.
        return np.array([sum(demand[first[cell] : first[cell + 1]], 0.0) for cell in cells])

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


def _rules(stepping: Stepping) -> _Rules:
    codes = {'exact': EXACT, 'equal': EQUAL}
    if stepping.allocator not in codes:
        raise AllocationError(
            f'allocator {stepping.allocator!r} cannot be stepped; there are {", ".join(codes)}'
        )
    return _Rules(
        layout=int(stepping.layout),
        allocator=codes[stepping.allocator],
        reward=int(stepping.reward),
        is_synchronous=int(stepping.is_synchronous),
        is_logged=int(stepping.is_logged),
        n_rows=stepping.max_decisions + 1 if stepping.max_decisions else 0,
    )


def _new_desks(layout: Layout, briefing: Briefing, n_worlds: int) -> _Desks:
    side = briefing.cells_per_side
    size = observation_size(layout, side, briefing.n_uavs)
    return _Desks(
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


@kernel
def _explore_batch(air: _Air, epsilon: float, hover_share: float, actions: Row[int]) -> None:
    for world in range(len(actions)):
        uav = air.desks.uav[world]
        if uav != NONE:
            mission = mission_of(air.batch.missions, world)
            seed, decision = mission.seed[0], mission.n_decisions[uav]
            legal = air.desks.legal[world]
            actions[world] = explore(seed, uav, decision, epsilon, hover_share, legal)


@kernel
def _step_batch(air: _Air, answers: Row[int]) -> None:
    briefing, batch, desks = air.briefing, air.batch, air.desks
    for world in range(len(answers)):
        uav = desks.uav[world]
        if uav == NONE:
            desks.duration_s[world] = 0.0
            desks.reward[world] = 0.0
            continue
        mission = mission_of(batch.missions, world)
        # A second look shows the same channels as the first.
        view = look(briefing, air.ground, mission, uav, batch.view_rows)
        if answers[world] == HOVER:
            allocate(air.rules.allocator, briefing, view, batch.desk)
        if desks.n_records[world] > 0:
            row = world * air.rules.n_rows + desks.n_records[world] - 1
            air.records.action[row] = answers[world]
        bit = start_action(briefing, mission, uav, view, answers[world], batch.desk.share_hz)
        _log(air, world, uav, view, actions.BY_POLICY, bit, desks.heard[world])
        _go_on(air, world)


@kernel
def _put_back(air: _Air, world: int) -> None:
    briefing, batch = air.briefing, air.batch
    restart_mission(briefing, air.ground, mission_of(batch.missions, world))
    for uav in range(briefing.n_uavs):
        forget(belief_of(batch.beliefs, world * briefing.n_uavs + uav))
    batch.n_events[world][0] = 0
    air.desks.n_records[world] = 0
    for cell in range(briefing.cells_per_side * briefing.cells_per_side):
        air.desks.complete[world][cell] = 0


@kernel
def _go_on(air: _Air, world: int) -> None:
    """Go on to the next decision, past the UAVs that turn home."""
    briefing, ground, batch, desks = air.briefing, air.ground, air.batch, air.desks
    mission = mission_of(batch.missions, world)
    first_s = mission.clock_s[0]
    start_s = first_s
    reward = 0.0
    last = desks.n_records[world] - 1
    while True:
        if air.rules.is_synchronous == 1:
            wait_for_the_slowest(briefing, mission)
        uav = next_uav(mission)
        stop_s = mission.leg_end_s[uav] if uav >= 0 else end_s(mission)
        gained = _interval_reward(air, mission, start_s, stop_s)
        reward += discount(ground, start_s - first_s) * gained
        n_events = batch.n_events[world][0]
        if air.rules.is_logged == 1 and n_events > 0:
            log_interval(air.log, world, n_events - 1, briefing, ground, mission, stop_s)
        start_s = stop_s
        if uav < 0:
            break
        view, reason, heard = arrive(air.rules.allocator, briefing, ground, batch, world, uav)
        reward += discount(ground, start_s - first_s) * _news_reward(air, world, uav)
        if reason == NONE:
            belief = belief_of(batch.beliefs, world * briefing.n_uavs + uav)
            encode(air.rules.layout, briefing, uav, belief, view, desks.observation[world])
            desks.heard[world] = heard
            _record(air, world, uav, view)
            break
        start_action(briefing, mission, uav, view, HOME, batch.desk.share_hz)
        _log(air, world, uav, view, reason, 0.0, heard)
    for action in range(N_ACTIONS):
        desks.legal[world][action] = batch.desk.legal[action] if uav >= 0 else 0
    desks.uav[world] = uav
    desks.time_s[world] = start_s
    desks.duration_s[world] = start_s - first_s
    desks.reward[world] = reward
    if last >= 0:
        air.records.reward[world * air.rules.n_rows + last] = reward
        air.records.duration_s[world * air.rules.n_rows + last] = start_s - first_s


@kernel
def _interval_reward(air: _Air, mission: Mission, start_s: float, stop_s: float) -> float:
    if air.rules.reward == 1:  # Reward.ENERGY
        return energy_reward(air.briefing, air.ground, mission, start_s, stop_s)
    return interval_reward(air.briefing, air.ground, mission, start_s, stop_s) + terminal_reward(
        air.briefing, air.ground, mission, start_s
    )


@kernel
def _news_reward(air: _Air, world: int, uav: int) -> float:
    """One for each cell that the deciding UAV is the first to know complete."""
    if air.rules.reward != 1:
        return 0.0
    known = air.batch.beliefs.complete[world * air.briefing.n_uavs + uav]
    n_new = 0
    for cell in range(len(known)):
        if known[cell] == 1 and air.desks.complete[world][cell] == 0:
            air.desks.complete[world][cell] = 1
            n_new += 1
    return 1.0 * n_new


@kernel
def _log(
    air: _Air, world: int, uav: int, view: LocalView, reason: int, bit: float, heard: int
) -> None:
    if air.rules.is_logged == 0:
        return
    index = air.batch.n_events[world][0]
    mission = mission_of(air.batch.missions, world)
    n_complete = air.batch.beliefs.n_complete[world * air.briefing.n_uavs + uav][0]
    log_event(air.log, world, index, mission, n_complete, uav, view, reason, bit, heard)
    air.batch.n_events[world][0] = index + 1


@kernel
def _record(air: _Air, world: int, uav: int, view: LocalView) -> None:
    """Open the record of the decision waited for."""
    n_records = air.desks.n_records[world]
    if n_records == air.rules.n_rows:
        return
    row = world * air.rules.n_rows + n_records
    mission, beliefs = mission_of(air.batch.missions, world), air.batch.beliefs
    first_belief, legal = world * air.briefing.n_uavs, air.batch.desk.legal
    record(air.records, row, air.briefing, mission, beliefs, first_belief, uav, view, legal)
    air.desks.n_records[world] = n_records + 1

"""Many missions at once, stepped from outside: what a learner and a learned policy drive.

Every mission waits for one decision, that of the UAV whose action ended first. A step carries
out a decision of each mission and goes on to the next one; everything in between happens by
`batch_kernels.fly_on`, whoever decides.
"""

from collections.abc import Callable, Sequence
import copy
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from uav_collect.errors import AllocationError, PolicyMismatchError
from uav_collect.kernels.arrays import (
    Bools,
    check_shape,
    copied,
    Floats,
    Ints,
    new_row,
    Row,
)
from uav_collect.kernels.compile import kernels_are_compiled
from uav_collect.kernels.handle import Handle
from uav_collect.missions.batch_kernels import (
    Batch,
    explore_all,
    fly_batch,
    IN_FLIGHT,
    Settings,
)
from uav_collect.missions.batch_logs import log_of
from uav_collect.missions.batch_metrics import BatchMetrics, metrics_of
from uav_collect.missions.batch_start import new_batch, restart_all
from uav_collect.missions.branches import Branches
from uav_collect.missions.event_log import grown_log, mission_header
from uav_collect.missions.experience import Episode, global_state, Records
from uav_collect.missions.own_numbers import OwnNumbers
from uav_collect.missions.own_reward import OwnReward, rewarded
from uav_collect.missions.teacher import Teacher
from uav_collect.physics.bandwidth import EQUAL, EXACT
from uav_collect.recording.mission_log import MissionHeader, MissionLog
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOME, HOVER, N_ACTIONS, NONE
from uav_collect.uav.actions import check_can_start
from uav_collect.uav.belief import belief_of
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.heuristics import Heuristic
from uav_collect.uav.observation import AnyLayout, frames, Layout, OwnLayout
from uav_collect.uav.policy import NamedPolicy, Policy
from uav_collect.uav.policy_network import FrozenPolicy
from uav_collect.world.dynamics import look, mission_of
from uav_collect.world.reward import KILOJOULE_J, Reward
from uav_collect.world.sensor_field import demand_by_cell

_FIRST_CAPACITY = 256  # events of a mission that the log has room for before it must grow

# What flying on writes and goes on from, but for logs and records.
_OWN_TABLES = (
    'missions', 'airwaves', 'beliefs', 'memory', 'watch', 'complete', 'n_events', 'earnings',
    'waiting',
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class VectorEnvConfig:
    """How missions are stepped."""

    layout: AnyLayout | None = Layout.EGOCENTRIC  # of observations; None: there are none
    allocator: str = 'equal'  # or 'exact'
    reward: Reward | None = Reward.PAPER  # None: it is not summed up
    own_reward: OwnReward | None = None  # a user's, of whole episodes; `reward` is ENERGY then
    energy_unit_j: float = KILOJOULE_J  # energy that takes one from the energy reward
    rule: Heuristic | None = None  # that decides; None: each step does
    is_synchronous: bool = False  # UAVs wait for each other and decide at the same instants
    is_logged: bool = False  # missions leave a log
    max_decisions: int = 0  # so many decisions of a mission are recorded for a learner
    guard_after: int = NONE  # decisions without news after which a UAV's guard decides; 0: never
    branch_share: float = 0.0  # of recorded decisions: what each action is worth, see `branches`
    teacher: NamedPolicy | None = None  # that says at each decision what it would do


@dataclass(frozen=True, kw_only=True)
class AwaitedDecisions:
    """The decisions that missions wait for, by mission. Valid until the next step or restart.

    What a UAV that turns home would have decided belongs to the decision before: reward and
    duration go on until a UAV decides again, or all have landed.
    """

    uav: Ints  # (W,) index of the UAV that decides; NONE (-1) where the mission is over
    time_s: Floats  # (W,)
    observation: Floats  # (W, observation_size)
    legal: Bools  # (W, N_ACTIONS) by the compass
    frame: Ints  # (W,) of the UAV, in which its observation shows places and actions
    advice: Ints  # (W,) what the layout's adviser would do, by the compass; NONE without one
    reward: Floats  # (W,) since the decision before, discounted to it
    duration_s: Floats  # (W,) since the decision before


class Flights(NamedTuple):
    """What missions in flight came from: flown again they are the same to the bit."""

    mission_seeds: Ints  # (W,)
    actions: NDArray[
        np.int8
    ]  # (W, max_decisions) in the order of a mission's decisions, then NONE


class VectorEnv:
    """Missions in flight that ask for one decision each."""

    def __init__(self, site: Site, mission_seeds: Sequence[int], config: VectorEnvConfig) -> None:
        """Take off.

        Args:
            mission_seeds: one per mission, 0..2^63-1.

        Raises:
            AllocationError: the allocator is not one that kernels know.
            ConfigError: no UAV has the energy to start, or the layout has no room for the fleet.
        """
        self._scenario, self._config = site.scenario, config
        self._is_compiled = kernels_are_compiled()
        capacity = _FIRST_CAPACITY if config.is_logged else 1
        batch = new_batch(site, mission_seeds, _settings(config), capacity, config.energy_unit_j)
        check_can_start(site.scenario, batch.briefing)
        layout = Layout.EGOCENTRIC if config.layout is None else config.layout
        self._frames = frames(layout, batch.briefing)
        self._own = OwnNumbers(layout, batch.briefing) if isinstance(layout, OwnLayout) else None
        self._held = Handle(batch if self._own is None else self._own.with_room(batch))
        self._worlds = np.arange(len(mission_seeds))
        self._decisions: AwaitedDecisions | None = None  # since a mission was last flown on
        self._branches = (
            Branches(site, batch, config.energy_unit_j) if config.branch_share > 0.0 else None
        )
        self._teacher = None if config.teacher is None else Teacher(config.teacher, batch)
        self._fly(new_row(len(mission_seeds), NONE))

    @property
    def _batch(self) -> Batch:
        return self._held.rows

    @property
    def briefing(self) -> Briefing:
        """What the UAVs know before they take off."""
        return self._batch.briefing

    @property
    def decisions(self) -> AwaitedDecisions:
        """What the missions wait for."""
        if self._decisions is None:
            waiting = self._batch.waiting
            uav = np.asarray(waiting.uav, dtype=np.int64)
            self._decisions = AwaitedDecisions(
                uav=uav,
                time_s=np.asarray(waiting.time_s),
                observation=np.asarray(waiting.observation),
                legal=np.asarray(waiting.legal) == 1,
                frame=self._frames[uav],
                advice=np.asarray(waiting.advice),
                reward=np.asarray(waiting.reward),
                duration_s=np.asarray(waiting.duration_s),
            )
        return self._decisions

    @property
    def n_recorded(self) -> Ints:
        """How many decisions of each mission are recorded, the one it waits for included, (W,)."""
        return np.asarray(self._batch.waiting.n_records)

    @property
    def mission_seeds(self) -> Ints:
        """Of the missions in flight, (W,)."""
        return np.array(self._batch.missions.seed, dtype=np.int64)[:, 0]

    @property
    def taught(self) -> Ints:
        """What the teacher would do, or the adviser where there is none; NONE where over, (W,)."""
        if self._teacher is None:
            return np.array(self._batch.waiting.advice)
        return self._teacher.actions(self._batch)

    def step(self, actions: Ints) -> AwaitedDecisions:
        """Carry out one decision of each mission.

        Args:
            actions: shape (W,); ignored where the mission is over.

        Returns:
            The next decisions, with the rewards of these.

        Raises:
            ValueError: an action is not legal.
        """
        uav = self.decisions.uav
        check_shape(actions, uav.shape, 'actions')
        self._check_legal(actions, uav != NONE)
        self._answer(np.where(uav == NONE, HOVER, actions))
        return self.decisions

    def fly_by_network(
        self, policy: FrozenPolicy, between_decisions: Callable[[], None] | None = None
    ) -> None:
        """Fly all missions to their end, every UAV by the same frozen network.

        Args:
            between_decisions: called before each; what it raises ends the flights.
        """
        n_worlds, n_uavs = len(self.decisions.uav), self._scenario.n_uavs
        hidden = policy.new_hidden(n_worlds * n_uavs)  # by mission, then UAV
        chosen = np.zeros(n_worlds, dtype=np.int64)
        decisions = self.decisions
        while len(waiting := np.flatnonzero(decisions.uav != NONE)):
            rows = waiting * n_uavs + decisions.uav[waiting]
            if between_decisions is not None:
                between_decisions()
            values, hidden[rows] = policy.step(decisions.observation[waiting], hidden[rows])
            of = decisions.legal[waiting], decisions.frame[waiting], decisions.advice[waiting]
            chosen[waiting] = policy.actions(values, *of)
            self._answer(chosen)
            decisions = self.decisions

    def fly_by_policies(self, make_policy: Callable[[], Policy]) -> None:
        """Fly all missions to their end, every UAV by a policy of its own.

        Raises:
            PolicyMismatchError: a policy does not fit, or chooses what is not legal.
        """
        batch, n_worlds, n_uavs = self._batch, len(self.decisions.uav), self._scenario.n_uavs
        policies = [make_policy() for _ in range(n_worlds * n_uavs)]  # by mission, then UAV
        for place, policy in enumerate(policies):
            policy.begin(batch.briefing, place % n_uavs)
        answers = new_row(n_worlds, NONE)
        while len(waiting := np.flatnonzero(np.asarray(batch.waiting.uav) != NONE)):
            for world in waiting.tolist():
                uav = int(batch.waiting.uav[world])
                place, legal = world * n_uavs + uav, batch.waiting.legal[world]
                mission = mission_of(batch.missions, world)
                view = look(batch.briefing, batch.sensor_field, mission, uav, batch.view_rows)
                belief = belief_of(batch.beliefs, place)
                action = policies[place].choose(belief, view, legal)
                if action != HOME and not (0 <= action < N_ACTIONS and legal[action] == 1):
                    raise PolicyMismatchError(
                        f'UAV {uav + 1}, event {batch.n_events[world]}: action {action} is illegal'
                    )
                answers[world] = action
            self._fly(answers)
            batch = self._batch

    def explore(self, epsilon: float, hover_share: float, advice_share: float = 0.0) -> Ints:
        """Random actions where UAVs explore, NONE elsewhere, (W,); see `exploration.explore`."""
        actions = new_row(len(self._batch.waiting.uav), NONE)
        explore_all(self._held, epsilon, hover_share, advice_share, actions)
        return np.asarray(actions)

    def restart(self, world: int, mission_seed: int) -> None:
        """Let another mission take off in the place of one."""
        self.restart_all([world], [mission_seed])

    def restart_all(self, worlds: Sequence[int], mission_seeds: Sequence[int]) -> None:
        """Let other missions take off in the places of some."""
        restarted = new_row(len(worlds), 0)
        for index, (world, seed) in enumerate(zip(worlds, mission_seeds, strict=True)):
            restarted[index] = world
            self._batch.missions.seed[world][0] = seed
        restart_all(self._held, restarted)
        if self._teacher is not None:
            self._teacher.forget(worlds)
        self._fly(new_row(len(self._worlds), NONE))

    def twin(self) -> 'VectorEnv':
        """The same missions where they are now, to try out what would come of actions.

        They leave no log and no records, and earn nothing.
        """
        batch, other = self._batch, copy.copy(self)
        tables = {name: copied(getattr(batch, name)) for name in _OWN_TABLES}
        for world in self._worlds.tolist():
            tables['waiting'].n_records[world] = 0  # else it would write into these missions' own
        settings = batch.settings._replace(is_logged=0, n_rows=0, reward=NONE)
        other._held = Handle(batch._replace(settings=settings, **tables))
        other._branches = other._teacher = other._decisions = None
        return other

    def episode(self, world: int) -> Episode:
        """What was recorded of a mission, copied; cut off if the mission is still under way."""
        first = world * self._batch.settings.n_rows
        rows = slice(first, first + int(self.n_recorded[world]))
        missions = self._batch.missions
        tables: list[Any] = [np.array(table[rows]) for table in self._batch.records]
        episode = Episode(
            mission_seed=int(missions.seed[world][0]),
            demand_bit=demand_by_cell(
                self._batch.sensor_field.first_sensor, missions.demand_bit[world]
            ),
            records=Records(*tables),
            is_whole=self._batch.waiting.uav[world] == NONE,
        )
        if self._config.own_reward is None or not episode.n_decisions:
            return episode
        end = missions.energy_left_j[world], sum(self._batch.complete[world])
        return rewarded(self._config.own_reward, episode, self._batch.briefing, *end)

    def mission_log(self, world: int, policy_name: str) -> MissionLog:
        """The log of a mission so far; the missions must be logged."""
        return log_of(self._batch, self._header(policy_name), world)

    def mission_logs(self, policy_name: str) -> list[MissionLog]:
        """The logs of all missions so far; the missions must be logged."""
        header = self._header(policy_name)
        return [log_of(self._batch, header, world) for world in self._worlds.tolist()]

    def metrics(self) -> BatchMetrics:
        """What the missions achieved; all must be over."""
        return metrics_of(self._batch.briefing, self._batch.missions)

    def _header(self, policy_name: str) -> MissionHeader:
        n_uavs, allocator = self._scenario.n_uavs, self._config.allocator
        return mission_header(
            self._scenario,
            0,
            (),
            [policy_name] * n_uavs,
            [allocator] * n_uavs,
            [self._config.guard_after] * n_uavs,
        )

    def global_state(self, world: int) -> Floats:
        """What a mixer sees of a mission: numbers from 0 to 1.

        Returns:
            Of each UAV east and north as shares of the area's side, energy left as a share of its
            budget, and whether it still decides; then each UAV's completion map; then the true
            one. Shape (U * N_UAV_SCALARS + (U + 1) * C,).
        """
        batch = self._batch
        mission, first = mission_of(batch.missions, world), world * self._scenario.n_uavs
        time_s = batch.waiting.time_s[world]
        return global_state(batch.briefing, mission, batch.beliefs, first, time_s)

    def efficiency_kbit_per_j(self, world: int) -> float:
        """Data that a mission has collected over the energy it has spent, both so far."""
        missions = self._batch.missions
        spent_j = sum(self._batch.briefing.energy_budget_j) - sum(missions.energy_left_j[world])
        return missions.collected_bit[world][0] / spent_j / 1e3 if spent_j > 0.0 else 0.0

    def collected_share(self, world: int) -> float:
        """Share of its data that a mission has collected so far; 1 where there is none."""
        missions = self._batch.missions
        total_bit = math.fsum(np.asarray(missions.demand_bit[world]).tolist())
        return min(1.0, missions.collected_bit[world][0] / total_bit) if total_bit > 0.0 else 1.0

    def flights(self) -> Flights:
        """What the missions in flight came from; their decisions must all be recorded."""
        n_worlds, most = len(self.n_recorded), self._config.max_decisions
        chosen = self._batch.records.action.reshape(n_worlds, -1)[:, :most]
        is_recorded = np.arange(most) < self.n_recorded[:, None]
        return Flights(
            mission_seeds=self.mission_seeds,
            actions=np.where(is_recorded, chosen, NONE).astype(np.int8),
        )

    def fly_again(self, flights: Flights) -> None:
        """Put all missions to where others were that had the same settings.

        Raises:
            ValueError: a seed is none, or an action is not legal.
        """
        if (flights.mission_seeds < 0).any():
            raise ValueError('a mission seed is negative')
        self.restart_all(self._worlds.tolist(), flights.mission_seeds.tolist())
        for actions in flights.actions.T.astype(np.int64):
            is_known = actions != NONE
            if not is_known.any():
                break
            self._check_legal(actions, is_known & (self.decisions.uav != NONE))
            self._answer(actions)

    def _answer(self, actions: Ints) -> None:
        """Carry out a legal action of each mission that waits; any for those that are over."""
        row = np.ascontiguousarray(actions, dtype=np.int64)
        if self._branches is not None:
            self._branches.record(self._batch, row != NONE, self._config.branch_share)
        if self._teacher is not None:
            self._teacher.record(self._batch, row != NONE)
        self._fly(row if self._is_compiled else row.tolist())

    def _fly(self, answers: Any) -> None:  # noqa: ANN401 - a row
        """Fly on with the answers, with more room for the log as often as that is needed."""
        self._decisions = None  # at once: what interrupts a kernel is raised as it returns
        flown = [] if self._own is None else self._flown_by(answers)
        n_in_flight = fly_batch(self._held, answers)
        while n_in_flight:
            n_worlds = len(self._worlds)
            log = grown_log(self._batch.log, n_worlds)
            self._held = Handle(self._batch._replace(log=log))
            n_in_flight = fly_batch(self._held, new_row(n_worlds, NONE))
        if self._own is not None:
            self._own.write(self._batch, flown)

    def _flown_by(self, answers: Row[int]) -> list[int]:
        """The missions that answers carry on."""
        waiting = enumerate(self._batch.waiting.uav)
        return [it for it, uav in waiting if uav == IN_FLIGHT or answers[it] != NONE]

    def _check_legal(self, actions: Ints, is_asked: Bools) -> None:
        """Raise ValueError if an action of a mission that is asked is not legal."""
        legal = self.decisions.legal
        is_action = (actions >= 0) & (actions < N_ACTIONS)
        is_legal = is_action & legal[self._worlds, np.where(is_action, actions, HOVER)]
        if (refused := is_asked & ~is_legal).any():
            world = int(refused.argmax())
            raise ValueError(self._refusal(world, actions[world]))

    def _refusal(self, world: int, action: int) -> str:
        seed, uav = self._batch.missions.seed[world][0], self._batch.waiting.uav[world]
        legal = [each for each in range(N_ACTIONS) if self._batch.waiting.legal[world][each] == 1]
        return (
            f'action {action} of UAV {uav + 1} in mission {seed} is not legal; legal are {legal}'
        )


def _settings(config: VectorEnvConfig) -> Settings:
    codes = {'exact': EXACT, 'equal': EQUAL}
    if config.allocator not in codes:
        raise AllocationError(
            f'allocator {config.allocator!r} cannot be stepped; there are {", ".join(codes)}'
        )
    return Settings(
        rule=NONE if config.rule is None else int(config.rule),
        allocator=codes[config.allocator],
        layout=NONE if config.layout is None else int(config.layout.base),
        adviser=NONE if config.layout is None else config.layout.adviser,
        reward=NONE if config.reward is None else int(config.reward),
        is_synchronous=int(config.is_synchronous),
        is_logged=int(config.is_logged),
        n_rows=config.max_decisions + 1 if config.max_decisions else 0,
        guard_after=config.guard_after,
    )

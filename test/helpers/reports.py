"""What nodes report of missions, without ROS: flown agent by agent in this process.

Beside it the same missions as the training's rollout flies and records them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from random_policies import header as policy_header
from random_policies import random_policy
from uav_collect.errors import RefusedError
from uav_collect.ingest.join import JoinedMission, MissionJoiner
from uav_collect.ingest.rebuild import EpisodeBuilder
from uav_collect.ingest.reports import (
    EventReport,
    FleetReport,
    FLOAT32,
    FLOAT64,
    MissionReport,
    report_spec,
    TransitionReport,
)
from uav_collect.kernels.arrays import Row
from uav_collect.missions.experience import Episode
from uav_collect.missions.own_reward import OwnReward
from uav_collect.missions.simulation import Event, FAULT_DECISION, Simulation
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.recording.mission_log import Events
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import HOME, NONE
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.exploration import explore
from uav_collect.uav.learned_on import learned_on
from uav_collect.uav.observation import AnyLayout, Layout, observation_size, Observer
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy
from uav_collect.uav.view import LocalView
from uav_collect.world.reward import Reward


@dataclass(frozen=True, kw_only=True)
class MissionSetup:
    """Which missions are flown, and how they are learned from."""

    scenario: Scenario
    layout: AnyLayout = Layout.EGOCENTRIC
    reward: Reward = Reward.ENERGY
    own_reward: OwnReward | None = None
    discount_per_s: float = 0.997
    max_decisions: int = 10**6
    epsilon: float = 0.3
    hover_share: float = 0.6
    flown: FrozenPolicy | None = None  # random weights otherwise

    @property
    def policy(self) -> FrozenPolicy:
        """What flies."""
        if self.flown is not None:
            return self.flown
        area, n_uavs = self.scenario.area, self.scenario.n_uavs
        header = replace(
            policy_header(self.layout, area.n_rows, n_uavs),
            observation_size=observation_size(self.layout, area.n_cells, n_uavs),
            cells_per_side_max=max(area.n_rows, area.n_columns),
            learned_on=(learned_on(self.scenario),),
        )
        return random_policy(header, seed=1)

    def joiner(self, **values: object) -> MissionJoiner:
        """What joins the reports of its missions."""
        site = build_site(self.scenario)
        builder = EpisodeBuilder(
            site, self.layout, self.reward, self.discount_per_s, own_reward=self.own_reward
        )
        builder.warm_up()
        spec = report_spec(site, self.layout)
        settings = {'max_decisions': self.max_decisions, **values}
        return MissionJoiner(spec, builder, **settings)  # type: ignore[arg-type]

    def episodes(self, seeds: Sequence[int]) -> list[Episode]:
        """Missions as the training's rollout records them."""
        env = VectorEnv(
            build_site(self.scenario).with_discount(self.discount_per_s),
            seeds,
            VectorEnvConfig(
                layout=self.layout,
                reward=self.reward,
                own_reward=self.own_reward,
                max_decisions=self.max_decisions,
            ),
        )
        policy, n_uavs = self.policy, self.scenario.n_uavs
        hidden, decisions = policy.new_hidden(len(seeds) * n_uavs), env.decisions
        ended: dict[int, Episode] = {}
        while len(ended) < len(seeds):
            flying = np.flatnonzero(decisions.uav != NONE)
            rows = flying * n_uavs + decisions.uav[flying]
            values, hidden[rows] = policy.step(decisions.observation[flying], hidden[rows])
            chosen = np.zeros(len(seeds), dtype=np.int64)
            of = decisions.legal[flying], decisions.frame[flying], decisions.advice[flying]
            chosen[flying] = policy.actions(values, *of)
            explored = env.explore(self.epsilon, self.hover_share)
            decisions = env.step(np.where(explored == NONE, chosen, explored))
            is_over = (decisions.uav == NONE) | (env.n_recorded > self.max_decisions)
            for world in np.flatnonzero(is_over).tolist():
                ended.setdefault(world, env.episode(world))
        return [ended[world] for world in range(len(seeds))]


@dataclass
class _Explorer(LearnedPolicy):
    """Flies the policy, and now and then at random."""

    epsilon: float = 0.0
    hover_share: float = 0.0
    mission_seed: int = 0
    uav: int = 0
    decision: int = 0

    def begin(self, briefing: Briefing, uav: int) -> None:
        super().begin(briefing, uav)
        self.uav, self.decision = uav, 0

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        chosen = super().choose(belief, view, legal)
        if chosen == HOME:
            return HOME
        key = self.mission_seed, self.uav, self.decision
        explored = explore(*key, self.epsilon, self.hover_share, 0.0, NONE, legal)
        self.decision += 1
        return chosen if explored == NONE else explored


class ReportingFlight:
    """One mission, which is reported as it is flown."""

    def __init__(self, setup: MissionSetup, seed: int, mission_id: str = '') -> None:
        self._setup = setup
        self._simulation = Simulation(build_site(setup.scenario), seed)
        self._fingerprint = fingerprint(setup.scenario)
        self._briefing = self._simulation.briefing
        self._seed, self._id = seed, mission_id or f'world-{seed}'
        policy = setup.policy
        self._agents = [
            Agent(
                self._briefing,
                uav,
                _Explorer('it', policy, setup.epsilon, setup.hover_share, seed),
                allocator_named('equal'),
            )
            for uav in range(self._briefing.n_uavs)
        ]

    def reports(self) -> Iterator[FleetReport]:
        """All reports, in the order in which they come about."""
        yield self._mission()
        simulation = self._simulation
        while (event := simulation.next_event()) is not None:
            if simulation.n_events > 0:
                yield self._event()
            if event.is_gone:
                simulation.start(event, FAULT_DECISION)
                continue
            agent = self._agents[event.uav]
            for message in event.heard:
                agent.hear(message)
            agent.observe(event.view)
            for hearer in simulation.transmit(event.uav, agent.belief.complete):
                self._agents[hearer].hear(simulation.radio(event.uav))
            decision = agent.decide(event.view)
            yield self._transition(event, decision.action)
            assert simulation.refusal(event, decision) is None
            simulation.start(event, decision)
        yield self._event()
        yield self._mission()

    def events(self) -> Events:
        """What was flown so far."""
        return self._simulation.events()

    def _mission(self) -> MissionReport:
        return MissionReport(
            mission_id=self._id,
            world_instance='world',
            scenario_fingerprint=self._fingerprint,
            mission_seed=self._seed,
            demand_bit=_floats(self._simulation.demand_bit),
        )

    def _transition(self, event: Event, action: int) -> TransitionReport:
        agent, briefing, view = self._agents[event.uav], self._briefing, event.view
        layout, belief = self._setup.layout, agent.belief
        observer = Observer(layout, briefing, event.uav)
        encoded = observer.observe(belief, view, agent.legal)
        return TransitionReport(
            mission_id=self._id,
            event=event.index,
            uav=event.uav,
            decision=event.decision,
            layout=layout.label,
            scenario_fingerprint=self._fingerprint,
            observation=np.array(encoded, dtype=FLOAT32).tobytes(),
            legal=sum(int(flag) << place for place, flag in enumerate(agent.legal)),
            action=action,
            time_s=float(view.time_s),
            energy_left_j=float(view.energy_left_j),
            cell=int(view.cell),
            previous_action=int(view.previous_action),
            complete=_bits(belief.complete),
            seen=_bits([bit > 0.0 for bit in belief.seen_bit]),
            peer_x_m=_floats(belief.peer_x_m),
            peer_y_m=_floats(belief.peer_y_m),
            peer_s=_floats(belief.peer_s),
        )

    def _event(self) -> EventReport:
        simulation, uavs = self._simulation, range(self._briefing.n_uavs)
        (logged,) = simulation.last_event()
        time_s = logged['time_s'].item()
        places_m = [simulation.position_m(uav, time_s) for uav in uavs]
        fields = {
            name: logged[name].item()
            for name in (
                'event', 'decision', 'time_s', 'x_m', 'y_m', 'action', 'reason', 'duration_s',
                'energy_left_j', 'energy_j', 'collected_bit', 'reward',
            )
        }  # fmt: skip
        return EventReport(
            mission_id=self._id,
            uav=logged['uav'].item() - 1,
            is_last=simulation.is_over,
            uav_x_m=_floats([x_m for x_m, _ in places_m]),
            uav_y_m=_floats([y_m for _, y_m in places_m]),
            uav_energy_left_j=_floats([simulation.energy_left_j(uav) for uav in uavs]),
            uav_phase=bytes(simulation.phase(uav, time_s) for uav in uavs),
            uav_complete=b''.join(_bits(simulation.known_complete(uav)) for uav in uavs),
            true_complete=_bits([bit <= 0.0 for bit in simulation.waiting_bit()]),
            **fields,
        )


def reports_of(setup: MissionSetup, seeds: Sequence[int]) -> list[FleetReport]:
    """All reports of missions, in order."""
    return [report for seed in seeds for report in ReportingFlight(setup, seed).reports()]


def joined(
    joiner: MissionJoiner,
    reports: Sequence[FleetReport],
    on_refusal: Callable[[str], None] | None = None,
) -> list[JoinedMission]:
    """The missions that are joined from reports."""
    found: list[JoinedMission] = []
    for report in reports:
        try:
            one = joiner.add(report)
        except RefusedError as error:
            if on_refusal is None:
                raise
            on_refusal(str(error))
            continue
        if one is not None:
            found.append(one)
    return found


def events_and_decisions(reports: Sequence[FleetReport]) -> list[FleetReport]:
    """The reports that are not of a mission as a whole."""
    return [report for report in reports if not isinstance(report, MissionReport)]


def changed(report: FleetReport, **changes: object) -> FleetReport:
    """The report with other values."""
    return replace(report, **changes)  # type: ignore


def is_decision(report: FleetReport) -> bool:
    """Whether a transition is of a UAV that goes on."""
    return isinstance(report, TransitionReport) and report.action != HOME


def same(one: Episode, other: Episode) -> list[str]:
    """What differs between two episodes, to the byte."""
    pairs = zip(one.records._fields, one.records, other.records, strict=True)
    found = [name for name, mine, theirs in pairs if _content(mine) != _content(theirs)]
    if one.demand_bit.tobytes() != other.demand_bit.tobytes():
        found.append('demand_bit')
    for name in ('mission_seed', 'is_whole'):
        if getattr(one, name) != getattr(other, name):
            found.append(name)
    return found


def _content(table: NDArray[Any]) -> tuple[object, ...]:
    return table.dtype, table.shape, table.tobytes()


def _floats(values: Sequence[float] | Row[float]) -> bytes:
    return np.array(values, dtype=FLOAT64).tobytes()


def _bits(flags: Sequence[bool] | Row[int]) -> bytes:
    return np.packbits(np.array(flags, dtype=bool), bitorder='little').tobytes()

"""One mission, event by event: what the world node and `fly_by_agents` drive.

It holds the world, the UAVs' radios and the log. A UAV's radio keeps the completion map that its
UAV sent last, merges what it hears, and answers with that.
"""

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
import math

from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Row, row_of
from uav_collect.limits import MAX_UAVS
from uav_collect.missions.batch_kernels import (
    be_heard,
    carry_out,
    end_interval,
    listen,
    Settings,
)
from uav_collect.missions.batch_start import new_batch
from uav_collect.missions.event_log import grown_log, logged_events, mission_header
from uav_collect.missions.running_legs import Leg, running_leg, turns_by
from uav_collect.physics.bandwidth import EXACT, hover_time_s
from uav_collect.recording.mission_log import Events, FaultRecord, MissionHeader, MissionLog
from uav_collect.scenario.model import FAULT_KINDS, Point
from uav_collect.scenario.site import Site
from uav_collect.uav import action_codes, actions
from uav_collect.uav.action_codes import BY_POLICY, GUARD, HOME, HOVER, NONE
from uav_collect.uav.actions import check_can_start
from uav_collect.uav.agent import Agent, allocator_named, write_powers
from uav_collect.uav.belief import Belief, belief_of, merge
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.policy import guard_for, Policy
from uav_collect.uav.view import LocalView
from uav_collect.world.dynamics import (
    contacts,
    end_s,
    GONE,
    has_fault,
    has_landed,
    LANDED,
    look,
    mission_of,
    next_uav,
    place_at,
    straight_at,
)
from uav_collect.world.exchange import airwaves_of, heard_map
from uav_collect.world.faults import fault_records, inject_fault, note_faults

# What the world does with a UAV that has no agent, or whose agent does not answer.
FAILSAFE_DECISION = Decision(action=HOME, reason=action_codes.FAILSAFE)
FAULT_DECISION = Decision(action=HOME, reason=action_codes.FAULT)
FAILSAFE_VERSION = 'failsafe'  # stands for that of a policy where none has decided

_FIRST_CAPACITY = 512  # events that the log has room for before it must grow
_REASONS_TO_GO_ON = (BY_POLICY, GUARD)
_REASONS_TO_GO_HOME = (BY_POLICY, action_codes.MAP_COMPLETE, action_codes.ENERGY_RESERVE)
_BANDWIDTH_TOLERANCE = 1e-9  # relative; what a sum of shares may lose in rounding
_LEAST_SHARE = 1e-100  # of the bandwidth; its noise and rate are still normal numbers


@dataclass(frozen=True, kw_only=True)
class Event:
    """A UAV has finished its action and decides."""

    index: int  # running number over the fleet
    uav: int
    decision: int  # running number of the UAV's own decisions
    view: LocalView
    heard: tuple[RadioMessage, ...]  # of each UAV that it hears, by index
    is_gone: bool = False  # its agent is, by a fault: the failsafe flies it home


class Simulation:
    """A mission in flight: ask for the event, transmit, start the action; until it is over."""

    def __init__(self, site: Site, mission_seed: int) -> None:
        """Put the mission to its start.

        Raises:
            ConfigError: no UAV has the energy to start.
        """
        settings = Settings(rule=NONE, allocator=EXACT, is_logged=1)
        # The beliefs are those that the UAVs' radios keep; on board, agents have their own.
        self._batch = new_batch(site, [mission_seed], settings, _FIRST_CAPACITY)
        self._mission = mission_of(self._batch.missions, 0)
        self.briefing = self._batch.briefing
        check_can_start(site.scenario, self.briefing)
        self.demand_bit = [float(bit) for bit in self._mission.demand_bit]
        self._sent_decision = [0] * self.briefing.n_uavs  # at which each UAV sent last
        # Where the radio is ideal, nothing is heard between an event and the next one's.
        self._known: Row[Row[int]] | list[Row[int]] = self._batch.beliefs.complete

    @property
    def n_events(self) -> int:
        """Actions started so far, turning home included."""
        return int(self._batch.n_events[0])

    def next_event(self) -> Event | None:
        """The next UAV to decide and what it sees and hears; None when all fly home."""
        uav = next_uav(self._mission)
        if uav < 0:
            return None
        batch, time_s = self._batch, self._mission.leg_end_s[uav]
        end_interval(batch, 0, time_s)
        if batch.may_fail:
            note_faults(self._mission, uav, time_s, self.n_events)
        heard = _indices(listen(batch, 0, uav, time_s))
        view = look(self.briefing, batch.sensor_field, self._mission, uav, batch.view_rows)
        radio = self.radio if self.is_radio_ideal else partial(self._heard_radio, uav)
        return Event(
            index=self.n_events,
            uav=uav,
            decision=int(self._mission.n_decisions[uav]),  # compiled kernels' rows hold numpy's
            view=view,
            heard=tuple(radio(other) for other in heard),
            is_gone=bool(has_fault(self._mission, GONE, uav, time_s)),
        )

    def inject(self, kind: str, uav: int) -> None:
        """Let a fault befall a UAV, by index; the next event is the first with it."""
        self._batch = self._batch._replace(may_fail=1)
        inject_fault(self._mission, FAULT_KINDS.index(kind), uav)

    def contacts(self, uav: int, time_s: float) -> list[int]:
        """The UAVs in range of one, by index."""
        return _indices(contacts(self.briefing, self._mission, uav, time_s))

    def radio(self, uav: int) -> RadioMessage:
        """What a UAV's radio answers now."""
        time_s = self.time_s
        x_m, y_m = self.position_m(uav, time_s)
        return RadioMessage(
            sender=uav,
            complete=self._batch.beliefs.complete[uav],
            x_m=x_m,
            y_m=y_m,
            time_s=time_s,
            decision=self._sent_decision[uav],
        )

    def _heard_radio(self, uav: int, sender: int) -> RadioMessage:
        """The newest message of another UAV that has reached one."""
        airwaves, n_uavs = airwaves_of(self._batch.airwaves, 0), self.briefing.n_uavs
        pair, n_cells = uav * n_uavs + sender, len(self._mission.cell_bit)
        return RadioMessage(
            sender=sender,
            complete=row_of(heard_map(airwaves, uav, sender, n_cells)),
            x_m=float(airwaves.heard_x_m[pair]),
            y_m=float(airwaves.heard_y_m[pair]),
            time_s=float(airwaves.heard_s[pair]),
            decision=int(airwaves.heard_decision[pair]),
        )

    def transmit(self, uav: int, complete: Row[int]) -> list[int]:
        """The deciding UAV sends its map.

        Returns:
            The UAVs that hear it at once, by index: none where messages may be lost or late.
        """
        merge(self._held(uav), complete)
        self._sent_decision[uav] = int(self._mission.n_decisions[uav])
        hearers = self.contacts(uav, self.time_s)
        be_heard(self._batch, 0, uav, _bits(hearers), self.time_s)
        return hearers if self.is_radio_ideal else []

    def refusal(self, event: Event, decision: Decision) -> str | None:
        """Why a decision cannot be carried out; None if it can."""
        action, view = decision.action, event.view
        if action not in range(HOME + 1):
            return f'action {action} is none of 0..{HOME}'
        if decision.reason not in (_REASONS_TO_GO_HOME if action == HOME else _REASONS_TO_GO_ON):
            return f'reason {decision.reason} is none for action {action}'
        if action != HOVER and (decision.sensor or decision.share_hz):
            n_shares = max(len(decision.sensor), len(decision.share_hz))
            return f'bandwidth for {n_shares} sensors, but action {action} collects from none'
        if action == HOME:
            return None
        if action == HOVER:
            return self._hover_refusal(event.uav, view, decision)
        legal = self._batch.workspace.legal
        actions.mark_legal(
            self.briefing,
            event.uav,
            view.x_m,
            view.y_m,
            view.energy_left_j,
            view.previous_action,
            0.0,
            legal,
        )
        if legal[action] == 1:
            return None
        return (
            f'action {action} is illegal at ({view.x_m:g}, {view.y_m:g}) m after action '
            f'{view.previous_action} with {view.energy_left_j:.0f} J left'
        )

    def start(self, event: Event, decision: Decision) -> None:
        """Carry out a decision that is not refused, and log it."""
        if self.n_events == len(self._batch.log.event[0]):
            self._batch = self._batch._replace(log=grown_log(self._batch.log, 1))
        for index, share_hz in enumerate(decision.share_hz):
            self._batch.workspace.share_hz[index] = share_hz
        heard = _bits([message.sender for message in event.heard])
        carry_out(self._batch, 0, event.uav, event.view, decision.action, decision.reason, heard)
        if not self.is_radio_ideal:
            self._known = [row_of([*known]) for known in self._batch.beliefs.complete]
        if next_uav(self._mission) < 0:
            end_interval(self._batch, 0, end_s(self._mission))

    @property
    def is_radio_ideal(self) -> bool:
        """Whether UAVs in contact hear each other at once, and always."""
        return bool(self._batch.link.is_ideal)

    @property
    def time_s(self) -> float:
        """Time of the latest event."""
        return float(self._mission.clock_s[0])  # compiled kernels' rows hold numpy's

    @property
    def is_over(self) -> bool:
        """Whether every UAV flies home or has landed."""
        return next_uav(self._mission) < 0

    @property
    def end_s(self) -> float:
        """When the last running action ends."""
        return end_s(self._mission)

    def events(self) -> Events:
        """The events so far; the last one's interval is open until the next event."""
        return logged_events(self._batch.log, 0, self.n_events)

    def last_event(self) -> Events:
        """The latest event alone, (1,); its interval is open until the next event."""
        return logged_events(self._batch.log, 0, self.n_events, self.n_events - 1)

    def log(self, header: MissionHeader) -> MissionLog:
        """The log of the mission so far under a header."""
        return MissionLog(header=header, events=self.events(), faults=self.faults())

    def faults(self) -> tuple[FaultRecord, ...]:
        """The faults that have begun so far."""
        return fault_records(self._mission)

    def position_m(self, uav: int, time_s: float) -> tuple[float, float]:
        """Where a UAV is at a time of its running action."""
        return place_at(self.briefing, self._mission, uav, time_s)

    def straight(self, uav: int, time_s: float) -> tuple[Point, Point]:
        """From where to where the straight part leads on which a UAV is at a time, east, north."""
        from_x_m, from_y_m, to_x_m, to_y_m, _ = straight_at(
            self.briefing, self._mission, uav, time_s
        )
        return (from_x_m, from_y_m), (to_x_m, to_y_m)

    def leg(self, uav: int) -> Leg:
        """The running action of a UAV; of one that waits for its next, the action that is over."""
        return running_leg(self.briefing, self._mission, uav)

    def turns(self, uav: int, time_s: float) -> list[tuple[float, Point]]:
        """When and where a UAV has turned by a time, on a way home around closed cells."""
        return turns_by(self.briefing, self._mission, uav, time_s)

    def energy_left_j(self, uav: int) -> float:
        """What a UAV has left when its running action ends."""
        return float(self._mission.energy_left_j[uav])

    def phase(self, uav: int, time_s: float) -> int:
        """ACTIVE, FLYING_HOME or LANDED, see `world.dynamics`."""
        return LANDED if has_landed(self._mission, uav, time_s) else self._mission.phase[uav]

    def known_complete(self, uav: int) -> Row[int]:
        """The completion map that a UAV's radio kept when the latest action started, (C,)."""
        return self._known[uav]

    def waiting_bit(self) -> list[float]:
        """Data not yet claimed, by cell."""
        return [float(bit) for bit in self._mission.cell_bit]

    @property
    def collected_share(self) -> float:
        """Data claimed so far over all data, 0..1; 1 where there is none."""
        total_bit = sum(self.demand_bit)
        if total_bit == 0.0:
            return 1.0
        return min(max(1.0 - sum(self.waiting_bit()) / total_bit, 0.0), 1.0)

    @property
    def energy_used_j(self) -> float:
        """Energy used by all UAVs, running actions counted whole."""
        uavs = range(self.briefing.n_uavs)
        return sum(self.briefing.energy_budget_j[uav] - self.energy_left_j(uav) for uav in uavs)

    def _held(self, uav: int) -> Belief:
        return belief_of(self._batch.beliefs, uav)

    def _hover_refusal(self, uav: int, view: LocalView, decision: Decision) -> str | None:
        share_hz = decision.share_hz
        if view.n_sensors == 0:
            return 'a hover, but no data waits in the cell'
        waiting = tuple(int(view.sensor[index]) for index in range(view.n_sensors))
        if decision.sensor != waiting:
            return f'bandwidth for the sensors {decision.sensor}, but data waits at {waiting}'
        if len(share_hz) != view.n_sensors:
            return f'{len(share_hz)} bandwidth shares for {view.n_sensors} sensors'
        for share in share_hz:
            if not (math.isfinite(share) and share > 0.0):
                return f'a bandwidth share of {share} Hz: each must be above 0 and finite'
        # Not fsum: it raises where a sum overflows.
        total_hz, limit_hz = sum(share_hz), self.briefing.bandwidth_hz
        if total_hz > limit_hz * (1.0 + _BANDWIDTH_TOLERANCE):
            return f'bandwidth shares sum to {total_hz:.6g} Hz of {limit_hz:.6g} Hz'
        hover_s = math.inf
        if min(share_hz) >= limit_hz * _LEAST_SHARE:
            hover_s = self._hover_s(view, share_hz)
        if not actions.may_hover(
            self.briefing, uav, view.x_m, view.y_m, view.energy_left_j, hover_s
        ):
            return f'a hover of {hover_s:.3g} s would leave too little energy for the way home'
        return None

    def _hover_s(self, view: LocalView, share_hz: tuple[float, ...]) -> float:
        workspace = self._batch.workspace
        write_powers(self.briefing, view, workspace)
        for index, share in enumerate(share_hz):
            workspace.share_hz[index] = share
        return hover_time_s(
            workspace.signal_w,
            workspace.error_w,
            view.sensor_bit,
            workspace.share_hz,
            view.n_sensors,
            self.briefing.noise_w_per_hz,
        )


def fly_by_agents(
    site: Site,
    mission_seed: int,
    make_policy: Callable[[], Policy],
    allocator: str,
    guard_after: int,
) -> MissionLog:
    """Fly a mission agent by agent, as nodes do, in one process.

    Args:
        guard_after: decisions without news after which a UAV's guard decides, but for rules.

    Raises:
        AllocationError: there is no such allocator.
        ConfigError: no UAV has the energy to start.
        PolicyMismatchError: a policy does not fit, or breaks the rules in flight.
    """
    simulation, n_uavs = Simulation(site, mission_seed), site.scenario.n_uavs
    policies = [make_policy() for _ in range(n_uavs)]
    guards = [guard_for(policy, guard_after, simulation.briefing) for policy in policies]
    agents = [
        Agent(simulation.briefing, uav, policy, allocator_named(allocator), guard_after=guard)
        for uav, (policy, guard) in enumerate(zip(policies, guards, strict=True))
    ]
    for _ in fly_agents(simulation, agents):
        pass
    names, allocators = [agent.policy.name for agent in agents], [allocator] * n_uavs
    header = mission_header(
        site.scenario, mission_seed, simulation.demand_bit, names, allocators, guards
    )
    return simulation.log(header)


def fly_agents(
    simulation: Simulation, agents: Sequence[Agent | None], failsafes: Container[int] = ()
) -> Iterator[Event]:
    """Fly a mission on to its end, agent by agent; gives each event once its action has started.

    Args:
        agents: by UAV; None: it has none, and the failsafe flies it home.
        failsafes: events at which the failsafe takes over, as their agents did not answer.

    Raises:
        PolicyMismatchError: a policy breaks the rules.
    """
    while (event := simulation.next_event()) is not None:
        agent = agents[event.uav]
        if event.is_gone or agent is None or event.index in failsafes:
            simulation.start(event, FAULT_DECISION if event.is_gone else FAILSAFE_DECISION)
            yield event
            continue
        for message in event.heard:
            agent.hear(message)
        agent.observe(event.view)
        for hearer in simulation.transmit(event.uav, agent.belief.complete):
            _hear(agents[hearer], simulation.radio(event.uav))
        decision = agent.decide(event.view)
        refusal = simulation.refusal(event, decision)
        if refusal is not None:
            raise PolicyMismatchError(f'UAV {event.uav + 1}, event {event.index}: {refusal}')
        simulation.start(event, decision)
        yield event


def _hear(agent: Agent | None, message: RadioMessage) -> None:
    if agent is not None:
        agent.hear(message)


def _indices(bits: int) -> list[int]:
    """The UAVs in the bits of an integer, by index."""
    return [uav for uav in range(MAX_UAVS) if bits >> uav & 1]


def _bits(uavs: list[int]) -> int:
    """UAVs as the bits of an integer of 64; the last of them is its sign, as in kernels."""
    bits = sum(1 << uav for uav in uavs)
    return bits - (bits >> 63 << 64)

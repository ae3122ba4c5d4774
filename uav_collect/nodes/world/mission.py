"""A mission in flight as the world node sees it: its simulation, and what agents were sent."""

from array import array
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
import math
from typing import Any

from builtin_interfaces.msg import Time
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics, OUTCOME_CODES
from uav_collect.kernels.arrays import Row, row_of
from uav_collect.limits import NO_AGENT
from uav_collect.lockstep.checks import name_problem
from uav_collect.lockstep.published_policy import PublishedPolicy
from uav_collect.lockstep.roster import Pilot
from uav_collect.lockstep.steering import Answer
from uav_collect.missions.event_log import mission_header
from uav_collect.missions.simulation import (
    Event,
    FAILSAFE_DECISION,
    FAILSAFE_VERSION,
    FAULT_DECISION,
    Simulation,
)
from uav_collect.nodes import convert
from uav_collect.recording.mission_log import (
    Events,
    FaultRecord,
    header_line,
    MissionHeader,
)
from uav_collect.scenario.model import FAULT_KINDS
from uav_collect.scenario.site import Site
from uav_collect.uav import action_codes
from uav_collect.uav.messages import Decision, packed_maps, RadioMessage
from uav_collect.uav.policy import TOPIC
from uav_collect_msgs.msg import Epoch, Mission, Observation, UavFigures
from uav_collect_msgs.msg import RadioMessage as RadioMessageMsg


@dataclass
class PendingDecision:
    """The event that waits for the deciding UAV's answer."""

    event: Event
    observation: Observation
    decision: Decision | None = None
    complete: Row[int] | None = None  # the map that the UAV transmitted
    policy_version: str = ''

    @property
    def is_answered(self) -> bool:
        """Whether command and radio message are both here."""
        return self.decision is not None and self.complete is not None


@dataclass
class _UavHistory:
    """What one UAV was sent in this mission; a restarted agent gets it again."""

    observations: list[Observation] = field(default_factory=list)
    radio: list[RadioMessageMsg] = field(default_factory=list)


class MissionInFlight:
    """A mission from its start to its end; the node publishes what the methods return."""

    def __init__(
        self,
        site: Site,
        seed: int,
        *,
        mission_id: str,
        pilots: dict[int, Pilot],
        policy: PublishedPolicy | None = None,
        clock_start_s: float = 0.0,
    ) -> None:
        """Put the mission to its start, each UAV flown by its pilot, if it has one.

        Args:
            policy: of a trainer, for the pilots that follow one.
            clock_start_s: what the clock shows now; times of the mission count from then on.
        """
        self.mission_id = mission_id
        self.clock_start_s = clock_start_s
        self.policy = policy
        self.seed = seed
        self.simulation = Simulation(site, seed)
        scenario = site.scenario
        ids = range(1, scenario.n_uavs + 1)
        self.header: MissionHeader = mission_header(
            scenario,
            seed,
            self.simulation.demand_bit,
            [_flown_by(pilots.get(uav), policy) for uav in ids],
            [pilots[uav].allocator if uav in pilots else NO_AGENT for uav in ids],
            [pilots[uav].guard_after if uav in pilots else action_codes.NONE for uav in ids],
        )
        flown = [pilot for pilot in pilots.values() if pilot.policy_version]  # not what it follows
        self.policy_versions = {pilot.policy: pilot.policy_version for pilot in flown}  # by name
        self.unflown = {uav for uav in ids if uav not in pilots}  # ids the failsafe flies home
        self._gone: set[int] = set()  # of them, those whose agents a fault took
        self.pending: PendingDecision | None = None
        self.n_radio_messages = 0
        self.n_decisions = 0
        self.time_s = 0.0  # of the latest event that has happened: the next one may be held back
        self._n_cells = scenario.n_cells
        self._histories: dict[int, _UavHistory] = defaultdict(_UavHistory)  # by id
        self._injected: list[tuple[str, int]] = []  # kinds and indices, for the next event
        self._outbox: defaultdict[int, list[RadioMessageMsg]] = defaultdict(list)  # by receiver
        self._event: Event | None = None  # the next one, once known
        self._open: tuple[float, str] | None = None  # time and policy of the latest event

    def next_event(self) -> Event | None:
        """The event for which no decision was requested yet; None when all fly home."""
        if self._event is None:
            for kind, uav in self._injected:
                self.simulation.inject(kind, uav)
            self._injected.clear()
            self._event = self.simulation.next_event()
        return self._event

    def inject(self, kind: str, uav: int) -> Answer:
        """Let a fault befall a UAV, by id; whether it will, and from when on or why not."""
        n_uavs = self.simulation.briefing.n_uavs
        if kind not in FAULT_KINDS:
            return False, f'fault is {kind!r}: must be one of {", ".join(FAULT_KINDS)}'
        if not 1 <= uav <= n_uavs:
            return False, f'uav is {uav}: must be from 1 to {n_uavs}'
        for fault in self.simulation.faults():
            if (fault.fault, fault.uav) == (kind, uav):
                return False, f'UAV {uav} is {kind} already, since event {fault.event}'
        self._injected.append((kind, uav - 1))
        # An event that is held back is drawn already.
        first = self.simulation.n_events + (self._event is not None)
        return True, f'UAV {uav} is {kind} from event {first} on'

    @property
    def next_time_s(self) -> float:
        """Time of that event, or of the mission's end."""
        event = self._event
        return self.simulation.end_s if event is None else event.view.time_s

    @property
    def awaited_uav(self) -> int | None:
        """Id of the UAV that has to answer now, if one has."""
        return None if self.pending is None else self.pending.event.uav + 1

    def radio_before(self, event: Event) -> list[RadioMessageMsg]:
        """What the deciding UAV hears before it sees, to be published to it."""
        receiver = event.uav + 1
        for message in event.heard:
            self._send(receiver, self._radio_msg(message))
        return self._outbox.pop(receiver, [])

    def undelivered(self) -> Iterator[tuple[int, RadioMessageMsg]]:
        """What UAVs hear, with their ids, to be published to them; each is given once.

        They need it when they decide next, so it can wait until the one that decides now is asked.
        """
        while self._outbox:
            receiver, messages = self._outbox.popitem()
            yield from ((receiver, message) for message in messages)

    def request_decision(self, event: Event) -> Observation:
        """What the deciding UAV sees, to be published to it; its answer is awaited from now on."""
        history = self._histories[event.uav + 1]
        observation = self._observation_msg(event)
        observation.exploration_key = self.seed
        if self.policy is not None:
            observation.policy_trainer, observation.policy_sequence = self.policy.key
        history.observations.append(observation)
        self.pending = PendingDecision(event=event, observation=observation)
        self.time_s = event.view.time_s
        return observation

    def accept_command(self, uav: int, msg: Any) -> str | None:
        """Note a command for a UAV, by id; why it is refused, or None."""
        refusal = self._mismatch(uav, msg.decision)
        pending = self.pending
        if refusal or pending is None:
            return refusal
        decision = convert.decision_from_msg(msg)
        refusal = self.simulation.refusal(pending.event, decision) or name_problem(
            'policy_version', msg.policy_version
        )
        if refusal is None:
            pending.decision = decision
            pending.policy_version = msg.policy_version
        return refusal

    def accept_radio(self, uav: int, msg: Any) -> str | None:
        """Note what a UAV, by id, transmits; why it is refused, or None."""
        refusal = self._mismatch(uav, msg.sequence)
        if refusal or self.pending is None:
            return refusal
        if msg.sender != uav:
            return f'it names UAV {msg.sender} as its sender'
        try:
            self.pending.complete = convert.radio_from_msg(msg, self._n_cells).complete
        except ValueError as error:
            return str(error)
        return None

    def carry_out(self) -> None:
        """Do what the answered decision says; others hear the deciding UAV, at once or later."""
        pending = self.pending
        if pending is None or pending.decision is None or pending.complete is None:
            raise RuntimeError('there is no answered decision to carry out')
        event = pending.event
        hearers = self.simulation.transmit(event.uav, pending.complete)
        heard = self.simulation.radio(event.uav)
        for hearer in hearers:
            self._send(hearer + 1, self._radio_msg(heard))
        self._start(event, pending.decision, pending.policy_version)

    def fly_home(self, event: Event) -> Decision:
        """Let the failsafe fly the deciding UAV home; the decision that this is."""
        self.unflown.add(event.uav + 1)
        if event.is_gone:
            self._gone.add(event.uav + 1)
        self.time_s = event.view.time_s
        decision = FAULT_DECISION if event.is_gone else FAILSAFE_DECISION
        self._start(event, decision, FAILSAFE_VERSION)
        return decision

    def closed_event(self) -> tuple[Epoch, Events, tuple[FaultRecord, ...]] | None:
        """The latest event's epoch and log, once the next one is known; each is returned once.

        With it come the faults that it is the first with.

        The fleet's state is read here, not when the event's action starts: until the next action
        starts it is the same, and by now the next UAV already decides.
        """
        if self._open is None:
            return None
        (time_s, policy_version), self._open = self._open, None
        epoch = self._fleet_state(time_s)
        epoch.policy_version = policy_version
        epoch.terminal = self.simulation.is_over
        event = self.simulation.last_event()
        index = self.simulation.n_events - 1
        faults = tuple(fault for fault in self.simulation.faults() if fault.event == index)
        convert.fill_epoch(epoch, event, faults)
        return epoch, event, faults

    def fill_history(self, response: Any, pilot: Pilot) -> None:
        """Give an agent that joins all that its UAV was sent so far, and what it is flown by."""
        history, pending = self._histories[pilot.uav], self.pending
        response.mission_id = self.mission_id
        response.observations, response.radio = history.observations, history.radio
        response.decision_pending = pending is not None and pending.event.uav + 1 == pilot.uav
        if self.policy is not None and pilot.policy == TOPIC:
            response.policy = self.policy.message

    def final_observation(self, event: Event) -> Observation:
        """What ends the mission for the agent of a UAV that the failsafe flies home."""
        observation = self._observation_msg(event)
        observation.terminated = True
        return observation

    def stamp(self, time_s: float) -> Time:
        """A time of the mission as the clock shows it."""
        return convert.stamp(self.clock_start_s + time_s)

    def metrics(self) -> MissionMetrics:
        """What the mission has achieved so far."""
        return mission_metrics(self.simulation.log(self.header))

    @property
    def failsafe_note(self) -> str:
        """Which UAVs the failsafe flew home, for people; empty if none."""
        notes = (
            ('the failsafe flew home', self.unflown - self._gone),
            ('a fault took the agents of', self._gone),
        )
        return '; '.join(
            f'{what}: {", ".join(f"UAV {uav}" for uav in sorted(uavs))}'
            for what, uavs in notes
            if uavs
        )

    def _mismatch(self, uav: int, decision: int) -> str | None:
        if self.pending is None or self.pending.event.uav + 1 != uav:
            return f'decision {decision} is not awaited'
        expected = self.pending.event.decision
        if decision == expected:
            return None
        word = 'stale' if decision < expected else 'future'
        return f'{word} decision {decision}, awaited is {expected}'

    def _observation_msg(self, event: Event) -> Observation:
        n_radio = len(self._histories[event.uav + 1].radio)
        return convert.observation_msg(event, self.mission_id, n_radio, self.clock_start_s)

    def _radio_msg(self, message: RadioMessage) -> RadioMessageMsg:
        return convert.radio_msg(
            message,
            self.mission_id,
            sequence=message.decision,
            clock_start_s=self.clock_start_s,
        )

    def _send(self, receiver: int, message: RadioMessageMsg) -> None:
        history = self._histories[receiver]
        message.delivery = len(history.radio) + 1
        history.radio.append(message)
        self._outbox[receiver].append(message)
        self.n_radio_messages += 1

    def _start(self, event: Event, decision: Decision, policy_version: str) -> None:
        self.pending = self._event = None
        self.n_decisions += decision.action != action_codes.HOME
        self.simulation.start(event, decision)
        self._open = (event.view.time_s, policy_version)

    def _fleet_state(self, time_s: float) -> Epoch:
        simulation, uavs = self.simulation, range(self.simulation.briefing.n_uavs)
        places_m = [simulation.position_m(uav, time_s) for uav in uavs]
        served = row_of([int(bit <= 0.0) for bit in simulation.waiting_bit()])
        return Epoch(
            stamp=self.stamp(time_s),
            mission_id=self.mission_id,
            uav_x_m=array('d', [x_m for x_m, _ in places_m]),
            uav_y_m=array('d', [y_m for _, y_m in places_m]),
            uav_energy_left_j=array('d', [simulation.energy_left_j(uav) for uav in uavs]),
            uav_phase=array('B', [simulation.phase(uav, time_s) for uav in uavs]),
            uav_complete=packed_maps([simulation.known_complete(uav) for uav in uavs]),
            true_complete=packed_maps([served]),
            heard_back=simulation.is_radio_ideal,
        )


def mission_msg(mission: MissionInFlight, world_instance: str, index: int, phase: int) -> Mission:
    """What the world publishes of a mission at its start and at its end."""
    result = mission.metrics()
    message = Mission(
        stamp=mission.stamp(mission.time_s),
        mission_id=mission.mission_id,
        phase=phase,
        world_instance=world_instance,
        scenario_fingerprint=mission.header.scenario_fingerprint,
        seed=mission.seed,
        index=index,
        log_header=header_line(mission.header),
        demand_bit=array('d', mission.simulation.demand_bit),
        total_bit=result.total_bit,
    )
    if phase != Mission.STARTED:
        _add_figures(message, mission, result)
    return message


def mission_summary(message: Mission) -> str:
    """The end of a mission in one line."""
    has_ended = message.phase == Mission.ENDED
    word = 'ended' if has_ended else f'was aborted, {message.note},'
    duration = f'{message.completion_s:.1f} s, ' if has_ended else ''
    return (
        f'mission {message.mission_id} {word} after {message.n_decisions} decisions: '
        f'{message.collected_bit / 1e6:.2f} of {message.total_bit / 1e6:.2f} Mbit, '
        f'{message.energy_j / 1e3:.2f} kJ, {duration}'
        f'{message.efficiency_bit_per_j / 1e3:.4f} kbit/J'
    )


def _flown_by(pilot: Pilot | None, policy: PublishedPolicy | None) -> str:
    """The policy that the log's header names for a UAV."""
    if pilot is None:
        return NO_AGENT
    return policy.version if policy is not None and pilot.policy == TOPIC else pilot.policy


def _add_figures(message: Mission, mission: MissionInFlight, result: MissionMetrics) -> None:
    message.collected_bit = result.collected_bit
    message.completion_s = result.completion_s
    message.energy_j = result.energy_j
    message.efficiency_bit_per_j = result.efficiency_bit_per_j
    message.n_decisions = result.n_decisions
    message.n_radio_messages = mission.n_radio_messages
    message.failsafe_used = result.failsafe_used
    if math.isfinite(result.completion_s):
        message.stamp = mission.stamp(result.completion_s)
    message.uavs = [
        UavFigures(
            uav=uav.id,
            speed_mps=uav.speed_mps,
            energy_budget_j=uav.energy_budget_j,
            energy_j=uav.energy_j,
            collected_bit=uav.collected_bit,
            flight_s=uav.flight_s,
            hover_s=uav.hover_s,
            decisions=uav.n_decisions,
            guarded=uav.n_guarded,
            outcome=OUTCOME_CODES[uav.outcome],
        )
        for uav in result.uavs
    ]

"""A recorded mission flown again, with all that its messages must have said.

The record gives what no flight can bring forth: who flew each UAV, where the failsafe took over,
and which faults were injected. All the rest follows.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field

from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Row
from uav_collect.missions.event_log import fault_fields, mission_header
from uav_collect.missions.simulation import Event, FAILSAFE_VERSION, fly_agents, Simulation
from uav_collect.recording.mission_log import (
    FaultRecord,
    MissionHeader,
    MissionLog,
    record_lines,
)
from uav_collect.recording.mission_messages import MessagePlace
from uav_collect.scenario.model import FAULT_KINDS
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import HOVER
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.messages import Decision, packed_map, packed_maps, RadioMessage
from uav_collect.uav.observation import AnyLayout, Observer
from uav_collect.uav.policy import Policy
from uav_collect.uav.view import LocalView

Values = Mapping[str, object]  # of the fields of a message


@dataclass(frozen=True, kw_only=True)
class FlownBy:
    """Who flies one UAV of a mission that is flown again."""

    policy: Policy  # with a memory of its own
    allocator: str
    guard_after: int  # decisions without news after which its guard decides; NONE: it has none


@dataclass(kw_only=True)
class Reflight:
    """What came of a mission that was flown again."""

    log: MissionLog  # to its end, or until it could not go on
    demand_bit: Sequence[float]  # (S,)
    messages: Mapping[
        MessagePlace, Values
    ]  # what each of its messages must say, as far as that is known
    injected: Sequence[FaultRecord] = ()  # faults that were taken from the record
    failure: str | None = None  # why it could not go on

    def lines(self, event: int) -> tuple[str, ...]:
        """The lines of the mission log about an event, faults that it is the first with before."""
        faults = [fault for fault in self.log.faults if fault.event == event]
        return tuple(record_lines(self.log.events[event : event + 1], faults))


def fly_again(
    site: Site,
    header: MissionHeader,
    crew: Sequence[FlownBy | None],
    *,
    failsafes: Container[int] = (),
    layouts: Sequence[AnyLayout] = (),
    n_events: int | None = None,
    faults: Sequence[FaultRecord] = (),
) -> Reflight:
    """Fly a recorded mission again.

    Args:
        header: of its log.
        crew: by UAV; None: it had no agent.
        failsafes: events at which the failsafe took over from an agent.
        layouts: in which its transitions show what agents saw.
        n_events: after which to stop, the last one's interval still open; None: fly to the end.
        faults: that were recorded; those that do not come by themselves are injected.

    Raises:
        AllocationError: there is no such allocator.
        ConfigError: no UAV has the energy to start, or a layout has no room for the fleet.
        PolicyMismatchError: a policy does not fit.
    """
    injected: list[FaultRecord] = []
    while True:
        flown = _fly(
            *(site, header, crew, injected),
            failsafes=failsafes,
            layouts=layouts,
            n_events=n_events,
        )
        known = {*flown.log.faults, *injected}
        missing = [it for it in faults if it not in known and it.fault in FAULT_KINDS]
        if not missing:
            return flown
        # Later ones may come by themselves once these are there.
        first = min(fault.event for fault in missing)
        injected += [fault for fault in missing if fault.event == first]


def _fly(
    site: Site,
    header: MissionHeader,
    crew: Sequence[FlownBy | None],
    injected: Sequence[FaultRecord],
    *,
    failsafes: Container[int],
    layouts: Sequence[AnyLayout],
    n_events: int | None,
) -> Reflight:
    simulation = Simulation(site, header.mission_seed)
    agents = [
        None if each is None else _WatchedAgent(simulation.briefing, uav, each, layouts)
        for uav, each in enumerate(crew)
    ]
    epochs: list[dict[str, object]] = []
    failure = None
    _inject(simulation, injected, 0)
    try:
        for event in fly_agents(simulation, agents, failsafes):
            by = agents[event.uav]
            is_lost = by is None or event.is_gone or event.index in failsafes
            version = FAILSAFE_VERSION if is_lost or by is None else by.policy.version
            epochs.append(_fleet_state(simulation, event) | {'policy_version': version})
            if len(epochs) == n_events:
                break
            _inject(simulation, injected, event.index + 1)
    except PolicyMismatchError as error:
        failure = str(error)
    log = simulation.log(_header_again(site, header, simulation))
    return Reflight(
        log=log,
        demand_bit=simulation.demand_bit,
        messages=_messages(agents, epochs, log, header),
        injected=injected,
        failure=failure,
    )


def _inject(simulation: Simulation, faults: Sequence[FaultRecord], event: int) -> None:
    """Inject the faults that an event is the first with, before it is known."""
    for fault in faults:
        if fault.event == event and 1 <= fault.uav <= simulation.briefing.n_uavs:
            simulation.inject(fault.fault, fault.uav - 1)


def _header_again(site: Site, header: MissionHeader, simulation: Simulation) -> MissionHeader:
    """The header as it must read, by who flew alone."""
    guards = [uav.guard_after for uav in header.uavs]
    names = [uav.policy for uav in header.uavs], [uav.allocator for uav in header.uavs]
    seed, demand_bit = header.mission_seed, simulation.demand_bit
    return mission_header(site.scenario, seed, demand_bit, *names, guards)


def _messages(
    agents: 'Sequence[_WatchedAgent | None]',
    epochs: Sequence[dict[str, object]],
    log: MissionLog,
    header: MissionHeader,
) -> dict[MessagePlace, Values]:
    """What all messages of the mission say."""
    events = log.events
    messages: dict[MessagePlace, Values] = {}
    for uav, agent in enumerate(agents, start=1):
        if agent is not None:
            messages.update(agent.messages(uav, header))
    for number, state in enumerate(epochs):
        messages[MessagePlace('epoch', 0, number)] = state | _logged(log, number)
        for kind in ('observation', 'transition'):
            place = MessagePlace(kind, int(events['uav'][number]), int(events['decision'][number]))
            if place in messages:
                messages[place] = {**messages[place], 'event': number}
    return messages


@dataclass(kw_only=True)
class _Exchange:
    """What one UAV was sent and said at its decisions, and heard in between."""

    observations: list[dict[str, object]] = field(default_factory=list)
    commands: list[dict[str, object]] = field(default_factory=list)
    sent: list[dict[str, object]] = field(default_factory=list)
    heard: list[dict[str, object]] = field(default_factory=list)
    transitions: list[dict[str, object]] = field(default_factory=list)


class _WatchedAgent(Agent):
    """An agent that notes what its messages say."""

    def __init__(
        self, briefing: Briefing, uav: int, by: FlownBy, layouts: Sequence[AnyLayout]
    ) -> None:
        allocator = allocator_named(by.allocator)
        super().__init__(briefing, uav, by.policy, allocator, guard_after=by.guard_after)
        self._exchange = _Exchange()
        self._observers = {layout: Observer(layout, briefing, uav) for layout in layouts}

    def hear(self, message: RadioMessage) -> None:
        super().hear(message)
        self._exchange.heard.append(_radio(message) | {'sequence': message.decision})

    def observe(self, view: LocalView) -> None:
        super().observe(view)
        exchange = self._exchange
        exchange.sent.append(_radio(self.message(view)))  # numbered by the decision
        exchange.observations.append(_view(view) | {'n_radio_delivered': len(exchange.heard)})

    def decide(self, view: LocalView) -> Decision:
        decision = super().decide(view)
        self._exchange.commands.append(_command(decision))
        if self._observers:
            self._exchange.transitions.append(self._transition(view, decision))
        return decision

    def messages(self, uav: int, header: MissionHeader) -> dict[MessagePlace, Values]:
        """What the messages say that the agent of a UAV, by id, got and sent."""
        exchange = self._exchange
        about: dict[str, dict[str, object]] = {
            'observation': {'exploration_key': header.mission_seed, 'terminated': False},
            'command': {'policy_version': self.policy.version},
            'transition': {
                'uav': uav,
                'scenario_fingerprint': header.scenario_fingerprint,
                'policy_version': self.policy.version,
            },
        }
        kinds = {
            'observation': exchange.observations,
            'command': exchange.commands,
            'transition': exchange.transitions,
            'radio_tx': exchange.sent,
            'radio_rx': exchange.heard,
        }
        return {
            MessagePlace(kind, uav, number): values | about.get(kind, {})
            for kind, said in kinds.items()
            for number, values in enumerate(said, start=int(kind == 'radio_rx'))
        }

    def _transition(self, view: LocalView, decision: Decision) -> dict[str, object]:
        belief = self.belief
        encoded = {
            layout.label: [*observer.observe(belief, view, self.legal)]
            for layout, observer in self._observers.items()
        }
        seen = [int(bit > 0.0) for bit in belief.seen_bit]
        return {
            'time_s': view.time_s,
            'energy_left_j': view.energy_left_j,
            'cell': view.cell,
            'previous_action': view.previous_action,
            'legal': [bool(flag) for flag in self.legal],
            'action': decision.action,
            'complete': [*packed_map(belief.complete)],
            'seen': [*packed_map(_ints(seen))],
            'peer_x_m': [*belief.peer_x_m],
            'peer_y_m': [*belief.peer_y_m],
            'peer_s': [*belief.peer_s],
            'observation': encoded,  # by layout
        }


def _ints(flags: list[int]) -> Row[int]:
    return flags


def _view(view: LocalView) -> dict[str, object]:
    """What an observation says of a local view."""
    seen = slice(view.n_sensors)
    return {
        'time_s': view.time_s,
        'x_m': view.x_m,
        'y_m': view.y_m,
        'cell': view.cell,
        'energy_left_j': view.energy_left_j,
        'previous_action': view.previous_action,
        'region_demand_bit': [*view.region_bit],
        'sensor': [*view.sensor[seen]],
        'sensor_demand_bit': [*view.sensor_bit[seen]],
        'sensor_gain': [*view.sensor_gain[seen]],
        'sensor_error_gain': [*view.sensor_error_gain[seen]],
    }


def _command(decision: Decision) -> dict[str, object]:
    is_hover = decision.action == HOVER
    return {
        'action': decision.action,
        'reason': decision.reason,
        'sensor': [*decision.sensor] if is_hover else [],
        'bandwidth_hz': [*decision.share_hz] if is_hover else [],
    }


def _radio(message: RadioMessage) -> dict[str, object]:
    return {
        'sender': message.sender + 1,
        'time_s': message.time_s,
        'x_m': message.x_m,
        'y_m': message.y_m,
        'complete': [*packed_map(message.complete)],  # a copy: the sender's own goes on changing
    }


def _fleet_state(simulation: Simulation, event: Event) -> dict[str, object]:
    """What an epoch says of the fleet, right after the event's action has started."""
    uavs, time_s = range(simulation.briefing.n_uavs), event.view.time_s
    places_m = [simulation.position_m(uav, time_s) for uav in uavs]
    served = [int(bit <= 0.0) for bit in simulation.waiting_bit()]
    return {
        'terminal': simulation.is_over,
        'heard_back': simulation.is_radio_ideal,
        'uav_x_m': [x_m for x_m, _ in places_m],
        'uav_y_m': [y_m for _, y_m in places_m],
        'uav_energy_left_j': [simulation.energy_left_j(uav) for uav in uavs],
        'uav_phase': [int(simulation.phase(uav, time_s)) for uav in uavs],
        'uav_complete': [*packed_maps([simulation.known_complete(uav) for uav in uavs])],
        'true_complete': [*packed_map(_ints(served))],
    }


def _logged(log: MissionLog, number: int) -> dict[str, object]:
    """What an epoch says of its event, but for who was heard; and of faults."""
    names = log.events.dtype.names or ()
    values = dict(zip(names, log.events[number].item(), strict=True))
    del values['heard']  # as bits; lines of the log have the ids
    faults = [fault for fault in log.faults if fault.event == number]
    return {**values, **fault_fields(faults)}

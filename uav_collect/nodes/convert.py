"""Messages to records of the core and back."""

from array import array
from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from uav_collect.errors import in_one_line
from uav_collect.kernels.arrays import Row, row_of
from uav_collect.lockstep.roster import Pilot
from uav_collect.missions.event_log import fault_fields
from uav_collect.missions.simulation import Event
from uav_collect.recording.mission_log import Events, FaultRecord
from uav_collect.uav.belief import Belief
from uav_collect.uav.messages import Decision, packed_map, RadioMessage, unpacked_map
from uav_collect.uav.view import LocalView
from uav_collect_msgs.msg import Command, Epoch, Observation, Refusal, Transition
from uav_collect_msgs.msg import RadioMessage as RadioMessageMsg

_NANOSECONDS = 1_000_000_000


def stamp(time_s: float) -> Time:
    """Simulated time as ROS writes it."""
    sec, nanosec = divmod(round(time_s * _NANOSECONDS), _NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def observation_msg(
    event: Event, mission_id: str, n_radio_delivered: int, clock_start_s: float = 0.0
) -> Observation:
    """What the deciding UAV of an event sees.

    Args:
        clock_start_s: what the clock showed as the mission began.
    """
    view = event.view
    seen = view.n_sensors
    return Observation(
        stamp=stamp(clock_start_s + view.time_s),
        mission_id=mission_id,
        decision=event.decision,
        event=event.index,
        time_s=view.time_s,
        x_m=view.x_m,
        y_m=view.y_m,
        cell=view.cell,
        energy_left_j=view.energy_left_j,
        region_demand_bit=list(view.region_bit),
        sensor=array('I', view.sensor[:seen]),
        sensor_demand_bit=array('d', view.sensor_bit[:seen]),
        sensor_gain=array('d', view.sensor_gain[:seen]),
        sensor_error_gain=array('d', view.sensor_error_gain[:seen]),
        previous_action=view.previous_action,
        n_radio_delivered=n_radio_delivered,
    )


def view_from_msg(msg: Any) -> LocalView:
    """The local view in an observation."""
    return LocalView(
        time_s=msg.time_s,
        x_m=msg.x_m,
        y_m=msg.y_m,
        cell=msg.cell,
        energy_left_j=msg.energy_left_j,
        previous_action=msg.previous_action,
        region_bit=row_of(msg.region_demand_bit.tolist()),
        n_sensors=len(msg.sensor),
        sensor=row_of(msg.sensor.tolist()),
        sensor_bit=row_of(msg.sensor_demand_bit.tolist()),
        sensor_gain=row_of(msg.sensor_gain.tolist()),
        sensor_error_gain=row_of(msg.sensor_error_gain.tolist()),
    )


def command_msg(decision: Decision, observation: Any) -> Command:
    """A decision as the answer to an observation."""
    return Command(
        stamp=observation.stamp,
        mission_id=observation.mission_id,
        decision=observation.decision,
        action=decision.action,
        reason=decision.reason,
        sensor=array('I', decision.sensor),
        bandwidth_hz=array('d', decision.share_hz),
    )


GREETING = 'greeting'  # what is refused, in a Refusal


def greeting_msg(agent_instance: str) -> Command:
    """What an agent sends first, to take the UAV that it has joined for: no action."""
    return Command(agent_instance=agent_instance, action=Command.ACTION_NONE)


def is_greeting(msg: Any) -> bool:
    """Whether a command is none, but a greeting."""
    return msg.action == Command.ACTION_NONE and not msg.mission_id


def decision_from_msg(msg: Any) -> Decision:
    """The decision in a command."""
    return Decision(
        action=msg.action,
        reason=msg.reason,
        sensor=tuple(msg.sensor),
        share_hz=tuple(msg.bandwidth_hz),
    )


def refusal_msg(what: str, msg: Any, why: str, at: Time) -> Refusal:
    """Why something that an agent sent, such as a command, was not done."""
    is_command = isinstance(msg, Command)
    return Refusal(
        stamp=at,
        agent_instance=in_one_line(msg.agent_instance) if is_command else '',
        what=what,
        mission_id=in_one_line(msg.mission_id),
        decision=msg.decision if is_command else msg.sequence,
        reason=in_one_line(why),
    )


def refusal_of_greeting(agent_instance: str, why: str, at: Time) -> Refusal:
    """Why an agent does not fly any more that did: it has to join anew."""
    return Refusal(
        stamp=at,
        agent_instance=in_one_line(agent_instance),
        what=GREETING,
        reason=in_one_line(why),
    )


def pilot_from_request(request: Any) -> Pilot:
    """The agent process that asks to join."""
    return Pilot(
        uav=request.uav,
        instance=request.agent_instance,
        host=request.host,
        pid=request.pid,
        policy=request.policy,
        policy_version=request.policy_version,
        allocator=request.allocator,
        guard_after=request.guard_after,
    )


def radio_msg(
    message: RadioMessage,
    mission_id: str,
    *,
    sequence: int,
    delivery: int = 0,
    clock_start_s: float = 0.0,
) -> RadioMessageMsg:
    """What one UAV transmits to others, as a message.

    Args:
        sequence: running number of the sender's decisions.
        delivery: running number of deliveries to the receiver, from 1; 0 on its way out.
        clock_start_s: what the clock showed as the mission began.
    """
    return RadioMessageMsg(
        stamp=stamp(clock_start_s + message.time_s),
        mission_id=mission_id,
        sender=message.sender + 1,
        sequence=sequence,
        delivery=delivery,
        time_s=message.time_s,
        x_m=message.x_m,
        y_m=message.y_m,
        complete=array('B', packed_map(message.complete)),
    )


def radio_from_msg(msg: Any, n_cells: int) -> RadioMessage:
    """What one UAV has transmitted to others.

    Raises:
        ValueError: its map is not one of that many cells.
    """
    return RadioMessage(
        sender=msg.sender - 1,
        complete=row_of(unpacked_map(msg.complete, n_cells)),
        x_m=msg.x_m,
        y_m=msg.y_m,
        time_s=msg.time_s,
    )


def transition_msg(
    observation: Any,
    *,
    uav: int,
    layout: str,
    scenario_fingerprint: str,
    policy_version: str,
    belief: Belief,
    encoded: Row[float],
    legal: Row[int],
    action: int,
) -> Transition:
    """What a learner needs of a decision.

    Args:
        observation: that was answered.
        uav: index of the deciding UAV.
        layout: label of the layout of `encoded`.
        belief: of the UAV when it decided.
    """
    return Transition(
        stamp=observation.stamp,
        mission_id=observation.mission_id,
        uav=uav + 1,
        event=observation.event,
        decision=observation.decision,
        layout=layout,
        scenario_fingerprint=scenario_fingerprint,
        policy_version=policy_version,
        observation=array('f', encoded),
        legal=[bool(flag) for flag in legal],
        action=action,
        time_s=observation.time_s,
        energy_left_j=observation.energy_left_j,
        cell=observation.cell,
        previous_action=observation.previous_action,
        complete=array('B', packed_map(belief.complete)),
        seen=array('B', packed_map(row_of([int(bit > 0.0) for bit in belief.seen_bit]))),
        peer_x_m=array('d', belief.peer_x_m),
        peer_y_m=array('d', belief.peer_y_m),
        peer_s=array('d', belief.peer_s),
    )


def fill_epoch(epoch: Epoch, events: Events, faults: Sequence[FaultRecord] = ()) -> None:
    """Write the one event of `events` into an epoch, field by field of the mission log.

    Args:
        faults: that the event is the first with.
    """
    for name, values in fault_fields(faults).items():
        setattr(epoch, name, values)
    for name, value in zip(events.dtype.names or (), events[0].tolist(), strict=True):
        setattr(epoch, name, array('B', uav_ids(value)) if name == 'heard' else value)


def uav_ids(mask: int) -> list[int]:
    """The ids of the UAVs in a bit mask of indices."""
    return [index + 1 for index in range(mask.bit_length()) if mask >> index & 1]

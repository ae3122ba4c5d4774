"""Reports out of messages, whether they come on topics or out of bags."""

from collections.abc import Callable
import re
from typing import Any

from uav_collect.errors import RefusedError
from uav_collect.ingest.reports import EventReport, FleetReport, MissionReport, TransitionReport

_ABORTED = 2  # Mission.ABORTED; a bag knows its messages without their constants
_MISSION_ID = re.compile(r'[!-~]{1,64}-(?:0|[1-9][0-9]{0,9})')
_LONGEST = 64  # characters of other names
_KINDS = re.compile(r'(?P<world>.*)/(?:world/(?P<kind>mission|epoch)|uav_\d+/transition)')


def converter_for(topic: str) -> tuple[str, Callable[[Any], FleetReport]] | None:
    """How to make reports of the messages on a topic, by its name.

    Returns:
        The namespace of its world, and what converts its messages, which raises a RefusedError for
        those that name their mission as no world does; None for a topic that reports nothing to a
        learner.
    """
    match = _KINDS.fullmatch(topic)
    if match is None:
        return None
    kinds: dict[str | None, Callable[[Any], FleetReport]] = {
        'mission': mission_report,
        'epoch': event_report,
        None: transition_report,
    }
    return match['world'], kinds[match['kind']]


def mission_report(msg: Any) -> MissionReport:
    """What a Mission message reports, at the start as at the end."""
    return MissionReport(
        mission_id=_mission_id(msg),
        world_instance=_name(msg, 'world_instance'),
        scenario_fingerprint=_name(msg, 'scenario_fingerprint'),
        mission_seed=int(msg.seed),
        demand_bit=msg.demand_bit.tobytes(),
        cut_after=int(msg.n_decisions) if msg.phase == _ABORTED else None,
    )


def event_report(msg: Any) -> EventReport:
    """What an Epoch message reports."""
    return EventReport(
        mission_id=_mission_id(msg),
        event=int(msg.event),
        uav=int(msg.uav) - 1,
        decision=int(msg.decision),
        time_s=float(msg.time_s),
        x_m=float(msg.x_m),
        y_m=float(msg.y_m),
        action=int(msg.action),
        reason=int(msg.reason),
        duration_s=float(msg.duration_s),
        energy_left_j=float(msg.energy_left_j),
        energy_j=float(msg.energy_j),
        collected_bit=float(msg.collected_bit),
        reward=float(msg.reward),
        is_last=bool(msg.terminal),
        uav_x_m=msg.uav_x_m.tobytes(),
        uav_y_m=msg.uav_y_m.tobytes(),
        uav_energy_left_j=msg.uav_energy_left_j.tobytes(),
        uav_phase=msg.uav_phase.tobytes(),
        uav_complete=msg.uav_complete.tobytes(),
        true_complete=msg.true_complete.tobytes(),
    )


def transition_report(msg: Any) -> TransitionReport:
    """What a Transition message reports."""
    return TransitionReport(
        mission_id=_mission_id(msg),
        event=int(msg.event),
        uav=int(msg.uav) - 1,
        decision=int(msg.decision),
        layout=_name(msg, 'layout'),
        scenario_fingerprint=_name(msg, 'scenario_fingerprint'),
        observation=msg.observation.tobytes(),
        legal=sum(int(is_legal) << action for action, is_legal in enumerate(msg.legal)),
        action=int(msg.action),
        time_s=float(msg.time_s),
        energy_left_j=float(msg.energy_left_j),
        cell=int(msg.cell),
        previous_action=int(msg.previous_action),
        complete=msg.complete.tobytes(),
        seen=msg.seen.tobytes(),
        peer_x_m=msg.peer_x_m.tobytes(),
        peer_y_m=msg.peer_y_m.tobytes(),
        peer_s=msg.peer_s.tobytes(),
    )


def _mission_id(msg: Any) -> str:
    """Which mission a message is of: a world and a running number.

    Raises:
        RefusedError: it names none.
    """
    mission_id: str = msg.mission_id
    if _MISSION_ID.fullmatch(mission_id) is None:
        raise RefusedError(
            f'mission_id is {mission_id[:_LONGEST]!r}: must be a world and a number, as world-7'
        )
    return mission_id


def _name(msg: Any, field: str) -> str:
    """A short text of a message.

    Raises:
        RefusedError: it is not short.
    """
    name: str = getattr(msg, field)
    if len(name) > _LONGEST:
        raise RefusedError(
            f'mission {msg.mission_id}: {field} has {len(name)} characters:'
            f' must have at most {_LONGEST}'
        )
    return name

"""Holds the messages of a recorded mission against those of the same mission flown again.

What does not follow from the mission is left out: how it is counted in its world and noted for
people, how many messages were delivered in all, and what an aborted one had come to by then.
"""

from collections.abc import Container, Iterable, Iterator, Sequence
import math
from typing import Any

import numpy as np
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics, OUTCOME_CODES
from uav_collect.missions.reflight import Reflight, Values
from uav_collect.recording.completeness import ABORTED, ENDED, STARTED
from uav_collect.recording.mission_log import header_line
from uav_collect.recording.mission_messages import MessagePlace, MissionMessages
from uav_collect.uav.action_codes import FAILSAFE, FAULT

_FROM_WORLD = ('epoch', 'observation', 'radio_rx')  # kinds that agents do not send
NOT_RECORDED = 'not recorded'  # what lines about gaps end with
_STAMP_NS = 2  # what two roundings may make of a stamp
_NANOSECONDS = 1_000_000_000


def message_differences(
    mission: MissionMessages, flown: Reflight, n_events: int, ignored: Container[str]
) -> Iterator[str]:
    """What messages say otherwise than the mission flown again, one line each, epochs first.

    Args:
        n_events: of the mission that are recorded.
        ignored: fields that are known to differ.
    """
    lost = _uavs_by(flown, (FAILSAFE, FAULT))
    limits = _heard_before_failsafes(_uavs_by(flown, (FAILSAFE,)), flown)
    start = mission.phases.get(STARTED)
    start_ns = None if start is None else _nanoseconds(start)
    for place in sorted(mission.placed, key=lambda it: (it.kind != 'epoch', it)):
        if place.kind == 'radio_rx' and place.number > limits.get(place.uav, math.inf):
            continue
        values = flown.messages.get(place)
        if values is None:
            # An agent that is lost was asked but did not answer in time, or is told that it is.
            is_unanswered = place.kind == 'observation' and place.uav in lost
            if place.kind in _FROM_WORLD and not is_unanswered:
                yield f'{_name(place)}: there is none such in the mission'
            continue
        found = [
            _difference(msg, values, ignored, start_ns) for msg in mission.placed[place]
        ]  # of what agents repeat or the world refuses, one counts
        if None not in found:
            yield f'{_name(place)}: {found[0]}'
    yield from _lacking(mission, flown, n_events, limits)
    yield from _phase_differences(mission, flown)


def _difference(
    message: Any,  # noqa: ANN401 - a message
    values: Values,
    ignored: Container[str],
    start_ns: int | None,
) -> str | None:
    """The first field that a message has otherwise, with both values."""
    for name, flown in values.items():
        recorded = getattr(message, name, None)
        if isinstance(flown, dict):  # by layout
            flown = flown.get(getattr(message, 'layout', ''))
        if recorded is None or flown is None or name in ignored:
            continue
        if not _is_equal(recorded, flown):
            return f'{name} is {_shown(recorded, flown)}'
    time_s, stamp = values.get('time_s'), getattr(message, 'stamp', None)
    if start_ns is not None and isinstance(time_s, float) and stamp is not None:
        flown_ns = start_ns + round(time_s * _NANOSECONDS)
        if abs(_nanoseconds(message) - flown_ns) > _STAMP_NS:
            return f'stamp is {_nanoseconds(message)} ns, flown {flown_ns} ns'
    return None


def _is_equal(recorded: Any, flown: object) -> bool:  # noqa: ANN401 - a field
    """Whether a field has the flown value, to the bit."""
    if isinstance(flown, list):
        mine = np.asarray(recorded)
        return len(mine) == len(flown) and mine.tobytes() == np.array(flown, mine.dtype).tobytes()
    return bool(recorded == flown) or (recorded != recorded and flown != flown)


def _shown(recorded: Any, flown: object) -> str:  # noqa: ANN401 - a field
    """Both values; of lists the first elements that differ."""
    if not isinstance(flown, list):
        return f'{recorded}, flown {flown}'
    mine = np.asarray(recorded)
    if len(mine) != len(flown):
        return f'{len(mine)} long, flown {len(flown)}'
    again = np.array(flown, mine.dtype)
    at = next(i for i in range(len(mine)) if mine[i].tobytes() != again[i].tobytes())
    return f'{mine[at]} at {at}, flown {again[at]}'


def _name(place: MessagePlace) -> str:
    if place.kind == 'epoch':
        return f'event {place.number}'
    return f'{place.kind} {place.number} of UAV {place.uav}'


def _nanoseconds(message: Any) -> int:  # noqa: ANN401 - a message
    return int(message.stamp.sec) * _NANOSECONDS + int(message.stamp.nanosec)


def _uavs_by(flown: Reflight, reasons: Sequence[int]) -> set[int]:
    """The ids of the UAVs that flew home for some reasons."""
    events = flown.log.events
    return {int(uav) for uav in events['uav'][np.isin(events['reason'], reasons)]}


def _heard_before_failsafes(lost: Iterable[int], flown: Reflight) -> dict[int, int]:
    """By UAV that the failsafe took over, how many deliveries its agent surely had before."""
    limits = dict.fromkeys(lost, 0)
    for place, values in flown.messages.items():
        n_delivered = values.get('n_radio_delivered')
        if place.uav in limits and isinstance(n_delivered, int):
            limits[place.uav] = max(limits[place.uav], n_delivered)
    return limits


def _lacking(
    mission: MissionMessages, flown: Reflight, n_events: int, limits: dict[int, int]
) -> Iterator[str]:
    """Messages of a mission that should be there, the first of each kind."""
    if not {ENDED, ABORTED} & mission.phases.keys():
        return  # the recording was cut off: anything may be missing at its end
    kinds = {place.kind for place in mission.placed} | {'epoch'}
    known = {(int(event['uav']), int(event['decision'])) for event in flown.log.events[:n_events]}
    for kind in sorted(kinds, key=lambda it: (it != 'epoch', it)):
        lacking = [
            place
            for place in flown.messages
            if place.kind == kind
            and place not in mission.placed
            and _is_expected(place, n_events, known, limits, is_over=ENDED in mission.phases)
        ]
        if lacking:
            more = f' and {len(lacking) - 1} more' if len(lacking) > 1 else ''
            yield f'{_name(min(lacking))}{more}: {NOT_RECORDED}'


def _is_expected(
    place: MessagePlace,
    n_events: int,
    known: Container[tuple[int, int]],
    limits: dict[int, int],
    *,
    is_over: bool,
) -> bool:
    if place.kind == 'epoch':
        return place.number < n_events
    if place.kind == 'radio_rx':
        return is_over and place.number <= limits.get(place.uav, math.inf)
    return (place.uav, place.number) in known


def _phase_differences(mission: MissionMessages, flown: Reflight) -> Iterator[str]:
    """What the messages about start and end say otherwise."""
    log = flown.log
    metrics = mission_metrics(log)
    for phase, message in sorted(mission.phases.items()):
        values: dict[str, object] = {
            'seed': log.header.mission_seed,
            'scenario_fingerprint': log.header.scenario_fingerprint,
            'log_header': header_line(log.header),
            'demand_bit': [*flown.demand_bit],
            'total_bit': metrics.total_bit,
        }
        if phase == ENDED:
            values |= _figures(metrics)
        elif phase != ABORTED:
            values |= dict.fromkeys(('collected_bit', 'completion_s', 'energy_j'), 0.0)
        word = {ENDED: 'end', ABORTED: 'abort'}.get(phase, 'start')
        found = _difference(message, values, (), None)
        if found is None and phase == ENDED:
            found = _uav_difference(message, metrics)
        if found is not None:
            yield f'message about its {word}: {found}'


def _figures(metrics: MissionMetrics) -> dict[str, object]:
    return {
        'collected_bit': metrics.collected_bit,
        'completion_s': metrics.completion_s,
        'energy_j': metrics.energy_j,
        'efficiency_bit_per_j': metrics.efficiency_bit_per_j,
        'n_decisions': metrics.n_decisions,
        'failsafe_used': metrics.failsafe_used,
    }


def _uav_difference(message: Any, metrics: MissionMetrics) -> str | None:  # noqa: ANN401
    recorded: Sequence[Any] = message.uavs
    if len(recorded) != len(metrics.uavs):
        return f'uavs is {len(recorded)} long, flown {len(metrics.uavs)}'
    for one, uav in zip(recorded, metrics.uavs, strict=True):
        values = {
            'uav': uav.id,
            'speed_mps': uav.speed_mps,
            'energy_budget_j': uav.energy_budget_j,
            'energy_j': uav.energy_j,
            'collected_bit': uav.collected_bit,
            'flight_s': uav.flight_s,
            'hover_s': uav.hover_s,
            'decisions': uav.n_decisions,
            'guarded': uav.n_guarded,
            'outcome': OUTCOME_CODES[uav.outcome],
        }
        found = _difference(one, values, (), None)
        if found is not None:
            return f'UAV {uav.id}: {found}'
    return None

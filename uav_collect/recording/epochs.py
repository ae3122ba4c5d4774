"""Events of the mission log out of Epoch messages, whoever has read them: a bag or a node."""

from collections.abc import Iterable
from typing import Any

from uav_collect.errors import in_one_line
from uav_collect.recording.log_model import EVENT_NAMES, EventModel, fault_problem
from uav_collect.recording.mission_log import FaultRecord
from uav_collect.scenario.model import FAULT_KINDS


def epoch_problem(epoch: Any, model: EventModel) -> str | None:  # noqa: ANN401 - a message
    """What an Epoch message says that cannot be; None if all can."""
    try:
        model.heard_bits([int(uav) for uav in epoch.heard])
        problem = model.problem(row_of(epoch))
        if problem is None and hasattr(epoch, 'fault'):
            faults = zip(epoch.fault, epoch.fault_uav, epoch.fault_s, strict=True)
            for kind, uav, begin_s in faults:
                values = {
                    'event': int(epoch.event),
                    'time_s': float(begin_s),
                    'uav': int(uav),
                    'fault': FAULT_KINDS[kind] if kind < len(FAULT_KINDS) else int(kind),
                }
                problem = problem or fault_problem(values, model.n_uavs)
    except ValueError as error:
        return in_one_line(str(error))
    return problem


def row_of(epoch: Any) -> tuple[Any, ...]:  # noqa: ANN401 - a message
    """The event of the mission log that an Epoch message is about, by EVENT_DTYPE.

    Raises:
        ValueError: it names a UAV that cannot be.
    """
    values = {name: getattr(epoch, name) for name in EVENT_NAMES}
    values['heard'] = _bits(values['heard'])
    return tuple(values.values())


def faults_of(epochs: Iterable[Any]) -> tuple[FaultRecord, ...]:
    """The faults that Epoch messages tell of."""
    return tuple(
        FaultRecord(
            event=int(epoch.event), time_s=float(begin_s), uav=int(uav), fault=FAULT_KINDS[kind]
        )
        for epoch in epochs
        if hasattr(epoch, 'fault')  # bags of before there were any do not know them
        for kind, uav, begin_s in zip(epoch.fault, epoch.fault_uav, epoch.fault_s, strict=True)
    )


def _bits(uavs: Any) -> int:  # noqa: ANN401 - an array of ids
    """Ids from 1 as the bits of one number."""
    return sum(1 << (int(uav) - 1) for uav in uavs)

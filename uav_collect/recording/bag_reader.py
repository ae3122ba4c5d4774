"""Reads the missions of a recording: the same logs, to the byte, that the world has written."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from uav_collect.errors import BagError, ConfigError, MissionLogError
from uav_collect.kernels.arrays import Floats
from uav_collect.recording.bag_checksums import READER_ERRORS
from uav_collect.recording.completeness import ENDED
from uav_collect.recording.log_model import EVENT_DTYPE
from uav_collect.recording.mission_log import (
    Events,
    FaultRecord,
    header_from_line,
    MissionLog,
)
from uav_collect.scenario.load import from_yaml
from uav_collect.scenario.model import FAULT_KINDS
from uav_collect.scenario.site import build_site, Site

# What topics end with: worlds may have a namespace.
_SCENARIO = '/world/scenario'
_MISSION = '/world/mission'
_EPOCH = '/world/epoch'
_DELIVERED = '/radio_rx'


@dataclass(frozen=True, kw_only=True)
class RecordedMission:
    """One mission as a bag has it: its log, and what it was flown over."""

    log: MissionLog  # of the events that were recorded
    site: Site
    demand_bit: Floats  # (S,) data of each sensor at the start
    n_radio_messages: int  # delivered between UAVs
    is_complete: bool  # ended, and every event of it was recorded
    index: int = 0  # running number of the mission in its world


@dataclass(kw_only=True)
class _Parts:
    """What was found of one mission."""

    start: Any  # the first Mission message
    phases: set[int] = field(default_factory=set)
    epochs: dict[int, Any] = field(default_factory=dict)  # by event
    n_radio_messages: int = 0


def read_missions(path: Path) -> list[RecordedMission]:
    """All missions of a bag, in the order they were flown; what was missed is left out of them.

    Args:
        path: folder of the bag.

    Raises:
        BagError: there is no bag, its recorder was cut off, or it holds no mission.
    """
    scenarios: dict[str, list[Any]] = {}  # Scenario messages by world
    missions: dict[str, _Parts] = {}
    parts_of_missions = (_SCENARIO, _MISSION, _EPOCH, _DELIVERED)
    for topic, message in messages(path, lambda name: name.endswith(parts_of_missions)):
        if topic.endswith(_SCENARIO):
            scenarios.setdefault(message.world_instance, []).append(message)
            continue
        parts = missions.setdefault(message.mission_id, _Parts(start=None))
        if topic.endswith(_MISSION):
            parts.start = parts.start or message
            parts.phases.add(int(message.phase))
        elif topic.endswith(_EPOCH):
            parts.epochs[int(message.event)] = message
        else:
            parts.n_radio_messages += 1
    found = [parts for parts in missions.values() if parts.start is not None]
    if not found:
        raise BagError(f'{path}: holds no mission, neither start nor end of one was recorded')
    flown = {_flown_of(parts) for parts in found}
    sites = {
        (world, wanted): _site_of(path, scenarios[world], wanted)
        for world, wanted in flown
        if world in scenarios
    }
    return [_mission(path, parts, sites) for parts in found]


def messages(
    path: Path,
    is_wanted: Callable[[str], bool],
    is_accepted: Callable[[str, bytes], bool] | None = None,
) -> Iterator[tuple[str, Any]]:
    """Topic and content of the messages of some topics, as received, but bytes that are none.

    Args:
        path: folder of the bag.
        is_wanted: of a topic, by its name.
        is_accepted: of a serialized message on a topic; None: all are.

    Raises:
        BagError: there is no bag, or its recorder was cut off.
    """
    with _reader(path) as reader:
        wanted = [it for it in reader.connections if is_wanted(it.topic)]
        for connection, _, content in reader.messages(wanted) if wanted else ():
            if is_accepted is not None and not is_accepted(connection.topic, content):
                continue
            try:
                message = reader.deserialize(content, connection.msgtype)
            except AnyReaderError:
                continue
            yield connection.topic, message


@contextmanager
def _reader(path: Path) -> Iterator[AnyReader]:
    if not path.exists():
        raise BagError(f'{path}: no such bag')
    if path.is_dir() and not (path / 'metadata.yaml').exists():
        if any(path.glob('*.mcap*')):
            raise BagError(f'{path}: its recorder was cut off; run: recorder --repair {path}')
        raise BagError(f'{path}: not a bag, it has no metadata.yaml')
    try:
        with AnyReader([path]) as reader:
            yield reader
    except READER_ERRORS as error:
        raise BagError(
            f'{path}: cannot be read ({error}); try: recorder --repair {path}'
        ) from error


def _flown_of(parts: _Parts) -> tuple[str, str]:
    """The world of a mission, and the fingerprint of the scenario that it had then."""
    return parts.start.world_instance, parts.start.scenario_fingerprint


def _site_of(path: Path, sent: list[Any], wanted: str) -> Site:
    """The site of a world, by the first of its Scenario messages that tells one.

    Args:
        wanted: fingerprint of the scenario; a world may have had others.
    """
    errors = []
    for message in [it for it in sent if it.fingerprint == wanted] or sent:
        try:
            return recorded_site(path, message)
        except BagError as error:
            errors.append(error)
    raise errors[0]


def recorded_site(path: Path, message: Any) -> Site:  # noqa: ANN401 - a message
    """The site that a Scenario message in a bag tells.

    Raises:
        BagError: it is not valid here, or its sensors would be others.
    """
    try:
        site = build_site(from_yaml(message.yaml))
    except ConfigError as error:
        raise BagError(f'{path}: its scenario is not valid here: {error}') from error
    recorded_m = np.column_stack([message.sensor_x_m, message.sensor_y_m])
    if not np.array_equal(site.position_m, recorded_m):
        raise BagError(f'{path}: its sensors are not those that this version draws')
    return site


def _mission(path: Path, parts: _Parts, sites: dict[tuple[str, str], Site]) -> RecordedMission:
    start, flown = parts.start, _flown_of(parts)
    if flown not in sites:
        raise BagError(f'{path}: the scenario of mission {start.mission_id} was not recorded')
    epochs = [parts.epochs[event] for event in sorted(parts.epochs)]
    try:
        header = header_from_line(start.log_header)
    except MissionLogError as error:
        raise BagError(f'{path}: mission {start.mission_id}: {error}') from error
    return RecordedMission(
        log=MissionLog(header=header, events=_events(epochs), faults=faults_of(epochs)),
        site=sites[flown],
        demand_bit=np.array(start.demand_bit, dtype=np.float64),
        n_radio_messages=parts.n_radio_messages,
        index=int(start.index),
        is_complete=ENDED in parts.phases
        and bool(epochs)
        and epochs[-1].terminal
        and len(epochs) == epochs[-1].event + 1,
    )


def _events(epochs: list[Any]) -> Events:
    events = np.zeros(len(epochs), dtype=EVENT_DTYPE)
    for place, epoch in enumerate(epochs):
        events[place] = event_of(epoch)
    return events


def event_of(epoch: Any) -> np.void:  # noqa: ANN401 - a message
    """The event of the mission log that an Epoch message is about."""
    [event] = np.zeros(1, dtype=EVENT_DTYPE)
    for name in EVENT_DTYPE.names or ():
        value = getattr(epoch, name)
        event[name] = _bits(value) if name == 'heard' else value
    return event


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

"""Reads the missions of a recording: the same logs, to the byte, that the world has written."""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from uav_collect.errors import BagError, ConfigError, in_one_line, MissionLogError
from uav_collect.kernels.arrays import Floats
from uav_collect.recording.bag_messages import MessageReader, refuse_damages, repair_hint
from uav_collect.recording.bag_storage import open_bag
from uav_collect.recording.completeness import ABORTED, ENDED
from uav_collect.recording.epochs import epoch_problem, faults_of, row_of
from uav_collect.recording.log_model import EVENT_DTYPE, EVENT_NAMES
from uav_collect.recording.mission_log import header_from_line, MissionHeader, MissionLog
from uav_collect.scenario.load import from_yaml
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.action_codes import HOME

# What topics end with: worlds may have a namespace.
_SCENARIO = '/world/scenario'
_MISSION = '/world/mission'
_EPOCH = '/world/epoch'
_DELIVERED = '/radio_rx'
_MOST_LINES = 20  # about what is damaged
_MOST_CHARACTERS = 80  # of a mission's id, and of a note, that are shown


@dataclass(frozen=True, kw_only=True)
class RecordedMission:
    """One mission as a bag has it: its log, and what it was flown over."""

    log: MissionLog  # of the events that were recorded
    site: Site
    demand_bit: Floats  # (S,) data of each sensor at the start
    n_radio_messages: int  # delivered between UAVs
    is_complete: bool  # ended, every event of it was recorded, and the bag is not damaged
    index: int = 0  # running number of the mission in its world
    given_up: str | None = None  # why its world did that; every event up to then was recorded


@dataclass(frozen=True, kw_only=True)
class Recording:
    """What a bag holds, and what of it is not as it was written."""

    missions: list[RecordedMission]  # in the order they were flown
    damages: list[str]  # one line each


@dataclass(kw_only=True)
class _Parts:
    """What was found of one mission."""

    start: Any = None  # the first Mission message
    phases: set[int] = field(default_factory=set)
    aborted: Any = None  # the Mission message that says so
    epochs: dict[int, Any] = field(default_factory=dict)  # by event, the first of each
    contradicted: set[int] = field(
        default_factory=set
    )  # events recorded twice with different values
    n_radio_messages: int = 0


def read_missions(path: Path) -> list[RecordedMission]:
    """All missions of a bag, in the order they were flown; what was missed is left out of them.

    Args:
        path: folder or file of the bag.

    Raises:
        BagError: there is no bag, it is damaged, or it holds no mission.
    """
    return _read(path, is_strict=True).missions


def read_recording(path: Path) -> Recording:
    """The same of a bag that may be damaged: what is whole of it, and what is not.

    Raises:
        BagError: there is no bag, or it holds no mission.
    """
    return _read(path, is_strict=False)


def _read(path: Path, *, is_strict: bool) -> Recording:
    with open_bag(path) as bag:
        parts_of_missions = (_SCENARIO, _MISSION, _EPOCH, _DELIVERED)
        reader = MessageReader(bag, lambda name: name.endswith(parts_of_missions))
        if is_strict:
            refuse_damages(bag, reader.problems)
        scenarios, missions = _found_in(reader)
        if is_strict:
            refuse_damages(bag, reader.problems)
    of_content = [*bag.damages, *reader.problems]
    found = [parts for parts in missions.values() if parts.start is not None]
    read: list[RecordedMission] = []
    problems: list[str] = []
    for parts in found:
        try:
            mission = _mission(parts, _site_of(parts, scenarios), problems)
        except BagError as error:
            problems.append(f'mission {_name(parts.start.mission_id)}: {error}')
            continue
        if of_content:
            mission = replace(mission, is_complete=False, given_up=None)
        read.append(mission)
    if is_strict and problems:
        raise BagError(f'{path}: {problems[0]}')
    if not read:
        nothing = 'holds no mission, neither start nor end of one was recorded'
        why = next(iter([*of_content, *problems, *bag.remarks]), nothing)
        raise BagError(f'{path}: {why}{repair_hint(bag)}')
    lines = [f'{path}: {line}' for line in (*of_content, *problems, *bag.remarks)]
    n_more = len(lines) - _MOST_LINES
    more = [f'{path}: {n_more} more of this'] if n_more > 0 else []
    return Recording(missions=read, damages=[*lines[:_MOST_LINES], *more])


def _found_in(reader: MessageReader) -> tuple[dict[str, list[Any]], dict[str, _Parts]]:
    """The Scenario messages by world, and what was found of missions by their ids."""
    scenarios: dict[str, list[Any]] = {}
    missions: dict[str, _Parts] = {}
    for topic, message in reader.messages():
        if topic.endswith(_SCENARIO):
            scenarios.setdefault(message.world_instance, []).append(message)
            continue
        parts = missions.setdefault(message.mission_id, _Parts())
        if topic.endswith(_MISSION):
            parts.start = parts.start or message
            parts.phases.add(int(message.phase))
            if message.phase == ABORTED:
                parts.aborted = message
        elif topic.endswith(_EPOCH):
            first = parts.epochs.setdefault(int(message.event), message)
            if _said_in(first) != _said_in(message):
                parts.contradicted.add(int(message.event))
        else:
            parts.n_radio_messages += 1
    return scenarios, missions


def _site_of(parts: _Parts, scenarios: dict[str, list[Any]]) -> Site:
    """The site of a mission's world, by the first of its Scenario messages that tells one.

    Raises:
        BagError: none does.
    """
    sent = scenarios.get(parts.start.world_instance)
    if sent is None:
        raise BagError('its scenario was not recorded')
    wanted = parts.start.scenario_fingerprint  # a world may have had others
    errors = []
    for message in [it for it in sent if it.fingerprint == wanted] or sent:
        try:
            return recorded_site(message)
        except BagError as error:
            errors.append(error)
    raise errors[0]


def recorded_site(message: Any) -> Site:  # noqa: ANN401 - a message
    """The site that a Scenario message in a bag tells.

    Raises:
        BagError: it is not valid here, or its sensors would be others.
    """
    try:
        site = _built_site(message.yaml)
    except ConfigError as error:
        raise BagError(f'its scenario is not valid here: {in_one_line(error.summary)}') from error
    x_m, y_m = np.asarray(message.sensor_x_m), np.asarray(message.sensor_y_m)
    is_alike = x_m.shape == y_m.shape
    if not is_alike or not np.array_equal(site.position_m, np.column_stack([x_m, y_m])):
        raise BagError('its sensors are not those that this version draws')
    return site


@lru_cache(maxsize=8)
def _built_site(text: str) -> Site:
    """The site of a scenario: the same for all missions of a world."""
    return build_site(from_yaml(text))


def _mission(parts: _Parts, site: Site, problems: list[str]) -> RecordedMission:
    """A mission, as far as it was recorded.

    Args:
        problems: takes what of its events cannot be.

    Raises:
        BagError: it cannot be told.
    """
    start = parts.start
    try:
        header = header_from_line(start.log_header)
    except MissionLogError as error:
        raise BagError(f'log_header: {error}') from error
    area = site.scenario.area
    here = site.scenario.n_uavs, area.n_rows, area.n_columns, area.cell_size_m
    if here != (len(header.uavs), header.n_rows, header.n_columns, header.cell_size_m):
        raise BagError('log_header: is of another scenario')
    epochs = _usable_epochs(parts, header, problems)
    has_all = bool(epochs) and len(epochs) == epochs[-1].event + 1
    return RecordedMission(
        log=MissionLog(
            header=header,
            events=np.array([row_of(epoch) for epoch in epochs], dtype=EVENT_DTYPE),
            faults=faults_of(epochs),
        ),
        site=site,
        demand_bit=_demand_of(start, site),
        n_radio_messages=parts.n_radio_messages,
        index=int(start.index),
        is_complete=ENDED in parts.phases and has_all and epochs[-1].terminal,
        given_up=_why_given_up(parts, epochs) if has_all else None,
    )


def _why_given_up(parts: _Parts, epochs: list[Any]) -> str | None:
    """What a world says of why it gave a mission up, if it did and all decisions are here."""
    aborted = parts.aborted
    n_decisions = sum(epoch.action != HOME for epoch in epochs)
    if aborted is None or ENDED in parts.phases or n_decisions != aborted.n_decisions:
        return None
    return in_one_line(aborted.note, _MOST_CHARACTERS)


def _usable_epochs(parts: _Parts, header: MissionHeader, problems: list[str]) -> list[Any]:
    """The Epoch messages of a mission in order, but those that cannot be or contradict others."""
    model = header.event_model()
    usable = []
    for event, epoch in sorted(parts.epochs.items()):
        problem = (
            'is recorded twice with different values' if event in parts.contradicted else None
        )
        if (problem := problem or epoch_problem(epoch, model)) is None:
            usable.append(epoch)
        else:
            mission = _name(parts.start.mission_id)
            problems.append(f'mission {mission}: event {event}, left out: {problem}')
    return usable


def _demand_of(start: Any, site: Site) -> Floats:  # noqa: ANN401 - a message
    demand_bit = np.array(start.demand_bit, dtype=np.float64)
    if demand_bit.shape != (site.n_sensors,):
        sizes = f'has {demand_bit.size} values: must have {site.n_sensors}, one of each sensor'
        raise BagError(f'demand_bit {sizes}')
    if not (np.isfinite(demand_bit) & (demand_bit >= 0.0)).all():
        raise BagError('demand_bit has a value that is no number from 0')
    return demand_bit


def _said_in(epoch: Any) -> tuple[Any, ...]:  # noqa: ANN401 - a message
    """What an Epoch message says of its event."""
    names = (*EVENT_NAMES, 'terminal', 'fault', 'fault_uav', 'fault_s')
    values = (getattr(epoch, name, None) for name in names)
    return tuple(it.tobytes() if isinstance(it, np.ndarray) else it for it in values)


def _name(mission_id: str) -> str:
    return in_one_line(mission_id, _MOST_CHARACTERS)

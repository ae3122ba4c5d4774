"""What messages tell a learner of missions flown elsewhere, and what they must match.

Arrays are the bytes of their numbers, as messages carry them: two messages are alike if their
bytes are, and a thousand of them take little room.
"""

from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.missions.experience import n_map_bytes
from uav_collect.scenario.load import fingerprint, Scenario
from uav_collect.uav import actions
from uav_collect.uav.actions import HOME, N_ACTIONS, NONE
from uav_collect.uav.observation import Layout, observation_size

FLOAT32, FLOAT64 = np.dtype('<f4'), np.dtype('<f8')  # of arrays in messages


class RefusedError(ValueError):
    """A message that cannot be learned from: which, what of it, its value, what it must be."""


@dataclass(frozen=True, kw_only=True)
class MissionTold:
    """What a mission is, told at its start and at its end."""

    mission_id: str
    scenario_fingerprint: str
    mission_seed: int
    demand_bit: bytes  # float64 (S,) at the start
    # After how many decisions the world gave it up; told at its end, if it did.
    cut_after: int | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class EventTold:
    """One event as the world tells it, and the fleet after it."""

    mission_id: str
    event: int  # running number over the fleet, from 0
    uav: int  # index of the deciding UAV
    decision: int  # running number of the UAV's own decisions
    time_s: float
    x_m: float
    y_m: float
    action: int
    reason: int
    duration_s: float
    energy_left_j: float  # before the action
    energy_j: float
    collected_bit: float
    reward: float  # of the interval until the next event, in the scenario's scale
    is_last: bool  # of the mission
    uav_x_m: bytes  # float64 (U,)
    uav_y_m: bytes
    uav_energy_left_j: bytes  # at the end of the running actions
    uav_phase: bytes  # (U,) 0 for those that still decide
    uav_complete: bytes  # the maps of all UAVs, a bit a cell, one after the other
    true_complete: bytes


@dataclass(frozen=True, kw_only=True)
class TransitionTold:
    """One decision as its UAV tells it."""

    mission_id: str
    event: int
    uav: int
    decision: int
    layout: str
    scenario_fingerprint: str
    observation: bytes  # float32, as it was encoded on board
    legal: int  # bits by action
    action: int
    time_s: float
    energy_left_j: float
    cell: int
    previous_action: int
    complete: bytes  # its map, a bit a cell
    seen: bytes  # where it has seen demand
    peer_x_m: bytes  # float64 (U,)
    peer_y_m: bytes
    peer_s: bytes


Told = MissionTold | EventTold | TransitionTold


@dataclass(frozen=True, kw_only=True)
class Terms:
    """What messages must match, so that a learner can use them."""

    layout: Layout
    scenario_fingerprint: str
    n_uavs: int
    n_cells: int
    n_sensors: int
    observation_size: int

    def check(self, told: Told) -> None:
        """Refuse a message that does not match.

        Raises:
            RefusedError: naming what does not match.
        """
        match told:
            case MissionTold():
                self._check_mission(told)
            case EventTold():
                self._check_event(told)
            case TransitionTold():
                self._check_transition(told)

    def _check_mission(self, told: MissionTold) -> None:
        where = f'mission {told.mission_id}'
        _same(where, 'scenario_fingerprint', told.scenario_fingerprint, self.scenario_fingerprint)
        _sized(where, 'demand_bit', told.demand_bit, self.n_sensors * FLOAT64.itemsize)
        _numbers(where, 'demand_bit', np.frombuffer(told.demand_bit, FLOAT64))

    def _check_event(self, told: EventTold) -> None:
        where = f'mission {told.mission_id}, event {told.event}'
        _within(where, 'uav', told.uav + 1, 1, self.n_uavs)
        _within(where, 'action', told.action, 0, HOME)
        for name in (
            'time_s', 'x_m', 'y_m', 'duration_s', 'energy_left_j', 'energy_j', 'collected_bit',
            'reward',
        ):  # fmt: skip
            _number(where, name, getattr(told, name))
        for name in ('uav_x_m', 'uav_y_m', 'uav_energy_left_j'):
            self._check_floats(where, name, getattr(told, name))
        n_bytes = n_map_bytes(self.n_cells)
        _sized(where, 'uav_phase', told.uav_phase, self.n_uavs)
        _sized(where, 'uav_complete', told.uav_complete, self.n_uavs * n_bytes)
        _sized(where, 'true_complete', told.true_complete, n_bytes)

    def _check_transition(self, told: TransitionTold) -> None:
        where = f'mission {told.mission_id}, event {told.event}, transition of UAV {told.uav + 1}'
        _same(where, 'scenario_fingerprint', told.scenario_fingerprint, self.scenario_fingerprint)
        _same(where, 'layout', told.layout, self.layout.label)
        _within(where, 'uav', told.uav + 1, 1, self.n_uavs)
        size = self.observation_size * FLOAT32.itemsize
        _sized(where, 'observation', told.observation, size)
        _numbers(where, 'observation', np.frombuffer(told.observation, FLOAT32))
        _number(where, 'time_s', told.time_s)
        _number(where, 'energy_left_j', told.energy_left_j)
        _within(where, 'cell', told.cell, 0, self.n_cells - 1)
        _within(where, 'previous_action', told.previous_action, NONE, N_ACTIONS - 1)
        _within(where, 'action', told.action, 0, HOME)
        if told.action != HOME and not told.legal >> told.action & 1:
            raise RefusedError(f'{where}: action is {told.action}: must be legal')
        for name in ('complete', 'seen'):
            _sized(where, name, getattr(told, name), n_map_bytes(self.n_cells))
        for name in ('peer_x_m', 'peer_y_m', 'peer_s'):
            self._check_floats(where, name, getattr(told, name))

    def _check_floats(self, where: str, name: str, content: bytes) -> None:
        _sized(where, name, content, self.n_uavs * FLOAT64.itemsize)
        _numbers(where, name, np.frombuffer(content, FLOAT64))


def terms_of(scenario: Scenario, layout: Layout, n_sensors: int) -> Terms:
    """What messages of missions of a scenario must match.

    Raises:
        ConfigError: the layout has no room for the fleet.
    """
    return Terms(
        layout=layout,
        scenario_fingerprint=fingerprint(scenario),
        n_uavs=scenario.n_uavs,
        n_cells=scenario.n_cells,
        n_sensors=n_sensors,
        observation_size=observation_size(layout, scenario.area.cells_per_side, scenario.n_uavs),
    )


def is_decision(told: EventTold) -> bool:
    """Whether the UAV goes on, so that there is something to learn: turning home is no choice."""
    return told.action != HOME


def is_failsafe(told: EventTold) -> bool:
    """Whether the world flew the UAV home because its agent did not answer."""
    return told.reason == actions.FAILSAFE


def _same(where: str, name: str, value: object, wanted: object) -> None:
    if value != wanted:
        raise RefusedError(f'{where}: {name} is {value!r}: must be {wanted!r}')


def _within(where: str, name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise RefusedError(f'{where}: {name} is {value}: must be {low} to {high}')


def _sized(where: str, name: str, content: bytes, n_bytes: int) -> None:
    if len(content) != n_bytes:
        raise RefusedError(f'{where}: {name} has {len(content)} bytes: must be {n_bytes}')


def _number(where: str, name: str, value: float) -> None:
    if not math.isfinite(value):
        raise RefusedError(f'{where}: {name} is {value}: must be finite')


def _numbers(where: str, name: str, values: NDArray[Any]) -> None:
    is_finite = np.isfinite(values)
    if not is_finite.all():
        place = int(np.flatnonzero(~is_finite)[0])
        _number(where, f'{name}[{place}]', values[place])

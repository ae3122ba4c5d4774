"""What messages report of missions flown elsewhere, and what a learner can use of it.

Arrays are the bytes of their numbers, as messages carry them: two messages are alike if their
bytes are, and a thousand of them take little room.
"""

from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from uav_collect.errors import RefusedError
from uav_collect.limits import MAX_SEED
from uav_collect.missions.experience import n_map_bytes
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import Site
from uav_collect.uav import action_codes
from uav_collect.uav.action_codes import HOME, N_ACTIONS, NONE
from uav_collect.uav.observation import AnyLayout, observation_size

FLOAT32, FLOAT64 = np.dtype('<f4'), np.dtype('<f8')  # of arrays in messages
_LARGEST = 1e12  # of any number: beyond all that is flown, and learners may square it in float32


@dataclass(frozen=True, kw_only=True)
class MissionReport:
    """What a mission is, reported at its start and at its end."""

    mission_id: str
    world_instance: str  # of the process that flies it
    scenario_fingerprint: str
    mission_seed: int
    demand_bit: bytes  # float64 (S,) at the start
    # After how many decisions the world aborted it; known at its end, if it did.
    cut_after: int | None = field(default=None, compare=False)

    @property
    def where(self) -> str:
        """Which one it is, for people."""
        return f'mission {self.mission_id}'


@dataclass(frozen=True, kw_only=True)
class EventReport:
    """One event as the world reports it, and the fleet after it."""

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

    @property
    def where(self) -> str:
        """Which one it is, for people."""
        return f'mission {self.mission_id}, event {self.event}'

    @property
    def is_decision(self) -> bool:
        """Whether the UAV goes on; turning home is no choice that could be learned from."""
        return self.action != HOME

    @property
    def is_failsafe(self) -> bool:
        """Whether the world flew the UAV home because its agent did not answer."""
        return self.reason == action_codes.FAILSAFE


@dataclass(frozen=True, kw_only=True)
class TransitionReport:
    """One decision as its UAV reports it."""

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

    @property
    def where(self) -> str:
        """Which one it is, for people."""
        return f'mission {self.mission_id}, event {self.event}, transition of UAV {self.uav + 1}'


FleetReport = MissionReport | EventReport | TransitionReport


@dataclass(frozen=True, kw_only=True)
class ReportSpec:
    """What reports must match, so that a learner can use them."""

    layout: AnyLayout
    scenario_fingerprint: str
    n_uavs: int
    n_cells: int
    n_sensors: int
    observation_size: int

    def check(self, report: FleetReport) -> None:
        """Refuse a report that does not match.

        Raises:
            RefusedError: naming what does not match.
        """
        match report:
            case MissionReport():
                self._check_mission(report)
            case EventReport():
                self._check_event(report)
            case TransitionReport():
                self._check_transition(report)

    def _check_mission(self, report: MissionReport) -> None:
        where = report.where
        self._check_fingerprint(where, report.scenario_fingerprint)
        _within(where, 'seed', report.mission_seed, 0, MAX_SEED)
        _sized(where, 'demand_bit', report.demand_bit, self.n_sensors * FLOAT64.itemsize)
        _numbers(where, 'demand_bit', np.frombuffer(report.demand_bit, FLOAT64), low=0.0)

    def _check_event(self, report: EventReport) -> None:
        where = report.where
        _within(where, 'uav', report.uav + 1, 1, self.n_uavs)
        _within(where, 'action', report.action, 0, HOME)
        for name in ('x_m', 'y_m', 'energy_left_j', 'energy_j', 'collected_bit', 'reward'):
            _number(where, name, getattr(report, name))
        for name in ('time_s', 'duration_s'):
            _number(where, name, getattr(report, name), low=0.0)
        for name in ('uav_x_m', 'uav_y_m', 'uav_energy_left_j'):
            self._check_floats(where, name, getattr(report, name))
        n_bytes = n_map_bytes(self.n_cells)
        _sized(where, 'uav_phase', report.uav_phase, self.n_uavs)
        _sized(where, 'uav_complete', report.uav_complete, self.n_uavs * n_bytes)
        _sized(where, 'true_complete', report.true_complete, n_bytes)

    def _check_transition(self, report: TransitionReport) -> None:
        where = report.where
        self._check_fingerprint(where, report.scenario_fingerprint)
        _same(where, 'layout', report.layout, self.layout.label)
        _within(where, 'uav', report.uav + 1, 1, self.n_uavs)
        size = self.observation_size * FLOAT32.itemsize
        _sized(where, 'observation', report.observation, size)
        _numbers(where, 'observation', np.frombuffer(report.observation, FLOAT32))
        _number(where, 'time_s', report.time_s, low=0.0)
        _number(where, 'energy_left_j', report.energy_left_j)
        _within(where, 'cell', report.cell, 0, self.n_cells - 1)
        _within(where, 'previous_action', report.previous_action, NONE, N_ACTIONS - 1)
        _within(where, 'action', report.action, 0, HOME)
        _within(where, 'legal', report.legal, 0, 2**N_ACTIONS - 1)
        if report.action != HOME and not report.legal >> report.action & 1:
            raise RefusedError(f'{where}: action is {report.action}: must be legal')
        for name in ('complete', 'seen'):
            _sized(where, name, getattr(report, name), n_map_bytes(self.n_cells))
        for name in ('peer_x_m', 'peer_y_m', 'peer_s'):
            self._check_floats(where, name, getattr(report, name))
        heard_s = float(np.frombuffer(report.peer_s, FLOAT64).max())
        if heard_s > report.time_s:
            raise RefusedError(
                f'{where}: peer_s is {heard_s}: must be at most time_s, {report.time_s}'
            )

    def _check_fingerprint(self, where: str, found: str) -> None:
        _same(where, 'scenario_fingerprint', found, self.scenario_fingerprint)

    def _check_floats(self, where: str, name: str, content: bytes) -> None:
        _sized(where, name, content, self.n_uavs * FLOAT64.itemsize)
        _numbers(where, name, np.frombuffer(content, FLOAT64))


def report_spec(site: Site, layout: AnyLayout) -> ReportSpec:
    """What reports of missions at a site must match.

    Raises:
        ConfigError: the layout has no room for the fleet.
    """
    scenario = site.scenario
    return ReportSpec(
        layout=layout,
        scenario_fingerprint=fingerprint(scenario),
        n_uavs=scenario.n_uavs,
        n_cells=scenario.n_cells,
        n_sensors=site.n_sensors,
        observation_size=observation_size(layout, scenario.n_cells, scenario.n_uavs),
    )


def _same(where: str, name: str, value: object, wanted: object) -> None:
    if value != wanted:
        raise RefusedError(f'{where}: {name} is {value!r}: must be {wanted!r}')


def _within(where: str, name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise RefusedError(f'{where}: {name} is {value}: must be {low} to {high}')


def _sized(where: str, name: str, content: bytes, n_bytes: int) -> None:
    if len(content) != n_bytes:
        raise RefusedError(f'{where}: {name} has {len(content)} bytes: must be {n_bytes}')


def _number(where: str, name: str, value: float, low: float = -_LARGEST) -> None:
    if not math.isfinite(value):
        raise RefusedError(f'{where}: {name} is {value}: must be finite')
    if not low <= value <= _LARGEST:
        raise RefusedError(f'{where}: {name} is {value:g}: must be {low:g} to {_LARGEST:g}')


def _numbers(where: str, name: str, values: NDArray[Any], low: float = -_LARGEST) -> None:
    is_wrong = ~((low <= values) & (values <= _LARGEST))  # a nan is neither
    if is_wrong.any():
        place = int(np.flatnonzero(is_wrong)[0])
        _number(where, f'{name}[{place}]', float(values[place]), low)

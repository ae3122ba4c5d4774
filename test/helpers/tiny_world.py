"""Tiny hand-made missions, flown action by action: every number can be worked out on paper.

  north
3 . . . .     4 x 4 cells of 50 m; both UAVs start and land at 0, in the south-west cell.
2 . . B .     Sensor 0, of 1 Mbit, is under the centre of cell 1 (A), sensors 1 and 2, of 0.5
1 . . . .     and 0.25 Mbit, both under the centre of cell 10 (B). The first UAV flies 5 m/s,
0 0 A . .     the second 10 m/s. Line of sight is certain and fading as good as absent, so a
  0 1 2 3     channel's gain is the path gain at 100 m, to 1e-7.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
import math

from uav_collect.kernels.arrays import Row
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import Event, Simulation
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import HOME
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.messages import Decision
from uav_collect.uav.view import LocalView

CELL_A = 1
CELL_B = 10
TOTAL_BIT = 1.75e6

MOVE_5_J = 1436.135  # 50 m at 5 m/s: 10 s at 143.61 W
MOVE_10_J = 630.168  # 50 m at 10 m/s: 5 s at 126.03 W
HOVER_W = 168.49

GAIN = 1.4228584e-4 * 100.0**-2.6  # alpha_0 at 2 GHz, 100 m
_CN0_HZ = 1e16 * GAIN  # P_s / N_0 is 1e16 Hz

_SENSORS = ((75.0, 25.0, 1.0), (125.0, 125.0, 0.5), (125.0, 125.0, 0.25))


def rate_bps(bandwidth_hz: float) -> float:
    """The rate of any of the three sensors on its share."""
    return bandwidth_hz * math.log2(1.0 + _CN0_HZ / bandwidth_hz)


def uav(
    speed_mps: float = 5.0,
    start: Sequence[int] = (0, 0),
    home_m: Sequence[float] | None = None,
    **values: float,
) -> dict[str, object]:
    """A UAV of a fleet; `start` is a cell's row and column, `home_m` where not there."""
    home = {'cell': [*start]} if home_m is None else {'position_m': [*home_m]}
    return {'speed_mps': speed_mps, 'start': {'cell': [*start]}, 'home': home, **values}


def tiny(
    *uavs: Mapping[str, object],
    sensors: Sequence[tuple[float, float, float]] = _SENSORS,
    **overrides: object,
) -> Scenario:
    """The scenario above, or its like.

    Args:
        uavs: the fleet, if another one.
        sensors: x [m], y [m] and data [Mbit] of each, if others.
        overrides: values by dotted path, with __ for the dot: area__cells_per_side=5.
    """
    entries = [
        {'id': f'S{number}', 'x_m': x_m, 'y_m': y_m, 'data_mbit': data_mbit}
        for number, (x_m, y_m, data_mbit) in enumerate(sensors, start=1)
    ]
    values = {
        'name': 'tiny',
        'area.cells_per_side': 4,
        'sensors': {'kind': 'listed', 'entries': entries},
        'demand': {'cell_share': 'all', 'data_mbit': 'csv', 'known_empty': 'none'},
        'radio.los_b': 10.0,
        'radio.rician_a1': 1000.0,
        'radio.rician_a2': 20.0,
        'fleet.uavs': [*uavs] or [uav(5.0), uav(10.0)],
    }
    values |= {name.replace('__', '.'): value for name, value in overrides.items()}
    return load('paper_10x10', values)


@dataclass
class Script:
    """A policy that flies each UAV by a list of actions, and home where the list ends."""

    scripts: Sequence[Sequence[int]]
    name: str = 'script'
    version: str = '1'
    _actions: Iterator[int] = field(default_factory=lambda: iter(()))

    def begin(self, briefing: Briefing, uav: int) -> None:
        self._actions = iter(self.scripts[uav])

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        return next(self._actions, HOME)


def fly_scripts(
    scenario: Scenario, *scripts: Sequence[int], seed: int = 0, allocator: str = 'exact'
) -> MissionLog:
    """The log of a mission, each UAV flown by its list of actions."""
    site = build_site(scenario)
    return fly(site, [seed], lambda: Script(scripts), allocator, guard_after=0)[0]


class Flight:
    """A mission flown by hand, one action at a time; the UAVs believe and talk as they do."""

    def __init__(self, scenario: Scenario, seed: int = 0, allocator: str = 'exact') -> None:
        self.simulation = Simulation(build_site(scenario), seed)
        briefing = self.simulation.briefing
        self.agents = [
            Agent(briefing, uav, _ScriptedPolicy(self), allocator_named(allocator))
            for uav in range(briefing.n_uavs)
        ]
        self.action = HOME

    def look(self) -> Event:
        """The next event, the deciding UAV's exchange with the others done."""
        event = self.simulation.next_event()
        assert event is not None
        agent = self.agents[event.uav]
        for message in event.heard:
            agent.hear(message)
        agent.observe(event.view)
        for hearer in self.simulation.transmit(event.uav, agent.belief.complete):
            self.agents[hearer].hear(self.simulation.radio(event.uav))
        return event

    def act(self, event: Event, action: int) -> Decision:
        """The deciding UAV's decision for an action, carried out."""
        self.action = action
        decision = self.agents[event.uav].decide(event.view)
        assert decision.action == action
        assert self.simulation.refusal(event, decision) is None
        self.simulation.start(event, decision)
        return decision

    def step(self, action: int) -> Event:
        """Look, then act. The event's view holds until the next one."""
        event = self.look()
        self.act(event, action)
        return event

    def known(self, uav: int) -> list[int]:
        """The cells that a UAV holds for complete."""
        complete = self.agents[uav].belief.complete
        return [cell for cell in range(len(complete)) if complete[cell]]  # type: ignore[arg-type]


@dataclass
class _ScriptedPolicy:
    flight: Flight
    name: str = 'scripted'
    version: str = '1'

    def begin(self, briefing: Briefing, uav: int) -> None:
        pass

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        return self.flight.action

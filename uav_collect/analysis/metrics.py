"""The metrics of a mission, from its log alone; and what every log must satisfy.

Time is the paper's eq. (2), energy eq. (7), data eq. (14), efficiency the goal of its problem (P);
the way home counts in time and energy. A mission cut short has metrics but no completion time; of
a recording that lacks events, sums are those of the events that it has.
"""

from dataclasses import dataclass
import math

import numpy as np
from uav_collect.errors import MissionLogError
from uav_collect.missions.batch_metrics import least_complete_bit, TOLERANCE
from uav_collect.recording.mission_log import Events, FaultRecord, MissionLog, UavHeader
from uav_collect.uav import action_codes
from uav_collect.uav.action_codes import COLUMN_STEP, GUARD, HOME, HOVER, REASON_NAMES, ROW_STEP

# How a UAV ended that the world flew home, as its agent did not answer, or is gone on purpose.
FAILSAFE = REASON_NAMES[action_codes.FAILSAFE]
FAULT = REASON_NAMES[action_codes.FAULT]
METRIC_COLUMNS = (
    'mission_seed', 'efficiency_kbit_per_j', 'completion_s', 'energy_kj', 'collected_mbit',
    'total_mbit', 'collected_share', 'decisions', 'is_safe', 'is_complete', 'guarded',
)  # fmt: skip
UNFINISHED = 'unfinished'  # how a UAV ended that the log leaves in the air
UNKNOWN = 'not known'  # how one ended after whose last event the log lacks some
# By how a UAV ended, what a UavFigures message says; a bag knows no constants.
OUTCOME_CODES = {
    REASON_NAMES[action_codes.MAP_COMPLETE]: 0,
    REASON_NAMES[action_codes.ENERGY_RESERVE]: 1,
    REASON_NAMES[action_codes.BY_POLICY]: 2,
    FAILSAFE: 3,
    UNFINISHED: 4,
    FAULT: 5,
}


@dataclass(frozen=True, kw_only=True)
class UavMetrics:
    """What one UAV did in a mission."""

    id: int  # from 1
    speed_mps: float
    energy_budget_j: float
    energy_margin_j: float  # to be left when landed
    energy_j: float  # used, way home included
    collected_bit: float
    flight_s: float  # moving, way home included
    hover_s: float
    n_decisions: int  # actions chosen; the way home is none
    n_guarded: int  # of them by its guard
    outcome: str  # why it flew home, one of REASON_NAMES, or UNFINISHED or UNKNOWN
    landed_s: float  # nan while it has not, or where that is not known
    energy_left_j: float  # of its budget at the end; nan where that is not known

    @property
    def has_landed(self) -> bool:
        """Whether it is known to have landed."""
        return math.isfinite(self.landed_s)

    @property
    def is_safe(self) -> bool:
        """Whether it landed with its margin."""
        rounding_j = TOLERANCE * self.energy_budget_j
        return self.has_landed and self.energy_left_j >= self.energy_margin_j - rounding_j


@dataclass(frozen=True, kw_only=True)
class MissionMetrics:
    """What one mission achieved."""

    mission_seed: int
    collected_bit: float
    total_bit: float  # waiting at the start
    energy_j: float  # of all UAVs
    completion_s: float  # when the last UAV landed; nan if one has not
    n_decisions: int
    n_guarded: int  # of them by guards
    n_heard: int  # over all events, how many other UAVs the deciding one heard
    uavs: tuple[UavMetrics, ...]
    faults: tuple[FaultRecord, ...]  # that have befallen them on purpose
    lacks_events: bool  # some were not recorded: more may have been flown and collected

    @property
    def collected_share(self) -> float:
        """Share of the data that was collected, 0..1; 1 where there was none."""
        return min(1.0, self.collected_bit / self.total_bit) if self.total_bit > 0 else 1.0

    @property
    def efficiency_bit_per_j(self) -> float:
        """Energy efficiency, data collected over energy used [bit/J]; 0 before any was used."""
        return self.collected_bit / self.energy_j if self.energy_j > 0 else 0.0

    @property
    def efficiency_kbit_per_j(self) -> float:
        """Energy efficiency [kbit/J]."""
        return self.efficiency_bit_per_j / 1e3

    @property
    def energy_kj(self) -> float:
        """Energy of all UAVs [kJ]."""
        return self.energy_j / 1e3

    @property
    def uav_energy_j(self) -> tuple[float, ...]:
        """Energy used by each UAV [J]."""
        return tuple(uav.energy_j for uav in self.uavs)

    @property
    def is_safe(self) -> bool:
        """Whether every UAV landed with at least its margin."""
        return all(uav.is_safe for uav in self.uavs)

    @property
    def is_complete(self) -> bool:
        """Whether all data were collected."""
        return self.collected_bit >= least_complete_bit(self.total_bit)

    @property
    def is_finished(self) -> bool:
        """Whether every UAV landed."""
        return math.isfinite(self.completion_s)

    @property
    def failsafe_used(self) -> bool:
        """Whether the world had to fly a UAV home because its agent was silent."""
        return any(uav.outcome == FAILSAFE for uav in self.uavs)


def mission_metrics(log: MissionLog) -> MissionMetrics:
    """Compute what a mission achieved, finished or not."""
    events = log.events
    uavs = tuple(_uav_metrics(header, events) for header in log.header.uavs)
    return MissionMetrics(
        mission_seed=log.header.mission_seed,
        collected_bit=float(events['collected_bit'].sum()),
        total_bit=log.header.total_bit,
        energy_j=sum(uav.energy_j for uav in uavs),
        completion_s=max((uav.landed_s for uav in uavs), key=_nan_is_last, default=math.nan),
        n_decisions=sum(uav.n_decisions for uav in uavs),
        n_guarded=sum(uav.n_guarded for uav in uavs),
        n_heard=sum(int(heard).bit_count() for heard in events['heard']),
        uavs=uavs,
        faults=log.faults,
        lacks_events=log.lacks_events,
    )


def metrics_row(mission: MissionMetrics) -> dict[str, float]:
    """A mission's row of a CSV file, by METRIC_COLUMNS."""
    values = (
        mission.mission_seed, mission.efficiency_kbit_per_j, mission.completion_s,
        mission.energy_kj, mission.collected_bit / 1e6, mission.total_bit / 1e6,
        mission.collected_share, mission.n_decisions, int(mission.is_safe),
        int(mission.is_complete), mission.n_guarded,
    )  # fmt: skip
    return dict(zip(METRIC_COLUMNS, values, strict=True))


def _nan_is_last(time_s: float) -> float:
    return math.inf if math.isnan(time_s) else time_s


def _uav_metrics(header: UavHeader, events: Events) -> UavMetrics:
    own = events[events['uav'] == header.id]
    is_hover = own['action'] == HOVER
    is_home = own['action'] == HOME
    home = own[is_home]
    landed = len(home) > 0
    lacks_end = not landed and _lacks_later(events, int(own['event'].max(initial=-1)))
    return UavMetrics(
        id=header.id,
        speed_mps=header.speed_mps,
        energy_budget_j=header.energy_budget_j,
        energy_margin_j=header.energy_margin_j,
        energy_j=float(own['energy_j'].sum()),
        collected_bit=float(own['collected_bit'].sum()),
        flight_s=float(own['duration_s'][~is_hover].sum()),
        hover_s=float(own['duration_s'][is_hover].sum()),
        n_decisions=int((~is_home).sum()),
        n_guarded=int((own['reason'] == GUARD).sum()),
        outcome=_outcome(home, lacks_end=lacks_end),
        landed_s=float(home['time_s'][0] + home['duration_s'][0]) if landed else math.nan,
        energy_left_j=math.nan if lacks_end else _energy_left_j(header, own),
    )


def _lacks_later(events: Events, number: int) -> bool:
    """Whether events after the one of that number are missing."""
    numbers = events['event']
    return int((numbers > number).sum()) < int(numbers.max(initial=-1)) - number


def _outcome(home: Events, *, lacks_end: bool) -> str:
    if len(home):
        return REASON_NAMES[home['reason'][0]]
    return UNKNOWN if lacks_end else UNFINISHED


def _energy_left_j(header: UavHeader, own: Events) -> float:
    """By its last event: a sum of what events took would miss those that are missing."""
    if not len(own):
        return header.energy_budget_j
    return float(own['energy_left_j'][-1] - own['energy_j'][-1])


def percent(share: float) -> str:
    """A share in per cent, rounded down: 100.0 % means all of it."""
    return f'{math.floor(1000 * share + 1e-6) / 10:.1f} %'


def check_log(log: MissionLog) -> None:
    """Check what holds in every mission: one story per UAV, with time and energy that add up.

    Each record of a UAV starts where, when and with the energy its record before ended. The log
    of a mission that was cut short is fine, a hole in the middle is not.

    Raises:
        MissionLogError: naming the first record that does not fit, its UAV and both values.
    """
    _check_fleet(log)
    for header in log.header.uavs:
        own = log.events[log.events['uav'] == header.id]
        left_j = header.energy_budget_j
        for decision, event in enumerate(own):
            before = own[decision - 1] if decision else None
            _check_uav_event(event, before, decision, log.header.cell_size_m)
            _check_close(event, 'energy left', event['energy_left_j'], left_j, 'J')
            left_j -= event['energy_j']


def _check_fleet(log: MissionLog) -> None:
    events = log.events
    ids = [uav.id for uav in log.header.uavs]
    for number, event in enumerate(events):
        if event['event'] != number:
            raise MissionLogError(f'record {number} says event {event["event"]}')
        if event['uav'] not in ids:
            raise _event_error(event, 'is not in the header')
        for name in ('time_s', 'duration_s', 'energy_j', 'collected_bit', 'interval_s'):
            if not 0.0 <= event[name] < math.inf:
                raise _event_error(event, f'{name} must be finite and >= 0, got {event[name]}')
        if number:
            end_s = events[number - 1]['time_s'] + events[number - 1]['interval_s']
            _check_close(event, 'time', event['time_s'], end_s, 's')
    collected_bit, total_bit = events['collected_bit'].sum(), log.header.total_bit
    if collected_bit > total_bit * (1.0 + TOLERANCE):
        raise MissionLogError(f'collected {collected_bit} bit of {total_bit} bit')


def _check_uav_event(
    event: np.void, before: np.void | None, decision: int, cell_size_m: float
) -> None:
    if event['decision'] != decision:
        raise _event_error(event, f'decision must be {decision}, got {event["decision"]}')
    if event['action'] != HOVER and event['collected_bit'] > 0:
        raise _event_error(event, f'collected {event["collected_bit"]} bit without hovering')
    if before is None:
        _check_close(event, 'time', event['time_s'], 0.0, 's')
        return
    if before['action'] == HOME:
        raise _event_error(event, 'decides after it turned home')
    east, north = COLUMN_STEP[before['action']], ROW_STEP[before['action']]
    end_s = before['time_s'] + before['duration_s']
    _check_close(event, 'time', event['time_s'], end_s, 's')
    _check_close(event, 'x', event['x_m'], before['x_m'] + east * cell_size_m, 'm')
    _check_close(event, 'y', event['y_m'], before['y_m'] + north * cell_size_m, 'm')


def _check_close(event: np.void, name: str, value: float, expected: float, unit: str) -> None:
    if not math.isclose(value, expected, rel_tol=TOLERANCE, abs_tol=TOLERANCE):
        raise _event_error(event, f'{name} must be {expected} {unit}, got {value} {unit}')


def _event_error(event: np.void, problem: str) -> MissionLogError:
    return MissionLogError(f'event {event["event"]}, UAV {event["uav"]}: {problem}')

"""What a learner keeps of a decision: enough to rebuild the observation and the global state.

A record is a tenth of an encoded observation: maps are kept as bits, and what demand a UAV has
seen as bits too, for a hover takes all of a cell's data, so that a cell holds all it had at first
or nothing. Observations that are learned from again and again may be kept beside it: four fifths
of their numbers are zeros, which are left out.
"""

from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from uav_collect.kernels.arrays import Floats, Ints, new_row, Row
from uav_collect.kernels.compile import kernel
from uav_collect.uav import actions
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.belief import Belief, belief_of, Beliefs, new_beliefs
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.heuristics import choose, MEMORY_SIZE, shares_for
from uav_collect.uav.moves import Moves, new_moves
from uav_collect.uav.observation import (
    AnyLayout,
    encode,
    observation_size,
    OwnLayout,
    write_own,
)
from uav_collect.uav.sharing import Shares
from uav_collect.uav.user_policy import arrayed
from uav_collect.uav.view import LocalView, VIEW_CELLS
from uav_collect.world.dynamics import ACTIVE, Mission, place_at

N_UAV_SCALARS = 4  # of the global state: position, energy, whether it still decides
_BYTE = 8


_Table = NDArray[Any]


class Records(NamedTuple):
    """Decisions, one row each, (N, ...); arrays always. Bits lie low first in their bytes."""

    uav: _Table  # (N,)
    decision: _Table  # running number of the UAV's own decisions
    time_s: _Table
    energy_left_j: _Table  # of the deciding UAV
    cell: _Table
    previous_action: _Table
    legal: _Table  # bits by action
    peer_x_m: _Table  # (N, U) where the UAV last heard each other one
    peer_y_m: _Table
    peer_s: _Table
    complete: _Table  # (N, U * B) the maps of all UAVs
    true_complete: _Table  # (N, B)
    seen: _Table  # (N, B) where the deciding UAV has seen demand
    fleet: _Table  # (N, U * N_UAV_SCALARS) the rest of the global state
    action: _Table  # what was chosen; NONE where that is not known yet
    reward: _Table  # until the next decision of the mission, discounted to this one
    duration_s: _Table
    is_judged: _Table  # 1 where what each action is worth is known, see `branches` and `teacher`
    worth: _Table  # (N, N_ACTIONS) that; 0 where an action is not legal


_BITS = {'legal', 'complete', 'true_complete', 'seen'}
_SMALL = {'uav', 'previous_action', 'action', 'is_judged'}


def n_map_bytes(n_cells: int) -> int:
    """Bytes of one completion map as bits."""
    return -(-n_cells // _BYTE)


def new_records(n_rows: int, briefing: Briefing) -> Records:
    """Room for so many decisions."""
    n_bytes = n_map_bytes(briefing.n_rows * briefing.n_columns)
    widths = {
        'complete': briefing.n_uavs * n_bytes, 'true_complete': n_bytes, 'seen': n_bytes,
        'fleet': briefing.n_uavs * N_UAV_SCALARS, 'worth': N_ACTIONS,
    } | dict.fromkeys(('peer_x_m', 'peer_y_m', 'peer_s'), briefing.n_uavs)  # fmt: skip
    tables: dict[str, Any] = {}
    for name in Records._fields:
        shape = (n_rows, widths[name]) if name in widths else (n_rows,)
        tables[name] = np.zeros(shape, dtype=_dtype(name))
    return Records(**tables)


def record_bytes(briefing: Briefing) -> int:
    """Size of one record."""
    return sum(table.nbytes for table in new_records(1, briefing))


def _dtype(name: str) -> np.dtype[Any]:
    if name in _BITS:
        return np.dtype(np.uint8)
    if name in _SMALL:
        return np.dtype(np.int8)
    if name in ('decision', 'cell'):
        return np.dtype(np.int32)
    return np.dtype(np.float32 if name in ('fleet', 'worth') else np.float64)


class SparseRows(NamedTuple):
    """Observations, one row each, of which only what is not zero is kept."""

    column: NDArray[np.int32]  # (V,) which number of its row each value is, rising
    value: NDArray[np.float32]  # (V,)
    start: Ints  # (N,) where the values of each row begin
    stop: Ints  # (N,) where they end

    @property
    def n_bytes(self) -> int:
        """Memory that they take."""
        return sum(table.nbytes for table in self)


@dataclass(frozen=True, kw_only=True)
class Episode:
    """The decisions of one mission, in order."""

    mission_seed: int
    demand_bit: Floats  # (C,) at the start of the mission
    records: Records
    is_whole: bool  # False: cut off; the last decision's outcome is not known
    observation: SparseRows | None = None  # of each decision, where they are at hand

    @property
    def n_decisions(self) -> int:
        """How many decisions it has."""
        return len(self.records.uav)


@kernel
def record(
    records: Records,
    row: int,
    briefing: Briefing,
    mission: Mission,
    beliefs: Beliefs,
    first_belief: int,
    uav: int,
    view: LocalView,
    legal: Row[int],
) -> None:
    """Write what the deciding UAV and the world know, before the UAV's action starts.

    Args:
        first_belief: place of the mission's first UAV in the beliefs.
    """
    belief = belief_of(beliefs, first_belief + uav)
    n_cells = len(belief.complete)
    n_bytes = len(records.seen[row])
    records.uav[row] = uav
    records.decision[row] = mission.n_decisions[uav]
    records.time_s[row] = view.time_s
    records.energy_left_j[row] = view.energy_left_j
    records.cell[row] = view.cell
    records.previous_action[row] = view.previous_action
    records.action[row] = NONE
    records.reward[row] = 0.0
    records.duration_s[row] = 0.0
    records.is_judged[row] = 0
    bits = 0
    for action in range(N_ACTIONS):
        bits |= legal[action] << action
    records.legal[row] = bits
    for byte in range(n_bytes):
        done, seen = 0, 0
        for place in range(min(_BYTE, n_cells - byte * _BYTE)):
            cell = byte * _BYTE + place
            done |= (1 if mission.cell_bit[cell] <= 0.0 else 0) << place
            seen |= (1 if belief.seen_bit[cell] > 0.0 else 0) << place
        records.true_complete[row][byte] = done
        records.seen[row][byte] = seen
    for other in range(briefing.n_uavs):
        records.peer_x_m[row][other] = belief.peer_x_m[other]
        records.peer_y_m[row][other] = belief.peer_y_m[other]
        records.peer_s[row][other] = belief.peer_s[other]
        complete = beliefs.complete[first_belief + other]
        for byte in range(n_bytes):
            known = 0
            for place in range(min(_BYTE, n_cells - byte * _BYTE)):
                known |= complete[byte * _BYTE + place] << place
            records.complete[row][other * n_bytes + byte] = known
        write_fleet(records.fleet[row], briefing, mission, other, view.time_s)


@kernel
def write_fleet(
    fleet: Row[float], briefing: Briefing, mission: Mission, uav: int, time_s: float
) -> None:
    """Write the place, energy and phase of one UAV into the fleet's, (U * N_UAV_SCALARS,)."""
    first = uav * N_UAV_SCALARS
    x_m, y_m = place_at(briefing, mission, uav, time_s)
    fleet[first] = x_m / (briefing.n_columns * briefing.cell_size_m)
    fleet[first + 1] = y_m / (briefing.n_rows * briefing.cell_size_m)
    fleet[first + 2] = mission.energy_left_j[uav] / briefing.energy_budget_j[uav]
    fleet[first + 3] = 1.0 if mission.phase[uav] == ACTIVE else 0.0


def global_state(
    briefing: Briefing, mission: Mission, beliefs: Beliefs, first: int, time_s: float
) -> Floats:
    """The global state of a mission, see `VectorEnv.global_state`.

    Args:
        first: place of its first UAV among the beliefs.
    """
    fleet = new_row(briefing.n_uavs * N_UAV_SCALARS, 0.0)
    for uav in range(briefing.n_uavs):
        write_fleet(fleet, briefing, mission, uav, time_s)
    known = [beliefs.complete[first + uav] for uav in range(briefing.n_uavs)]
    is_empty = np.asarray(mission.cell_bit) <= 0.0
    return np.concatenate([np.asarray(fleet), *map(np.asarray, known), is_empty])


def sparse_observations(episode: Episode, layout: AnyLayout, briefing: Briefing) -> SparseRows:
    """The observations of a mission's decisions, as the UAVs encoded them."""
    size = observation_size(layout, len(briefing.is_open), briefing.n_uavs)
    n_rows, demand_bit = episode.n_decisions, episode.demand_bit[None]
    order, mission = np.arange(n_rows), np.zeros(n_rows, dtype=np.int64)
    dense = np.empty((n_rows, size), dtype=np.float32)
    observations(layout, briefing, episode.records, demand_bit, mission, order, dense)
    return sparse_rows(dense)


def sparse_rows(dense: NDArray[np.float32]) -> SparseRows:
    """What is not zero in observations, (N, observation_size)."""
    row, column = np.nonzero(dense)
    stop = np.cumsum(np.bincount(row, minlength=len(dense)))
    return SparseRows(
        column=column.astype(np.int32),
        value=dense[row, column],
        start=np.concatenate([[0], stop[:-1]]),
        stop=stop,
    )


class _Rebuilt(NamedTuple):
    """Rows that observations are rebuilt in."""

    beliefs: Beliefs  # one
    region_bit: Row[float]
    no_sensor: Row[int]
    observation: Row[float]  # encoded in full precision, then rounded, as it was in flight
    legal: Row[int]
    shares: Shares  # of the layout's adviser
    moves: Moves  # scratch of the same
    memory: Row[int]  # the same; it has none


def observations(
    layout: AnyLayout,
    briefing: Briefing,
    records: Records,
    demand_bit: Floats,
    mission: NDArray[np.int64],
    order: NDArray[np.int64],
    out: NDArray[np.float32],
) -> None:
    """Rebuild the observations of records, as the UAVs encoded them.

    Args:
        demand_bit: of each mission, shape (M, C).
        mission: which mission each record belongs to, shape (N,).
        order: the row of `out` that each record goes to, shape (N,).
        out: written, shape (N, observation_size).
    """
    adviser = layout.adviser
    rebuilt = _Rebuilt(
        beliefs=new_beliefs(briefing, 1),
        region_bit=new_row(VIEW_CELLS, 0.0),
        no_sensor=new_row(1, 0),
        observation=new_row(out.shape[1], 0.0),
        legal=new_row(N_ACTIONS, 0),
        shares=shares_for(adviser, briefing),
        moves=new_moves(briefing),
        memory=new_row(MEMORY_SIZE, 0),
    )
    base = int(layout.base)
    _rebuild(base, adviser, briefing, records, demand_bit, mission, order, rebuilt, out)
    if isinstance(layout, OwnLayout):
        known = arrayed(briefing)
        for row in range(len(records.uav)):
            seen = _rebuilt_situation(known, records, row, demand_bit[mission[row]])
            write_own(layout, known, *seen, out[order[row]])


def _rebuilt_situation(
    briefing: Briefing, records: Records, row: int, demand_bit: Floats
) -> tuple[int, Belief, LocalView, Ints]:
    """What a record's UAV knew, but for the sensors below: it, belief, view, legal actions."""
    uav, cell, n_cells = int(records.uav[row]), int(records.cell[row]), len(demand_bit)
    n_bytes = len(records.seen[row])
    complete = _flags(records.complete[row][uav * n_bytes : (uav + 1) * n_bytes], n_cells)
    seen_bit = np.where(_flags(records.seen[row], n_cells) == 1, demand_bit, 0.0)
    belief: Any = Belief(
        complete=complete,
        n_complete=np.array([int(complete.sum())]),
        seen_bit=seen_bit,
        peer_x_m=records.peer_x_m[row],
        peer_y_m=records.peer_y_m[row],
        peer_s=records.peer_s[row],
    )
    near = [
        actions.neighbour(briefing, cell, index // 3 - 1, index % 3 - 1)
        for index in range(VIEW_CELLS)
    ]
    none: Any = np.zeros(0)
    region_bit: Any = np.array([seen_bit[it] if it >= 0 else math.nan for it in near])
    view = LocalView(
        time_s=float(records.time_s[row]),
        x_m=(cell % briefing.n_columns + 0.5) * briefing.cell_size_m,
        y_m=(cell // briefing.n_columns + 0.5) * briefing.cell_size_m,
        cell=cell,
        energy_left_j=float(records.energy_left_j[row]),
        previous_action=int(records.previous_action[row]),
        region_bit=region_bit,
        n_sensors=0,
        sensor=none,
        sensor_bit=none,
        sensor_gain=none,
        sensor_error_gain=none,
    )
    return uav, belief, view, _flags(records.legal[row : row + 1], N_ACTIONS).astype(np.int64)


def _flags(packed: _Table, n_flags: int) -> NDArray[np.uint8]:
    return np.unpackbits(packed, count=n_flags, bitorder='little')


@kernel
def _rebuild(
    layout: int,
    adviser: int,
    briefing: Briefing,
    records: Records,
    demand_bit: Floats,
    mission: NDArray[np.int64],
    order: NDArray[np.int64],
    rebuilt: _Rebuilt,
    out: NDArray[np.float32],
) -> None:
    belief = belief_of(rebuilt.beliefs, 0)
    n_columns = briefing.n_columns
    for row in range(len(records.uav)):
        # As they are, numbers of a byte would overflow where kernels are interpreted.
        uav = int(records.uav[row])
        _rebuild_belief(briefing, records, row, demand_bit[mission[row]], belief)
        cell = int(records.cell[row])
        for index in range(VIEW_CELLS):
            near = actions.neighbour(briefing, cell, index // 3 - 1, index % 3 - 1)
            rebuilt.region_bit[index] = belief.seen_bit[near] if near >= 0 else math.nan
        view = LocalView(
            records.time_s[row],
            (cell % n_columns + 0.5) * briefing.cell_size_m,
            (cell // n_columns + 0.5) * briefing.cell_size_m,
            cell,
            records.energy_left_j[row],
            int(records.previous_action[row]),
            rebuilt.region_bit,
            0,
            rebuilt.no_sensor,
            rebuilt.region_bit,
            rebuilt.region_bit,
            rebuilt.region_bit,
        )
        for action in range(N_ACTIONS):
            rebuilt.legal[action] = int(records.legal[row] >> action & 1)
        shares, advice = rebuilt.shares, NONE
        if adviser != NONE:
            ways, legal = (shares, rebuilt.moves), rebuilt.legal
            advice = choose(adviser, briefing, *ways, uav, belief, view, legal, rebuilt.memory)
        encode(layout, briefing, shares, uav, belief, view, advice, rebuilt.observation)
        target = out[order[row]]
        for index in range(len(rebuilt.observation)):
            target[index] = rebuilt.observation[index]


@kernel
def _rebuild_belief(
    briefing: Briefing, records: Records, row: int, demand_bit: Row[float], belief: Belief
) -> None:
    n_bytes = len(records.seen[row])
    first = int(records.uav[row]) * n_bytes
    n_complete = 0
    for cell in range(len(belief.complete)):
        byte, place = cell // _BYTE, cell % _BYTE
        known = int(records.complete[row][first + byte] >> place & 1)
        belief.complete[cell] = known
        n_complete += int(known)  # a byte would be full at 255 cells
        has_seen = records.seen[row][byte] >> place & 1
        belief.seen_bit[cell] = demand_bit[cell] if has_seen else 0.0
    belief.n_complete[0] = n_complete
    for other in range(briefing.n_uavs):
        belief.peer_x_m[other] = records.peer_x_m[row][other]
        belief.peer_y_m[other] = records.peer_y_m[row][other]
        belief.peer_s[other] = records.peer_s[row][other]
